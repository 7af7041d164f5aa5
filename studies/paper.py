"""Figures of the source study that ours stand beside.

Source: A. Davydzenka, P. Tahmasebi, J. Fluid Mech. 938 (2022) A20.
"""

from typing import Any

MESHES = {1: "4 cm", 2: "8 cm", 4: "16 cm", 8: "32 cm"}
"""By the factor on the cells of the fine mesh."""

COARSE = {factor: mesh for factor, mesh in MESHES.items() if factor > 1}

RUNOFF = {1: 9.1, 2: 5.9, 4: 6.5, 8: 6.9}
HEIGHT = {1: 0.856, 2: 1.353, 4: 1.151, 8: 0.903}
RUNOFF_CLOSURE = {2: 9.5, 4: 8.5, 8: 9.4}
HEIGHT_CLOSURE = {2: 0.876, 4: 0.94, 8: 0.7}
"""At the end, on each mesh; without and with the learned closure [m]."""

RUN_TIME = {1: 1550.0, 2: 800.0, 4: 635.0, 8: 627.0}
RUN_TIME_CLOSURE = {2: 865.0, 4: 776.0, 8: 695.0}
"""On four cores [s]."""

STORAGE = {1: 3.29, 2: 2.29, 4: 2.05, 8: 1.98}
"""Memory or storage [GB]."""

EVALUATION = {"classical": 4e-7, "learned": 1.75e-5}
"""One drag evaluation per particle [s]."""

TRAINING_TIME, TRAINING_RUN = 1856.0, 2080.0
"""Training, and the run that it is trained on [s]."""

R2: dict[str, dict[Any, float]] = {
    "activation": {
        "relu": 0.8185, "elu": 0.8408, "sigmoid": 0.4113, "tanh": 0.7023, "softsign": 0.7378, "softplus": 0.8332,
        "selu": 0.8096,
    },
    "loss": {"mse": 0.8408, "mae": 0.3809, "msle": 0.1256, "mape": 0.2449, "log_cosh": 0.7937},
    "samples": {
        1_000_000: 0.8689, 500_000: 0.8642, 250_000: 0.8408, 100_000: 0.7881, 50_000: 0.7601, 25_000: 0.5913,
        10_000: 0.2106,
    },
    "hidden": {(170, 70, 30): 0.8408},
}  # fmt: skip
"""On held-out fine inputs, by what differs from the paper's settings; of hidden layers there are the paper's alone."""

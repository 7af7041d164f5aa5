"""Transport of a surface by planes in the cells, and its curvature, against exact shapes and published errors.

    python benchmarks/surface_transport.py [--long-vortex]

With --long-vortex it writes results/surface_vortex.{json,md}: the vortex with T = 8, which makes a thread of the disc.

- Zalesak's disc (S. T. Zalesak, J. Comput. Phys. 31 (1979) 335-362) as M. Rudman, Int. J. Numer. Meth. Fluids 24 (1997)
  671-691 has it: a slotted disc of radius 0.5 about (2, 2.75) in a box of side 4, slot 0.12 wide with a bridge of 0.4,
  200 x 200 cells, one turn about the middle in 2524 steps. Error: sum |c - c_0| / sum c_0.
- A disc of radius 0.15 in a vortex that turns back, psi = sin^2(pi x) sin^2(pi y) cos(pi t / T) / pi with T = 2, as
  W. J. Rider, D. B. Kothe, J. Comput. Phys. 141 (1998) 112-152. Error: sum |c - c_0| h^2.
- 10,000 steps of a rough stream at the limit of the Courant number: volume, and the bounds of the fraction.
- The same without the dilation of the sweeps, cut off at 0 and 1: what it loses.
- Curvature of circles at 20 random places, and of spheres at 3: largest and root mean square error over 1/R and 2/R.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script from anywhere

jax.config.update("jax_enable_x64", True)

from benchmarks import harness  # noqa: E402 - after the setting
from jaxdem.fluid.curvature import curvature  # noqa: E402
from jaxdem.fluid.grid import Grid  # noqa: E402
from jaxdem.fluid.volume_of_fluid import SURFACE_COURANT, Carrier, _Sweep, advance_fraction, surface_courant  # noqa: E402
from tests.cases.fractions import disc, sphere  # noqa: E402

PARTS = 40
"""Points a side of a cell that the slotted disc is sampled by."""


def of_potential(potential: np.ndarray, h: float) -> tuple[jax.Array, jax.Array]:
    """Fluxes of a stream function at the corners of square cells."""
    return jnp.asarray(np.diff(potential, axis=1) / h), jnp.asarray(-np.diff(potential, axis=0) / h)


def corners(n: int, size: float) -> tuple[np.ndarray, np.ndarray]:
    """Places of the corners of n x n cells."""
    edges = np.linspace(0.0, size, n + 1)
    return edges[:, None], edges[None]


def zalesak(n: int = 200, steps: int = 2524) -> dict[str, float]:
    """One turn of the slotted disc."""
    x = (np.arange(n * PARTS) + 0.5) * 4.0 / (n * PARTS) - 2.0
    inside = np.hypot(x[:, None], x[None] - 0.75) < 0.5
    # The slot reaches from the lower rim to 0.4 below the upper one.
    inside &= ~((np.abs(x) < 0.06)[:, None] & (x < 0.75 + 0.1)[None])
    first = inside.reshape(n, PARTS, n, PARTS).mean(axis=(1, 3))
    grid = Grid((n, n), (4.0, 4.0), 1.0, (False, False))
    a, b = corners(n, 4.0)
    flux = of_potential(-0.25 * ((a - 2.0) ** 2 + (b - 2.0) ** 2), 4.0 / n)
    step = 4.0 * np.pi / steps
    march = jax.jit(
        lambda c: lax.fori_loop(0, steps, lambda k, c: advance_fraction(grid, c, Carrier(flux), step, k).fraction, c)
    )
    begin = time.perf_counter()
    last = np.asarray(march(jnp.asarray(first)))
    return {
        "error": float(np.abs(last - first).sum() / first.sum()),
        "volume": float(last.sum() / first.sum() - 1.0),
        "courant": float(surface_courant(grid, flux, step)),
        "seconds": time.perf_counter() - begin,
    }


def vortex(n: int, period: float = 2.0) -> float:
    """Error of the disc that has come back."""
    grid = Grid((n, n), (1.0, 1.0), 1.0, (False, False))
    a, b = corners(n, 1.0)
    flux = of_potential(np.sin(np.pi * a) ** 2 * np.sin(np.pi * b) ** 2 / np.pi, 1.0 / n)
    steps = 2 * int(np.ceil(period / 0.8 * float(surface_courant(grid, flux, 1.0))))
    step = period / steps
    first = jnp.asarray(disc(grid.cells, grid.size, (0.5, 0.75), 0.15))

    def body(k: Any, c: jax.Array) -> jax.Array:
        now = jnp.cos(jnp.pi * (k + 0.5) / steps)
        return advance_fraction(grid, c, Carrier(tuple(now * f for f in flux)), step, k).fraction

    last = jax.jit(lambda c: lax.fori_loop(0, steps, body, c))(first)
    return float(jnp.sum(jnp.abs(last - first))) / n**2


def rough(steps: int = 10_000, dilated: bool = True) -> dict[str, float]:
    """A stream of random corners at the limit of the Courant number."""
    n = 16
    grid = Grid((n, n), (1.0, 1.0), 1.0, (False, False))
    potential = np.random.default_rng(0).normal(size=(n + 1, n + 1))
    potential[[0, -1]] = 0.0
    potential[:, [0, -1]] = 0.0
    flux = of_potential(potential, 1.0 / n)
    step = SURFACE_COURANT / float(surface_courant(grid, flux, 1.0))
    first = jnp.asarray(disc(grid.cells, grid.size, (0.5, 0.5), 0.3))

    def without(k: Any, c: jax.Array) -> jax.Array:
        both = c, jnp.zeros_like(c)
        for axis in range(2):
            both, _ = _Sweep(grid, 1.0, jnp.zeros_like(c), None)(both, flux[axis], step, axis, axis == 1)
        return jnp.clip(both[0], 0.0, 1.0)

    def body(k: Any, carry: tuple[jax.Array, ...]) -> tuple[jax.Array, ...]:
        c, low, high = carry
        c = advance_fraction(grid, c, Carrier(flux), step, k).fraction if dilated else without(k, c)
        return c, jnp.minimum(low, jnp.min(c)), jnp.maximum(high, jnp.max(c))

    last, low, high = jax.jit(lambda c: lax.fori_loop(0, steps, body, (c, jnp.min(c), jnp.max(c))))(first)
    return {"volume": float(jnp.sum(last) / jnp.sum(first)) - 1.0, "lowest": float(low), "above one": float(high) - 1.0}


def bent(n: int, dimension: int) -> tuple[float, float]:
    """Largest and root mean square error of the curvature of circles or spheres of radius 0.3."""
    grid = Grid((n,) * dimension, (1.0,) * dimension, 1.0, (False,) * dimension)
    places = 0.45 + 0.1 * np.random.default_rng(1).random((20 if dimension == 2 else 3, dimension))
    of_cells = jax.jit(lambda c: curvature(grid, c))
    errors = []
    for place in places:
        c = (
            disc(grid.cells, grid.size, place, 0.3)
            if dimension == 2
            else sphere(grid.cells, grid.size, place, 0.3, 120)
        )
        error = np.asarray(of_cells(jnp.asarray(c))) * 0.3 / (dimension - 1) - 1.0
        errors.append(error[(c > 1e-6) & (c < 1.0 - 1e-6)])
    found = np.concatenate(errors)
    return float(np.abs(found).max()), float(np.sqrt(np.mean(found**2)))


LONG = {32: 4.78e-2, 64: 6.96e-3, 128: 1.44e-3}
"""Errors of Rider & Kothe with T = 8, as table 9 of the paper on the scheme THINC/QQ lists them."""


def long_vortex() -> None:
    """The vortex with T = 8, and its table."""
    found = {n: vortex(n, 8.0) for n in LONG}
    lines = ["| cells a side | error, T = 8 | Rider & Kothe (1998) |", "| --- | --- | --- |"]
    lines += [f"| {n} | {error:.3g} | {LONG[n]:.3g} |" for n, error in found.items()]
    harness.write("surface_vortex", {"errors": found}, "\n".join(lines))


def main() -> None:
    """All of them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--long-vortex", action="store_true")
    if parser.parse_args().long_vortex:
        return long_vortex()
    result: dict[str, Any] = {"zalesak": zalesak()}
    result["vortex"] = {str(n): vortex(n) for n in (32, 64, 128)}
    result["rough stream"] = {"10,000 steps": rough(), "100 steps, no dilation, cut off": rough(100, False)}
    result["circle"] = {str(n): bent(n, 2) for n in (16, 32, 64, 128)}
    result["sphere"] = {str(n): bent(n, 3) for n in (12, 24)}
    z, v = result["zalesak"], result["vortex"]
    rows = [
        "| case | result | published |",
        "| --- | --- | --- |",
        f"| Zalesak's disc, one turn, 200 x 200 | {z['error']:.3g}; volume {z['volume']:.1e} | Youngs 1.09e-2, "
        "FCT-VOF 3.29e-2, SLIC 8.38e-2 (Rudman 1997) |",
    ]
    published = {"32": 2.36e-3, "64": 5.85e-4, "128": 1.31e-4}
    for n, before in ((32, None), (64, 32), (128, 64)):
        order = "" if before is None else f", order {np.log2(v[str(before)] / v[str(n)]):.2f}"
        rows.append(
            f"| vortex that turns back, {n} x {n} | {v[str(n)]:.3g}{order} | "
            f"{published[str(n)]:.3g} (Rider & Kothe 1998) |"
        )
    for name, found in result["rough stream"].items():
        rows.append(
            f"| rough stream, {name} | volume {found['volume']:.1e}, lowest {found['lowest']:.1e}, "
            f"above one {found['above one']:.1e} | |"
        )
    for name in ("circle", "sphere"):
        for n, (most, mean) in result[name].items():
            rows.append(
                f"| curvature of a {name}, {0.3 * int(n):g} cells a radius | largest {most:.3g}, rms {mean:.3g} | |"
            )
    harness.write("surface_transport", result, "\n".join(rows) + "\n")


if __name__ == "__main__":
    main()

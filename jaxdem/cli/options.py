"""The arguments and options of the commands, each declared once. Their names and defaults stand in the commands."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

from typer import Argument, Option


class Scale(StrEnum):
    """Size of a study."""

    demo = "demo"
    paper = "paper"


class Color(StrEnum):
    """Quantity that colours the particles."""

    velocity = "velocity"
    drag = "drag"


class ExportFormat(StrEnum):
    """File format of an exported closure."""

    c = "c"
    onnx = "onnx"
    stablehlo = "stablehlo"


class Recipe(StrEnum):
    """How a closure is fitted."""

    paper = "paper"
    filtered = "filtered"
    neighbours = "neighbours"


class Size(StrEnum):
    """How large a closure of neighbours is; names of `jaxdem.train.neighbors.SIZES`."""

    large = "large"
    medium = "medium"
    short = "short"
    small = "small"


class Method(StrEnum):
    """How a closure is trained through the solver."""

    gradient = "gradient"
    gradient_free = "gradient-free"


class Trained(StrEnum):
    """Which closures are trained through the solver."""

    drag = "drag"
    subgrid = "subgrid"
    both = "both"


def file_out(content: str) -> object:
    """`--out FILE` of a command that writes one file."""
    return Option("--out", metavar="FILE", help=content)


def folder_out(content: str) -> object:
    """`--out DIR` of a command that writes a folder."""
    return Option("--out", metavar="DIR", help=content)


# What is read.
SceneFile = Annotated[Path, Argument(metavar="SCENE", help="Scene file (TOML).", show_default=False)]
DeckFile = Annotated[
    Path, Argument(metavar="DECK", help="Script of LIGGGHTS or LAMMPS, or folder of a CFDEM case.", show_default=False)
]
SceneFiles = Annotated[
    list[Path],
    Argument(metavar="SCENE...", help="Scene file (TOML); several are run one after the other.", show_default=False),
]
RunFolder = Annotated[Path, Argument(metavar="RUN", help="Run directory.", show_default=False)]
SampledRun = Annotated[Path, Argument(metavar="RUN", help="Run directory with samples.h5.")]
ReferenceRun = Annotated[Path, Argument(metavar="REFERENCE", help="Run directory of the reference.")]
ComparedRuns = Annotated[list[Path], Argument(metavar="RUN...", help="Run directories that are compared with it.")]
Datasets = Annotated[
    list[Path],
    Argument(
        metavar="DATASET...",
        help="Dataset files written by `jaxdem dataset`; for --recipe neighbours one file of forces on spheres.",
    ),
]
SphereData = Annotated[Path, Argument(metavar="DATA", help="File of forces on spheres (HDF5).", show_default=False)]
Closure = Annotated[Path, Argument(metavar="CLOSURE", help="Closure file.", show_default=False)]
FilteredClosure = Annotated[Path, Argument(metavar="CLOSURE", help="Closure file from `jaxdem train`.")]
StudyName = Annotated[str, Argument(metavar="NAME", help="Name of the study, e.g. injection.")]
ReferenceOption = Annotated[
    Path, Option("--reference", metavar="RUN", help="Run directory of the fine run that is the reference.")
]

# What changes a scene.
ClosureFile = Annotated[
    Path | None,
    Option("--closure", metavar="FILE", help="Learned drag closure, in place of closure.file of the scene."),
]
SubgridFile = Annotated[
    Path | None,
    Option("--subgrid", metavar="FILE", help="Learned subgrid stress, in place of fluid.subgrid of the scene."),
]
Settings = Annotated[
    list[str] | None,
    Option("--set", metavar="KEY=VALUE", help="Change a key of the scene; may be given several times."),
]
Vary = Annotated[
    list[str], Option("--vary", metavar="KEY=A,B,C", help="A key and its values in TOML; may be given several times.")
]

# How a command works.
Quiet = Annotated[
    bool, Option("--quiet", help="Show no progress, neither a bar nor lines in a log, and no warnings of units.")
]
Resume = Annotated[bool, Option("--resume", help="Continue from the checkpoint in --out.")]
DeviceCount = Annotated[
    int | None,
    Option(
        "--devices",
        metavar="N",
        min=1,
        help="Devices of the run, each with a part of the box; without cards so many parts on the processor, to try "
        "it out. [1]",
    ),
]
CheckedDevices = Annotated[
    int | None,
    Option("--devices", metavar="N", min=1, help="Say also what each of N devices has to do and to send. [1]"),
]
ProcessCount = Annotated[
    int | None,
    Option(
        "--processes",
        metavar="N",
        min=1,
        help="Start the run as N processes on this machine, one device each. Not needed under srun and mpirun.",
    ),
]
Profile = Annotated[bool, Option("--profile", help="Measure fluid and particles apart in every interval; slower.")]
Form = Annotated[ExportFormat, Option("--format", help="C header, ONNX, or StableHLO (artifact and text).")]
Colour = Annotated[Color, Option("--color", help="Quantity that colours the particles.")]
PlotOut = Annotated[
    Path | None,
    Option(
        "--out",
        metavar="PATH",
        help="Folder for metrics.png, snapshot.png and probes.png, or one .png, .pdf, .svg. [RUN/plots]",
    ),
]
SnapshotTime = Annotated[
    float | None, Option("--time", metavar="T", help="Time of the snapshot [s]; the last output by default.")
]
Forces = Annotated[
    bool, Option("--forces", help="Draw forces in contacts as lines; of a run with a probe of kind contacts.")
]
FrameRate = Annotated[float, Option("--fps", metavar="N", help="Outputs per second of film.")]
StudyScale = Annotated[
    Scale, Option("--scale", help="demo: a few minutes. paper: that of the source paper; needs the source code.")
]
Parts = Annotated[
    str,
    Option("--parts", metavar="A,B,...", help="Parts to run, for --scale paper, e.g. mesh,budget; all by default."),
]
Jobs = Annotated[
    int | None,
    Option(
        "--jobs",
        metavar="N",
        help="Number of processes at once, for --scale paper; one per core by default. "
        "0 only writes the tables of finished runs.",
    ),
]

# Datasets.
Coarsen = Annotated[
    str,
    Option(
        "--coarsen",
        metavar="N,N,...",
        help="Number of fine cells along a side of a coarse cell; several numbers for several coarse meshes.",
    ),
]
CoarseSettings = Annotated[
    list[str] | None,
    Option(
        "--set",
        metavar="KEY=VALUE",
        help="Setting of the coarse runs where it differs from the fine run: coupling.kernel_width, "
        "coupling.void_fraction or coupling.deconvolution.",
    ),
]

# Networks.
RecipeName = Annotated[
    Recipe,
    Option(
        "--recipe",
        help="paper: method of the source paper. filtered: learns a factor on the base law, from filtered inputs. "
        "neighbours: learns force and torque from the places of the neighbours.",
    ),
]
SizeName = Annotated[
    Size | None, Option("--size", help="How large a closure of neighbours is, for the neighbours recipe. [large]")
]
Seed = Annotated[int | None, Option("--seed", min=0, help="Random seed of weights, shuffling and choice of rows.")]
Epochs = Annotated[int | None, Option("--epochs", min=1, help="Number of passes through the data.")]
FurtherEpochs = Annotated[
    int | None, Option("--epochs", min=1, help="Number of passes through the data to train the smaller network.")
]
Rows = Annotated[int | None, Option("--samples", min=1, help="Largest number of training rows.")]
Hidden = Annotated[
    str | None, Option("--hidden", metavar="N-N-...", help="Widths of the hidden layers, e.g. 170-70-30.")
]
Activation = Annotated[str | None, Option("--activation", help="Activation of the hidden layers, e.g. elu.")]
SameActivation = Annotated[
    str | None,
    Option("--activation", help="Activation of the hidden layers; that of the given closure by default."),
]
LossName = Annotated[
    str | None, Option("--loss", help="Loss function: mse, mae, ...; the filtered recipe has its own.")
]
Terms = Annotated[
    str | None,
    Option(
        "--terms",
        metavar="A,B",
        help="Terms added to the drag, for the filtered recipe: void_fraction_gradient, ...",
    ),
]
Features = Annotated[
    str | None,
    Option("--features", metavar="A,B", help="What the network sees, for the filtered recipe; by default all."),
]
Bounded = Annotated[
    bool, Option("--bounded", help="The factor on the base law is at most one, for the filtered recipe.")
]
Members = Annotated[
    int | None, Option("--ensemble", metavar="N", min=2, help="Train N networks and write them as one closure.")
]
KeptNeurons = Annotated[float, Option("--neurons", help="Fraction of the neurons of each layer that is kept.")]

# Training through the solver.
StartClosure = Annotated[
    Path | None,
    Option("--closure", metavar="FILE", help="Drag closure to start from; that of the scene by default."),
]
StartSubgrid = Annotated[
    str | None, Option("--subgrid", metavar="FILE", help="Learned subgrid stress to start from, or `new`.")
]
TrainedClosures = Annotated[
    Trained | None, Option("--train", help="What is trained; by default all closures that are given.")
]
SubgridOut = Annotated[
    Path | None, Option("--subgrid-out", metavar="FILE", help="File for the subgrid stress, if both are trained.")
]
Horizons = Annotated[
    str | None,
    Option(
        "--horizons",
        metavar="N,N,...",
        help="Length of the training runs in outputs of the reference, one number per stage.",
    ),
]
Updates = Annotated[int, Option("--updates", min=1, help="Number of updates in each stage.")]
LearningRate = Annotated[float, Option("--learning-rate", help="Learning rate of Adam.")]
MethodName = Annotated[Method, Option("--method", help="gradient: Adam. gradient-free: a search on a few parameters.")]
OrderSeed = Annotated[int, Option("--seed", min=0, help="Random seed of the order of the start times.")]

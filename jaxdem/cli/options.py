"""The arguments and options of the commands, each declared once. Their names and defaults stand in the commands."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

from typer import Argument, Option

# Headings of the help, by `rich_help_panel`; an option without stands under Options. See `GroupedHelp`.
CLOSURES, TRAINING, DEVICES = "Closures", "Training", "Several devices"
FILTERED, NEIGHBOURS, NOT_NEIGHBOURS = (
    "Recipe filtered alone", "Recipe neighbours alone", "Recipes filtered and paper alone",
)  # fmt: skip


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


class Loss(StrEnum):
    """What the filtered recipe minimises; see `jaxdem.train.fit.fit_filtered`."""

    mse = "mse"
    balance = "balance"


class Size(StrEnum):
    """How large a closure of neighbours is; names of `jaxdem.train.neighbor_settings.SIZES`."""

    large = "large"
    medium = "medium"
    short = "short"
    small = "small"


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
    Argument(metavar="SCENE", help="Scene file (TOML); several are run one after the other.", show_default=False),
]
RunFolder = Annotated[Path, Argument(metavar="RUN", help="Run directory.", show_default=False)]
SampledRun = Annotated[Path, Argument(metavar="RUN", help="Run directory with samples.h5.")]
ReferenceRun = Annotated[Path, Argument(metavar="REFERENCE", help="Run directory of the reference.")]
ComparedRuns = Annotated[list[Path], Argument(metavar="RUN", help="Run directories that are compared with it.")]
Datasets = Annotated[
    list[Path],
    Argument(
        metavar="DATASET",
        help="Dataset files written by `jaxdem dataset`; for --recipe neighbours one file of forces on spheres.",
    ),
]
SampleData = Annotated[list[Path], Argument(metavar="DATASET", help="Dataset files written by `jaxdem dataset`.")]
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
    Option(
        "--closure",
        metavar="FILE",
        help="Learned drag closure, in place of closure.file of the scene.",
        rich_help_panel=CLOSURES,
    ),
]
SubgridFile = Annotated[
    Path | None,
    Option(
        "--subgrid",
        metavar="FILE",
        help="Learned subgrid stress, in place of fluid.subgrid of the scene.",
        rich_help_panel=CLOSURES,
    ),
]
Settings = Annotated[
    list[str] | None,
    Option("--set", metavar="KEY=VALUE", help="Change a key of the scene; may be given several times."),
]
Vary = Annotated[
    list[str], Option("--vary", metavar="KEY=A,B,C", help="A key and its values in TOML; may be given several times.")
]

# How a command works.
Quiet = Annotated[bool, Option("--quiet", help="Show no progress, neither a bar nor lines in a log.")]
QuietRun = Annotated[
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
        rich_help_panel=DEVICES,
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
        rich_help_panel=DEVICES,
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
    Size | None, Option("--size", help="How large a closure of neighbours is. [large]", rich_help_panel=NEIGHBOURS)
]
Seed = Annotated[
    int | None,
    Option(
        "--seed",
        metavar="N",
        min=0,
        help="Random seed of weights, shuffling and choice of rows.",
        rich_help_panel=TRAINING,
    ),
]
Epochs = Annotated[
    int | None,
    Option("--epochs", metavar="N", min=1, help="Number of passes through the data.", rich_help_panel=TRAINING),
]
FurtherEpochs = Annotated[
    int | None,
    Option("--epochs", metavar="N", min=1, help="Number of passes through the data to train the smaller network."),
]
Rows = Annotated[
    int | None,
    Option("--samples", metavar="N", min=1, help="Largest number of training rows.", rich_help_panel=TRAINING),
]
Hidden = Annotated[
    str | None,
    Option(
        "--hidden",
        metavar="N-N-...",
        help="Widths of the hidden layers, e.g. 170-70-30.",
        rich_help_panel=TRAINING,
    ),
]
Terms = Annotated[
    str | None,
    Option(
        "--terms", metavar="A,B", help="Terms added to the drag: void_fraction_gradient, ...", rich_help_panel=FILTERED
    ),
]
Features = Annotated[
    str | None,
    Option(
        "--features",
        metavar="A,B",
        help="What the network sees; by default all but log_solid_fraction, log_wide_solid_fraction.",
        rich_help_panel=FILTERED,
    ),
]
Bounded = Annotated[
    bool, Option("--bounded", help="The factor on the base law is at most one.", rich_help_panel=FILTERED)
]
LossName = Annotated[
    Loss | None,
    Option(
        "--loss", help="Fit single forces by squares (mse), or mean forces (balance). [mse]", rich_help_panel=FILTERED
    ),
]
Members = Annotated[
    int | None,
    Option(
        "--ensemble",
        metavar="N",
        min=2,
        help="Train N networks and write them as one closure.",
        rich_help_panel=NOT_NEIGHBOURS,
    ),
]
KeptNeurons = Annotated[
    float, Option("--neurons", metavar="R", help="Fraction of the neurons of each layer that is kept.")
]

# Training through the solver.
StartClosure = Annotated[
    Path | None,
    Option(
        "--closure",
        metavar="FILE",
        help="Drag closure to train; without, that of the scene stays as it is.",
        rich_help_panel=CLOSURES,
    ),
]
StartSubgrid = Annotated[
    str | None,
    Option("--subgrid", metavar="FILE", help="Learned subgrid stress to train, or `new`.", rich_help_panel=CLOSURES),
]
SubgridOut = Annotated[
    Path | None,
    Option(
        "--subgrid-out",
        metavar="FILE",
        help="File for the subgrid stress, if both are trained.",
        rich_help_panel=CLOSURES,
    ),
]
Horizons = Annotated[
    str | None,
    Option(
        "--horizons",
        metavar="N,N,...",
        help="Length of the training runs in outputs of the reference, one number per stage.",
        rich_help_panel=TRAINING,
    ),
]
Updates = Annotated[
    int, Option("--updates", metavar="N", min=1, help="Number of updates in each stage.", rich_help_panel=TRAINING)
]
LearningRate = Annotated[
    float, Option("--learning-rate", metavar="R", help="Learning rate of Adam.", rich_help_panel=TRAINING)
]

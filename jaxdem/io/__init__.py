"""Run directory, VTKHDF frames, samples, history, checkpoint. numpy and h5py only; no jax."""

from jaxdem.io.checkpoint import read_checkpoint, write_checkpoint
from jaxdem.io.fluid_file import FluidFormat, fluid_frame
from jaxdem.io.frames import Frame, FrameSeries
from jaxdem.io.history import History, read_history
from jaxdem.io.load import Run, load_run
from jaxdem.io.particle_file import ParticleFormat, particle_frame
from jaxdem.io.run_directory import RunDirectory
from jaxdem.io.samples import SampleFormat, Samples

__all__ = [
    "FluidFormat",
    "Frame",
    "FrameSeries",
    "History",
    "ParticleFormat",
    "Run",
    "RunDirectory",
    "SampleFormat",
    "Samples",
    "fluid_frame",
    "load_run",
    "particle_frame",
    "read_checkpoint",
    "read_history",
    "write_checkpoint",
]

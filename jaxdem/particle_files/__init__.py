"""Particles from files with named columns: text, .npz, LAMMPS and LIGGGHTS, VTK, frames of a run. numpy only."""

from jaxdem.particle_files.columns import Columns, Source
from jaxdem.particle_files.reading import read_columns

__all__ = ["Columns", "Source", "read_columns"]

"""Scenes from the input of other programs: scripts of LIGGGHTS and LAMMPS and CFDEM cases, line by line."""

from jaxdem.foreign.convert import Imported, import_deck, refuse_other_file

__all__ = ["Imported", "import_deck", "refuse_other_file"]

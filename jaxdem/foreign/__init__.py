"""Scenes from the input of other programs: LIGGGHTS scripts, and what it takes of them, line by line."""

from jaxdem.foreign.convert import Imported, import_deck

__all__ = ["Imported", "import_deck"]

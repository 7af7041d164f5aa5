"""The description of a scene: TOML and back, one module a table, checks beside the keys."""

from jaxdem.scene.contact import Contact
from jaxdem.scene.packs import Pack
from jaxdem.scene.particles import Particles
from jaxdem.scene.reading import load_scene, named_files, parse_override
from jaxdem.scene.scene import Scene

__all__ = ["Contact", "Pack", "Particles", "Scene", "load_scene", "named_files", "parse_override"]

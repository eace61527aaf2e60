"""Worlds: scenes of extruded shapes and moving obstacles, generated from a seed or read from a file."""

from worlds.importers.scene_file import load_scene, save_scene
from worlds.motion.movers import MoverField
from worlds.registry import WORLDS, make_world
from worlds.world import World

__all__ = ["WORLDS", "MoverField", "World", "load_scene", "make_world", "save_scene"]

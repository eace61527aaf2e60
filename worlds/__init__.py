"""Worlds: scenes of extruded shapes and moving obstacles, generated from a seed or read from a file.

The names are imported when they are first used: ``vuca --help`` reads ``worlds.importers.commands``, and is quick.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from worlds.importers.scene_file import load_scene, save_scene
    from worlds.motion.movers import MoverField
    from worlds.registry import WORLDS, make_world
    from worlds.world import World

__all__ = ["WORLDS", "MoverField", "World", "load_scene", "make_world", "save_scene"]

_PLACES = {
    "WORLDS": "worlds.registry",
    "MoverField": "worlds.motion.movers",
    "World": "worlds.world",
    "load_scene": "worlds.importers.scene_file",
    "make_world": "worlds.registry",
    "save_scene": "worlds.importers.scene_file",
}


def __getattr__(name: str) -> Any:
    """A name of this package, from the module that has it."""
    if name not in _PLACES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(_PLACES[name]), name)

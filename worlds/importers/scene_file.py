"""Scenes as files: ``scene.yaml``, after the JSON schema beside this module; docs/scene-format.md describes it."""

from pathlib import Path

import yaml

from vuca_nav.data_files import shown
from vuca_nav.errors import BadWorld
from vuca_nav.yaml_file import Limits, is_plain_text, read_yaml
from worlds.checks import BadField, check_world
from worlds.importers.scene_document import document_of, world_from
from worlds.importers.schema import first_fault
from worlds.world import UserMotion, World

SCHEMA_FILE = Path(__file__).with_name("scene.schema.json")
LIMITS = Limits(nodes=1_000_000)
"""Bounds of a scene file: recorded people of an hour are 200,000 keyframes of four values."""


def load_scene(path: str | Path, *, trust: bool = False) -> World:
    """The world that a scene file describes.

    Args:
        path: Path of a YAML file after ``scene.schema.json``.
        trust: Whether motions of the user's own, which are Python code, may be run.

    Raises:
        BadWorld: No such file, broken YAML, a field that is not as the schema wants it, or a world that fails
            :func:`worlds.checks.check_world`; the message gives the file, the field and its line.
    """
    document = read_yaml(path, BadWorld, LIMITS)
    try:
        fault = first_fault(document.value, SCHEMA_FILE)
        if fault is not None:
            raise BadField(str(path), *fault)
        world = world_from(document.value)
        for i, mover in enumerate(world.movers):
            if isinstance(mover.motion, UserMotion) and not trust:
                raise BadField(
                    str(path),
                    f"movers[{i}].motion.class",
                    f"{shown(mover.motion.name)} is Python code of your own; --trust runs it, if you trust it",
                )
        check_world(world, str(path))
    except BadField as error:
        line = document.line_of(error.field)
        raise BadWorld(f"{error} (line {line})" if line else str(error)) from None
    return world


def save_scene(world: World, path: str | Path) -> None:
    """Write a world so that :func:`load_scene` gives an equal one back.

    Args:
        world: Any world.
        path: Path of the file; an existing one is replaced.

    Raises:
        BadWorld: The file cannot be written.
    """
    text = yaml.dump(document_of(world), Dumper=_Dumper, sort_keys=False, default_flow_style=None, width=110)
    try:
        Path(path).write_text(text, encoding="utf-8")
    except OSError as error:
        raise BadWorld(
            f"{path}: cannot be written: {error.strerror}; a path in a writable folder would be right"
        ) from error


# -- writing -------------------------------------------------------------------------------------------------------


class _Dumper(yaml.SafeDumper):
    """Writes for readers of YAML 1.1 and of 1.2: what either takes for something else than a text is in quotes."""


def _text(dumper: _Dumper, text: str) -> yaml.ScalarNode:
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, style=None if is_plain_text(text) else "'")


_Dumper.add_representer(str, _text)

"""Scenes as files: ``scene.yaml``, after the JSON schema beside this module; docs/scene-format.md describes it."""

import json
import math
from collections.abc import Iterator, Mapping
from difflib import get_close_matches
from functools import cache
from itertools import islice
from pathlib import Path
from typing import Any, cast

import jsonschema
import yaml
from jsonschema.exceptions import ValidationError, best_match

from vuca_nav.data_files import shown
from vuca_nav.errors import BadWorld
from vuca_nav.yaml_file import Limits, is_plain_text, read_yaml
from worlds.checks import BadField, check_world
from worlds.importers.scene_document import document_of, world_from
from worlds.world import UserMotion, World

SCHEMA_FILE = Path(__file__).with_name("scene.schema.json")
LIMITS = Limits(nodes=1_000_000)
"""Bounds of a scene file: recorded people of an hour are 200,000 keyframes of four values."""
MOST_ERRORS = 100
"""Number of errors that are looked at: one is told, and a file can be wrong everywhere."""
TYPE_NAMES = {
    "object": "a mapping",
    "array": "a list",
    "number": "a number",
    "integer": "an integer",
    "string": "a text",
    "boolean": "true or false",
}


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
        for field, number in _numbers(document.value):
            if not math.isfinite(number):
                raise BadField(str(path), field, f"{number} is not a finite number")
        error = best_match(islice(_validator().iter_errors(document.value), MOST_ERRORS), key=_relevance)
        if error is not None:
            raise BadField(str(path), _field(error), _problem(error))
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


# -- reading -------------------------------------------------------------------------------------------------------


@cache
def _validator() -> jsonschema.Draft202012Validator:
    schema = json.loads(SCHEMA_FILE.read_text(encoding="utf-8"))
    return jsonschema.Draft202012Validator(_inlined(schema, schema["$defs"]))


def _inlined(schema: Any, definitions: dict[str, Any]) -> Any:
    """The schema with its definitions in place of the references to them, which takes half the time to check by."""
    if isinstance(schema, list):
        return [_inlined(item, definitions) for item in schema]
    if not isinstance(schema, dict):
        return schema
    own = {key: _inlined(value, definitions) for key, value in schema.items() if key not in ("$ref", "$defs")}
    if "$ref" in schema:
        own |= _inlined(definitions[schema["$ref"].removeprefix("#/$defs/")], definitions)
    return own


def _numbers(value: Any, where: str = "") -> Iterator[tuple[str, float]]:
    """All floats of a document, each with its path."""
    if isinstance(value, Mapping):
        for key, item in value.items():
            yield from _numbers(item, f"{where}.{shown(key)}" if where else shown(key))
    elif isinstance(value, list):
        for i, item in enumerate(value):
            yield from _numbers(item, f"{where}[{i}]")
    elif isinstance(value, float):
        yield where, value


def _relevance(error: ValidationError) -> tuple:
    """The first field in the order of the file wins, so that errors are mended from the top; unknown ones first."""
    path = tuple(-part if isinstance(part, int) else 0 for part in error.absolute_path)
    return path, error.validator == "additionalProperties"


def _field(error: ValidationError) -> str:
    """Path of the field that an error is about; empty for the whole file."""
    field = ""
    for part in error.absolute_path:
        field += f"[{part}]" if isinstance(part, int) else f".{shown(part)}" if field else shown(part)
    return field


def _problem(error: ValidationError) -> str:
    """What is wrong with a field, and what would be right."""
    rule, wanted = str(error.validator), error.validator_value
    instance: Any = error.instance
    value, schema = shown(repr(instance)), cast(dict, error.schema)
    if rule == "type":
        return f"{value} is not {TYPE_NAMES.get(str(wanted), wanted)}"
    if rule == "required":
        return f"{', '.join(name for name in schema['required'] if name not in instance)} missing"
    if rule == "additionalProperties":
        known = list(schema["properties"])
        unknown = [name for name in instance if name not in known]
        close = get_close_matches(unknown[0], known, n=1)
        hint = f"; did you mean {close[0]!r}?" if close else ""
        return f"unknown field {', '.join(map(shown, unknown[:5]))}; its fields are {', '.join(known)}{hint}"
    if rule == "enum":
        return f"{value} is not one of {', '.join(schema['enum'])}"
    if rule == "const":
        return f"{value} should be {wanted!r}"
    if rule in ("minItems", "maxItems", "minLength", "maxLength"):
        limit = "at least" if rule.startswith("min") else "at most"
        return f"it has {len(instance)} {'entries' if rule.endswith('Items') else 'characters'}; {limit} {wanted}"
    if rule == "not":
        return f"{value} has a slash or a character that XML or a line cannot hold; letters and digits would be right"
    return error.message


# -- writing -------------------------------------------------------------------------------------------------------


class _Dumper(yaml.SafeDumper):
    """Writes for readers of YAML 1.1 and of 1.2: what either takes for something else than a text is in quotes."""


def _text(dumper: _Dumper, text: str) -> yaml.ScalarNode:
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, style=None if is_plain_text(text) else "'")


_Dumper.add_representer(str, _text)

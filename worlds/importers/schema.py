"""Documents checked by a JSON schema; what is wrong is told in one line that says what would be right."""

import json
import math
from collections.abc import Iterator, Mapping
from difflib import get_close_matches
from functools import cache
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple, cast

import jsonschema
from jsonschema.exceptions import ValidationError, best_match

from vuca_nav.data_files import shown

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


class Fault(NamedTuple):
    """A field that is wrong."""

    field: str
    """Path of the field, as in ``movers[3].motion``; empty for the whole file."""
    problem: str
    """What is wrong, and what would be right."""


def first_fault(document: Any, schema_file: Path) -> Fault | None:
    """Find what is wrong with a document; None if nothing is.

    Args:
        document: Mappings, lists, texts and numbers, as ``vuca_nav.yaml_file`` reads them.
        schema_file: A JSON schema (draft 2020-12) of this project.
    """
    for field, number in _numbers(document):
        if not math.isfinite(number):
            return Fault(field, f"{number} is not a finite number")
    error = best_match(islice(_validator(schema_file).iter_errors(document), MOST_ERRORS), key=_relevance)
    return None if error is None else Fault(_field(error), _problem(error))


@cache
def _validator(schema_file: Path) -> jsonschema.Draft202012Validator:
    schema = json.loads(schema_file.read_text(encoding="utf-8"))
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

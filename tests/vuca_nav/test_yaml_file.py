"""YAML files as data: what scalars mean, what is refused, and that nothing takes long."""

import math
import time

import pytest

from vuca_nav.errors import BadArgument, BadWorld
from vuca_nav.yaml_file import Limits, is_plain_text, read_yaml


def read(tmp_path, text, limits=None):
    path = tmp_path / "data.yaml"
    path.write_text(text, encoding="utf-8")
    return read_yaml(path, BadWorld, limits or Limits())


@pytest.mark.parametrize(
    ("scalar", "value"),
    [
        ("010", 10),
        ("-08", -8),
        ("0o17", 15),
        ("0x1F", 31),
        ("1e1", 10.0),
        ("1e-2", 0.01),
        (".5", 0.5),
        ("1.", 1.0),
        ("-.inf", -math.inf),
        ("true", True),
        ("~", None),
        ("", None),
        ("yes", "yes"),
        ("off", "off"),
        ("2024-13-01", "2024-13-01"),
        ("2024-01-01", "2024-01-01"),
        ("12:30", "12:30"),
        ("1_000", "1_000"),
        ("0b11", "0b11"),
        ("'1'", "1"),
        ('"true"', "true"),
        ("|\n  12", "12"),
    ],
)
def test_scalars_are_those_of_yaml_1_2(tmp_path, scalar, value):
    found = read(tmp_path, f"a: {scalar}").value["a"]
    assert found == value
    assert type(found) is type(value)


def test_keys_are_texts(tmp_path):
    assert read(tmp_path, "on: 1\n1: 2\n~: 3\n").value == {"on": 1, "1": 2, "~": 3}


def test_every_field_has_its_line(tmp_path):
    document = read(tmp_path, "a: 1\nb:\n- c: 2\n- d:\n    e: 3\n")
    lines = [document.line_of(field) for field in ("", "a", "b", "b[0].c", "b[1].d.e", "b[1].d.missing", "x.y")]
    assert lines == [1, 1, 3, 3, 5, 5, 1]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a: !!int abc", r"line 1, column 4: a: a tag \(tag:yaml.org,2002:int\)"),
        ("a: {b: !x {}}", "line 1, column 8: a.b: a tag"),
        ("!!map {a: 1}", "line 1, column 1: a tag"),
        ("a: &x [1, *x]", r"line 1, column 11: a\[1\]: \*x refers to itself"),
        ("a: &x {b: {c: *x}}", r"a.b.c: \*x refers to itself"),
        ("a: *x", r"a: \*x without an anchor before it"),
        ("a: {x: 1}\nb: {<<: {x: 1}}", "line 2, column 5: b: a merge key"),
        ("a: 1\nb: 2\na: 3", "line 3, column 1: not YAML: the key 'a' a second time"),
        ("a: 1\n'a': 3", "the key 'a' a second time"),
        ("? [a]\n: b", "a key that is not a plain text"),
        ("a: 1\n---\nb: 1\n", "line 2, column 1: a second document"),
        ("a: [1, 2", "not YAML: did not find expected"),
        ("a: " + "9" * 5000, "line 1, column 4: a: an integer of 5000 digits; at most 40"),
        ("[" * 5000, "nested too deeply; at most 32 levels"),
        ("- " * 5000, "nested too deeply"),
        ("a: \x01", "not YAML: control characters"),
        ('a: "\\ud800"', "not YAML: found invalid Unicode"),
    ],
)
def test_what_is_refused_is_named_with_its_place(tmp_path, text, message):
    with pytest.raises(BadWorld, match=message) as caught:
        read(tmp_path, text)
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith(str(tmp_path / "data.yaml"))


def bomb(levels: int) -> str:
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 9)}]" for k in range(1, levels)]
    return "\n".join(lines)


def test_an_alias_counts_as_what_it_stands_for(tmp_path):
    document = read(tmp_path, bomb(3))
    assert len(document.value["a2"]) == 9
    began = time.perf_counter()
    with pytest.raises(BadWorld, match="more than 200000 values; fewer would be right"):
        read(tmp_path, bomb(9))
    assert time.perf_counter() - began < 1.0
    with pytest.raises(BadWorld, match="more than 5 aliases"):
        read(tmp_path, "a: &a 1\nb: [*a, *a, *a, *a, *a, *a]", Limits(aliases=5))


def test_many_values_are_refused_before_they_are_all_read(tmp_path):
    with pytest.raises(BadWorld, match=r"\[100\]: more than 101 values"):
        read(tmp_path, "[" + "1," * 1000 + "]", Limits(nodes=101))


def test_the_error_is_of_the_class_that_is_asked_for(tmp_path):
    (tmp_path / "data.yaml").write_text("a: !!int 1")
    with pytest.raises(BadArgument):
        read_yaml(tmp_path / "data.yaml", BadArgument)


@pytest.mark.parametrize("text", ["1", "010", "0o7", "0x1", "1e1", "true", "null", "~", "", ".inf", ".nan", "-.5"])
def test_a_text_that_reads_as_something_else_is_not_plain(text):
    assert not is_plain_text(text)


@pytest.mark.parametrize("text", ["yes", "a", "1_0", "1e", "0b1", ".", "-", "1 2", "\N{ARABIC-INDIC DIGIT ONE}"])
def test_other_texts_are_plain(text):
    assert is_plain_text(text)

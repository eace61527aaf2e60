"""A bundle is loaded as it was exported, or refused in one line."""

import json
import os
import pathlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.fuzz import FAST, SLOW
from tests.vuca_nav.deploy.bundles import ABOUT, CONFIG, body, files, write
from vuca_nav.deploy.bundle import as_yaml, load_bundle
from vuca_nav.deploy.manifest import MANIFEST, NAVIGATOR, POLICY, ROBOT, digest_of, write_bundle
from vuca_nav.deploy.robot_file import robot_file_of
from vuca_nav.errors import BadBundle
from vuca_nav.plain import to_plain
from vuca_nav.shield.shield import Shield
from vuca_nav.types import LidarSpec, Odometry, Pose2, Scan, Twist2


def refusal(directory):
    with pytest.raises(BadBundle) as caught:
        load_bundle(directory)
    message = str(caught.value)
    assert message.isprintable()
    assert len(message) < 1000
    return message


def rewrite(directory, **changes):
    """Change the manifest and sign it again."""
    content = json.loads((directory / MANIFEST).read_text()) | changes
    content["digest"] = digest_of(content)
    (directory / MANIFEST).write_text(json.dumps(content))


def test_a_bundle_has_the_settings_that_were_exported(tmp_path):
    bundle = load_bundle(write(tmp_path / "b"))
    assert to_plain(bundle.robot) == to_plain(robot_file_of(body(), LidarSpec(height=0.25)))
    navigator = bundle.navigator()
    assert isinstance(navigator.policy, Shield)
    assert navigator.policy.config == CONFIG.shield  # not the default
    navigator.reset(Pose2(0.0, 0.0, 0.0), (3.0, 0.0))
    command = navigator.step(Scan(0.0, np.full(360, 5.0)), Odometry(0.0, Pose2(0.0, 0.0, 0.0), Twist2(0.0, 0.0, 0.0)))
    assert np.isfinite(command).all()


def test_a_bundle_drives_with_the_lidar_that_the_robot_has(tmp_path):
    lidar = LidarSpec(num_beams=271, angle_min=-2.0, angle_increment=0.015, mount=Pose2(0.2, 0.0, 0.0))
    navigator = load_bundle(write(tmp_path / "b")).navigator(lidar=lidar)
    navigator.step(Scan(0.0, np.full(271, 5.0)), Odometry(0.0, Pose2(0.0, 0.0, 0.0), Twist2(0.0, 0.0, 0.0)))


def test_a_copy_elsewhere_is_the_same_bundle(tmp_path):
    first = write(tmp_path / "b")
    (tmp_path / "c").mkdir()
    for path in first.iterdir():
        (tmp_path / "c" / path.name).write_bytes(path.read_bytes())
    assert load_bundle(tmp_path / "c").manifest == load_bundle(first).manifest


@pytest.mark.parametrize("name", [NAVIGATOR, ROBOT, POLICY, MANIFEST])
def test_a_missing_file_is_refused(tmp_path, name):
    directory = write(tmp_path / "b")
    (directory / name).unlink()
    assert name in refusal(directory)


def test_a_file_too_many_is_refused(tmp_path):
    directory = write(tmp_path / "b")
    (directory / "notes.txt").write_text("x")
    assert "notes.txt is not listed" in refusal(directory)


def test_the_weights_of_another_bundle_are_refused(tmp_path):
    directory, other = write(tmp_path / "b"), write(tmp_path / "o")
    content = bytearray((other / POLICY).read_bytes())
    content[-2] ^= 1
    (directory / POLICY).write_bytes(content)
    assert f"{POLICY} is not the file of this bundle" in refusal(directory)


def test_the_robot_of_another_bundle_is_refused_even_if_it_was_signed_again(tmp_path):
    directory = tmp_path / "b"
    write_bundle(directory, files("other"), ABOUT)
    assert "is of the robot 'other', the bundle of 'box'" in refusal(directory)


def test_a_newer_format_is_refused_as_such(tmp_path):
    directory = write(tmp_path / "b")
    (directory / "engine.plan").write_text("x")
    content = json.loads((directory / MANIFEST).read_text()) | {"format": 2}
    (directory / MANIFEST).write_text(json.dumps(content))
    message = refusal(directory)
    assert "its format is 2" in message
    assert "a newer vuca-nav reads it" in message


@pytest.mark.parametrize("name", ["../policy.safetensors", "/etc/passwd", "a\\b", ".."])
def test_a_path_that_leads_out_is_refused(tmp_path, name):
    directory = write(tmp_path / "b")
    listed = json.loads((directory / MANIFEST).read_text())["files"]
    rewrite(directory, files={**listed, name: {"bytes": 1, "sha256": "0" * 64}})
    assert "leads out of the folder" in refusal(directory)


def test_weights_outside_of_the_folder_are_refused(tmp_path):
    directory = tmp_path / "b"
    named = as_yaml(CONFIG, "a test").replace(b"weights: policy", b"weights: ../policy")
    write_bundle(directory, {**files(), NAVIGATOR: named}, ABOUT)
    assert "weights of '../policy.safetensors', expected the bundle's own" in refusal(directory)


def test_links_and_folders_and_pipes_are_refused(tmp_path):
    directory = write(tmp_path / "b")
    (tmp_path / "elsewhere").write_bytes((directory / POLICY).read_bytes())
    (directory / POLICY).unlink()
    (directory / POLICY).symlink_to(tmp_path / "elsewhere")
    assert "is a symbolic link" in refusal(directory)
    (directory / POLICY).unlink()
    (directory / POLICY).mkdir()
    assert "is no regular file" in refusal(directory)
    (directory / POLICY).rmdir()
    os.mkfifo(directory / POLICY)
    assert "is no regular file" in refusal(directory)


def test_a_huge_file_is_refused_unread(tmp_path):
    directory = write(tmp_path / "b")
    with (directory / ROBOT).open("r+b") as file:
        file.truncate(2**40)
    assert "larger than 1 MiB" in refusal(directory)


@pytest.mark.parametrize("line", [b"window: !!python/name:os.system x\n", b"&a [*a]\n", b"- " * 100, b"\xff"])
def test_tricks_of_yaml_are_refused(tmp_path, line):
    directory = tmp_path / "b"
    write_bundle(directory, {**files(), NAVIGATOR: line}, ABOUT)
    assert NAVIGATOR in refusal(directory)


@pytest.mark.parametrize("text", ["[" * 100_000, '{"kind": 1, "kind": 2}', '{"format": NaN}', "null", '{"format": 1}'])
def test_tricks_of_json_are_refused(tmp_path, text):
    directory = write(tmp_path / "b")
    (directory / MANIFEST).write_text(text)
    assert MANIFEST in refusal(directory)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (b"max_v_x: 1.0", b"max_v_x: -1.0", "max_v_x must be above 0"),
        (b"max_v_x: 1.0", b"max_v_x: .inf", "max_v_x must be above 0"),
        (b"[0.3, 0.2]", b"[-0.3, -9.2]", "convex"),
        (b"scan: scan", b"scan: 'sc an'", "scan must be a name"),
        (b"num_beams: 360", b"num_beams: 10000000000", "num_beams must be"),
    ],
)
def test_a_robot_that_cannot_be_is_refused(tmp_path, old, new, message):
    directory = tmp_path / "b"
    robot = files()[ROBOT]
    assert old in robot
    write_bundle(directory, {**files(), ROBOT: robot.replace(old, new)}, ABOUT)
    assert message in refusal(directory)


def check_byte(directory, name, at, value):
    """One byte of one file changed: the bundle is refused, or it is the same bundle."""
    whole, path = load_bundle(directory), directory / name
    content = path.read_bytes()
    path.write_bytes(content[: at % len(content)] + bytes([value]) + content[at % len(content) + 1 :])
    try:
        changed = load_bundle(directory)
    except BadBundle:
        return
    finally:
        path.write_bytes(content)
    assert changed.manifest == whole.manifest
    assert to_plain(changed.robot) == to_plain(whole.robot)
    assert changed.config == whole.config


places = {
    "name": st.sampled_from([MANIFEST, MANIFEST, *files()]),
    "at": st.integers(0, 100_000),
    "value": st.one_of(st.integers(0, 255), st.sampled_from(b' "0[{')),
}


@FAST
@given(**places)
def test_a_changed_byte_is_noticed(tmp_path_factory, name, at, value):
    check_byte(shared(tmp_path_factory), name, at, value)


@pytest.mark.slow
@SLOW
@given(**places)
def test_any_changed_byte_is_noticed(tmp_path_factory, name, at, value):
    check_byte(shared(tmp_path_factory), name, at, value)


def shared(factory):
    directory = factory.getbasetemp() / "shared-bundle"
    return directory if directory.exists() else write(directory)


class TestWriting:
    def test_it_replaces_a_bundle_and_an_empty_folder(self, tmp_path):
        (tmp_path / "b").mkdir()
        write(tmp_path / "b")
        write(tmp_path / "b", method="other")
        assert load_bundle(tmp_path / "b").manifest.method == "other"
        assert [path.name for path in tmp_path.iterdir()] == ["b"]

    def test_it_leaves_other_folders_alone(self, tmp_path):
        (tmp_path / "thesis.tex").write_text("x")
        with pytest.raises(BadBundle, match=r"holds thesis\.tex, which is not of a bundle"):
            write(tmp_path)
        assert (tmp_path / "thesis.tex").read_text() == "x"

    def test_a_full_disk_leaves_the_old_bundle(self, tmp_path, small_files):
        directory = write(tmp_path / "b")
        with small_files(2000), pytest.raises(BadBundle, match="cannot be written"):
            write(directory, method="other")
        assert load_bundle(directory).manifest.method == "net"
        assert [path.name for path in tmp_path.iterdir()] == ["b"]


def test_an_interrupt_while_a_bundle_is_replaced_keeps_the_old_one(tmp_path, monkeypatch):
    out = write(tmp_path / "bundle")
    rename = pathlib.Path.rename

    def interrupted(self, target):
        if self.name.endswith(".new"):
            raise KeyboardInterrupt
        return rename(self, target)

    monkeypatch.setattr(pathlib.Path, "rename", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write(out, command="another")
    assert load_bundle(out).manifest.content.get("command") != "another"
    assert [path.name for path in tmp_path.iterdir()] == ["bundle"]

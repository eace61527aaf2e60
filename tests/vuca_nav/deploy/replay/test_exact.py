"""A log replays to the bit with the bundle that drove; what does not fit, or is damaged, is told in one line."""

import json
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.fuzz import FAST, SLOW
from tests.vuca_nav.deploy.bundles import write
from tests.vuca_nav.deploy.missions import drive, write_log
from vuca_nav.deploy.bundle import load_bundle
from vuca_nav.deploy.log import MissionLog
from vuca_nav.deploy.log_writer import LogWriter
from vuca_nav.deploy.replay.command import replay
from vuca_nav.deploy.replay.exact import replay_log
from vuca_nav.deploy.replay.log_file import MAGIC, MOST_RECORD, LogFile
from vuca_nav.errors import BadLog
from vuca_nav.types import STANDING, LidarSpec, Odometry, Pose2, Scan, Twist2, VelocityCommand

TICKS = 60


@pytest.fixture(scope="module")
def bundle(tmp_path_factory):
    return load_bundle(write(tmp_path_factory.mktemp("bundle") / "b"))


@pytest.fixture(scope="module")
def log(bundle, tmp_path_factory):
    path = tmp_path_factory.mktemp("log") / "log.mcap"
    write_log(bundle, path, TICKS)
    return path


def test_the_commands_are_the_same_to_the_bit(bundle, log, capsys):
    assert replay([str(bundle.directory), str(log), "--json"]) == 0
    result = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert (result["ticks"], result["equal"], result["first"], result["missions"]) == (TICKS, TICKS, None, 1)


def test_the_lidar_that_drove_drives_again(bundle, tmp_path):
    lidar = LidarSpec(num_beams=271, angle_min=-2.0, angle_increment=0.015, mount=Pose2(0.2, 0.0, 0.0))
    write_log(bundle, tmp_path / "log.mcap", 20, lidar)
    assert replay_log(bundle, LogFile(tmp_path / "log.mcap")).equal == 20


def test_a_command_that_differs_is_told_with_exit_code_1(bundle, log, tmp_path, capsys):
    path = tmp_path / "log.mcap"
    with MissionLog(path, bundle.manifest) as other:
        other.began(STANDING, (1.0, 0.0), LidarSpec(), 0)
        copied = next(message for message in LogFile(log).messages() if message.topic == "/scan")
        number = other.received(copied.topic, copied.type_name, copied.data, 1)
        odometry = Odometry(0.0, STANDING, Twist2(0.0, 0.0, 0.0))
        other.ticked(Scan(0.0, None), number, odometry, VelocityCommand(9.0, 0.0, 0.0), 2_000_000_000)  # type: ignore[arg-type]
    assert replay([str(bundle.directory), str(path), "--json"]) == 1
    first = json.loads(capsys.readouterr().out.splitlines()[-1])["first"]
    assert (first["tick"], first["log_time"], first["logged"]) == (0, 2_000_000_000, [9.0, 0.0, 0.0])


def test_a_recording_is_made(bundle, log, tmp_path):
    assert replay([str(bundle.directory), str(log), "--record", str(tmp_path / "r.rrd")]) == 0
    assert (tmp_path / "r.rrd").stat().st_size > 1000


def test_a_log_of_another_bundle_is_refused(log, tmp_path):
    other = write(tmp_path / "other", method="another")
    with pytest.raises(BadLog, match="the log is of another bundle, of box and net"):
        replay([str(other), str(log)])


def test_a_log_that_was_cut_off_gives_what_it_holds(bundle, log, tmp_path):
    content = log.read_bytes()
    (tmp_path / "cut.mcap").write_bytes(content[: len(content) - 20_000])
    result = replay_log(bundle, LogFile(tmp_path / "cut.mcap"))
    assert 0 < result.ticks == result.equal < TICKS
    assert result.damage is not None


@pytest.mark.parametrize("topic", ["/vuca/tick", "/scan"])
def test_after_something_that_the_disk_was_too_slow_for_nothing_is_compared(bundle, tmp_path, monkeypatch, topic):
    add = LogWriter.add

    def lose(writer, entry, *, always=False):
        if (entry.topic, entry.number) != (topic, 20):
            add(writer, entry, always=always)

    monkeypatch.setattr(LogWriter, "add", lose)
    with MissionLog(tmp_path / "log.mcap", bundle.manifest) as log:
        drive(bundle, log, TICKS)
        drive(bundle, log, TICKS)
    result = replay_log(bundle, LogFile(tmp_path / "log.mcap"))
    missed = TICKS - 21 if topic == "/vuca/tick" else TICKS - 20
    assert (result.ticks, result.equal, result.left_out) == (20 + TICKS, 20 + TICKS, missed)


@pytest.mark.parametrize("content", [b"", b"x", b"#ROSBAG V2.0\n", b"PK\x03\x04" + bytes(1000)])
def test_what_is_no_mcap_is_refused(bundle, tmp_path, content):
    (tmp_path / "log.mcap").write_bytes(content)
    with pytest.raises(BadLog, match="is no MCAP file"):
        replay([str(bundle.directory), str(tmp_path / "log.mcap")])


def test_a_pipe_and_a_folder_are_refused(bundle, tmp_path):
    import os

    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", tmp_path, tmp_path / "missing"):
        with pytest.raises(BadLog):
            replay([str(bundle.directory), str(path)])


@pytest.mark.parametrize(
    "record",
    [
        struct.pack("<BQ", 6, 2**62),
        struct.pack("<BQ", 6, MOST_RECORD + 1) + bytes(100),
        struct.pack("<BQ", 6, 60) + struct.pack("<QQQII", 0, 0, 2**50, 0, 4) + b"zstd" + bytes(24),
        struct.pack("<BQ", 3, 8) + struct.pack("<HI", 1, 2**32 - 1) + bytes(2),
        struct.pack("<BQ", 5, 3) + bytes(3),
    ],
)
def test_absurd_sizes_are_damage(tmp_path, record):
    (tmp_path / "log.mcap").write_bytes(MAGIC + record)
    log = LogFile(tmp_path / "log.mcap")
    assert list(log.messages()) == []
    assert log.damage is not None
    assert log.damage.isprintable()


def check_damage(bundle, log, directory, at, value):
    content = bytearray(log.read_bytes())
    content[at % len(content)] = value
    path = directory / "damaged.mcap"
    path.write_bytes(bytes(content))
    try:
        result = replay_log(bundle, LogFile(path))
    except BadLog as error:
        assert str(error).isprintable()  # noqa: PT017
        return
    assert result.ticks <= TICKS


@FAST
@given(at=st.integers(0, 50_000), value=st.integers(0, 255))
def test_a_damaged_log_is_read_as_far_as_it_goes(bundle, log, tmp_path_factory, at, value):
    check_damage(bundle, log, tmp_path_factory.getbasetemp(), at, value)


@pytest.mark.slow
@SLOW
@given(at=st.integers(0, 500_000), value=st.integers(0, 255))
def test_any_damaged_log_is_read_as_far_as_it_goes(bundle, log, tmp_path_factory, at, value):
    check_damage(bundle, log, tmp_path_factory.getbasetemp(), at, value)

"""The log of a mission: others read it, a kill leaves what was written, a full disk does not stop the robot."""

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import Writer
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from tests.vuca_nav.deploy.bundles import write
from tests.vuca_nav.deploy.missions import COMMAND, SCAN, scan_message, write_log
from vuca_nav.deploy.bundle import load_bundle
from vuca_nav.deploy.log import MissionLog
from vuca_nav.deploy.replay.log_file import LogFile
from vuca_nav.deploy.transport.ros_types import encode, new
from vuca_nav.errors import BadArgument
from vuca_nav.types import LidarSpec

ROOT = Path(__file__).parents[3]
RANGES = np.array([1.0, np.inf, 0.25], np.float32)
LIDAR = LidarSpec(num_beams=3)


@pytest.fixture(scope="module")
def bundle(tmp_path_factory):
    return load_bundle(write(tmp_path_factory.mktemp("bundle") / "b"))


def scan_bytes(stamp=5):
    return encode(scan_message(RANGES, stamp, LIDAR), SCAN)


def test_the_readers_of_mcap_and_of_rosbags_read_it(bundle, tmp_path):
    commands = write_log(bundle, tmp_path / "log.mcap", ticks=40)
    with (tmp_path / "log.mcap").open("rb") as file:
        reader = make_reader(file)
        assert reader.get_header().profile == "ros2"
        summary = reader.get_summary()
        assert summary is not None
        assert {schema.encoding for schema in summary.schemas.values()} == {"ros2msg"}
        assert [metadata.name for metadata in reader.iter_metadata()] == ["vuca"]
        assert len(list(reader.iter_messages(["/scan"]))) == 40
    with AnyReader([tmp_path / "log.mcap"], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
        assert {connection.topic: connection.msgtype for connection in reader.connections}["/cmd_vel"] == COMMAND
        sent: list[Any] = [
            reader.deserialize(raw, COMMAND) for link, _, raw in reader.messages() if link.topic == "/cmd_vel"
        ]
    assert [(each.linear.x, each.angular.z) for each in sent] == [(each.v_x, each.w_z) for each in commands]


def test_messages_come_back_as_they_were_with_their_times_and_numbers(bundle, tmp_path):
    with MissionLog(tmp_path / "log.mcap", bundle.manifest) as log:
        assert log.received("/scan", SCAN, scan_bytes(), 7) == 0
        assert log.received("/scan", SCAN, scan_bytes(6), 8) == 1
        assert log.received("/other", SCAN, scan_bytes(), 9) == 0
    first, second, third = LogFile(tmp_path / "log.mcap").messages()
    assert first == ("/scan", SCAN, 0, 7, scan_bytes())
    assert (second.number, second.log_time) == (1, 8)
    assert (third.topic, third.number) == ("/other", 0)


def test_a_log_is_never_written_over(bundle, tmp_path):
    (tmp_path / "log.mcap").write_text("dear")
    with pytest.raises(BadArgument, match="is never written over"):
        MissionLog(tmp_path / "log.mcap", bundle.manifest)
    assert (tmp_path / "log.mcap").read_text() == "dear"


def test_a_full_disk_is_told_and_does_not_raise(bundle, tmp_path, small_files):
    log = MissionLog(tmp_path / "log.mcap", bundle.manifest)
    noise = np.random.default_rng(0).uniform(0.1, 9.0, 5000)
    data = encode(scan_message(noise, 5, LIDAR), SCAN)
    with small_files(60_000):
        for k in range(100):
            log.received("/scan", SCAN, data, k)
        log.close()
    assert log.failure is not None
    assert "File too large" in log.failure
    assert LogFile(tmp_path / "log.mcap").metadata == {}  # not read yet; it can be


@pytest.fixture
def disk(monkeypatch):
    """A disk that takes nothing while it is cleared, and is set in the end."""
    ready, add_message = threading.Event(), Writer.add_message

    def wait_and_add(*arguments):
        ready.wait(60.0)
        add_message(*arguments)

    ready.set()
    monkeypatch.setattr(Writer, "add_message", wait_and_add)
    yield ready
    ready.set()


def test_a_disk_that_stands_still_holds_nobody_up_and_what_it_misses_is_counted(bundle, tmp_path, disk):
    log, data = MissionLog(tmp_path / "log.mcap", bundle.manifest), scan_bytes() + bytes(1 << 20)
    log.received("/scan", SCAN, data, 0)
    disk.clear()
    began = time.monotonic()
    for k in range(1, 40):
        log.received("/scan", SCAN, data, k)
    assert time.monotonic() - began < 5.0
    assert log.failure is not None
    assert "too slow for the log: 2" in log.failure
    disk.set()
    assert log.flush(60.0)
    log.received("/scan", SCAN, data, 40)
    log.close()
    numbers = [message.number for message in LogFile(tmp_path / "log.mcap").messages()]
    assert numbers == [*range(len(numbers) - 1), 40]
    assert 10 < len(numbers) < 20


def test_a_disk_that_stands_still_does_not_keep_the_program_from_ending(bundle, tmp_path, disk, monkeypatch):
    monkeypatch.setattr("vuca_nav.deploy.log.PATIENCE", 0.2)
    log = MissionLog(tmp_path / "log.mcap", bundle.manifest)
    disk.clear()
    log.received("/scan", SCAN, scan_bytes(), 0)
    log.close()
    assert log.failure == "the disk has not taken the end of the log in 0.2 s"


def test_requests_to_end_do_not_cut_the_end_of_a_log(bundle, tmp_path, disk):
    log = MissionLog(tmp_path / "log.mcap", bundle.manifest)
    disk.clear()
    for k in range(5):
        log.received("/scan", SCAN, scan_bytes(), k)

    def ask():
        time.sleep(0.3)
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(0.1)
        disk.set()

    asking = threading.Thread(target=ask)
    asking.start()
    log.close()
    asking.join()
    read = LogFile(tmp_path / "log.mcap")
    assert len(list(read.messages())) == 5
    assert read.damage is None


KILLED = """
import os, signal, sys
from pathlib import Path
from tests.vuca_nav.deploy.missions import write_log, drive
from vuca_nav.deploy.bundle import load_bundle
from vuca_nav.deploy.log import MissionLog
bundle = load_bundle(Path(sys.argv[1]))
drive(bundle, MissionLog(Path(sys.argv[2]), bundle.manifest), 200)
os.kill(os.getpid(), signal.SIGKILL)
"""


def test_a_kill_leaves_all_but_the_last_chunk(bundle, tmp_path):
    path = tmp_path / "log.mcap"
    command = [sys.executable, "-c", KILLED, str(bundle.directory), str(path)]
    killed = subprocess.run(command, cwd=ROOT, env={**os.environ, "PYTHONPATH": str(ROOT)}, timeout=300)
    assert killed.returncode == -signal.SIGKILL
    log = LogFile(path)
    ticks = [message for message in log.messages() if message.topic == "/vuca/tick"]
    assert len(ticks) > 100
    assert [tick.number for tick in ticks] == list(range(len(ticks)))
    assert log.damage is not None
    assert "its writer was killed" in log.damage


def test_memory_stays_bounded(bundle, tmp_path):
    """Nothing but the index of chunks grows: some hundred bytes for 128 kB."""
    import tracemalloc

    log = MissionLog(tmp_path / "log.mcap", bundle.manifest)
    data = encode(new("std_msgs/msg/String", data="x" * 1000), "std_msgs/msg/String")

    def grown(messages):
        before = tracemalloc.get_traced_memory()[0]
        for k in range(messages):
            log.received("/text", "std_msgs/msg/String", data, k)
            assert k % 1000 or log.flush(60.0)
        assert log.flush(60.0)
        return tracemalloc.get_traced_memory()[0] - before

    tracemalloc.start()
    grown(1000)
    later = grown(20_000)
    tracemalloc.stop()
    log.close()
    assert later < 300_000


def test_a_log_that_ends_before_its_first_message_is_not_in_the_way_of_the_next(bundle, tmp_path):
    MissionLog(tmp_path / "log.mcap", bundle.manifest).close()
    with MissionLog(tmp_path / "log.mcap", bundle.manifest) as log:
        log.received("/scan", SCAN, scan_bytes(), 7)
    assert [message.number for message in LogFile(tmp_path / "log.mcap").messages()] == [0]

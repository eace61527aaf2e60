import json
import math
from collections import Counter

import numpy as np
import pytest
import yaml
from PIL import Image
from rerun.chunk import RrdReader

from tests.vuca_nav.rooms import moved, ranges_to_boxes, room
from tests.vuca_nav.slam_log.carmen_lines import robot_laser
from vuca_nav.errors import BadArgument, BadLog, VucaError
from vuca_nav.geometry import between, compose
from vuca_nav.slam_log.command import slam
from vuca_nav.types import STANDING, LidarSpec, Pose2

LIDAR = LidarSpec(num_beams=181, max_range=30.0, angle_min=-math.pi / 2, angle_increment=math.pi / 180)
RING = np.vstack([room(16.0, 12.0), [[3.0, 3.0, 6.5, 9.0], [6.5, 3.0, 13.0, 4.0], [9.0, 6.0, 13.0, 9.0]]])


def drive(laps: int):
    """A robot goes round a building of corridors at 0.1 m a scan; odometry turns 5% too far and goes 3% too far."""
    rng = np.random.default_rng(1)
    truth, odometry = Pose2(1.5, 1.5, 0.0), STANDING
    legs = [(130, 0.1, 0.0), (20, 0.0, math.pi / 40), (90, 0.1, 0.0), (20, 0.0, math.pi / 40)] * 2 * laps
    for count, forward, turn in legs:
        for _ in range(count):
            ranges = ranges_to_boxes(RING, truth, LIDAR)
            yield truth, odometry, np.where(np.isfinite(ranges), ranges + rng.normal(0.0, 0.01, 181), 40.0)
            truth = moved(truth, forward, turn)
            odometry = compose(odometry, Pose2(1.03 * forward, 0.0, 1.05 * turn))


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """The log, its true relations, and the true poses in the frame of odometry's first one."""
    folder = tmp_path_factory.mktemp("log")
    lines, truths = [], []
    for k, (truth, odometry, ranges) in enumerate(drive(laps=2)):
        line = robot_laser(0.2 * k, ranges, odometry, fov=math.pi, start=-math.pi / 2)
        lines.append(line.replace(f"{math.pi / 181:.8f}", f"{math.pi / 180:.8f}"))
        truths.append(truth)
    relations = []
    for k in range(0, len(truths) - 400, 25):
        for later in (k + 10, k + 400):
            to = between(truths[k], truths[later])
            relations.append(f"{0.2 * k:.3f} {0.2 * later:.3f} {to.x:.6f} {to.y:.6f} 0 0 0 {to.yaw:.6f}\n")
    (folder / "ring.clf").write_text("".join(lines))
    (folder / "ring.relations").write_text("".join(relations))
    return folder, np.array([between(truths[0], truth) for truth in truths])


def test_a_log_becomes_a_map_a_trajectory_and_errors(recorded, tmp_path, capsys):
    folder, truths = recorded
    arguments = [str(folder / "ring.clf"), "--relations", str(folder / "ring.relations"), "--out", str(tmp_path)]
    assert slam([*arguments, "--json"]) == 0
    out, err = capsys.readouterr()
    facts = json.loads(out.splitlines()[-1])
    assert "scans" in err
    assert facts["scans"] == len(truths)
    assert facts["ms_per_scan"]["median"] <= facts["ms_per_scan"]["p999"]
    assert facts["times_real_time"] > 1.0
    for name in ("final", "online"):
        assert set(facts[name]) == {"n", "m_mean", "m_sd", "deg_mean", "deg_sd"}
        assert facts[name]["m_mean"] < 0.03
        assert facts[name]["deg_mean"] < 0.3
    trajectory = np.loadtxt(tmp_path / "trajectory.tum")
    assert trajectory.shape == (len(truths), 8)
    assert trajectory[:, 0] == pytest.approx(0.2 * np.arange(len(truths)))
    assert np.hypot(*(trajectory[:, 1:3] - truths[:, :2]).T).max() < 0.1
    np.testing.assert_allclose(np.hypot(trajectory[:, 6], trajectory[:, 7]), 1.0, atol=1e-6)
    description = yaml.safe_load((tmp_path / "map.yaml").read_text())
    image = np.asarray(Image.open(tmp_path / description["image"]))
    np.testing.assert_array_equal(image, np.asarray(Image.open(tmp_path / "map.png")))

    def grey(x: float, y: float) -> int:
        """In the frame of odometry, which begins at (1.5, 1.5) of the building."""
        column, row = ((v - o) / description["resolution"] for v, o in zip((x, y), description["origin"]))
        return int(image[len(image) - 1 - int(row), int(column)])

    assert grey(5.0, 0.0) == 254
    assert grey(3.0, 4.0) == 205  # inside of a block
    assert min(grey(3.0, y) for y in (1.4, 1.45, 1.5, 1.55)) == 0


def test_the_same_log_gives_the_same_bits(recorded, tmp_path):
    folder, _ = recorded
    for name in ("a", "b"):
        slam([str(folder / "ring.clf"), "--out", str(tmp_path / name)])
    assert (tmp_path / "a" / "trajectory.tum").read_bytes() == (tmp_path / "b" / "trajectory.tum").read_bytes()


def test_a_run_is_recorded_and_the_recording_changes_nothing(recorded, tmp_path, capsys):
    folder, truths = recorded
    slam([str(folder / "ring.clf"), "--out", str(tmp_path / "a")])
    told = ["--record", str(tmp_path / "ring.rrd"), "--save-map", str(tmp_path / "map.yaml"), "--json"]
    assert slam([str(folder / "ring.clf"), "--out", str(tmp_path / "b"), *told]) == 0
    facts = json.loads(capsys.readouterr().out.splitlines()[-1])
    for name in ("trajectory.tum", "online.tum", "map.pgm"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()
    assert (tmp_path / "map.pgm").read_bytes() == (tmp_path / "a" / "map.pgm").read_bytes()
    rows = Counter[str]()
    lines = []
    reader = RrdReader(tmp_path / "ring.rrd")
    for chunk in reader.stream(store=reader.recordings()[0]):
        if not chunk.is_static:
            batch = chunk.to_record_batch()
            rows[chunk.entity_path] += batch.num_rows
            if chunk.entity_path == "/map/closures":
                strips = batch.column("LineStrips3D:strips").to_pylist()
                lines += zip(batch.column("time").cast("int64").to_pylist(), strips)
    assert rows["/plots/scan_time"] == rows["/map/scan"] == len(truths)
    for path in ("/map/grid", "/map/estimate", "/map/odometry", "/map/trail/estimate", "/events"):
        assert rows[path] > 10, path
    last = max(lines)[1]
    assert 0 < len(last) <= facts["closures"]
    assert all(len(strip) == 2 for strip in last)


def test_options_that_cannot_be_met_are_refused_before_the_log_is_read(tmp_path):
    log = str(tmp_path / "none.clf")
    with pytest.raises(BadArgument, match="exclude each other"):
        slam([log, "--record", str(tmp_path / "a.rrd"), "--serve"])
    (tmp_path / "file").write_text("")
    with pytest.raises(BadArgument, match=r"--save-map .* ends in \.yaml"):
        slam([log, "--save-map", str(tmp_path / "file")])


def test_a_recording_that_cannot_be_written_is_refused(recorded, tmp_path):
    with pytest.raises(BadArgument, match=r"cannot record to .*: there is no directory"):
        slam([str(recorded[0] / "ring.clf"), "--record", str(tmp_path / "none" / "a.rrd")])


def test_bad_logs_are_refused(tmp_path):
    bad = tmp_path / "bad.clf"
    bad.write_text("nothing\n")
    with pytest.raises(BadLog):
        slam([str(bad)])
    with pytest.raises(BadLog, match="another format"):
        slam([str(tmp_path / "a.bag")])


def broken_lines(lines: list[str]) -> list[str]:
    """A log of which parts are broken: at each tenth scan another way."""
    rng = np.random.default_rng(2)
    broken = list(lines)
    for k in range(10, len(lines), 10):
        words = lines[k].split()
        kind = (k // 10) % 6
        first, last = 9, 9 + 181  # the ranges
        if kind == 0:  # a third of the ranges are no numbers, or infinite
            for i in rng.choice(np.arange(first, last), 60, replace=False):
                words[i] = str(rng.choice(["nan", "inf", "-inf", "-1.0", "0.0"]))
        elif kind == 1:  # all are
            words[first:last] = ["nan"] * 181
        elif kind == 2:
            words = words[: len(words) // 2]
        elif kind == 3:  # its time is that of ten scans ago
            words[-3] = lines[k - 10].split()[-3]
        elif kind == 4:
            words[8], words[first:last] = "91", words[first:last:2]
        else:
            words[last + 4] = "nan"  # x of the robot
        broken[k] = " ".join(words) + "\n"
    return broken


def test_a_log_with_broken_scans_gives_the_map_of_the_whole_one_and_counts_them(recorded, tmp_path, capsys):
    folder, _ = recorded
    lines = (folder / "ring.clf").read_text().splitlines(keepends=True)[:1040]
    kinds = Counter((k // 10) % 6 for k in range(10, len(lines), 10))
    (tmp_path / "broken.clf").write_text("".join(broken_lines(lines)))
    relations = ["--relations", str(folder / "ring.relations")]
    assert slam([str(tmp_path / "broken.clf"), *relations, "--json"]) == 0
    out = capsys.readouterr().out
    facts = json.loads(out.splitlines()[-1])
    assert facts["skipped"] == {
        "more than half of the ranges NaN": kinds[1],
        "incomplete": kinds[2],
        "time runs backwards": kinds[3],
        "another size": kinds[4],
        "no finite pose or time": kinds[5],
    }
    assert facts["scans"] == len(lines) - sum(facts["skipped"].values())
    assert f"skipped          {kinds[2]} scans: incomplete" in out
    for name in ("final", "online"):
        assert facts[name]["m_mean"] < 0.04
        assert facts[name]["deg_mean"] < 0.5  # where a turn begins at a scan that is missing, poses are interpolated


def test_a_log_that_ends_within_a_line_is_read_up_to_there(recorded, tmp_path, capsys):
    text = (recorded[0] / "ring.clf").read_text()
    (tmp_path / "cut.clf").write_text(text[: len(text) // 8])
    assert slam([str(tmp_path / "cut.clf"), "--json"]) == 0
    facts = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert facts["skipped"] == {"incomplete": 1}


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.clf", b"\x1f\x8b" + b"\0" * 20),
        ("a.log", b"#ROSBAG V2.0\n" + bytes(range(256)) * 20),
        ("a.mcap", b"SQLite format 3\0" * 20),
        ("a.db3", b"SQLite format 3\0" * 20),
        ("a.clf.gz", b"PK\3\4" + bytes(200)),
        ("a.csv", b"time,x,y\n1,2,3\n" * 10),
        ("a.clf", b"ROBOTLASER1 0 nan nan nan 80 0 0 1 1.0 0 0 0 0 0 0 0 0 0 0 0 0 1.0 h 1.0\n" * 5),
        ("a.clf", b"FLASER 1 1.0 0 0 0 0 0 0 1.0 h 1.0\n" * 5),
    ],
)
def test_other_formats_are_refused_in_one_line(tmp_path, name, content):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(VucaError) as error:
        slam([str(tmp_path / name)])
    assert "\n" not in str(error.value)
    assert name in str(error.value)

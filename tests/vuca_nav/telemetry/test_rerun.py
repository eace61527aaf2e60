import inspect
import math
import os
import subprocess
import sys
import time
import urllib.request
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
import rerun as rr
from rerun.chunk import RrdReader

from vuca_nav.errors import BadArgument
from vuca_nav.geometry import compose, transform_points
from vuca_nav.mapping.grid import GridConfig, OccupancyGrid
from vuca_nav.telemetry.interface import FrontierView, MeshPart, SceneShape, Telemetry
from vuca_nav.telemetry.rerun import blueprint as look
from vuca_nav.telemetry.rerun import drawing
from vuca_nav.telemetry.rerun.recorder import RerunTelemetry
from vuca_nav.telemetry.rerun.status import Status, best_first, describe
from vuca_nav.types import Pose2, Scan, VelocityCommand

RATE = 30
SLAM_OFFSET, ODOMETRY_OFFSET = 0.05, 0.5
VIEW = FrontierView(
    points_in_map=np.array([[5.0, 1.0], [3.0, 4.0], [-2.0, 2.0], [0.0, 6.0]]),
    goal_term=np.array([0.1, 0.4, 0.9, 0.3]),
    safety_term=np.array([0.2, 0.0, 0.1, 0.9]),
    score=np.array([0.3, 0.4, 1.0, 1.2]),
    chosen=0,
)


@pytest.fixture(autouse=True, scope="module")
def _strict():
    rr.set_strict_mode(True)
    yield
    rr.set_strict_mode(False)


def drive_in_a_circle(telemetry: Telemetry, seconds: float, num_movers: int = 2) -> None:
    """A robot at 1 m/s on a circle of 2 m in a room of 12 x 12 m, SLAM off by 0.05 m, dead reckoning by 0.5 m."""
    telemetry.time(0.0)
    wall = SceneShape("north", "box", (6.0, 0.1, 1.0), (0.0, 6.0, 1.0), 0.0, "wall")
    pillar = SceneShape("pillar", "cylinder", (0.3, 0.3, 1.2), (3.0, 3.0, 1.2), 0.0, "pillar")
    telemetry.scene([wall, pillar], (-6.0, -6.0, 6.0, 6.0), (5.0, 5.0))
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], dtype=np.float32)
    telemetry.robot_model([MeshPart("base", corners, np.array([[0, 1, 2]], dtype=np.uint32), (90, 90, 90))])
    cart = SceneShape("cart", "box", (0.4, 0.3, 0.5), (0.0, 0.0, 0.5), 0.0, "cart")
    leg = SceneShape("leg", "cylinder", (0.1, 0.1, 0.4), (0.0, 0.0, 0.4), 0.0, "legs")
    telemetry.mover_model([cart, leg] * (num_movers // 2))
    grid = OccupancyGrid(GridConfig())
    angles = -np.pi + np.arange(360) * np.pi / 180.0
    ranges = 4.0 / np.maximum(np.abs(np.cos(angles)), np.abs(np.sin(angles)))
    returns_in_base = np.column_stack([ranges * np.cos(angles), ranges * np.sin(angles)])
    for tick in range(round(seconds * RATE)):
        now = tick / RATE
        pose = Pose2(2.0 * math.cos(0.5 * now), 2.0 * math.sin(0.5 * now), 0.5 * now + math.pi / 2.0)
        believed = compose(pose, Pose2(SLAM_OFFSET, 0.0, 0.0))
        telemetry.time(now)
        telemetry.true_pose(pose)
        half = pose.yaw / 2.0
        telemetry.robot_parts(np.array([[pose.x, pose.y, 0.0]]), np.array([[math.cos(half), 0.0, 0.0, math.sin(half)]]))
        telemetry.movers(np.column_stack([np.arange(float(num_movers)), np.full((num_movers, 2), now)]))
        telemetry.estimated_pose(believed, compose(pose, Pose2(ODOMETRY_OFFSET, 0.0, 0.0)))
        telemetry.scan(Scan(now, ranges), transform_points(believed, returns_in_base))
        if tick % RATE == 0:
            grid.level[40 : 60 + tick // RATE, 50:90] = -5
            telemetry.grid(grid)
            telemetry.entropy(1000.0 - tick)
            telemetry.path(np.array([pose[:2], (5.0, 5.0)]))
            telemetry.waypoint((5.0, now))
            telemetry.frontiers(VIEW)
            telemetry.event("it is time: now heading for (5.0, 1.0)")
        telemetry.command(VelocityCommand(1.0, 0.0, 0.5))
    telemetry.path(np.empty((0, 2)))
    telemetry.event("collision with cart", "ERROR")


def chunks(path: Path):
    reader = RrdReader(path)
    (recording,) = reader.recordings()
    return list(reader.stream(store=recording))


def column(path: Path, entity: str, component: str) -> list:
    """Logged values of a component, in the order of time; static ones left out."""
    rows = []
    for chunk in chunks(path):
        batch = chunk.to_record_batch()
        if chunk.entity_path == entity and not chunk.is_static and component in batch.schema.names:
            nanoseconds = batch.column("time").cast("int64").to_pylist()
            rows += zip(nanoseconds, batch.column(component).to_pylist())
    return [value for _, value in sorted(rows, key=lambda row: row[0]) if value is not None]


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("recording") / "circle.rrd"
    telemetry = RerunTelemetry.record(path, title="circle")
    drive_in_a_circle(telemetry, 4.0)
    telemetry.close()
    telemetry.close()
    return path


def test_every_method_of_the_interface_is_recorded():
    methods = {name for name, _ in inspect.getmembers(Telemetry, inspect.isfunction) if name[0] != "_"}
    assert methods - set(vars(RerunTelemetry)) == set()
    for name in methods:
        assert inspect.signature(getattr(Telemetry, name)) == inspect.signature(getattr(RerunTelemetry, name))


def test_the_null_telemetry_swallows_everything():
    telemetry = Telemetry()
    drive_in_a_circle(telemetry, 0.2)
    telemetry.wait()
    telemetry.close()
    assert vars(telemetry) == {}


def test_rows_of_every_entity(recording: Path):
    rows: Counter[str] = Counter()
    static, timelines = set(), set()
    for chunk in chunks(recording):
        if chunk.is_static:
            static.add(chunk.entity_path)
        else:
            rows[chunk.entity_path] += chunk.num_rows
            timelines.update(chunk.timeline_names)
    assert timelines == {"time"}
    at_10_hz = (
        "/map/estimate /map/odometry /map/estimate/command /map/scan /world/robot/base "
        "/world/robot/parts/00_base /world/movers/boxes /world/movers/cylinders "
        "/plots/error/slam /plots/error/odometry /plots/nearest/range /plots/nearest/close"
    )
    expected = dict.fromkeys(at_10_hz.split(), 40)
    expected |= {f"/plots/command/{name}": 120 for name in ("v_x", "v_y", "w_z")}
    at_1_hz = "/map/grid /map/waypoint /map/waypoint/label /map/frontiers /map/frontiers/best"
    expected |= dict.fromkeys(at_1_hz.split(), 4) | {"/map/frontiers/chosen": 4, "/plots/entropy": 4}
    expected |= {"/map/path": 5, "/events": 5, "/map/waypoint/line": 39}  # the first pose knows no waypoint yet
    expected |= dict.fromkeys(("/world/trail", "/map/trail/estimate", "/map/trail/odometry"), 5)
    expected["/now"] = 9  # twice a second, and at the end
    assert dict(rows) == expected
    assert {
        "/legend",
        "/world/scene/wall/boxes",
        "/world/scene/pillar/cylinders",
        "/world/goal",
        "/world/movers/boxes",
        "/world/robot/parts/00_base",
        "/map/estimate/arrow",
    } <= static


def test_a_moment_found_afterwards_is_marked_at_its_time(tmp_path: Path):
    path = tmp_path / "moment.rrd"
    telemetry = RerunTelemetry.record(path, title="moment")
    drive_in_a_circle(telemetry, 2.0)
    telemetry.moment(1.25, (3.0, 4.0), "last avoidable moment")
    telemetry.close()
    times = [
        chunk.to_record_batch().column("time").cast("int64").to_pylist()
        for chunk in chunks(path)
        if chunk.entity_path == "/world/moments/0"
    ]
    assert times == [[1_250_000_000]]
    assert ["last avoidable moment"] in column(path, "/events", "TextLog:text")


def view_origins(path: Path) -> set[str]:
    reader = RrdReader(path)
    (layout,) = reader.blueprints()
    origins = set()
    for chunk in reader.stream(store=layout):
        batch = chunk.to_record_batch()
        if "ViewBlueprint:space_origin" in batch.schema.names:
            origins.update(row[0] for row in batch.column("ViewBlueprint:space_origin").to_pylist())
    return origins


def test_the_layout_rides_with_the_true_robot_if_there_is_a_scene(recording: Path):
    assert {"/world/robot/base", "/now", "/legend", "/events", "/plots"} < view_origins(recording)


def test_the_layout_rides_with_the_estimate_if_there_is_none(tmp_path: Path):
    path = tmp_path / "run.rrd"
    telemetry = RerunTelemetry.record(path, title="run")
    telemetry.time(1000.0)
    telemetry.estimated_pose(Pose2(0.0, 0.0, 0.0), Pose2(0.0, 0.0, 0.0))
    telemetry.close()
    assert "/map/estimate" in view_origins(path)
    assert "/world/robot/base" not in view_origins(path)


def test_shares_of_experts_and_safety_maps_are_shown_where_there_are_any(tmp_path: Path):
    paths = {}
    for kind in ("learned", "without a critic"):
        paths[kind] = tmp_path / f"{kind}.rrd"
        telemetry = RerunTelemetry.record(paths[kind], title=kind)
        for tick in range(RATE * 6):
            telemetry.time(tick / RATE)
            telemetry.estimated_pose(Pose2(1.0, 2.0, 0.0), Pose2(1.0, 2.0, 0.0))
            if tick % RATE == 0:  # oftener than maps are wanted
                telemetry.safety(
                    lambda points, learned=kind == "learned": 0.75 + 0.0318 * (points[:, 0] - 1.0) * learned
                )
            if kind == "learned":
                telemetry.gate(np.array([0.1, 0.2, 0.3, 0.4]))
        telemetry.close()
    shares = [column(paths["learned"], f"/plots/gate/expert_{n}", "Scalars:scalars") for n in (1, 2, 3, 4)]
    assert [len(share) for share in shares] == [RATE * 6] * 4
    assert [share[7][0] for share in shares] == pytest.approx([0.1, 0.2, 0.3, 0.4])
    first, _ = column(paths["learned"], "/map/safety", "GridMap:data")
    levels = np.asarray(first[0]).reshape(64, 64)
    assert (levels == levels[0]).all()  # safety rises with x alone, left to right
    assert (np.diff(levels[0].astype(int)) > 0).all()
    assert (levels[0, 0], levels[0, -1]) == (0, 255)
    assert column(paths["without a critic"], "/map/safety", "GridMap:data") == []
    assert num_views(paths["learned"]) == num_views(paths["without a critic"]) + 2


def num_views(path: Path) -> int:
    reader = RrdReader(path)
    (layout,) = reader.blueprints()
    entities = {chunk.entity_path for chunk in reader.stream(store=layout)}
    return sum(entity.startswith("/view/") and entity.count("/") == 2 for entity in entities)


def test_pose_errors_are_those_of_the_same_tick(recording: Path):
    assert np.allclose(column(recording, "/plots/error/slam", "Scalars:scalars"), SLAM_OFFSET)
    assert np.allclose(column(recording, "/plots/error/odometry", "Scalars:scalars"), ODOMETRY_OFFSET)


def test_pose_error_waits_for_both_poses_of_a_tick(tmp_path: Path):
    path = tmp_path / "run.rrd"
    telemetry = RerunTelemetry.record(path, title="run")
    telemetry.time(1.0)
    telemetry.true_pose(Pose2(0.0, 0.0, 0.0))
    telemetry.time(2.0)
    telemetry.estimated_pose(Pose2(3.0, 4.0, 0.0), Pose2(6.0, 8.0, 0.0))  # the true pose is a second old
    telemetry.true_pose(Pose2(3.0, 4.0, 0.0))
    telemetry.close()
    assert column(path, "/plots/error/slam", "Scalars:scalars") == [[0.0]]
    assert column(path, "/plots/error/odometry", "Scalars:scalars") == [[5.0]]


def test_the_now_panel_speaks_of_the_tick_it_stands_at(recording: Path):
    texts = [row[0] for row in column(recording, "/now", "TextDocument:text")]
    assert texts[0].startswith("### 0.0 s: driving at 1.00 m/s, turning left (+0.50 rad/s)")
    assert "**Heads for** the waypoint (5.0, 0.0)" in texts[0]
    assert "**Pose error** 0.05 m; dead reckoning 0.50 m" in texts[0]
    assert "collision with cart" in texts[-1]


def test_what_made_a_recording_is_kept_with_it(tmp_path: Path):
    path = tmp_path / "run.rrd"
    telemetry = RerunTelemetry.record(path, title="a run")
    telemetry.made_by({"commit": "0123456789ab", "machine": {"cpu": "a processor", "cores": 2}})
    telemetry.close()
    content = path.read_bytes()
    assert b"made_by" in content
    assert b"0123456789ab" in content
    assert b"a processor" in content


def test_recordings_do_not_share_state(tmp_path: Path):
    first = RerunTelemetry.record(tmp_path / "first.rrd", title="first")
    second = RerunTelemetry.record(tmp_path / "second.rrd", title="second")
    assert rr.get_global_data_recording() is None
    first.time(1.0)
    second.time(2.0)
    first.event("one")
    second.event("two")
    first.close()
    second.close()
    assert column(tmp_path / "first.rrd", "/events", "TextLog:text") == [["one"]]
    assert column(tmp_path / "second.rrd", "/events", "TextLog:text") == [["two"]]


def test_five_minutes_among_forty_movers_stay_below_60_mb(tmp_path: Path):
    sizes = []
    for seconds in (2.0, 12.0):
        telemetry = RerunTelemetry.record(tmp_path / "run.rrd", title="run")
        drive_in_a_circle(telemetry, seconds, num_movers=40)
        telemetry.close()
        sizes.append((tmp_path / "run.rrd").stat().st_size)
    bytes_per_second = (sizes[1] - sizes[0]) / 10.0
    assert 300.0 * bytes_per_second < 60e6


@pytest.mark.parametrize(
    ("path", "complaint"),
    [
        ("missing/run.rrd", "there is no directory"),
        ("file/run.rrd", "there is no directory"),
        (".", "it is a directory"),
    ],
)
def test_a_file_that_cannot_be_written_is_refused_at_once(tmp_path: Path, path: str, complaint: str):
    (tmp_path / "file").touch()
    with pytest.raises(BadArgument, match=complaint) as error:
        RerunTelemetry.record(tmp_path / path, title="run")
    assert "\n" not in str(error.value)


@pytest.mark.skipif(hasattr(os, "geteuid") and os.geteuid() == 0, reason="root may write anywhere")
def test_a_directory_without_permission_is_refused(tmp_path: Path):
    tmp_path.chmod(0o500)
    with pytest.raises(BadArgument, match="Permission denied"):
        RerunTelemetry.record(tmp_path / "run.rrd", title="run")


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere there is always a display")
def test_a_window_needs_a_display(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(BadArgument, match="no display"):
        RerunTelemetry.spawn(title="run")


def test_served_to_a_browser_until_interrupted(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    telemetry = RerunTelemetry.serve(title="run", open_browser=False)
    (line,) = capsys.readouterr().err.splitlines()
    assert urllib.request.urlopen(line.removeprefix("viewer: "), timeout=10.0).status == 200
    drive_in_a_circle(telemetry, 0.2)

    def interrupt(_seconds: float) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(time, "sleep", interrupt)
    telemetry.wait()
    telemetry.close()
    telemetry.wait()  # nothing to wait for any more


def test_greys_follow_the_classes_of_the_map():
    probability = np.arange(256, dtype=np.uint8)
    greys = drawing.greys_of(probability)
    share = probability / 255.0
    assert np.array_equal(greys == look.UNSEEN, (share >= 0.48) & (share <= 0.52))
    assert greys[share < 0.48].min() > look.UNSEEN > greys[share > 0.52].max()
    assert (greys[0], greys[255]) == (255, 0)


def test_grid_map_holds_the_seen_part_upper_row_first():
    greys = np.full((6, 5), look.UNSEEN, dtype=np.uint8)
    greys[2, 1:4] = (0, 10, 20)
    greys[3, 2] = 255
    image = drawing.grid_map(greys, 0.5, (-1.0, 2.0))
    assert image is not None
    assert image.data is not None
    assert image.translation is not None
    pixels = np.array(image.data.as_arrow_array().to_pylist()[0], dtype=np.uint8).reshape(2, 3)
    assert pixels.tolist() == [[look.UNSEEN, 255, look.UNSEEN], [0, 10, 20]]
    assert image.translation.as_arrow_array().to_pylist() == [[-0.5, 3.0, 0.0]]


def test_grid_map_of_nothing_seen_is_nothing():
    assert drawing.grid_map(np.full((3, 3), look.UNSEEN, dtype=np.uint8), 0.1, (0.0, 0.0)) is None


@pytest.mark.parametrize(
    ("command", "end"),
    [
        (VelocityCommand(1.0, 0.0, 0.0), (2.0, 0.0)),
        (VelocityCommand(1.0, 0.0, math.pi / 2.0), (0.0, 4.0 / math.pi)),  # half a circle of radius 2 / pi
        (VelocityCommand(0.0, 1.0, math.pi / 2.0), (-4.0 / math.pi, 0.0)),
        (VelocityCommand(0.0, 0.0, 1.0), (0.0, 0.0)),
    ],
)
def test_command_arc_ends_where_the_held_command_leads(command: VelocityCommand, end: tuple[float, float]):
    arc = drawing.command_arc(command, 2.0, 0.1)
    assert np.allclose(arc[0], (0.0, 0.0, 0.1))
    assert np.allclose(arc[-1], (*end, 0.1), atol=1e-5)


def test_normals_of_a_flat_sheet_point_up():
    vertices = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=np.float32)
    faces = np.array([[0, 1, 2], [0, 2, 3]], dtype=np.uint32)
    assert np.allclose(drawing.vertex_normals(vertices, faces), [0.0, 0.0, 1.0])


def test_trail_is_thinned_out_but_ends_where_the_pose_is():
    trail = drawing.Trail(look.TRUE, 0.0)
    for step in range(101):
        trail.extend(Pose2(0.01 * step, 0.0, 0.0))
    strips = trail.strip().strips
    assert strips is not None
    (points,) = strips.as_arrow_array().to_pylist()
    assert len(points) <= 7  # 1 m at 0.2 m apart, and the end
    assert points[0] == [0.0, 0.0, 0.0]
    assert points[-1] == pytest.approx([1.0, 0.0, 0.0])


def test_a_trail_moves_along_with_the_map():
    correction, poses = Pose2(1.0, -2.0, 0.5), [Pose2(0.1 * step, 0.02 * step, 0.0) for step in range(12)]
    trail, moved = drawing.Trail(look.TRUE, 0.0), drawing.Trail(look.TRUE, 0.0)
    for pose in poses:
        trail.extend(pose)
        moved.extend(compose(correction, pose))
    trail.move(correction)
    assert points_of(trail) == pytest.approx(points_of(moved), abs=1e-6)
    for line in (trail, moved):  # it goes on from where the robot is now
        line.extend(compose(correction, Pose2(1.4, 0.3, 0.0)))
    assert points_of(trail) == pytest.approx(points_of(moved), abs=1e-6)
    empty = drawing.Trail(look.TRUE, 0.0)
    empty.move(correction)
    assert len(points_of(empty)) == 0


def points_of(trail: drawing.Trail) -> np.ndarray:
    strips = trail.strip().strips
    assert strips is not None
    return np.array(strips.as_arrow_array().to_pylist()[0])


def test_of_the_trails_only_the_estimates_follows_a_correction(tmp_path: Path):
    path, correction = tmp_path / "run.rrd", Pose2(0.0, 3.0, math.pi / 2.0)
    telemetry = RerunTelemetry.record(path, title="run")
    for tick in range(61):
        telemetry.time(tick / RATE)
        pose = Pose2(0.05 * tick, 0.0, 0.0)
        if tick == 30:
            telemetry.map_correction(correction)
        telemetry.true_pose(pose)
        telemetry.estimated_pose(compose(correction, pose) if tick >= 30 else pose, pose)
    telemetry.close()
    (estimate,), (odometry,), (true,) = (
        column(path, trail, "LineStrips3D:strips")[-1]
        for trail in ("/map/trail/estimate", "/map/trail/odometry", "/world/trail")
    )
    for straight in (odometry, true):
        assert straight[0][:2] == [0.0, 0.0]
        assert straight[-1][:2] == pytest.approx([3.0, 0.0])
    # All of it, what was drawn before the correction too: from (0, 3) on upwards.
    assert np.array(estimate)[:, 0] == pytest.approx(0.0, abs=1e-5)
    assert estimate[0][:2] == pytest.approx([0.0, 3.0], abs=1e-5)
    assert estimate[-1][:2] == pytest.approx([0.0, 6.0], abs=1e-5)


def test_the_chosen_frontier_is_among_the_best_whatever_its_score():
    assert best_first(VIEW, 3) == [0, 1, 2]
    worst_chosen = FrontierView(VIEW.points_in_map, VIEW.goal_term, VIEW.safety_term, VIEW.score, chosen=3)
    assert best_first(worst_chosen, 3) == [0, 1, 3]


@pytest.mark.parametrize(
    ("command", "words"),
    [
        (None, "no command yet"),
        (VelocityCommand(0.0, 0.0, 0.0), "standing"),
        (VelocityCommand(0.0, 0.0, -0.5), "turning right on the spot (-0.50 rad/s)"),
        (VelocityCommand(0.5, 0.0, 0.0), "driving at 0.50 m/s, straight on"),
        (VelocityCommand(-0.2, 0.0, 0.3), "backing up at 0.20 m/s, turning left (+0.30 rad/s)"),
    ],
)
def test_motion_in_words(command: VelocityCommand | None, words: str):
    assert describe(Status(time=1.5, command=command)) == f"### 1.5 s: {words}"


def test_directions_are_the_robots_own():
    status = Status(
        map_from_base=Pose2(1.0, 1.0, math.pi / 2.0),
        waypoint_in_map=(0.0, 1.0),
        nearest_in_map=np.array([1.5, 1.0]),
        goal=(1.0, 3.0),
        decision=VIEW,
    )
    text = describe(status)
    assert "the waypoint (0.0, 1.0): 1.0 m, 90° to the left" in text
    assert "**Nearest return** (1.5, 1.0): 0.5 m, 90° to the right, **closer than 0.6 m**" in text
    assert "**Goal** (1.0, 3.0): 2.0 m, ahead" in text
    assert "| **chosen** | (5.0, 1.0) | 0.1 | 0.2 | 0.3 |" in text


def test_a_recording_is_made_where_rerun_is_off_by_default(tmp_path):
    code = (
        "import sys; from vuca_nav.telemetry.rerun.recorder import RerunTelemetry;"
        "telemetry = RerunTelemetry.record(sys.argv[1], title='run'); telemetry.time(0.0); telemetry.close()"
    )
    environment = {**os.environ, "RERUN": "off"}
    result = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path / "run.rrd")], env=environment, capture_output=True, text=True,
        timeout=120, check=False,
    )  # fmt: skip
    assert (result.returncode, result.stderr) == (0, "")
    assert (tmp_path / "run.rrd").stat().st_size > 1000


def test_a_pipe_and_a_name_that_is_not_utf_8_are_refused(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(BadArgument, match="is a pipe or a device"):
        RerunTelemetry.record(tmp_path / "pipe", title="run")  # to open it would wait for a reader
    with pytest.raises(BadArgument, match="only names that are UTF-8"):
        RerunTelemetry.record(tmp_path / os.fsdecode(b"\xff.rrd"), title="run")


def test_a_recording_that_the_disk_does_not_take_is_told_at_the_end(tmp_path, small_files):
    with small_files(20_000):
        telemetry = RerunTelemetry.record(tmp_path / "run.rrd", title="run")
        drive_in_a_circle(telemetry, seconds=2.0)
        with pytest.raises(BadArgument, match="the recording is not whole"):
            telemetry.close()
        telemetry.close()


def test_a_title_may_hold_any_name_of_a_file(tmp_path):
    telemetry = RerunTelemetry.record(tmp_path / "run.rrd", title=os.fsdecode(b"room-\xff.yaml"))
    telemetry.close()
    assert (tmp_path / "run.rrd").stat().st_size > 1000


def test_slam_over_a_log_shows_its_way_its_closures_and_its_time(tmp_path):
    telemetry = RerunTelemetry.record(tmp_path / "log.rrd", title="log")
    for tick in range(4):
        telemetry.time(float(tick))
        telemetry.scan_time(0.5 + tick)
        telemetry.estimated_pose(Pose2(float(tick), 0.0, 0.0), Pose2(float(tick), 0.1, 0.0))
    telemetry.trajectory(np.array([[0.0, 1.0], [3.0, 1.0]]))
    telemetry.closures(np.array([[[0.0, 1.0], [3.0, 1.0]]]))
    telemetry.close()
    assert column(tmp_path / "log.rrd", "/plots/scan_time", "Scalars:scalars") == [[0.5], [1.5], [2.5], [3.5]]
    (strips,) = column(tmp_path / "log.rrd", "/map/closures", "LineStrips3D:strips")
    assert [point[:2] for point in strips[0]] == [[0.0, 1.0], [3.0, 1.0]]
    way = column(tmp_path / "log.rrd", "/map/trail/estimate", "LineStrips3D:strips")[-1]
    assert [point[:2] for point in way[0]] == [[0.0, 1.0], [3.0, 1.0]]

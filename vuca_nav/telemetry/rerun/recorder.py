"""A run as a Rerun recording: into a file, into the viewer, or served to a browser.

Stable entity paths, one timeline ``time``; docs/recordings.md says what each of them shows. Nothing here is
global state: every telemetry has its own stream.
"""

import json
import os
import sys
import time
from collections.abc import Callable, Mapping, Sequence

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from vuca_nav.errors import BadArgument
from vuca_nav.exploration.heatmap import safety_around
from vuca_nav.geometry import distance
from vuca_nav.mapping.grid import OccupancyGrid
from vuca_nav.telemetry.interface import FrontierView, MeshPart, SceneShape, Telemetry
from vuca_nav.telemetry.rerun import blueprint as look
from vuca_nav.telemetry.rerun import drawing
from vuca_nav.telemetry.rerun.sinks import stream_to_browsers, stream_to_file, stream_to_window
from vuca_nav.telemetry.rerun.status import Status, best_first, describe
from vuca_nav.telemetry.rerun.writer import MARK_HEIGHT, Writer
from vuca_nav.types import FloatArray, Pose2, Scan, VelocityCommand

_POSE_PERIOD = 0.1
"""Period of bodies, poses and scan [s]: 10 Hz is smooth to the eye and a third of the lidar's rate."""
_PLOT_PERIOD = 1.0 / 30.0
"""Period of the command plots [s]: the rate of commands."""
_SLOW_PERIOD = 1.0
"""Period of the map and the trails, the largest parts of a recording [s]."""
_STATUS_PERIOD = 0.5
"""Period of the status text [s]."""
_SAFETY_PERIOD = 5.0
"""Least time between two maps of V^h, which are made at decisions of the explorer [s]."""
_SAFETY_HALF, _SAFETY_RESOLUTION = 8.0, 0.25
"""Half side of the square about the robot that maps of V^h show, and side of their cells [m]."""
_CHOSEN_RADIUS = 0.6
"""Radius of the ring about the chosen frontier [m]; that about the goal is the task's tolerance."""
_WANTED_HEIGHT, _TRAIL_HEIGHT = 0.08, 0.04
"""Heights above the map, so that lines do not hide one another [m]."""


class RerunTelemetry(Telemetry):
    """Writes a run to a ``RecordingStream``, at rates that keep a recording small.

    Made by ``record``, ``spawn`` or ``serve``.

    Args:
        stream: The stream that is written to.
        title: Title of the recording, shown in the viewer.
        served: Whether viewers get the stream from this process, so that ``wait`` has to keep it alive.
    """

    def __init__(self, stream: rr.RecordingStream, *, title: str, served: bool = False):
        # The name of a file may hold bytes that are not UTF-8.
        self._writer = Writer(stream, title.encode(errors="backslashreplace").decode())
        self._served, self._closed = served, False
        self._blueprint_sent = False
        self._began: float | None = None
        self._bounds: look.Bounds | None = None
        self._gate_told, self._safety_told = False, False
        self._moments = 0
        self._status = Status()
        self._part_paths: list[str] = []
        self._movers: drawing.Solids | None = None
        self._greys: NDArray[np.uint8] | None = None
        self._true: tuple[float, Pose2] | None = None
        self._believed: tuple[float, Pose2, Pose2] | None = None
        self._trails = {path: drawing.Trail(colour, _TRAIL_HEIGHT) for path, colour in look.TRAILS}

    @classmethod
    def record(cls, path: str | os.PathLike[str], *, title: str) -> "RerunTelemetry":
        """Record into an ``.rrd`` file; an existing one is overwritten.

        Raises:
            BadArgument: The file cannot be written; what cannot be written later is reported by ``close``.
        """
        return cls(stream_to_file(path), title=title)

    @classmethod
    def spawn(cls, *, title: str) -> "RerunTelemetry":
        """Record into a viewer window, which stays open when the run is over.

        Raises:
            BadArgument: There is no display, or the viewer does not start.
        """
        return cls(stream_to_window(), title=title)

    @classmethod
    def serve(cls, *, title: str, open_browser: bool = True) -> "RerunTelemetry":
        """Record into a web viewer; its address is printed to stderr. Call ``wait`` before ``close``.

        Raises:
            BadArgument: The server does not start.
        """
        stream, address = stream_to_browsers(open_browser=open_browser)
        print(f"viewer: {address}", file=sys.stderr, flush=True)
        return cls(stream, title=title, served=True)

    def made_by(self, facts: Mapping[str, object]) -> None:
        """Keep with the recording what made it, the code and the machine, as a property of the recording.

        Args:
            facts: Values that JSON can hold.
        """
        told = {key: value if isinstance(value, str) else json.dumps(value) for key, value in facts.items()}
        self._writer.stream.send_property("made_by", rr.AnyValues(**told))  # pyright: ignore[reportArgumentType]

    def wait(self) -> None:
        """Return once no viewer needs this process any more: a served recording at Ctrl-C, any other at once."""
        if not self._served or self._closed:
            return
        self._writer.stream.flush()
        print("the run is over; Ctrl-C ends the viewer's server", file=sys.stderr, flush=True)
        try:
            while True:
                time.sleep(3600.0)
        except KeyboardInterrupt:
            print(file=sys.stderr)

    def close(self) -> None:
        """Flush and release; a second call does nothing.

        Raises:
            BadArgument: The recording is not whole: a full disk, or a viewer that has gone.
        """
        if self._closed:
            return
        self._closed = True
        self._send_blueprint()
        self._log_status()
        for path, trail in self._trails.items():
            self._writer.log(path, trail.strip())
        try:
            self._writer.stream.flush()
        except RuntimeError as error:
            raise BadArgument(f"the recording is not whole, as on a full disk: {error}") from error
        finally:
            self._writer.stream.disconnect()

    # -- the simulation's side: the true state -------------------------------------------------------

    def scene(self, shapes: Sequence[SceneShape], bounds: look.Bounds, goal: tuple[float, float]) -> None:
        """The static obstacles, once."""
        self._bounds = bounds
        self._status.goal = goal
        for category in sorted({shape.category for shape in shapes}):
            members = [shape for shape in shapes if shape.category == category]
            solids = drawing.Solids(f"/world/scene/{category}", members)
            solids.log_model(self._writer.stream, rr.components.FillMode.TransparentFillMajorWireframe)
            poses = np.array([[shape.centre[0], shape.centre[1], shape.yaw] for shape in members])
            solids.log_poses(self._writer.stream, poses, static=True)
        strips = [[[*goal, 0.0], [*goal, 2.5]], drawing.ring(goal, self.goal_tolerance, _WANTED_HEIGHT)]
        self._writer.log("/world/goal", rr.LineStrips3D(strips, radii=0.05, colors=look.GOAL), static=True)
        self._writer.mark("/world/goal/mark", goal, "goal", look.GOAL, static=True)

    def robot_model(self, parts: Sequence[MeshPart]) -> None:
        """The robot's visuals, once."""
        self._part_paths = [f"/world/robot/parts/{i:02d}_{part.name}" for i, part in enumerate(parts)]
        for path, part in zip(self._part_paths, parts):
            mesh = rr.Mesh3D(
                vertex_positions=part.vertices,
                triangle_indices=part.faces,
                vertex_normals=drawing.vertex_normals(part.vertices, part.faces),
                albedo_factor=part.colour,
            )
            self._writer.log(path, mesh, static=True)

    def mover_model(self, parts: Sequence[SceneShape]) -> None:
        """The parts of the moving obstacles, once; their poses follow with ``movers``."""
        self._movers = drawing.Solids("/world/movers", parts)
        self._movers.log_model(self._writer.stream, rr.components.FillMode.Solid)

    def time(self, seconds: float) -> None:
        """Set the time of everything that follows, by the simulation or robot clock [s]."""
        if seconds != self._status.time and self._writer.due("status", _STATUS_PERIOD):
            self._log_status()  # of the tick that ends here, which is now complete
        if self._began is None:
            self._began = seconds
        elif seconds != self._began:
            self._send_blueprint()  # the first tick has shown which panels there are
        self._status.time = seconds
        self._writer.set_time(seconds)

    def robot_parts(self, positions: FloatArray, quaternions: FloatArray) -> None:
        """True poses of the robot's parts in the world: (n, 3) [m] and (n, 4) as w, x, y, z."""
        if not self._writer.due("parts", _POSE_PERIOD):
            return
        for path, position, (w, x, y, z) in zip(self._part_paths, positions, quaternions, strict=True):
            rotation = rr.Quaternion(xyzw=(x, y, z, w))
            self._writer.log(path, rr.Transform3D(translation=position, quaternion=rotation))

    def true_pose(self, world_from_base: Pose2) -> None:
        """True pose of the robot."""
        self._true = (self._status.time, world_from_base)
        if self._writer.due("true", _POSE_PERIOD):
            self._writer.log("/world/robot/base", drawing.transform(world_from_base))
        self._extend_trail("/world/trail", world_from_base)
        self._log_errors()

    def movers(self, poses: FloatArray) -> None:
        """True poses of the movers' parts: (n, 3) x, y, yaw in the world, ``inf`` for one that is not there now."""
        if self._movers is not None and self._writer.due("movers", _POSE_PERIOD):
            self._movers.log_poses(self._writer.stream, poses)

    # -- the stack's side: estimates and decisions -------------------------------------------------

    def scan(self, scan: Scan, points_in_map: FloatArray) -> None:
        """The returns of one scan as the stack places them, (n, 2) [m]."""
        if not self._writer.due("scan", _POSE_PERIOD):
            return
        colours = np.empty((len(points_in_map), 3), dtype=np.uint8)
        colours[:] = look.SENSED
        self._status.nearest_in_map = None
        if self._status.map_from_base is not None and len(points_in_map):
            offsets = points_in_map - self._status.map_from_base[:2]
            ranges = np.hypot(offsets[:, 0], offsets[:, 1])
            colours[ranges < look.CLOSE_RANGE] = look.CLOSE
            nearest = int(np.argmin(ranges))
            self._status.nearest_in_map = points_in_map[nearest].copy()
            self._writer.scalar("/plots/nearest/range", ranges[nearest])
            self._writer.scalar("/plots/nearest/close", look.CLOSE_RANGE)
        points = drawing.at_height(points_in_map, MARK_HEIGHT)
        self._writer.log("/map/scan", rr.Points3D(points, colors=colours, radii=rr.Radius.ui_points(2.0)))

    def estimated_pose(self, map_from_base: Pose2, map_from_base_by_odometry: Pose2) -> None:
        """Poses of the robot by SLAM and by dead reckoning."""
        self._believed = (self._status.time, map_from_base, map_from_base_by_odometry)
        self._status.map_from_base = map_from_base
        if self._writer.due("believed", _POSE_PERIOD):
            self._writer.log("/map/estimate", drawing.transform(map_from_base))
            self._writer.log("/map/odometry", drawing.transform(map_from_base_by_odometry))
            if self._status.waypoint_in_map is not None:
                ends = np.array([map_from_base[:2], self._status.waypoint_in_map])
                line = drawing.at_height(ends, _WANTED_HEIGHT)
                self._writer.strip("/map/waypoint/line", line, look.PLANNED, 1.0)
        self._extend_trail("/map/trail/estimate", map_from_base)
        self._extend_trail("/map/trail/odometry", map_from_base_by_odometry)
        self._log_errors()

    def map_correction(self, map_correction: Pose2) -> None:
        """A correction of the map: the estimate's trail moves along."""
        self._trails["/map/trail/estimate"].move(map_correction)

    def grid(self, grid: OccupancyGrid) -> None:
        """The present navigation grid."""
        if not self._writer.due("grid", _SLOW_PERIOD):
            return
        greys = drawing.greys_of(grid.probability())
        if self._greys is not None and np.array_equal(greys, self._greys):
            return
        self._greys = greys
        image = drawing.grid_map(greys, grid.resolution, grid.origin)
        if image is not None:
            self._writer.log("/map/grid", image)

    def entropy(self, entropy: float) -> None:
        """Entropy of the map, against an unseen one (Zhang et al., Section III-C) [nat]."""
        self._status.entropy = entropy
        if self._writer.due("entropy", _POSE_PERIOD):
            self._writer.scalar("/plots/entropy", entropy)

    def frontiers(self, view: FrontierView) -> None:
        """One decision of the explorer."""
        self._status.decision, self._status.decision_time = drawing.copy_of(view), self._status.time
        self._writer.log("/map/frontiers", drawing.frontier_points(view, MARK_HEIGHT))
        labels = drawing.labelled_frontiers(view, best_first(view, 3), MARK_HEIGHT)
        self._writer.log("/map/frontiers/best", labels)
        if view.chosen >= 0:
            x, y = view.points_in_map[view.chosen]
            ring = drawing.ring((x, y), _CHOSEN_RADIUS, MARK_HEIGHT)
            self._writer.strip("/map/frontiers/chosen", ring, look.WANTED, 3.0)
        else:
            self._writer.clear("/map/frontiers/chosen")

    def path(self, points_in_map: FloatArray) -> None:
        """The planned path, (n, 2) [m]; empty if there is none."""
        if len(points_in_map):
            strip = drawing.at_height(points_in_map, _WANTED_HEIGHT)
            self._writer.strip("/map/path", strip, look.PLANNED, 2.5)
        else:
            self._writer.clear("/map/path")

    def waypoint(self, point_in_map: tuple[float, float]) -> None:
        """The waypoint that the local policy heads for [m]."""
        if point_in_map != self._status.waypoint_in_map:
            self._status.waypoint_in_map = point_in_map
            self._writer.mark("/map/waypoint", point_in_map, "waypoint", look.WANTED)

    def command(self, command: VelocityCommand) -> None:
        """The local policy's command to the body."""
        self._status.command = command
        if self._writer.due("command", _PLOT_PERIOD):
            for name, value in zip(command._fields, command):
                self._writer.scalar(f"/plots/command/{name}", value)
        if self._writer.due("arc", _POSE_PERIOD):
            arc = drawing.command_arc(command, look.ARC_DURATION, MARK_HEIGHT)
            self._writer.strip("/map/estimate/command", arc, look.WANTED, 3.5)

    def gate(self, shares: FloatArray) -> None:
        """Shares of the local policy's experts in the command of this tick, (E,); they add up to 1."""
        paths = [f"/plots/gate/expert_{n + 1}" for n in range(len(shares))]
        if not self._gate_told:
            self._gate_told = True
            for n, path in enumerate(paths):
                colour = look.EXPERT_COLOURS[n % len(look.EXPERT_COLOURS)]
                lines = rr.SeriesLines(names=f"expert {n + 1}", colors=colour, widths=1.5)
                self._writer.log(path, lines, static=True)
        if self._writer.due("gate", _PLOT_PERIOD):
            for path, share in zip(paths, shares):
                self._writer.scalar(path, float(share))

    def safety(self, rate: Callable[[FloatArray], FloatArray]) -> None:
        """The critic can be asked now, at a decision of the explorer."""
        pose = self._status.map_from_base
        if pose is None or not self._writer.due("safety", _SAFETY_PERIOD):
            return
        image = drawing.safety_grid(safety_around(rate, pose[:2], _SAFETY_HALF, _SAFETY_RESOLUTION))
        if image is not None:  # with no critic all are alike
            self._safety_told = True
            self._writer.log("/map/safety", image)

    def trajectory(self, points_in_map: FloatArray) -> None:
        """The robot's whole way as SLAM knows it by now: the trail of the estimate goes on from it."""
        self._trails["/map/trail/estimate"].become(points_in_map)

    def closures(self, ends_in_map: FloatArray) -> None:
        """All loop closures that SLAM goes by: the two submaps that each ties together."""
        ends = np.concatenate([ends_in_map, np.full((*ends_in_map.shape[:2], 1), _WANTED_HEIGHT)], axis=2)
        lines = rr.LineStrips3D(ends, colors=look.CLOSURE, radii=rr.Radius.ui_points(0.5))
        self._writer.log("/map/closures", lines)

    def scan_time(self, milliseconds: float) -> None:
        """Time that SLAM took for the scan of this tick [ms]."""
        self._status.scan_time = milliseconds
        self._writer.scalar("/plots/scan_time", milliseconds)

    def event(self, text: str, level: str = "INFO") -> None:
        """An event of interest to an engineer: a trigger, a recovery, a collision."""
        colour = look.LEVEL_COLOURS.get(level, look.LEVEL_COLOURS["INFO"])
        self._writer.log("/events", rr.TextLog(text, level=level, color=colour))
        self._status.event = f"at {self._status.time:.1f} s: {text}"

    def moment(self, seconds: float, point_in_world: tuple[float, float], text: str) -> None:
        """A moment that was found to matter when the run was over: a line among the events, a mark from then on."""
        now = self._writer.time
        self._writer.set_time(seconds)
        self._writer.log("/events", rr.TextLog(text, level="WARN", color=look.LEVEL_COLOURS["WARN"]))
        path = f"/world/moments/{self._moments}"
        self._writer.mark(path, point_in_world, text, look.CLOSE)
        self._moments += 1
        self._writer.set_time(now)

    # -- the means ---------------------------------------------------------------------------------

    def _send_blueprint(self) -> None:
        """Send the layout once; without bounds there is no true scene, as on a real robot."""
        if not self._blueprint_sent:
            self._blueprint_sent = True
            is_log = self._status.scan_time is not None
            layout = look.blueprint(self._bounds, gate=self._gate_told, safety=self._safety_told, scan_time=is_log)
            self._writer.stream.send_blueprint(layout)

    def _extend_trail(self, path: str, pose: Pose2) -> None:
        trail = self._trails[path]
        trail.extend(pose)
        if self._writer.due(path, _SLOW_PERIOD):
            self._writer.log(path, trail.strip())

    def _log_errors(self) -> None:
        """Log the pose errors once the true and the estimated pose of this tick are both there."""
        if self._true is None or self._believed is None or self._true[0] != self._believed[0]:
            return
        errors = distance(self._true[1], self._believed[1]), distance(self._true[1], self._believed[2])
        self._status.errors = errors
        if self._writer.due("errors", _POSE_PERIOD):
            self._writer.scalar("/plots/error/slam", errors[0])
            self._writer.scalar("/plots/error/odometry", errors[1])

    def _log_status(self) -> None:
        self._writer.markdown("/now", describe(self._status))

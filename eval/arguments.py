"""The arguments of this package's commands: fields are flags, their docstrings the help."""

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro

from vuca_nav.cli import optional
from vuca_nav.telemetry.options import ViewArguments


@dataclass(frozen=True)
class DialArguments:
    """How much moves, how fast, and how much of it sees the robot."""

    movers: Annotated[int | None, optional("N")] = None
    """Number of moving obstacles, in the worlds where things move; vuca list worlds shows the ranges."""
    speed: Annotated[float, tyro.conf.arg(metavar="FACTOR")] = 1.0
    """Factor on the speeds of the moving obstacles, 0 to 2.5."""
    sighted: Annotated[float | None, optional("SHARE")] = None
    """Share of the moving obstacles that see the robot and give way to it, 0 to 1; if left out, as the world has it:
    the pedestrians of building do, all else is blind."""

    def dials(self) -> dict[str, Any]:
        """The dials by name."""
        return {field.name: getattr(self, field.name) for field in fields(DialArguments)}


@dataclass(frozen=True)
class SceneArguments(DialArguments):
    """The place and the task of an episode."""

    world: str = "factory"
    """A world's name (see vuca list worlds), a scene file ending in .yaml, or a file of your own as map:FILE,
    barn:FILE, dynabarn:FILE or tracks:FILE (docs/your-own-map.md, docs/your-own-crowd.md)."""
    region: Annotated[int | None, optional("K")] = None
    """Number of quarters of the factory, 1 to 4."""
    seed: int = 0
    """Seed of the world, its moving obstacles and the sensors' noise."""
    without: str = ""
    """Difficulties left out: V moving obstacles, U the map unknown, C corridors, A noise of the sensors."""
    start: Annotated[tuple[float, float, float | None] | None, optional("X Y YAW")] = None
    """Start here instead [m, m, rad]; None as the yaw is a heading in which the body fits."""
    goal: Annotated[tuple[float, float] | None, optional("X Y")] = None
    """Go there instead [m]."""
    tolerance: Annotated[float | None, optional("M")] = None
    """Distance from the goal within which it counts as reached [m]; if left out, the world's own, or 0.3."""
    time_limit: Annotated[float | None, optional("S")] = None
    """Time limit [s]; if left out, the world's own, or one by the length of the shortest way."""
    obstacles: Annotated[str | None, optional("tracks:FILE")] = None
    """Recorded people who walk in it besides, as they walked (docs/your-own-crowd.md)."""
    unknown: Annotated[Literal["solid", "free", "unknown"] | None, optional("solid|free|unknown")] = None
    """What a map's unknown cells are: walls, as if left out; free floor; or free floor that is unknown to a robot
    with a map."""
    map: Annotated[str | None, optional("FILE.yaml")] = None
    """Give the robot this map, by ROS's map_server, as --save-map writes it; it goes on mapping. Its frame is the
    world's, a cell 0.05 m or a whole multiple or part of that."""


@dataclass(frozen=True)
class RobotArguments:
    """The robot, and the method that drives it."""

    robot: str = "tiago"
    """A robot's name (see vuca list robots), or mjcf:robot.yaml, a robot of your own (docs/your-own-robot.md)."""
    method: Annotated[str | None, optional("NAME")] = None
    """A method's name; vuca list methods shows them and which one is the default. module:build is a factory of your own
    (docs/methods.md)."""


@dataclass(frozen=True)
class OptionArguments:
    """What is changed of a method."""

    trust: bool = False
    """Run the Python of your own: of a method module:build, of motions in a scene file, of the drive of a robot."""
    policy: Annotated[Path | None, optional("FILE.safetensors")] = None
    """Drive by these weights instead of the method's own, as vuca train makes them."""
    gate: Annotated[str | None, optional("uniform")] = None
    """Give every expert the same share, instead of what the trained gate decides; for a fused policy."""
    without_expert: Annotated[int | None, optional("N")] = None
    """Leave expert N out (1 to 4, as in the paper); the others share what it had; for a fused policy."""
    no_shield: bool = False
    """Let the policy's commands through as they are; for a method with a shield."""
    critic: Annotated[Path | None, optional("FILE.safetensors")] = None
    """Rate exploration's candidates by this critic instead of the shipped one; for a method with V^h (see vuca train
    critic)."""
    gamma: Annotated[float | None, optional("G")] = None
    """Weight of V^h: extra way [m] that is worth it if it surely spares meeting a mover; for a method with V^h."""


@dataclass(frozen=True)
class MonitorArguments:
    """What stands between the method and the robot."""

    monitor: bool = False
    """Put the safety layer of a deployed robot under the method: it stops before what the body could not stop for
    (docs/safety.md). The row says in how many ticks it did what."""


@dataclass(frozen=True)
class DriverArguments(OptionArguments, RobotArguments):
    """The robot, the method that drives it, and what is changed of the method."""


@dataclass(frozen=True)
class EpisodeArguments(DriverArguments, SceneArguments):
    """Everything that an episode depends on."""


@dataclass(frozen=True)
class RunArguments(ViewArguments, MonitorArguments, EpisodeArguments):
    """Run one episode: a robot, a world it has no map of, a goal."""

    save_map: Annotated[Path | None, optional("FILE.yaml|DIR")] = None
    """Write the map that the robot has in the end, as ROS's map_server reads it: FILE.yaml, or DIR/map.yaml, with a PGM
    and a PNG beside it."""
    json: bool = False
    """End with one JSON object on stdout."""


@dataclass(frozen=True)
class ListArguments:
    """List the worlds, robots, methods or suites there are."""

    what: tyro.conf.Positional[Literal["worlds", "robots", "methods", "suites"]]
    """What to list."""
    json: bool = False
    """End with one JSON object on stdout."""


@dataclass(frozen=True, kw_only=True)
class EvalArguments(MonitorArguments, OptionArguments, DialArguments):
    """Run a suite of episodes on all cores; run it again, and it goes on where it was."""

    suite: Annotated[tyro.conf.Positional[str | None], optional("SUITE")] = None
    """A suite's name (see vuca list suites); none with --tasks."""
    out: Path
    """Directory of the results."""
    tasks: Annotated[Path | None, optional("FILE")] = None
    """Run these tasks instead: a file of tasks, or a folder of worlds, each with its own task
    (docs/your-own-map.md)."""
    robot: Annotated[str | None, optional("NAME,...")] = None
    """Robots, instead of the suite's own (see vuca list robots), or mjcf:robot.yaml of your own
    (docs/your-own-robot.md)."""
    method: Annotated[str | None, optional("NAME,...")] = None
    """Methods, instead of the suite's own (see vuca list methods), or module:build of your own (docs/methods.md). An
    option below goes to those that take it."""
    episodes: Annotated[int | None, optional("N")] = None
    """Only the first N episodes, of all robots, methods and tasks together: the first seed of each comes before the
    second. --seeds A:B runs B - A of each."""
    seeds: Annotated[str | None, optional("A:B")] = None
    """The seeds A to B - 1 instead of the suite's own."""
    workers: Annotated[int | None, optional("W")] = None
    """Number of processes; by default one for each core."""
    backend: Literal["local", "ray"] = "local"
    """Where the episodes run: on this computer, or on a Ray cluster, that of RAY_ADDRESS or one that is started here.
    The rows are the same."""
    record: Annotated[Literal["failures"] | None, optional("failures")] = None
    """Run the missions that failed once more and record them, into OUT/recordings."""
    json: bool = False
    """End with one JSON object on stdout, the summary."""


@dataclass(frozen=True)
class CompareArguments:
    """Compare methods in the episodes that they share: paired differences of each outcome."""

    folders: tyro.conf.Positional[tuple[Path, ...]]
    """Directories of vuca eval, complete or not, or files of kept rows; each method in them is compared with the
    first."""
    against: Annotated[str | None, optional("NAME")] = None
    """Compare with this method or directory instead of the first; named as in the tables."""
    seeds: Annotated[str | None, optional("A:B")] = None
    """Only the seeds A to B - 1."""
    json: bool = False
    """End with one JSON object on stdout, the differences."""


@dataclass(frozen=True, kw_only=True)
class ReportArguments:
    """Write a report of evaluations: one HTML page, Markdown, tables as CSV, figures, the paper's claims answered."""

    folders: tyro.conf.Positional[tuple[Path, ...]]
    """Directories of vuca eval, complete or not, or files of kept rows; their names name the pages. Beside them, files
    of measurements: moments.jsonl of vuca explain --all, gate.jsonl of python -m train.analysis.gate, and those of
    python -m eval.analysis.measurements.courses and of openness."""
    out: Path
    """Directory of the report, as docs/results: report.html, index.md with a page for each evaluation, tables/ and
    figures/; files of the same names are written over."""
    rows: bool = False
    """Keep the rows in OUT/rows as well, a compressed file for each suite, robot and method; going on with an
    evaluation adds to them."""
    json: bool = False
    """End with one JSON object on stdout, the files written."""


@dataclass(frozen=True)
class ExplainArguments:
    """Say why an episode failed: its contact, the last moment at which it was avoidable, a recording and a picture."""

    source: tyro.conf.Positional[Path]
    """Directory of a vuca eval, or a file that holds what vuca run --json printed."""
    seed: Annotated[tyro.conf.Positional[int | None], optional("SEED")] = None
    """Seed of the episode; it may be left out if the source holds one episode."""
    world: Annotated[str | None, optional("NAME")] = None
    """Its world, where the source holds the seed in several; the same with the options below."""
    region: Annotated[int | None, optional("K")] = None
    """Its region of the factory."""
    robot: Annotated[str | None, optional("NAME")] = None
    """Its robot."""
    method: Annotated[str | None, optional("NAME")] = None
    """Its method."""
    without: Annotated[str | None, optional("LETTERS")] = None
    """The difficulties that it leaves out."""
    movers: Annotated[int | None, optional("N")] = None
    """Its number of moving obstacles."""
    speed: Annotated[float | None, optional("FACTOR")] = None
    """Its factor on their speeds."""
    sighted: Annotated[float | None, optional("SHARE")] = None
    """Its share of them that see the robot."""
    task: Annotated[str | None, optional("NAME")] = None
    """Its task, of an evaluation of tasks."""
    all: bool = False
    """Find the last avoidable moment of every collision there is, without recordings and pictures; run again, it goes
    on where it was."""
    out: Annotated[Path | None, optional("DIR")] = None
    """Directory of the recording and the picture, or of all moments; by default "explained" beside the rows."""
    trust: bool = False
    """Run the Python that the row names: its method module:build, motions in its scene file, the drive of its robot."""
    json: bool = False
    """End with one JSON object on stdout: the row, t_inevitable, and the files written."""

    def filters(self) -> dict[str, Any]:
        """The fields that the row must have, by name."""
        names = ("world", "region", "robot", "method", "without", "movers", "speed", "sighted", "task")
        return {name: getattr(self, name) for name in names if getattr(self, name) is not None}


@dataclass(frozen=True, kw_only=True)
class HeatmapArguments(EpisodeArguments):
    """Draw V^h around the robot at one moment of a run: the critic's value of every place as a goal."""

    out: Path
    """The picture, a PNG file."""
    at: float = 20.0
    """Moment of the run [s]; if it is over earlier, its last one."""
    method: Annotated[str | None, optional("NAME")] = None
    """A method with V^h (see vuca list methods): it drives, and its critic is asked; by default ours."""
    half_side: float = 8.0
    """Half the side of the square that is drawn [m]."""
    resolution: float = 0.1
    """Distance between two places asked about [m]."""
    json: bool = False
    """End with one JSON object on stdout."""


@dataclass(frozen=True)
class BenchArguments:
    """Measure speed: ratios against named references, real-time factor, time of each stage."""

    json: bool = False
    """End with one JSON object on stdout."""

"""What the commands of this package can be told: their fields are the flags, their docstrings the help."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro


@dataclass(frozen=True)
class SceneArguments:
    """Where an episode is, and what it asks for."""

    world: str = "factory"
    """A world's name (see vuca list worlds), or a scene file ending in .yaml."""
    region: Annotated[int | None, tyro.conf.arg(metavar="K")] = None
    """How many quarters of the factory, 1 to 4."""
    seed: int = 0
    """Of the world, its moving obstacles and the sensors' noise."""
    without: str = ""
    """Difficulties left out: V moving obstacles, U the map unknown, C corridors, A noise of the sensors."""
    movers: Annotated[int | None, tyro.conf.arg(metavar="N")] = None
    """How many moving obstacles, in the worlds that let one choose."""
    start: Annotated[tuple[float, float, float] | None, tyro.conf.arg(metavar="X Y YAW")] = None
    """Start here instead [m, m, rad]."""
    goal: Annotated[tuple[float, float] | None, tyro.conf.arg(metavar="X Y")] = None
    """Go there instead [m]."""


@dataclass(frozen=True)
class DriverArguments:
    """What drives, and by what."""

    robot: str = "tiago"
    """A robot's name (see vuca list robots)."""
    method: Annotated[str | None, tyro.conf.arg(metavar="NAME")] = None
    """A method's name (see vuca list methods); by default the best there is."""
    policy: Annotated[Path | None, tyro.conf.arg(metavar="FILE.safetensors")] = None
    """Drive by these weights instead of the method's own."""
    gamma: Annotated[float | None, tyro.conf.arg(metavar="G")] = None
    """How much longer a way may be if that surely spares meeting somebody [m], for a method that has V^h."""
    safety: Annotated[Path | None, tyro.conf.arg(metavar="FILE.safetensors")] = None
    """Rate the ways by this critic instead of the shipped one, for a method that has V^h (see vuca train critic)."""


@dataclass(frozen=True)
class EpisodeArguments(DriverArguments, SceneArguments):
    """All that an episode depends on."""


@dataclass(frozen=True)
class RunArguments(EpisodeArguments):
    """Run one episode: a robot, a world it has no map of, a goal."""

    record: Annotated[Path | None, tyro.conf.arg(metavar="FILE.rrd")] = None
    """Record the run for the Rerun viewer."""
    spawn: bool = False
    """Show the run in a Rerun viewer as it happens."""
    serve: bool = False
    """Show the run in a browser as it happens."""
    json: bool = False
    """End with one JSON object on stdout."""


@dataclass(frozen=True)
class ListArguments:
    """List the worlds, robots, methods or suites there are."""

    what: tyro.conf.Positional[Literal["worlds", "robots", "methods", "suites"]]
    """What to list."""
    json: bool = False
    """As one JSON object."""


@dataclass(frozen=True, kw_only=True)
class EvalArguments(DriverArguments):
    """Run a suite of episodes on all cores; run it again, and it goes on where it was."""

    suite: tyro.conf.Positional[str]
    """A suite's name (see vuca list suites)."""
    out: Path
    """Directory of the results."""
    episodes: Annotated[int | None, tyro.conf.arg(metavar="N")] = None
    """Only the first N episodes."""
    seeds: Annotated[str | None, tyro.conf.arg(metavar="A:B")] = None
    """The seeds A to B - 1 instead of the suite's own."""
    workers: Annotated[int | None, tyro.conf.arg(metavar="W")] = None
    """Number of processes; by default one for each core."""
    json: bool = False
    """End with one JSON object on stdout, the summary."""


@dataclass(frozen=True, kw_only=True)
class HeatmapArguments(EpisodeArguments):
    """Draw what the critic makes of every place around the robot as a goal, V^h, at one moment of a run."""

    out: Path
    """The picture, a PNG file."""
    at: float = 20.0
    """Moment of the run [s]; if it is over earlier, its last one."""
    method: Annotated[str | None, tyro.conf.arg(metavar="NAME")] = None
    """A method with V^h (see vuca list methods): it drives, and its critic is asked; by default the best there is."""
    half_side: float = 8.0
    """Of the square that is drawn [m]."""
    resolution: float = 0.1
    """Between two places asked about [m]."""
    json: bool = False
    """End with one JSON object on stdout."""


@dataclass(frozen=True)
class BenchArguments:
    """Measure speed: ratios against named references, real-time factor, time of each stage."""

    json: bool = False
    """End with one JSON object on stdout."""

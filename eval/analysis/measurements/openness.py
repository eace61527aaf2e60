"""Whether V^h is higher where there is more space: the heatmap of Zhang et al., Section III-C, at many moments.

``python -m eval.analysis.measurements.openness --method ours --seeds 3000:3020 --out FILE.jsonl`` drives missions, and
every ten seconds asks the critic about the free places in sight of the robot. V^h and the places' true clearance are
compared by Spearman's rank correlation, also with the distance from the robot held fixed (a partial correlation of the
ranks): a critic that knows nothing but how far a place is would not pass that.
"""

import base64
import math
import shlex
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
import tyro
from numpy.typing import NDArray

from eval.analysis.measurements.courses import scene_row
from eval.analysis.measurements.files import measure
from eval.episode import Episode, EpisodeConfig
from eval.methods import BEST_WITH_CRITIC, is_users_own
from eval.suites import parse_seeds
from robots.simulation import Simulation
from vuca_nav.cli import optional, run_module
from vuca_nav.errors import BadArgument
from vuca_nav.exploration.heatmap import SafetyMap
from vuca_nav.exploration.heuristic import LEAST, Critic, NoCritic
from vuca_nav.files import prepare_file
from vuca_nav.geometry import transform_points
from vuca_nav.navigator import Navigator
from vuca_nav.telemetry.interface import Telemetry
from vuca_nav.types import FloatArray, Pose2
from worlds.arrays import pack_shapes
from worlds.clearance import clearance_at
from worlds.world import Shape

KIND = "heatmap"
HALF_SIDE = 6.0
"""Half the side of the square about the robot whose places are asked about [m]: half the range of the lidars."""
SPACING = 0.4
"""Distance between two places [m]: 961 of them in the square."""
DRAWN = 0.25
"""Distance between two places of the view that is kept for a picture [m]."""
LEAST_PLACES = 30
"""Least number of places in sight of a moment that counts."""
LEVELS = 255


class Moment(NamedTuple):
    """The places in sight of a robot at one moment; n of them."""

    values: FloatArray
    """V^h (n,)."""
    clearance: FloatArray
    """True distance to the nearest obstacle, standing or moving (n,) [m]."""
    distance: FloatArray
    """Distance from the robot (n,) [m]."""


def correlations(moment: Moment) -> tuple[float | None, float | None]:
    """Spearman's rank correlation of V^h and clearance, and the same with the distance from the robot held fixed.

    Returns:
        The two correlations, None where one of the quantities does not vary.
    """
    from scipy.stats import rankdata  # late: it takes a second to import

    values, clearance, distance = (rankdata(each) for each in moment)
    plain = _correlation(values, clearance)
    by_distance = _correlation(values, distance), _correlation(clearance, distance)
    if plain is None:
        return None, None
    if None in by_distance:
        return plain, None
    a, b = (float(each or 0.0) for each in by_distance)
    rest = math.sqrt(max((1.0 - a * a) * (1.0 - b * b), 0.0))
    return plain, (plain - a * b) / rest if rest > 1e-9 else None


def _correlation(first: FloatArray, second: FloatArray) -> float | None:
    a, b = first - first.mean(), second - second.mean()
    spread = math.sqrt(float(a @ a) * float(b @ b))
    return float(a @ b) / spread if spread > 0.0 else None


class _MoverPoses(Telemetry):
    """Keeps the true poses of the movers' parts."""

    def __init__(self) -> None:
        self.poses: FloatArray = np.zeros((0, 3))

    def movers(self, poses: FloatArray) -> None:
        self.poses = poses.copy()


def openness_of(config: EpisodeConfig, *, every: float) -> dict[str, Any]:
    """Drive an episode, and compare V^h with the clearance of places in sight at many moments.

    Args:
        config: The episode; its method has a critic.
        every: Time between two moments [s].

    Returns:
        The episode's own fields; ``moments``, each with ``time`` [s], the number of ``places``, ``correlation`` and
        ``at_same_distance``; ``view``: V^h over the square about the robot at the second moment, or the only one, for a
        picture; None without any.

    Raises:
        BadArgument: The method has no critic.
    """
    episode, telemetry = Episode(config), _MoverPoses()
    simulation, navigator, scan, odometry = episode.begin(telemetry)
    critic = critic_of(navigator, config)
    assert isinstance(navigator, Navigator)
    standing = [obstacle.shape for obstacle in episode.world.obstacles]
    parts = [part.shape for mover in episode.world.movers for part in mover.parts]
    moments: list[dict[str, Any]] = []
    view = None
    while episode.judge(simulation) is None:
        command = navigator.step(scan, odometry)
        percept = navigator.percept
        if simulation.time >= every * (len(moments) + 1) - 1e-9 and percept is not None:
            shapes = [*standing, *_placed(parts, telemetry.poses)]
            seen, places = _look(navigator, critic, simulation, shapes)
            plain, partial_ = correlations(seen) if places >= LEAST_PLACES else (None, None)
            told = {"correlation": plain, "at_same_distance": partial_}
            moments.append({"time": round(simulation.time, 3), "places": places, **told})
            if len(moments) <= 2:
                view = _view(navigator, critic, simulation, shapes, episode)
        scan, odometry = simulation.step(command)
    return {**config.row(), "moments": moments, "view": view}


def critic_of(navigator: object, config: EpisodeConfig) -> Critic:
    """The critic of a stack.

    Raises:
        BadArgument: It has none.
    """
    critic = navigator.explorer.critic if isinstance(navigator, Navigator) else NoCritic()
    if isinstance(critic, NoCritic):
        raise BadArgument(f"method {config.method!r} has no critic; take one with V^h, such as {BEST_WITH_CRITIC!r}")
    return critic


def _placed(parts: Sequence[Shape], poses: FloatArray) -> list[Shape]:
    """The movers' parts where they are, those that are nowhere left out; a part's offset is in its pose already."""
    found = zip(parts, poses.tolist(), strict=True)
    return [_moved(shape, pose) for shape, pose in found if all(map(math.isfinite, pose))]


def _moved(shape: Shape, pose: list[float]) -> Shape:
    x, y, yaw = pose
    return replace(shape, x=x, y=y, **({"yaw": yaw} if hasattr(shape, "yaw") else {}))


def _grid(spacing: float) -> FloatArray:
    """The middles of square cells over the square about the robot, row by row, (n, 2) [m]."""
    cells = round(2.0 * HALF_SIDE / spacing)
    offsets = (np.arange(cells) + 0.5 - 0.5 * cells) * spacing
    x, y = np.meshgrid(offsets, offsets)
    return np.column_stack([x.ravel(), y.ravel()]).astype(np.float64)


def _look(navigator: Navigator, critic: Critic, simulation: Simulation, shapes: Sequence[Shape]) -> tuple[Moment, int]:
    """What the critic makes of the free places in sight, and their number."""
    places, percept, pose = _grid(SPACING), navigator.percept, navigator.map_from_base
    assert percept is not None
    packed = pack_shapes(shapes)
    in_world = transform_points(simulation.true_pose, places)
    clearance = np.array([clearance_at(packed, x, y)[0] for x, y in in_world.tolist()])
    distance = np.hypot(*places.T)
    mask = (clearance > 0.0) & (distance < percept.ring[_beams(places, len(percept.ring))])
    values = critic.values(transform_points(pose, places[mask]), percept, pose)
    return Moment(values, clearance[mask], distance[mask]), int(mask.sum())


def _beams(places: FloatArray, num_beams: int) -> NDArray[np.int64]:
    """The beam of a ring that goes to each place, (n,)."""
    angles = np.arctan2(places[:, 1], places[:, 0])
    return np.round((angles + math.pi) / (2.0 * math.pi) * num_beams).astype(np.int64) % num_beams


def _view(
    navigator: Navigator, critic: Critic, simulation: Simulation, shapes: Sequence[Shape], episode: Episode
) -> dict[str, Any]:
    """V^h over the square about the robot, along the world's axes, in 255 steps of its scale."""
    percept, pose, (x, y, yaw) = navigator.percept, navigator.map_from_base, simulation.true_pose
    assert percept is not None
    in_base = transform_points(Pose2(0.0, 0.0, -yaw), _grid(DRAWN))
    values = critic.values(transform_points(pose, in_base), percept, pose)
    low, high = SafetyMap(values, (0.0, 0.0), DRAWN).scale
    levels = np.round(LEVELS * np.clip((values - low) / max(high - low, LEAST), 0.0, 1.0)).astype(np.uint8)
    movers = pack_shapes(shapes[len(episode.world.obstacles) :])
    radii = np.where(movers.is_cylinder, movers.half[:, 0], movers.half.mean(axis=1))
    return {
        "time": round(simulation.time, 3),
        "pose": [round(x, 2), round(y, 2), round(yaw, 3)],
        "half_side": HALF_SIDE,
        "scale": [low, high],
        "levels": base64.b64encode(levels.tobytes()).decode(),
        "movers": np.round(np.column_stack([movers.centre, radii]), 2).tolist(),
        "scene": _near(scene_row(episode.world), x, y),
    }


def _near(scene: dict[str, Any], x: float, y: float) -> dict[str, Any]:
    """The part of a scene that reaches into the square about a place."""

    def reaches(shape: list[float]) -> bool:
        size = shape[2] if len(shape) == 3 else 0.5 * math.hypot(shape[3], shape[4])
        return max(abs(shape[0] - x), abs(shape[1] - y)) < HALF_SIDE + size

    return {**scene, **{name: list(filter(reaches, scene[name])) for name in ("boxes", "cylinders")}}


def levels_of(view: dict[str, Any]) -> NDArray[np.floating]:
    """V^h of a view (rows y, columns x), as shares of its scale.

    Raises:
        BadArgument: It is no view.
    """
    try:
        levels = np.frombuffer(base64.b64decode(view["levels"], validate=True), np.uint8)
        side = math.isqrt(len(levels))
        return levels.reshape(side, side) / LEVELS
    except (KeyError, TypeError, ValueError) as error:
        raise BadArgument(f"a heatmap's view is damaged: {error}") from error


@dataclass(frozen=True, kw_only=True)
class OpennessArguments:
    """Compare V^h with the space around places, at many moments of many missions.

    Each mission is driven by its method, and every so often the method's critic is asked about the free places in sight
    of the robot, 0.4 m apart, up to 6 m aside. V^h and the true distance of each place to the nearest obstacle,
    standing or moving, are compared by Spearman's rank correlation. vuca report takes the file beside evaluations.
    """

    seeds: str
    """The missions' seeds, A:B for A to B - 1."""
    out: Path
    """The file of measurements, as runs/heatmap-tiago-ours.jsonl; begun again, it goes on where it was."""
    method: str = BEST_WITH_CRITIC
    """A method with V^h (see vuca list methods)."""
    robot: str = "tiago"
    """A robot's name (see vuca list robots)."""
    world: str = "factory"
    """A world's name (see vuca list worlds), or a scene file ending in .yaml."""
    region: Annotated[int | None, tyro.conf.arg(metavar="K", help_behavior_hint="4 in the factory")] = None
    """Number of quarters of the factory."""
    every: float = 10.0
    """Time between two moments [s]."""
    workers: Annotated[int | None, optional("W")] = None
    """Number of processes; by default one for each core."""


def main(arguments: OpennessArguments) -> None:
    """Drive, ask and write.

    Raises:
        VucaError: The missions cannot be run, the method has no critic, or the file cannot be written or gone on with.
    """
    if not 0.1 <= arguments.every < math.inf:
        raise BadArgument(f"--every must be 0.1 or more, got {arguments.every}")
    seeds = parse_seeds(arguments.seeds)
    region = 4 if arguments.region is None and arguments.world == "factory" else arguments.region
    config = EpisodeConfig(arguments.world, region, arguments.robot, arguments.method)
    if is_users_own(config.method):
        raise BadArgument("a method of your own has no critic that is known here; take one such as 'ours'")
    prepare_file(arguments.out)
    critic_of(Episode(replace(config, seed=seeds[0])).build(Telemetry())[1], config)  # before an hour is spent
    configs = [replace(config, seed=seed) for seed in seeds]
    command = shlex.join(["python", "-m", "eval.analysis.measurements.openness", *sys.argv[1:]])
    settings = {"every": arguments.every, "half_side": HALF_SIDE, "spacing": SPACING}
    job = partial(openness_of, every=arguments.every)
    rows, crashes = measure(
        arguments.out, KIND, configs, job, workers=arguments.workers, command=command, settings=settings
    )
    found = [m["correlation"] for row in rows for m in row["moments"] if m["correlation"] is not None]
    mean = f", mean rank correlation {sum(found) / len(found):+.2f}" if found else ""
    print(f"{len(found)} moments of {len(rows)} missions{mean}: {arguments.out}")
    if crashes:
        raise BadArgument(f"{len(crashes)} missions could not be run; give the same command again")


if __name__ == "__main__":
    run_module("openness", main, OpennessArguments)

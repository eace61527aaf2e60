"""One episode: a world, a robot, a method and a seed give one result."""

import math
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal

import numpy as np

from eval.baselines.oracle.truth import Truth
from eval.contact import Contact, classify_contact
from eval.failure import Failure, Trail, classify_failure, is_out_of_reach
from eval.methods import BEST, UNCHANGED, MethodOptions, build, resolve
from eval.metrics import Metrics, MetricsRecorder
from eval.monitored import Monitored
from eval.prior_map import rasterise, read_prior_map
from robots.arithmetic import fingerprint
from robots.bodies.body import Body
from robots.noise import NoiseConfig
from robots.registry import make_body
from robots.simulation import Simulation
from vuca_nav.errors import BadArgument
from vuca_nav.geometry import distance, wrap_angle
from vuca_nav.mapping.grid import OccupancyGrid
from vuca_nav.stack import Stack
from vuca_nav.task import time_limit
from vuca_nav.telemetry.interface import Telemetry
from vuca_nav.types import Odometry, Scan
from vuca_nav.wire import round_pose
from worlds.checks import check_task, fitting_heading
from worlds.importers.sources import Bringing, is_brought, with_task
from worlds.registry import make_world, ordered_difficulties
from worlds.world import World

Outcome = Literal["success", "collision", "fall", "timeout"]
OUTCOMES: tuple[Outcome, ...] = ("success", "collision", "fall", "timeout")
REFUSED = "refused"
"""The outcome of a task that cannot be run: a row says why, and the evaluation goes on."""
MOVED = 0.1
"""Distance from the start from which on the robot has moved [m], as in BARN."""
Progress = Callable[[float, float], None]
"""Called with the simulated time [s] and the true distance to the goal [m] after every step."""


@dataclass(frozen=True, slots=True)
class EpisodeConfig:
    """Everything an episode depends on."""

    world: str = "factory"
    """A world's name, a scene file ending in .yaml, or a file of another kind as ``map:FILE``."""
    region: int | None = None
    """Number of quarters of the factory."""
    robot: str = "tiago"
    """A robot's name, or ``mjcf:`` and the path of a robot's file."""
    method: str = BEST
    """A method's name, or ``module:build``: a factory in a module that is then imported."""
    seed: int = 0
    """Seed of the world's layout, of its movers and of the sensors' noise."""
    without: str = ""
    """Difficulties left out: V moving obstacles, U the map unknown, C corridors, A noise of the sensors."""
    movers: int | None = None
    """Number of moving obstacles, where things move."""
    speed: float = 1.0
    """Factor on the speeds of the moving obstacles."""
    sighted: float | None = None
    """Share of the moving obstacles that see the robot and give way to it; None: as the world has it."""
    start: tuple[float, float, float | None] | None = None
    """Start instead of the world's own: x [m], y [m], yaw [rad]; without a yaw the heading in which the body fits that
    is nearest to the goal's direction, where there is a goal."""
    goal: tuple[float, float] | None = None
    """Goal instead of the world's own [m]."""
    tolerance: float | None = None
    """Distance from the goal within which it counts as reached, instead of the world's own [m]."""
    time_limit: float | None = None
    """Time limit instead of the world's own [s]."""
    obstacles: str | None = None
    """``tracks:FILE``: recorded people in the world besides."""
    unknown: str | None = None
    """What a map's unknown cells are: solid (None as well), free or unknown."""
    map: str | None = None
    """YAML file of a map that the stack is given beforehand."""
    trust: bool = False
    """Whether motions of the user's own, in a scene file, may be run. No row says so."""
    options: MethodOptions = UNCHANGED
    """Changes to the method."""

    def __post_init__(self) -> None:
        """Raise BadArgument for a negative seed, an unknown difficulty, a start or goal that is not finite."""
        if self.seed < 0:
            raise BadArgument(f"the seed must be 0 or more, got {self.seed}")
        dials = (self.speed, 0.0 if self.sighted is None else self.sighted)
        for name, numbers in (
            ("start", self.start),
            ("goal", self.goal),
            ("speed", dials[:1]),
            ("sighted", dials[1:]),
            ("tolerance", (self.tolerance or 0.0,)),
            ("time-limit", (self.time_limit or 0.0,)),
        ):
            for number in numbers or ():
                if number is not None and not math.isfinite(number):
                    raise BadArgument(f"--{name}: {number} is not a finite number")
        for name, number, most in (("tolerance", self.tolerance, 100.0), ("time-limit", self.time_limit, 1e5)):
            if number is not None and not 0.0 < number <= most:
                raise BadArgument(f"--{name} {number:g}: a number above 0, up to {most:g}, would be right")
        if self.map is not None and "U" in self.without:
            raise BadArgument(f"--map {self.map} and --without U, which gives the true map, exclude each other")
        object.__setattr__(self, "without", ordered_difficulties(self.without))

    def row(self) -> dict[str, Any]:
        """The configuration as JSON holds it, flat: tuples are lists, and the options stand beside the rest."""
        own = asdict(self)
        own |= own.pop("options")
        del own["trust"]
        return {key: list(v) if isinstance(v, tuple) else v for key, v in own.items()}


CONFIG_FIELDS = tuple(EpisodeConfig().row())
"""The fields of a row that say which episode it is of."""
ADDED_FIELDS = {"monitor": False, "map": None}
"""Those of them that rows of earlier versions lack, with what they stood for."""


@dataclass(frozen=True, slots=True)
class EpisodeResult:
    """The result of an episode."""

    config: EpisodeConfig
    outcome: Outcome
    arriving_time: float | None
    """Simulated time at which the goal was reached; None if it was not [s]."""
    duration: float
    """Simulated time at which the episode ended [s]."""
    shortest_path: float
    """Length of the shortest path for the body's footprint, moving obstacles left out [m]."""
    collided_with: str | None
    """Kind of the obstacle or mover that the robot touched, "wall" or "cart" for example."""
    contact: Contact | None
    """How the contact came about; None without one."""
    failure: Failure | None
    """Why the mission did not arrive without a contact; None if it arrived or touched something."""
    why: str | None
    """What the stack itself found out about the goal that it did not reach: that no way leads there; else None."""
    monitor_ticks: dict[str, int] | None
    """Number of ticks by what the safety layer did, or which faults it saw; None without ``--monitor``."""
    judged_tolerance: float
    """Distance from the goal within which it counted as reached [m]."""
    judged_time_limit: float
    """Time limit of the mission [s]."""
    judged_by_motion: bool
    """Whether the time limit counted from the robot's first motion."""
    moved_after: float | None
    """Simulated time at which the robot had moved 0.1 m; None if it never did [s]."""
    way: str | None
    """The first of the world's ways to the goal that the robot entered; None if the world names none, or it did not."""
    arithmetic: str
    """Fingerprint of the machine's arithmetic (``robots.arithmetic``): rows of different ones differ in their bits."""
    metrics: Metrics
    real_time_factor: float
    """Simulated time over the loop's wall time, the whole loop in one process: physics, sensors and stack."""
    wall_time: float
    """Wall time of the loop [s]."""
    set_up_time: float
    """Wall time of building the world, the body and the stack [s]."""

    def row(self) -> dict[str, Any]:
        """The result as one JSON object, flat but for ``contact`` and ``failure``; what is not finite is None."""
        own = asdict(self)
        own["contact"] = None if self.contact is None else self.contact.row()
        own["failure"] = None if self.failure is None else self.failure.row()
        metrics = own.pop("metrics")
        own.pop("config")
        flat = {**self.config.row(), **own, **metrics}
        return {k: None if isinstance(v, float) and not math.isfinite(v) else v for k, v in flat.items()}


class Episode:
    """A task and a body that has to do it, checked and ready to run.

    Args:
        config: The episode to build.
        wants_map: Whether the stack's map is wanted in the end.

    Raises:
        VucaError: A name is unknown, an argument is out of range, or start or goal cannot be used.

    Attributes:
        map: The stack's map at the end of the last run, if it is wanted; None before.
    """

    def __init__(self, config: EpisodeConfig, *, wants_map: bool = False):
        began = time.perf_counter()
        self.config = config
        self._wants_map = wants_map
        self.map: OccupancyGrid | None = None
        self.method = resolve(config.method, config.options)
        self.body = make_body(config.robot, trust=config.trust)
        self.world = _make_task(config, self.body)
        self.shortest_path = check_task(
            self.world,
            self.body.spec.footprint,
            config.world if is_brought(config.world) else "",
            self.body.height,
            self.world.tolerance,
        )
        self.timeout = self.world.time_limit or time_limit(self.shortest_path, self.body.spec.max_v_x)
        self._moved_after: float | None = None
        self._prior_map: OccupancyGrid | None = None
        if config.map is not None:
            self._prior_map = read_prior_map(config.map)
        elif "U" in config.without:
            self._prior_map = rasterise(self.world, self.body.height)
        self._set_up_time = time.perf_counter() - began

    def simulation(self, telemetry: Telemetry) -> Simulation:
        """The side of the loop that knows the truth."""
        (sensors_seed,) = np.random.SeedSequence(self.config.seed).spawn(1)
        ambiguous = "A" not in self.config.without
        return Simulation(
            self.world,
            self.body,
            sensors_seed,
            noise=NoiseConfig() if ambiguous else NoiseConfig.none(),
            telemetry=telemetry,
            perfect_odometry=not ambiguous,
        )

    def build(self, telemetry: Telemetry) -> tuple[Simulation, Stack]:
        """The two sides of the loop: the simulation and the stack."""
        localisation = "slam" if "A" not in self.config.without else "odometry"
        simulation = self.simulation(telemetry)
        truth = Truth(self.world, self.body, simulation)
        body, lidar = self.body.spec, self.body.lidar
        stack = build(self.method, body, lidar, localisation, telemetry, truth)
        return simulation, Monitored(stack, body, lidar, simulation.rate) if self.config.options.monitor else stack

    def begin(self, telemetry: Telemetry) -> tuple[Simulation, Stack, Scan, Odometry]:
        """Both sides ready for the first step, and the robot's first readings."""
        simulation, navigator = self.build(telemetry)
        scan, odometry = simulation.reset()
        navigator.tolerance, self._moved_after = self.world.tolerance, None
        navigator.reset(self.world.start, self.world.goal, self._prior_map)
        return simulation, navigator, scan, odometry

    def run(self, telemetry: Telemetry | None = None, progress: Progress | None = None) -> EpisodeResult:
        """Drive until success, collision, fall or timeout.

        Args:
            telemetry: Listens to the simulation and to the stack.
            progress: Called after every step.
        """
        began = time.perf_counter()
        telemetry = telemetry or Telemetry()
        telemetry.goal_tolerance = self.world.tolerance
        goal = self.world.goal
        simulation, navigator, scan, odometry = self.begin(telemetry)
        if self._wants_map and navigator.grid is None:
            raise BadArgument(f"--save-map: method {self.config.method} keeps no map; one with SLAM would be right")
        recorder = MetricsRecorder(self.world.start, goal, self.shortest_path, self.world.tolerance)
        trail = Trail()
        set_up_time = self._set_up_time + time.perf_counter() - began

        began = time.perf_counter()
        outcome: Outcome | None = None
        way: str | None = None
        while outcome is None:
            command = navigator.step(scan, odometry)
            recorder.add(
                scan,
                odometry.odom_from_base,
                simulation.true_pose,
                navigator.map_from_base,
                simulation.clearance,
            )
            trail.add(simulation.time, simulation.true_pose)
            scan, odometry = simulation.step(command)
            to_goal = distance(simulation.true_pose, goal)
            outcome = self.judge(simulation)
            way = way or self.world.way_of(simulation.true_pose)
            if progress is not None:
                progress(simulation.time, to_goal)
        wall_time = time.perf_counter() - began
        self.map = navigator.grid if self._wants_map else None

        success = outcome == "success"
        touched = f" with {simulation.contact_name}" if simulation.contact_name else ""
        telemetry.event(f"{outcome}{touched}", "INFO" if success else "ERROR")
        metrics = recorder.finish(simulation.true_pose, simulation.clearance, success)
        facts = simulation.contact_facts
        return EpisodeResult(
            config=self.config,
            outcome=outcome,
            arriving_time=simulation.time if success else None,
            duration=simulation.time,
            shortest_path=self.shortest_path,
            collided_with=simulation.contact,
            contact=None if facts is None else classify_contact(facts),
            failure=self._why(outcome, simulation, trail, metrics),
            why=None if success else navigator.finding,
            monitor_ticks=dict(navigator.actions) if isinstance(navigator, Monitored) else None,
            judged_tolerance=self.world.tolerance,
            judged_time_limit=self.timeout,
            judged_by_motion=self.world.starts_on_motion,
            moved_after=self._moved_after,
            way=way,
            arithmetic=fingerprint(),
            metrics=metrics,
            real_time_factor=simulation.time / wall_time,
            wall_time=wall_time,
            set_up_time=set_up_time,
        )

    def _why(self, outcome: Outcome, simulation: Simulation, trail: Trail, metrics: Metrics) -> Failure | None:
        """Why the mission ended by a fall or out of time; None if it did not."""
        if outcome not in ("fall", "timeout"):
            return None
        fallen = outcome == "fall"
        return classify_failure(
            fallen=fallen,
            out_of_reach=not fallen and is_out_of_reach(self.world, self.body, self.timeout),
            slam_error=metrics.slam_final_error,
            time=simulation.time,
            end=simulation.true_pose,
            trail=trail,
            way=metrics.path_length,
            shortest=self.shortest_path,
        )

    def judge(self, simulation: Simulation) -> Outcome | None:
        """Outcome of the episode, None while it goes on. A contact in the last step still counts.

        It has to be asked after every step: a time limit may count from the robot's first motion.
        """
        if self._moved_after is None and distance(simulation.true_pose, self.world.start) >= MOVED:
            self._moved_after = simulation.time
        if simulation.contact is not None:
            return "collision"
        if simulation.fallen:
            return "fall"
        if distance(simulation.true_pose, self.world.goal) <= self.world.tolerance:
            return "success"
        began = (self._moved_after or 0.0) if self.world.starts_on_motion else 0.0
        return "timeout" if simulation.time - began >= self.timeout else None


def run_episode(config: EpisodeConfig, telemetry: Telemetry | None = None) -> EpisodeResult:
    """Build and run one episode.

    Raises:
        VucaError: The configuration cannot be used.
    """
    return Episode(config).run(telemetry)


def bringing_of(config: EpisodeConfig) -> Bringing:
    """How the world of an episode is brought in."""
    start = config.start
    if start is not None:
        x, y, yaw = start
        if yaw is None:
            yaw = 0.0 if config.goal is None else math.atan2(config.goal[1] - y, config.goal[0] - x)
        start = x, y, yaw
    return Bringing(
        start,
        config.goal,
        config.tolerance,
        config.time_limit,
        config.unknown or "solid",
        config.obstacles,
        trust=config.trust,
    )


def _make_task(config: EpisodeConfig, body: Body) -> World:
    """The world with the start and the goal that are asked for; the start's yaw as a message carries it."""
    bringing = bringing_of(config)
    world = make_world(
        config.world,
        config.seed,
        region=config.region,
        movers=config.movers,
        speed=config.speed,
        sighted=config.sighted,
        without=config.without,
        footprint_radius=body.spec.radius,
        height=body.height,
        bringing=bringing,
    )
    world = with_task(world, bringing)
    start = world.start
    if config.start is not None and config.start[2] is None:
        start = start._replace(yaw=fitting_heading(world, body.spec.footprint, body.height))
    if abs(start.yaw) > math.pi:
        start = start._replace(yaw=wrap_angle(start.yaw))
    return replace(world, start=round_pose(start))

"""Times of perception, policy and shield: crowded episodes are recorded, played back to them and timed."""

import time
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eval.bench.timing import Result, best_of, result
from eval.episode import Episode, EpisodeConfig
from robots.registry import make_body
from vuca_nav.exploration.critic import SHIPPED, LearnedCritic, load_critic
from vuca_nav.navigator import Navigator
from vuca_nav.perception.percept import Percept
from vuca_nav.perception.perception import Perception
from vuca_nav.policy.base import LocalGoal, LocalPolicy
from vuca_nav.policy.learned import LearnedPolicy
from vuca_nav.policy.weights_file import WEIGHTS_FOLDER, load_weights
from vuca_nav.shield.shield import Shield
from vuca_nav.telemetry.interface import Telemetry
from vuca_nav.types import Odometry, Pose2, Scan, VelocityCommand

CROWD = EpisodeConfig(world="square", movers=24, method="ours")
CROWD_TIME = 60.0
"""Least time that is simulated [s]."""
REPEATS = 3
"""Number of times that each tick is played back; the least disturbed one counts."""
TICK = 1000.0 / 30.0
"""Time until the next scan [ms]."""
CANDIDATES, CALLS = 200, 200
"""Number of points that V^h is asked about at once, and of such calls."""
POLICY_LIMIT, CRITIC_LIMIT = 0.3, 2.0
"""Goals: a step of a policy, V^h of ``CANDIDATES`` points [ms]."""


class Tick(NamedTuple):
    """The sensors' readings and the local goal at a tick."""

    scan: Scan
    odometry: Odometry
    goal: LocalGoal | None
    """The local goal; None where the body had to stand."""


class Tape(LocalPolicy):
    """Keeps the goals that another policy is given."""

    def __init__(self, policy: LocalPolicy):
        self.policy = policy
        self.goals: list[LocalGoal | None] = []

    def reset(self) -> None:
        """Reset the other policy."""
        self.policy.reset()

    def command(self, percept: Percept, goal: LocalGoal | None) -> VelocityCommand:
        """Keep the goal and pass it on."""
        self.goals.append(goal)
        return self.policy.command(percept, goal)


class Timed(LocalPolicy):
    """Times another policy."""

    def __init__(self, policy: LocalPolicy):
        self.policy = policy
        self.seconds = 0.0
        """Time of the policy since this was last set to 0 [s]."""

    def reset(self) -> None:
        """Reset the other policy."""
        self.policy.reset()

    def command(self, percept: Percept, goal: LocalGoal | None) -> VelocityCommand:
        """Pass the request on and time it."""
        began = time.perf_counter()
        command = self.policy.command(percept, goal)
        self.seconds += time.perf_counter() - began
        return command


def record(config: EpisodeConfig, least: float) -> list[list[Tick]]:
    """Record the lower layer's input in episodes, one seed after the other, until enough time has been simulated.

    Args:
        config: Configuration of the first episode.
        least: Least time to simulate [s].
    """
    tapes: list[list[Tick]] = []
    simulated = 0.0
    while simulated < least:
        episode = Episode(replace(config, seed=config.seed + len(tapes)))
        simulation, navigator, scan, odometry = episode.begin(Telemetry())
        assert isinstance(navigator, Navigator)
        tape = Tape(navigator.policy)
        navigator.policy = tape
        sensed: list[tuple[Scan, Odometry]] = []
        while episode.judge(simulation) is None:
            sensed.append((Scan(scan.stamp, scan.ranges.copy()), odometry))
            scan, odometry = simulation.step(navigator.step(scan, odometry))
        tapes.append([Tick(*pair, goal) for pair, goal in zip(sensed, tape.goals, strict=True)])
        simulated += simulation.time
    return tapes


def replay(
    tapes: list[list[Tick]], perception: Perception, policy: Timed, shield: LocalPolicy | None = None
) -> NDArray[np.float64]:
    """Times of the ticks at which a command was asked for.

    Args:
        tapes: Recorded ticks, a list for each episode.
        perception: Reads the sensors.
        policy: The policy that is timed.
        shield: The shield over the policy; without one, the policy is asked directly.

    Returns:
        (n, 3) times of perception, of the policy, and of the shield without the policy [s].
    """
    outer, times = shield or policy, []
    for ticks in tapes:
        perception.reset()
        outer.reset()
        for scan, odometry, goal in ticks:
            policy.seconds = 0.0
            began = time.perf_counter()
            percept = perception.update(scan, odometry)
            perceived = time.perf_counter()
            outer.command(percept, goal)
            if goal is not None:
                rest = time.perf_counter() - perceived - policy.seconds
                times.append((perceived - began, policy.seconds, rest))
    return np.array(times)


def lower_layer() -> list[Result]:
    """Time a step of the policies and of the shield in a crowd, and V^h of all candidates, each against its goal."""
    tapes, body = record(CROWD, CROWD_TIME), make_body(CROWD.robot)
    spec, lidar = body.spec, body.lidar
    policies = {
        name: Timed(LearnedPolicy(spec, lidar, load_weights(WEIGHTS_FOLDER / f"{name}.safetensors")))
        for name in ("fusion", "fusion-plus")
    }
    plus = policies["fusion-plus"]
    shield = Shield(spec, lidar, plus)
    perception = Perception(lidar)
    paper_times, times = _least(tapes, perception, policies["fusion"]), _least(tapes, perception, plus, shield)
    where = f"square, {CROWD.movers} movers, {len(times)} ticks, seeds 0 to {len(tapes) - 1}"
    return [
        *_step("perception", times[:, 0], f"tracks and levelled scan, {where}", TICK),
        *_step("fusion", paper_times[:, 1], f"observation and network, {where}", POLICY_LIMIT),
        *_step("fusion-plus", times[:, 1], f"observation and network, {where}", POLICY_LIMIT),
        *_step("shield", times[:, 2], f"a tick; without the policy under it, {where}", TICK),
        result("shield_step_max", 1e3 * times[:, 2].max(), "ms", f"{_of(times[:, 2].max(), TICK)}; the greatest"),
        _critic(tapes, perception, LearnedCritic(spec, lidar, load_critic(SHIPPED))),
    ]


def _least(
    tapes: list[list[Tick]], perception: Perception, policy: Timed, shield: Shield | None = None
) -> NDArray[np.float64]:
    """Least time of each tick over several calls of ``replay``, after one that compiles."""
    replay(tapes[:1], perception, policy, shield)
    return np.min([replay(tapes, perception, policy, shield) for _ in range(REPEATS)], axis=0)


def _step(name: str, seconds: NDArray[np.float64], where: str, limit: float) -> list[Result]:
    mean, slow = seconds.mean(), np.percentile(seconds, 99.0)
    return [
        result(f"{name}_step_mean", 1e3 * mean, "ms", f"{_of(mean, limit)}; {where}"),
        result(f"{name}_step_p99", 1e3 * slow, "ms", f"{_of(slow, limit)}; the 99th percentile"),
    ]


def _critic(tapes: list[list[Tick]], perception: Perception, critic: LearnedCritic) -> Result:
    """Time V^h of points all around, by the first percept."""
    perception.reset()
    percept = perception.update(tapes[0][0].scan, tapes[0][0].odometry)
    points = np.random.default_rng(0).uniform(-4.0, 4.0, (CANDIDATES, 2))

    def rate() -> None:
        for _ in range(CALLS):
            critic.values(points, percept, Pose2(0.0, 0.0, 0.0))

    seconds = best_of(5, rate) / CALLS
    return result(f"v_h_of_{CANDIDATES}", 1e3 * seconds, "ms", f"{_of(seconds, CRITIC_LIMIT)}; {CANDIDATES} candidates")


def _of(seconds: float, limit: float) -> str:
    return f"{1e3 * seconds / limit:.3f} of {limit:.3g} ms"

"""How long the learned lower layer takes to decide: what it saw in crowded episodes, once more and timed."""

import time
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eval.bench.timing import Result, best_of, result
from eval.episode import Episode, EpisodeConfig
from robots.registry import make_body
from vuca_nav.exploration.critic import SHIPPED, LearnedSafety, load_safety
from vuca_nav.policy.base import LocalObservation, LocalPolicy
from vuca_nav.policy.learned import LearnedPolicy
from vuca_nav.policy.weights_file import WEIGHTS_FOLDER, load_weights
from vuca_nav.shield.shield import Shield
from vuca_nav.telemetry.interface import Telemetry
from vuca_nav.types import FloatArray, Pose2, VelocityCommand

CROWD = EpisodeConfig(world="square", movers=24, method="ours")
CROWD_TIME = 60.0
"""Simulated at least [s]."""
REPEATS = 3
"""Of which each tick's least disturbed one counts."""
TICK = 1000.0 / 30.0
"""Until the next scan [ms]."""
CANDIDATES, CALLS = 200, 200
"""How many points V^h is asked about at once, and how often."""
POLICY_LIMIT, CRITIC_LIMIT = 0.3, 2.0
"""Goals: a step of a policy, V^h of ``CANDIDATES`` points [ms]."""


class Tick(NamedTuple):
    """What a local policy is asked at a tick."""

    seen: LocalObservation
    asked: LocalObservation | None
    """None where the body was told to stand without asking."""


class Tape(LocalPolicy):
    """Keeps what another policy is asked."""

    def __init__(self, policy: LocalPolicy):
        self.policy = policy
        self.ticks: list[Tick] = []

    def reset(self) -> None:
        """Pass it on."""
        self.policy.reset()

    def look(self, observation: LocalObservation) -> None:
        """Keep it and pass it on."""
        self.ticks.append(Tick(observation, None))
        self.policy.look(observation)

    def walkers(self) -> FloatArray:
        """The other policy's."""
        return self.policy.walkers()

    def stopped(self) -> None:
        """Pass it on."""
        self.policy.stopped()

    def command(self, observation: LocalObservation) -> VelocityCommand:
        """Keep it and pass it on."""
        self.ticks[-1] = self.ticks[-1]._replace(asked=observation)
        return self.policy.command(observation)


class Timed(LocalPolicy):
    """Times another policy."""

    def __init__(self, policy: LocalPolicy):
        self.policy = policy
        self.seconds = 0.0
        """That it took since this was last set to 0."""

    def reset(self) -> None:
        """Pass it on."""
        self.policy.reset()

    def look(self, observation: LocalObservation) -> None:
        """Pass it on."""
        began = time.perf_counter()
        self.policy.look(observation)
        self.seconds += time.perf_counter() - began

    def command(self, observation: LocalObservation) -> VelocityCommand:
        """Pass it on."""
        began = time.perf_counter()
        command = self.policy.command(observation)
        self.seconds += time.perf_counter() - began
        return command


def record(config: EpisodeConfig, least: float) -> list[list[Tick]]:
    """What the lower layer is asked in episodes of one seed after the other, until enough time has been simulated.

    Args:
        config: Of the first.
        least: How much time is enough [s].
    """
    tapes: list[list[Tick]] = []
    simulated = 0.0
    while simulated < least:
        episode = Episode(replace(config, seed=config.seed + len(tapes)))
        simulation, navigator, scan, odometry = episode.begin(Telemetry())
        tape = Tape(navigator.policy)
        navigator.policy = tape
        while episode.judge(simulation) is None:
            scan, odometry = simulation.step(navigator.step(scan, odometry))
        tapes.append(tape.ticks)
        simulated += simulation.time
    return tapes


def replay(tapes: list[list[Tick]], policy: Timed, shield: LocalPolicy | None = None) -> NDArray[np.float64]:
    """Times of the ticks at which a command was asked for, (n, 2): of the policy, and of the shield without it [s].

    Args:
        tapes: What is asked.
        policy: Who is timed.
        shield: Who guards it; without one, the policy is asked directly.
    """
    outer, times = shield or policy, []
    for ticks in tapes:
        outer.reset()
        for seen, asked in ticks:
            policy.seconds = 0.0
            began = time.perf_counter()
            outer.walkers()
            outer.look(seen)
            if asked is None:
                outer.stopped()
                continue
            outer.command(asked)
            times.append((policy.seconds, time.perf_counter() - began - policy.seconds))
    return np.array(times)


def lower_layer() -> list[Result]:
    """A step of the policies and of the shield in a crowd, and V^h of all candidates, each against its goal."""
    tapes, body = record(CROWD, CROWD_TIME), make_body(CROWD.robot)
    spec, lidar = body.spec, body.lidar
    policies = {
        name: Timed(LearnedPolicy(spec, lidar, load_weights(WEIGHTS_FOLDER / f"{name}.safetensors")))
        for name in ("fusion", "fusion-plus")
    }
    plus = policies["fusion-plus"]
    shield = Shield(spec, lidar, plus)
    paper_times, times = _least(tapes, policies["fusion"], None), _least(tapes, plus, shield)
    where = f"square, {CROWD.movers} movers, {len(times)} ticks, seeds 0 to {len(tapes) - 1}"
    return [
        *_step("fusion", paper_times[:, 0], f"observation and network, {where}", POLICY_LIMIT),
        *_step("fusion-plus", times[:, 0], f"observation and network, {where}", POLICY_LIMIT),
        *_step("shield", times[:, 1], f"a tick; without the policy under it, {where}", TICK),
        result("shield_step_max", 1e3 * times[:, 1].max(), "ms", f"{_of(times[:, 1].max(), TICK)}; the greatest"),
        _critic(plus),
    ]


def _least(tapes: list[list[Tick]], policy: Timed, shield: Shield | None) -> NDArray[np.float64]:
    """``replay``, each tick's least of several, after one that compiles."""
    replay(tapes[:1], policy, shield)
    return np.min([replay(tapes, policy, shield) for _ in range(REPEATS)], axis=0)


def _step(name: str, seconds: NDArray[np.float64], where: str, limit: float) -> list[Result]:
    mean, slow = seconds.mean(), np.percentile(seconds, 99.0)
    return [
        result(f"{name}_step_mean", 1e3 * mean, "ms", f"{_of(mean, limit)}; {where}"),
        result(f"{name}_step_p99", 1e3 * slow, "ms", f"{_of(slow, limit)}; the 99th percentile"),
    ]


def _critic(policy: Timed) -> Result:
    """V^h of points all around, by what the policy saw last."""
    assert isinstance(policy.policy, LearnedPolicy)
    critic = LearnedSafety(policy.policy, load_safety(SHIPPED))
    points = np.random.default_rng(0).uniform(-4.0, 4.0, (CANDIDATES, 2))

    def rate() -> None:
        for _ in range(CALLS):
            critic.values(points, Pose2(0.0, 0.0, 0.0))

    seconds = best_of(5, rate) / CALLS
    return result(f"v_h_of_{CANDIDATES}", 1e3 * seconds, "ms", f"{_of(seconds, CRITIC_LIMIT)}; {CANDIDATES} candidates")


def _of(seconds: float, limit: float) -> str:
    return f"{1e3 * seconds / limit:.3f} of {limit:.3g} ms"

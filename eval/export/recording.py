"""The steps that go into a bundle: missions in the simulator, driven by the very stack that is exported."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from eval.episode import Episode, EpisodeConfig
from vuca_nav.build import StackConfig, build_navigator
from vuca_nav.deploy.steps import StepsRecorder
from vuca_nav.exploration.critic import CriticNetwork, LearnedCritic
from vuca_nav.policy.handover import Handover
from vuca_nav.policy.learned import LearnedPolicy
from vuca_nav.policy.network import Network
from vuca_nav.shield.shield import Shield
from vuca_nav.stack import Stack
from vuca_nav.telemetry.interface import Telemetry
from vuca_nav.types import FloatArray

WORLD, REGION, FIRST_SEED = "factory", 2, 900
"""Missions: the factory's corridors and halls with moving obstacles; no result is reported on these seeds."""
MOST_MISSIONS = 20


def record_steps(
    task: EpisodeConfig,
    config: StackConfig,
    progress: Callable[[int], None],
    count: int,
) -> tuple[StepsRecorder, dict[str, str]]:
    """Drive missions until there are so many steps.

    Args:
        task: World, robot and method of the missions; their seeds are ``FIRST_SEED`` and those after it.
        config: The stack.
        progress: Called with the number of steps so far.
        count: Number of steps of the policy, or of ticks where no network drives.

    Returns:
        The steps, and which missions they are of.
    """
    recorder, seeds = StepsRecorder(), []
    done = 0
    while done < count and len(seeds) < MOST_MISSIONS:
        seeds.append(FIRST_SEED + len(seeds))
        episode = Episode(replace(task, seed=seeds[-1]))
        simulation = episode.simulation(Telemetry())
        scan, odometry = simulation.reset()
        navigator = build_navigator(config, episode.body.spec, episode.body.lidar)
        navigator.reset(episode.world.start, episode.world.goal)
        recorder.begin(episode.world.start, episode.world.goal)
        acts = _listen(navigator, recorder)
        outcome = None
        while outcome is None and done < count:
            command = navigator.step(scan, odometry)
            recorder.add(scan, odometry, command)
            scan, odometry = simulation.step(command)
            outcome = episode.judge(simulation)
            done = len(recorder.acted) if acts else recorder.ticks
            progress(done)
    return recorder, {"world": f"{task.world} --region {task.region}", "seeds": ", ".join(map(str, seeds))}


def _listen(navigator: Stack, recorder: StepsRecorder) -> bool:
    """Have a stack's networks tell the recorder what they see and say; returns whether a network drives."""
    policy: Any = getattr(navigator, "policy", None)
    while isinstance(policy, Shield | Handover):
        policy = policy.policy
    critic: Any = getattr(getattr(navigator, "explorer", None), "critic", None)
    if isinstance(critic, LearnedCritic):
        critic.network = _HeardCritic(critic.network, recorder)
    if not isinstance(policy, LearnedPolicy):
        return False
    policy.network = _HeardNetwork(policy.network, recorder)
    return True


class _HeardNetwork(Network):
    """A policy's network that tells what it sees and says."""

    def __init__(self, network: Network, recorder: StepsRecorder):
        self._network, self._recorder = network, recorder
        self.weights, self.gate, self.shares = network.weights, network.gate, network.shares

    def act(self, observation: np.ndarray, action: FloatArray) -> bool:
        """Implements :class:`~vuca_nav.policy.network.Network`."""
        acted = self._network.act(observation, action)
        if acted:
            self._recorder.acted.append((observation.copy(), action.tolist(), self._network.shares.tolist()))
        return acted


class _HeardCritic(CriticNetwork):
    """A critic's network that tells what it sees and says."""

    def __init__(self, network: CriticNetwork, recorder: StepsRecorder):
        super().__init__(network.weights)
        self._recorder = recorder

    def rate(self, observation: np.ndarray, goals: np.ndarray) -> FloatArray:
        """Implements :class:`~vuca_nav.exploration.critic.CriticNetwork`."""
        values = super().rate(observation, goals)
        for goal, value in zip(goals, values.tolist()):
            seen = observation.copy()
            seen[self.weights.observation.goal_slice] = goal
            self._recorder.rated.append((seen, value))
        return values

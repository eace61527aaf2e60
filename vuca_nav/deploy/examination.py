"""What ``vuca check`` finds: whether a bundle computes here what it computed where it was made, and how fast."""

import time
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vuca_nav.deploy.bundle import Bundle
from vuca_nav.deploy.graphs import Graph
from vuca_nav.deploy.manifest import CRITIC_GRAPH, POLICY_GRAPH
from vuca_nav.deploy.steps import Steps, greatest_difference
from vuca_nav.exploration.critic import CriticNetwork, CriticWeights
from vuca_nav.policy.network import make_network
from vuca_nav.policy.observation import command_from_action, limits_of
from vuca_nav.policy.weights_file import ACTION_SIZE, PolicyWeights, load_weights
from vuca_nav.provenance import machine, version_of

TOLERANCE = 1e-5
"""Greatest difference of two implementations of a network that is taken for rounding."""
WARM_UP = 60
"""Ticks before the latency of ticks is measured: kernels are loaded or compiled in them."""
COMPUTING = ("numpy", "scipy", "numba", "llvmlite")
"""Libraries that the stack computes with."""


class Parity(NamedTuple):
    """A comparison of two implementations, or of one with the recorded steps."""

    name: str
    steps: int
    greatest: float
    """Greatest difference."""

    @property
    def holds(self) -> bool:
        """Whether the difference is rounding."""
        return self.greatest <= TOLERANCE


class Latency(NamedTuple):
    """Times of one step [ms]."""

    name: str
    steps: int
    median: float
    p99: float
    p999: float


class StackParity(NamedTuple):
    """The whole stack over the recorded ticks."""

    ticks: int
    equal: int
    """Number of commands that are equal to the bit."""
    first: int | None
    """First tick whose command differs."""
    greatest: float


class Report(NamedTuple):
    """The result of a check."""

    parities: list[Parity]
    contracts: dict[str, bool]
    """Whether the contract in each graph is the manifest's."""
    stack: StackParity
    is_same_machine: bool
    """Whether this machine is of the kind that the steps were recorded on, so that it has to compute the same bits."""
    latencies: list[Latency]

    @property
    def is_sound(self) -> bool:
        """Whether all networks agree, the graphs carry the manifest's contract, and the stack drives as it did.

        On a machine of another kind the last bit of a sine differs now and then, and a mission with it.
        """
        drives = self.stack.first is None or not self.is_same_machine
        return all(parity.holds for parity in self.parities) and all(self.contracts.values()) and drives


def examine(bundle: Bundle, steps: Steps, progress: Callable[[int], None]) -> Report:
    """Compare and measure.

    Args:
        bundle: The bundle.
        steps: Its recorded steps.
        progress: Called with the number of ticks replayed.

    Raises:
        BadBundle: A graph cannot be run, or steps are not of these networks.
    """
    parities: list[Parity] = []
    latencies: list[Latency] = []
    contracts: dict[str, bool] = {}
    navigator = bundle.navigator()  # before all else: it says what does not go together
    networks = bundle.manifest.content.get("contract", {}).get("networks", {})
    if bundle.config.weights is not None:
        graph = Graph(bundle, POLICY_GRAPH, ("action", "command", "shares"))
        contracts[POLICY_GRAPH] = graph.contract == networks.get(POLICY_GRAPH)
        _compare_policy(bundle, load_weights(bundle.config.weights), graph, steps, (parities, latencies))
    critic = getattr(navigator.explorer.critic, "network", None)
    if isinstance(critic, CriticNetwork):
        graph = Graph(bundle, CRITIC_GRAPH, ("value",))
        contracts[CRITIC_GRAPH] = graph.contract == networks.get(CRITIC_GRAPH)
        _compare_critic(critic, graph, steps, (parities, latencies))
    stack, ticks = _replay(bundle, steps, progress)
    latencies.append(_latency("tick of the whole stack", ticks))
    return Report(parities, contracts, stack, _is_same_machine(bundle), latencies)


Found = tuple[list[Parity], list[Latency]]


def _compare_policy(bundle: Bundle, weights: PolicyWeights, graph: Graph, steps: Steps, found: Found) -> None:
    """The policy's graph, its network and the recorded steps, each with each."""
    parities, latencies = found
    network, count = make_network(weights, bundle.config.gate), len(steps.observations)
    actions, shares = np.full((count, ACTION_SIZE), np.nan), np.full((count, weights.experts), np.nan)
    graph.check_columns(steps.observations)
    times = []
    for k, observation in enumerate(steps.observations):
        began = time.perf_counter_ns()
        network.act(observation, actions[k])
        times.append(time.perf_counter_ns() - began)
        shares[k] = network.shares
    latencies.append(_latency("policy, as the stack runs it", times[1:]))
    outputs, times = graph.run_each(steps.observations)
    latencies.append(_latency(POLICY_GRAPH, times[1:]))
    commands = command_from_action(actions, limits_of(bundle.body))
    given = (actions, commands, shares)
    parities += [
        Parity(f"{POLICY_GRAPH} {name} and the stack's network", count, greatest_difference(a, b))
        for name, a, b in zip(("action", "command", "shares"), outputs, given)
    ]
    for name, own, of_graph, recorded in (
        ("action", actions, outputs[0], steps.actions),
        ("shares", shares, outputs[2], steps.shares),
    ):
        parities.append(
            Parity(f"the stack's network {name} and the recorded", count, greatest_difference(own, recorded))
        )
        parities.append(
            Parity(f"{POLICY_GRAPH} {name} and the recorded", count, greatest_difference(of_graph, recorded))
        )


def _compare_critic(critic: CriticNetwork, graph: Graph, steps: Steps, found: Found) -> None:
    """The critic's graph, its network and the recorded steps, each with each."""
    parities, latencies = found
    weights: CriticWeights = critic.weights
    observations, count = steps.critic_observations, len(steps.critic_observations)
    graph.check_columns(observations)
    values, times = np.empty(count), []
    for k, observation in enumerate(observations):
        began = time.perf_counter_ns()
        values[k] = critic.rate(observation, observation[None, weights.observation.goal_slice])[0]
        times.append(time.perf_counter_ns() - began)
    latencies.append(_latency("critic, as the stack runs it", times[1:]))
    (rated,), times = graph.run_each(observations)
    latencies.append(_latency(CRITIC_GRAPH, times[1:]))
    parities += [
        Parity(f"{CRITIC_GRAPH} value and the stack's network", count, greatest_difference(rated[:, 0], values)),
        Parity("the stack's network value and the recorded", count, greatest_difference(values, steps.values)),
        Parity(f"{CRITIC_GRAPH} value and the recorded", count, greatest_difference(rated[:, 0], steps.values)),
    ]


def _replay(bundle: Bundle, steps: Steps, progress: Callable[[int], None]) -> tuple[StackParity, list[int]]:
    """The stack over the recorded ticks, and its times [ns]."""
    navigator = bundle.navigator()
    commands, times = np.empty_like(steps.commands), []
    missions = list(steps.missions())
    start, goal, ticks = missions[0]
    navigator.reset(start, goal)
    for tick in ticks[:WARM_UP]:
        navigator.step(*steps.sensed(tick))
    for start, goal, ticks in missions:
        navigator.reset(start, goal)
        for tick in ticks:
            scan, odometry = steps.sensed(tick)
            began = time.perf_counter_ns()
            command = navigator.step(scan, odometry)
            times.append(time.perf_counter_ns() - began)
            commands[tick] = command
            progress(tick + 1)
    same = (commands == steps.commands).all(axis=1)
    first = None if same.all() else int(np.argmin(same))
    return StackParity(len(same), int(same.sum()), first, greatest_difference(commands, steps.commands)), times


def _latency(name: str, nanoseconds: Sequence[int] | NDArray[Any]) -> Latency:
    if not len(nanoseconds):
        return Latency(name, 0, 0.0, 0.0, 0.0)
    median, p99, p999 = (np.percentile(nanoseconds, [50.0, 99.0, 99.9]) * 1e-6).tolist()
    return Latency(name, len(nanoseconds), median, p99, p999)


def _is_same_machine(bundle: Bundle) -> bool:
    """Whether processor, C library, Python and the libraries that compute are those where the bundle was made."""
    made_by = bundle.manifest.content.get("made_by")
    there = made_by.get("machine") if isinstance(made_by, dict) else None
    here, there = machine(), there if isinstance(there, dict) else {}
    libraries = there.get("libraries")
    libraries = libraries if isinstance(libraries, dict) else {}
    return all(here[name] == there.get(name) for name in ("cpu", "libc", "python")) and all(
        version_of(name) == libraries.get(name) for name in COMPUTING
    )

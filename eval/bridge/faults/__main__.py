"""``python -m eval.bridge.faults``: faults on the wire, each some times, or for an hour at random."""

import sys
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np

from eval.analysis.report.tables import markdown
from eval.bridge.faults.campaign import FaultyStack, Means, MissionOver
from eval.bridge.faults.kept import BUNDLES, Keeper
from eval.bridge.faults.raw import RawPublisher
from eval.bridge.faults.table import memory_in_words, table_of
from eval.bridge.processes import SIMULATED_CLOCK, Deployment, StackEnded, own_domain
from eval.bridge.remote_stack import RealTime
from eval.bridge.robot_wire import RobotWire
from eval.bridge.session import BridgedEpisode, wait_for_stack
from eval.bridge.trials import bundle_of, typed
from eval.episode import EpisodeConfig
from robots.registry import make_body
from vuca_nav.cli import optional, run_module, show
from vuca_nav.deploy.safety.faults import FAULTS
from vuca_nav.deploy.transport.dds import DdsTransport
from vuca_nav.deploy.transport.names import RosArguments
from vuca_nav.deploy.transport.network import NetworkConfig
from vuca_nav.errors import BadArgument, UnknownName
from vuca_nav.files import write_whole

INJECTED = tuple(name for name, fault in FAULTS.items() if fault.target != "localisation")
"""Faults that can be made on the wire: no topic tells the quality of a localisation."""
NEVER_AT_RANDOM = ("process_killed",)
"""Faults that a soak leaves out: its memory is that of one process."""
_SAMPLE = 5.0
"""Time between two samples of memory [s]."""


@dataclass(frozen=True, kw_only=True)
class FaultArguments:
    """Make faults on the wire, and see that the body stands in time and goes on."""

    out: Path
    """Directory of the bundle, the trials and the table; the same command goes on where it was."""
    robot: str = "go2"
    """A robot's name."""
    world: str = "factory"
    """A world's name."""
    region: int | None = 2
    """Number of quarters of the factory; None for other worlds."""
    without: str = ""
    """Difficulties left out."""
    method: str = "ours-dh"
    """The method that is deployed."""
    faults: Annotated[str | None, optional("NAME,...")] = None
    """Only these faults, with commas between them."""
    number: int = 20
    """Number of trials of each fault."""
    soak: float | None = None
    """Faults at random for so long instead, and the memory of the deployed stack [s]."""
    seed: int = 0
    """Seed of the first mission, and of what is random."""
    timeout: float = 120.0
    """How long to wait for the deployed stack to appear [s]."""


class Plan:
    """Which fault comes next.

    Args:
        arguments: What is asked for.
        done: Number of trials that there are, by fault.
    """

    def __init__(self, arguments: FaultArguments, done: Counter[str]):
        names = INJECTED if arguments.faults is None else tuple(arguments.faults.split(","))
        for name in names:
            if name not in INJECTED:
                raise UnknownName("fault", name, INJECTED)
        self._left = Counter({name: max(arguments.number - done[name], 0) for name in names})
        self._total = self._left.total()
        self._names = [name for name in names if name not in NEVER_AT_RANDOM]
        self._rng = np.random.default_rng(arguments.seed)
        self._began = time.monotonic()
        self._soak = arguments.soak

    @property
    def is_done(self) -> bool:
        """Whether there is nothing left."""
        if self._soak is not None:
            return time.monotonic() - self._began > self._soak
        return not self._left.total()

    def choose(self) -> str:
        """The next fault: the one with most trials left, or any.

        Raises:
            MissionOver: If there is none.
        """
        if self.is_done:
            raise MissionOver
        if self._soak is not None:
            return self._names[int(self._rng.integers(len(self._names)))]
        return self._left.most_common(1)[0][0]

    def note(self, fault: str) -> str:
        """Take a trial for done, and say how far it is."""
        self._left[fault] -= 1
        elapsed = time.monotonic() - self._began
        if self._soak is not None:
            return f"{fault}; {max(self._soak - elapsed, 0.0):.0f} s left"
        left = self._left.total()
        done = self._total - left
        return f"{fault}; {done}/{self._total} trials, {elapsed / max(done, 1) * left / 60.0:.0f} min left"


@contextmanager
def faulty(arguments: FaultArguments, plan: Plan) -> Iterator[tuple[FaultyStack, Deployment]]:
    """The deployed stack in a process of its own, and what faults happen to it."""
    bundle = bundle_of(arguments.robot, arguments.method, arguments.out / BUNDLES)
    domain, log = own_domain(), arguments.out / "deploy.log"
    network, body = NetworkConfig(domain), make_body(arguments.robot)
    with Deployment(bundle, SIMULATED_CLOCK, domain, log) as process, DdsTransport(network) as transport:
        wire = RobotWire(transport, body)
        wait_for_stack(wire, arguments.timeout, process.check)
        means = Means(
            process,
            lambda: DdsTransport(network, RosArguments(node="intruder")),
            lambda type_name: RawPublisher(domain, transport.full_name("scan"), type_name),
        )
        yield FaultyStack(wire, RealTime(), body.spec, plan.choose, means), process


def run(arguments: FaultArguments) -> None:
    """Make the faults that are asked for, and tell what became of them."""
    if arguments.number < 1 or (arguments.soak is not None and not 0.0 < arguments.soak < float("inf")):
        raise BadArgument("--number must be 1 or more, --soak a time above 0 s")
    keeper = Keeper(arguments.out)
    campaign = keeper.campaign
    plan = Plan(arguments, Counter(trial.fault for trial in campaign.trials))
    seed = arguments.seed + len(campaign.trials)
    if not plan.is_done:
        names = ("robot", "method", "world", "region", "without", "soak")
        keeper.note_run(typed(sys.argv), {name: getattr(arguments, name) for name in names})
    while not plan.is_done:
        with faulty(arguments, plan) as (stack, process):
            try:
                while not plan.is_done and process.exit_code is None:
                    _drive(arguments, seed, stack, process, keeper, plan)
                    seed += 1
            except StackEnded as error:
                keeper.add_crash(stack.fault or "none")
                print(f"{error}", file=sys.stderr)
    text = "\n".join(markdown(table_of(campaign.trials, campaign.crashes)))
    if arguments.soak is not None:
        text += f"\n\n{memory_in_words(campaign.memory)}"
    write_whole(arguments.out / "faults.md", f"{text}\n")
    show(text)


def _drive(
    arguments: FaultArguments, seed: int, stack: FaultyStack, process: Deployment, keeper: Keeper, plan: Plan
) -> None:
    """Drive one mission, with as many faults as happen in it."""
    config = EpisodeConfig(
        world=arguments.world, region=arguments.region, without=arguments.without, robot=arguments.robot, seed=seed
    )
    began = time.monotonic()

    def watch(_time: float, _to_goal: float) -> None:
        nonlocal began
        while stack.trials:
            trial = stack.trials.pop(0)
            keeper.add_trial(trial)
            print(plan.note(trial.fault), file=sys.stderr)
        if arguments.soak is not None and time.monotonic() - began > _SAMPLE:
            began = time.monotonic()
            keeper.add_memory(began, process.memory())

    try:
        BridgedEpisode(config, stack).run(stack.truth, watch)
    except MissionOver:
        pass
    finally:
        stack.abandon()
        watch(0.0, 0.0)


if __name__ == "__main__":
    run_module("faults", run, FaultArguments)

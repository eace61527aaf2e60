"""``vuca train`` for navigation policies: arguments to stages, one after another."""

import os
import shlex
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from train.critic.config import CriticConfig
from train.critic.training import NAME as CRITIC
from train.critic.training import CriticTraining
from train.navigation.config import Collector, RunConfig
from train.navigation.environment import ArenaEnvironment
from train.navigation.stages import EVERYTHING, StageConfig, find_stage, from_scratch
from train.navigation.training import NavigationTraining, even_workers
from vuca_nav.cli import parse
from vuca_nav.errors import BadArgument
from vuca_nav.policy.weights_file import WEIGHTS_FOLDER
from vuca_nav.provenance import usable_cores


@dataclass(frozen=True)
class RunArguments:
    """Arguments of every training."""

    out: Path = Path("runs/navigation")
    """Directory that holds a directory for each policy, with its checkpoint, log, TensorBoard files, curves, weights
    and their page; policies to start from are looked for here, too; if there is none, the critic of V^h learns from the
    shipped one."""
    seed: int = 0
    resume: bool = False
    """Go on with the run in --out."""


@dataclass(frozen=True)
class CriticArguments(RunArguments):
    """Train the critic of V^h on the outcomes of episodes in the batched arena."""

    workers: Annotated[int | None, tyro.conf.arg(metavar="N")] = None
    """Number of threads that step the arena, by default one for each core; the weights do not depend on it."""
    config: CriticConfig = field(default_factory=CriticConfig)


@dataclass(frozen=True)
class NavigationArguments(RunArguments):
    """Train navigation policies in the batched arena."""

    workers: Annotated[int | None, tyro.conf.arg(metavar="N")] = None
    """Number of processes that learn together, a core each; by default as many as there are cores and share out worlds
    and minibatches evenly. Another number gives other weights."""
    collector: Collector = "local"
    """Place of the worlds: local, or on a Ray cluster (found by RAY_ADDRESS, else started here), N workers of it."""
    from_scratch: bool = False
    """Start experts from random weights, not from trained policies."""


def train_navigation(name: str, argv: list[str]) -> int:
    """Train one policy, the critic of V^h, or all of them.

    Args:
        name: Name of a stage, "critic", or "all".
        argv: Arguments after it.

    Returns:
        The exit code.
    """
    if name == "all":
        arguments = parse(NavigationArguments, "train all", argv)
        command = shlex.join(["vuca", "train", "all", *argv])
        for stage in EVERYTHING:
            _train(find_stage(stage), arguments, command)
        _train_critic(CriticConfig(), arguments, command)
        return 0
    if name == CRITIC:
        chosen = parse(CriticArguments, f"train {name}", argv)
        _train_critic(chosen.config, chosen, shlex.join(["vuca", "train", name, *argv]))
        return 0
    find_stage(name)

    @dataclass(frozen=True)
    class StageArguments(NavigationArguments):
        """Train a navigation policy in the batched arena; every setting of it can be changed."""

        stage: StageConfig = field(default_factory=lambda: find_stage(name))

    arguments = parse(StageArguments, f"train {name}", argv)
    _train(arguments.stage, arguments, shlex.join(["vuca", "train", name, *argv]))
    return 0


def _train(stage: StageConfig, arguments: NavigationArguments, command: str) -> None:
    _check_seed(arguments.seed)
    if arguments.from_scratch:
        stage = from_scratch(stage)
    sources = tuple(arguments.out / source / f"{source}.safetensors" for source in stage.sources)
    workers = arguments.workers
    if workers is None:
        workers = even_workers(stage, usable_cores())[-1]
    run = RunConfig(arguments.seed, workers, sources, command, arguments.collector)
    training = NavigationTraining(stage, run, arguments.out / stage.name, ArenaEnvironment, resume=arguments.resume)
    training.run()
    print(f"weights: {training.weights}")


def _train_critic(config: CriticConfig, arguments: NavigationArguments | CriticArguments, command: str) -> None:
    _check_seed(arguments.seed)
    policy = arguments.out / config.policy / f"{config.policy}.safetensors"
    shipped = WEIGHTS_FOLDER / policy.name
    if shipped.is_file() and not policy.is_file():
        print(f"{CRITIC}: no {policy}, so the shipped {config.policy} drives", file=sys.stderr)
        policy = shipped
    # Collectors on other machines do not help here.
    threads = usable_cores() if arguments.workers is None else min(arguments.workers, os.cpu_count() or 1)
    training = CriticTraining(
        config, arguments.seed, policy, arguments.out / CRITIC, threads, command, resume=arguments.resume
    )
    training.run()
    print(f"weights: {training.weights}")


def _check_seed(seed: int) -> None:
    if seed < 0:
        raise BadArgument(f"the seed must be 0 or more, got {seed}")

"""The command ``vuca train``: arguments in, an exit code out. Heavy modules are imported when needed."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from vuca_nav.cli import parse
from vuca_nav.errors import BadArgument, UnknownName
from vuca_nav.provenance import usable_cores

TRAINABLE = {
    "locomotion": "a quadruped's gait, over batched MuJoCo",
    "go-straight": "the paper's expert for what stands",
    "obstacle-avoidance": "the paper's expert for what moves; starts as go-straight",
    "single": "one network that sees what the paper's do: what fusing must beat",
    "fusion": "the paper's policy, four networks fused by a gate; starts as the two experts",
    "base-plus": "one network that sees tracks of what moves",
    "single-plus": "one network, trained on from base-plus",
    "fusion-plus": "four networks fused by a gate that is taught; starts as base-plus",
    "drl-circle": "the first stage of the baseline drl, 24 robots in a circle",
    "drl": "the baseline of Long et al., 44 robots in a hall; starts as drl-circle",
    "critic": "the critic of V^h, from episodes that fusion-plus drives",
    "all": "everything but locomotion, one after another",
}
"""Trainings and what they train; all but the gait in the batched arena. Kept here, so that help needs no torch."""


@dataclass(frozen=True)
class LocomotionArguments:
    """Train a quadruped's gait over batched MuJoCo; an interrupted run goes on with --resume."""

    robot: str = "go2"
    """Name of a quadruped."""
    out: Path | None = None
    """Directory of checkpoints, log, TensorBoard files, curves and weights; by default runs/ROBOT."""
    seed: int = 0
    steps: Annotated[int | None, tyro.conf.arg(metavar="N")] = None
    """Control steps of all robots together; by default the full recipe. The curriculum follows them."""
    threads: Annotated[int | None, tyro.conf.arg(metavar="N")] = None
    """Number of processor cores to use; by default all. The weights do not depend on it."""
    resume: bool = False
    """Go on with the run in --out."""


def train(argv: list[str]) -> int:
    """Train a gait, navigation policies or the critic of V^h, to weights a mission can load."""
    if not argv:
        raise BadArgument(f"give what to train: {', '.join(TRAINABLE)} (see vuca train --help)")
    what = argv[0]
    if what in ("-h", "--help"):
        print(_overview())
        return 0
    if what.startswith("-"):
        raise BadArgument(f"what to train comes first, before {what}: {', '.join(TRAINABLE)} (see vuca train --help)")
    if what not in TRAINABLE:
        raise UnknownName("policy to train", what, TRAINABLE)
    if what == "locomotion":
        return _train_locomotion(argv[1:])
    from train.navigation.commands import train_navigation

    return train_navigation(what, argv[1:])


def _overview() -> str:
    """Help of ``vuca train`` itself."""
    width = max(map(len, TRAINABLE))
    lines = ["usage: vuca train WHAT [OPTIONS]", "", f"{(train.__doc__ or '').strip()}", "", "what:"]
    lines += [f"  {name:{width}}  {description}" for name, description in TRAINABLE.items()]
    return "\n".join([*lines, "", "vuca train WHAT --help tells about one of them, with all its settings."])


def _train_locomotion(argv: list[str]) -> int:
    arguments = parse(LocomotionArguments, "train locomotion", argv)
    if arguments.steps is not None and arguments.steps < 1:
        raise BadArgument(f"--steps must be 1 or more, got {arguments.steps}")
    if arguments.seed < 0:
        raise BadArgument(f"the seed must be 0 or more, got {arguments.seed}")
    threads = usable_cores() if arguments.threads is None else arguments.threads
    if threads < 1:
        raise BadArgument(f"--threads must be 1 or more, got {arguments.threads}")
    out = arguments.out or Path("runs") / arguments.robot
    from robots.registry import find_quadruped
    from train.locomotion.config import STEPS, TrainingConfig
    from train.locomotion.training import GaitTraining

    config = TrainingConfig(seed=arguments.seed, steps=STEPS if arguments.steps is None else arguments.steps)
    training = GaitTraining(find_quadruped(arguments.robot), config, out, resume=arguments.resume, threads=threads)
    training.run()
    print(f"weights: {training.weights}")
    return 0

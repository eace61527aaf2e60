"""The command ``vuca train``: arguments in, an exit code out. What is heavy is imported when needed."""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from vuca_nav.cli import parse
from vuca_nav.errors import BadArgument


@dataclass(frozen=True)
class TrainArguments:
    """Train a policy from scratch; interrupted, go on with --resume."""

    what: tyro.conf.Positional[Literal["locomotion"]]
    """What to train: locomotion, a quadruped's gait. Navigation policies have settings of their own: see
    vuca train go_straight --help; they are go_straight, obstacle_avoidance, single, fusion, base_plus, single_plus and
    fusion_plus; safety, the critic of V^h; or all."""
    robot: str = "go2"
    """A quadruped's name."""
    out: Path | None = None
    """Directory of checkpoints, log, TensorBoard files, curves and weights; by default runs/ROBOT."""
    seed: int = 0
    steps: Annotated[int | None, tyro.conf.arg(metavar="N")] = None
    """Control steps of all robots together; by default the full recipe. The curriculum follows them."""
    threads: Annotated[int | None, tyro.conf.arg(metavar="N")] = None
    """Processor cores to use; by default all. The weights do not depend on it."""
    resume: bool = False
    """Go on with what is in --out."""


def train(argv: list[str]) -> int:
    """Train a gait over batched MuJoCo or a navigation policy in the batched arena, to weights a mission can load."""
    if argv and not argv[0].startswith("-") and argv[0] != "locomotion":
        from train.navigation.commands import train_navigation

        return train_navigation(argv[0], argv[1:])
    arguments = parse(TrainArguments, "train", argv)
    if arguments.steps is not None and arguments.steps < 1:
        raise BadArgument(f"--steps must be 1 or more, got {arguments.steps}")
    if arguments.seed < 0:
        raise BadArgument(f"the seed must be 0 or more, got {arguments.seed}")
    threads = len(os.sched_getaffinity(0)) if arguments.threads is None else arguments.threads
    if threads < 1:
        raise BadArgument(f"--threads must be 1 or more, got {arguments.threads}")
    out = arguments.out or Path("runs") / arguments.robot
    from robots.registry import find_quadruped
    from train.locomotion.run import STEPS, Training, TrainingConfig

    config = TrainingConfig(seed=arguments.seed, steps=STEPS if arguments.steps is None else arguments.steps)
    training = Training(find_quadruped(arguments.robot), config, out, resume=arguments.resume, threads=threads)
    training.run()
    print(f"weights: {out / training.robot.weights}")
    return 0

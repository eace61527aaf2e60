"""``vuca export``: a robot and a method as a deployable bundle."""

import json
import shlex
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from eval.arguments import DriverArguments
from vuca_nav.cli import parse, show
from vuca_nav.errors import BadArgument
from vuca_nav.progress import CountedProgress

MOST_STEPS = 20_000
"""Greatest number of steps to record: eleven minutes of driving, 50 MB."""


@dataclass(frozen=True, kw_only=True)
class ExportArguments(DriverArguments):
    """Export a robot and a method as a deployable bundle: networks, every setting, the robot, a manifest."""

    out: Path
    """Folder of the bundle; an older bundle there is replaced."""
    steps: Annotated[int, tyro.conf.arg(metavar="N")] = 1000
    """Number of steps that are recorded in the simulator for vuca check."""
    json: bool = False
    """End with one JSON object on stdout."""


def export(argv: list[str]) -> int:
    """Export a robot and a method as a deployable bundle: networks, every setting, the robot, a manifest."""
    arguments = parse(ExportArguments, "export", argv)
    if not 1 <= arguments.steps <= MOST_STEPS:
        raise BadArgument(f"--steps must be 1 to {MOST_STEPS}, got {arguments.steps}")
    from eval.commands import driver_of, options_of
    from eval.episode import EpisodeConfig
    from eval.export.making import make_bundle
    from eval.export.recording import REGION, WORLD
    from eval.methods import BEST

    method = driver_of(arguments, BEST)
    options = options_of(arguments)
    task = EpisodeConfig(WORLD, REGION, arguments.robot, method, options=options, trust=arguments.trust)
    with CountedProgress(sys.stderr, "steps recorded in the simulator", arguments.steps) as progress:
        exported = make_bundle(task, arguments.out, progress, arguments.steps, _told(argv, arguments.out))
    show("\n".join(f"{name:20} {size:>10,} bytes" for name, size in exported["files"].items()))
    show(f"bundle of {exported['robot']}, {exported['method']}: {arguments.out}\nnext: vuca check {arguments.out}")
    if arguments.json:
        show(json.dumps(exported, allow_nan=False))
    return 0


def _told(argv: list[str], out: Path) -> str:
    """The command as a manifest tells it: the bundle's folder by its name, wherever that lies on one machine."""
    words = [out.name if word == str(out) else word.replace(f"--out={out}", f"--out={out.name}") for word in argv]
    return shlex.join(["vuca", "export", *words])

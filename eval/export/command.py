"""``vuca export``: a robot and a method as a deployable bundle."""

import json
import shlex
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import tyro

from eval.arguments import DriverArguments
from vuca_nav.cli import parse, show
from vuca_nav.errors import BadArgument

MOST_STEPS = 20_000
"""Greatest number of steps to record: eleven minutes of driving, 50 MB."""
LIBRARIES = ("vuca-nav", "numpy", "numba", "scipy", "onnx", "safetensors", "mujoco")
"""Packages whose versions a manifest tells."""


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
    from eval.commands import options_of
    from eval.methods import BEST
    from vuca_nav.progress import CountedProgress

    with CountedProgress(sys.stderr, "steps recorded in the simulator", arguments.steps) as progress:
        exported = make_bundle(
            arguments.robot, arguments.method or BEST, options_of(arguments), arguments.out,
            progress=progress, steps=arguments.steps, command=_told(argv, arguments.out),
        )  # fmt: skip
    show("\n".join(f"{name:20} {size:>10,} bytes" for name, size in exported["files"].items()))
    show(f"bundle of {exported['robot']}, {exported['method']}: {arguments.out}\nnext: vuca check {arguments.out}")
    if arguments.json:
        show(json.dumps(exported, allow_nan=False))
    return 0


def _told(argv: list[str], out: Path) -> str:
    """The command as a manifest tells it: the bundle's folder by its name, wherever that lies on one machine."""
    words = [out.name if word == str(out) else word.replace(f"--out={out}", f"--out={out.name}") for word in argv]
    return shlex.join(["vuca", "export", *words])


def make_bundle(
    robot: str, method: str, options: Any, out: Path, *, progress: Any, steps: int, command: str
) -> dict[str, Any]:  # fmt: skip
    """Make a bundle.

    Args:
        robot: The robot's name.
        method: The method's name.
        options: Changes to the method, ``MethodOptions``.
        out: Folder of the bundle.
        progress: Called with the number of recorded steps.
        steps: Number of steps to record.
        command: Command that makes it.

    Returns:
        What was written: robot, method, digest, size of every file.

    Raises:
        VucaError: The method cannot be exported, or the bundle not be written.
    """
    from eval.export.figures import evaluation_figures, training_figures
    from eval.export.graphs import IR_VERSION, OPSET, critic_graph, policy_graph
    from eval.export.recording import record_steps
    from eval.methods import resolve, stack_config, title_of
    from robots.registry import make_body
    from vuca_nav.build import critic_of
    from vuca_nav.deploy import manifest
    from vuca_nav.deploy.bundle import as_yaml
    from vuca_nav.deploy.contract import contract_of
    from vuca_nav.deploy.robot_file import robot_file_of
    from vuca_nav.deploy.steps import steps_file
    from vuca_nav.policy.weights_file import load_weights
    from vuca_nav.provenance import commit, machine, version_of

    manifest.check_target(out)
    chosen = exportable(method, resolve(method, options))
    body, config = make_body(robot), stack_config(chosen)
    title = title_of(method, options.given())
    robot_file = robot_file_of(body.spec, body.lidar)
    policy = None if config.weights is None else load_weights(config.weights)
    critic = critic_of(config.critic, policy)
    contract = contract_of(robot_file, config, policy, critic)
    networks, files, training = contract["networks"], {}, {}
    if policy is not None:
        files[manifest.POLICY] = policy.path.read_bytes()
        files[manifest.POLICY_GRAPH] = policy_graph(policy, config.gate, body.spec, networks[manifest.POLICY_GRAPH])
        training["policy"] = training_figures(policy.path, policy.metadata)
    if critic is not None:
        files[manifest.CRITIC_GRAPH] = critic_graph(critic, networks[manifest.CRITIC_GRAPH])
        if isinstance(config.critic, Path):
            files[manifest.CRITIC] = config.critic.read_bytes()
            training["critic"] = training_figures(config.critic, critic.metadata)
    recorder, missions = record_steps(robot, (method, options), config, progress, steps)
    name = f"{robot}, {title}"
    files[manifest.STEPS] = steps_file(recorder.steps(), {"robot": robot, "method": title, **missions})
    files[manifest.ROBOT] = as_yaml(robot_file, f"The robot of the bundle {name}. Units: m, rad, s, Hz.")
    own = replace(
        config,
        weights=None if policy is None else Path(manifest.POLICY),
        critic=Path(manifest.CRITIC) if isinstance(config.critic, Path) else config.critic,
    )
    files[manifest.NAVIGATOR] = as_yaml(own, f"Every setting of the stack of the bundle {name} (vuca_nav/build.py).")
    about = {
        "robot": robot,
        "method": title,
        "command": command,
        "made_by": {
            "commit": commit(),
            "versions": {library: version_of(library) for library in LIBRARIES},
            "onnx_opset": OPSET,
            "onnx_ir_version": IR_VERSION,
            "machine": machine(),
        },
        "contract": contract,
        "training": training or {"reason": "no network drives"},
        "evaluation": evaluation_figures(robot, title, chosen),
        "steps": {"recorded_in": missions, "of_the_policy": len(recorder.acted), "ticks": recorder.ticks},
    }
    digest = manifest.write_bundle(out, files, about)
    return {"robot": robot, "method": title, "digest": digest, "files": {k: len(v) for k, v in sorted(files.items())}}


def exportable(name: str, config: Any) -> Any:
    """The configuration of a method that can be exported.

    Raises:
        BadArgument: It is another kind of stack, which a robot without the testbed cannot have.
    """
    from eval.methods import METHODS, MethodConfig

    if isinstance(config, MethodConfig):
        return config
    those = ", ".join(known for known, method in METHODS.items() if isinstance(method.config, MethodConfig))
    if name not in METHODS:
        why = "a planner of your own is Python, which a bundle does not carry; drive it over vuca bridge"
    elif name.startswith("oracle"):
        why = "it needs the truth of the simulation"
    else:
        why = "the baseline is part of the testbed, not of what runs on a robot"
    raise BadArgument(f"method {name!r} cannot be exported: {why} (can be: {those})")

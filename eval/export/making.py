"""Makes a bundle: the stack of a method for a robot, with all that it has to tell about itself."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from eval.episode import EpisodeConfig
from eval.export.figures import evaluation_figures, training_figures
from eval.export.graphs import IR_VERSION, OPSET, critic_graph, policy_graph
from eval.export.recording import record_steps
from eval.method_config import MethodConfig
from eval.methods import METHODS, MethodOptions, is_users_own, resolve, stack_config, title_of
from robots.registry import make_body
from vuca_nav.build import StackConfig, critic_of
from vuca_nav.deploy import manifest
from vuca_nav.deploy.bundle import as_yaml
from vuca_nav.deploy.contract import contract_of
from vuca_nav.deploy.robot_file import RobotFile, robot_file_of
from vuca_nav.deploy.steps import steps_file
from vuca_nav.errors import BadArgument
from vuca_nav.policy.weights_file import load_weights
from vuca_nav.provenance import commit, machine, version_of

LIBRARIES = ("vuca-nav", "numpy", "numba", "scipy", "onnx", "safetensors", "mujoco")
"""Packages whose versions a manifest tells."""


def make_bundle(
    task: EpisodeConfig, out: Path, progress: Callable[[int], None], steps: int, command: str
) -> dict[str, Any]:  # fmt: skip
    """Make a bundle.

    Args:
        task: Robot and method, with the missions that steps are recorded in.
        out: Folder of the bundle.
        progress: Called with the number of recorded steps.
        steps: Number of steps to record.
        command: Command that makes it.

    Returns:
        What was written: robot, method, digest, size of every file.

    Raises:
        VucaError: The method cannot be exported, or the bundle not be written.
    """
    manifest.check_target(out)
    method = exportable(task.method, task.options)
    body, config = make_body(task.robot), stack_config(method)
    robot_file, title = robot_file_of(body.spec, body.lidar), title_of(task.method, task.options.given())
    files, contract, training = _networks(config, robot_file)
    recorder, missions = record_steps(task, config, progress, steps)
    robot = body.spec.name
    name = f"{robot}, {title}"
    files[manifest.STEPS] = steps_file(recorder.steps(), {"robot": robot, "method": title, **missions})
    files[manifest.ROBOT] = as_yaml(robot_file, f"The robot of the bundle {name}. Units: m, rad, s, Hz.")
    own = replace(
        config,
        weights=None if config.weights is None else Path(manifest.POLICY),
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
        "evaluation": evaluation_figures(task.robot, title, method),
        "steps": {"recorded_in": missions, "of_the_policy": len(recorder.acted), "ticks": recorder.ticks},
    }
    digest = manifest.write_bundle(out, files, about)
    sizes = {file: len(content) for file, content in sorted(files.items())}
    return {"robot": robot, "method": title, "digest": digest, "files": sizes}


def exportable(name: str, options: MethodOptions) -> MethodConfig:
    """The configuration of a method that can be exported; a module of the user's own is not imported.

    Args:
        name: The method's name.
        options: Changes to it.

    Raises:
        BadArgument: It is another kind of stack, which a robot without the testbed cannot have, or as ``resolve``.
    """
    config = None if is_users_own(name) else resolve(name, options)
    if isinstance(config, MethodConfig):
        return config
    if config is None:
        why = "a planner of your own is Python, which a bundle does not carry; drive it over vuca bridge"
    elif name.startswith("oracle"):
        why = "it needs the truth of the simulation"
    else:
        why = "the baseline is part of the testbed, not of what runs on a robot"
    those = ", ".join(known for known, method in METHODS.items() if isinstance(method.config, MethodConfig))
    raise BadArgument(f"method {name!r} cannot be exported: {why} (can be: {those})")


def _networks(config: StackConfig, robot: RobotFile) -> tuple[dict[str, bytes], dict[str, Any], dict[str, Any]]:
    """Weights and graphs of a stack, the contract of the whole, and the figures of the training."""
    policy = None if config.weights is None else load_weights(config.weights)
    critic = critic_of(config.critic, policy)
    contract = contract_of(robot, config, policy, critic)
    networks, files, training = contract["networks"], {}, {}
    if policy is not None:
        files[manifest.POLICY] = policy.path.read_bytes()
        files[manifest.POLICY_GRAPH] = policy_graph(policy, config.gate, robot.body, networks[manifest.POLICY_GRAPH])
        training["policy"] = training_figures(policy.path, policy.metadata)
    if critic is not None:
        files[manifest.CRITIC_GRAPH] = critic_graph(critic, networks[manifest.CRITIC_GRAPH])
        if isinstance(config.critic, Path):
            files[manifest.CRITIC] = config.critic.read_bytes()
            training["critic"] = training_figures(config.critic, critic.metadata)
    return files, contract, training

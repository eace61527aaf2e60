"""What decides the bits of a result: code, libraries, arithmetic, noise, the settings of each method, a hash of all.

The code is what an episode runs, not the commit: the modules that ``eval.episode`` imports, directly or not, without
comments, docstrings and layout. So a change of a page or of the report does not end an evaluation.
"""

import ast
import functools
import hashlib
import importlib.metadata
import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from eval.episode import EpisodeConfig
from eval.methods import resolve, settings_of, title_of
from eval.store import Row
from robots.arithmetic import fingerprint
from robots.noise import NoiseConfig
from robots.registry import digest_of as digest_of_body
from robots.registry import make_body
from vuca_nav.provenance import commit

LIBRARIES = (
    "mujoco",
    "dm-control",
    "numpy",
    "numba",
    "llvmlite",
    "scipy",
    "example-robot-data",
    "trimesh",
    "pycollada",
)
"""The libraries that physics, sensors and stack compute with, and those that the bodies are made of."""
_ENTRY = "eval.episode"
_PACKAGES = ("vuca_nav", "worlds", "robots", "eval")
_ROOT = Path(__file__).resolve().parents[1]
_DATA = "robots/locomotion/weights/*.safetensors"
"""Files beside the code that a body runs by; policy and critic belong to a method, see ``identity_of``."""
_DIGITS = 16


def common() -> Row:
    """What decides on the bits of results whatever the method: code, libraries, the machine's arithmetic, noise."""
    libraries = {name: importlib.metadata.version(name) for name in LIBRARIES}
    made_by = {"code": code_digest(), "libraries": libraries, "arithmetic": fingerprint()}
    return {**made_by, "noise": asdict(NoiseConfig())}


def provenance(configs: Sequence[EpisodeConfig]) -> Row:
    """Everything that decides on the bits of results: ``common``, and the settings of every robot and method.

    Args:
        configs: The episodes of the evaluation. The settings are those with all difficulties: a task names those that
            it leaves out.

    Raises:
        VucaError: There is no such robot or method, or it cannot be built.
    """
    drivers = {driver_of(config): config for config in configs}
    return {**common(), "settings": {driver: _settings(config) for driver, config in drivers.items()}}


def bits_of(made_by: Row, driver: str, configuration: Row) -> str:
    """Hash of everything but task and seed that decides on the bits of an episode: rows of one hash can be joined.

    Args:
        made_by: Result of ``provenance``.
        driver: Robot and method, as ``driver_of`` has them.
        configuration: The method, as ``identity_of`` has it.
    """
    parts = {**made_by, "settings": made_by["settings"][driver], "driver": driver, "configuration": configuration}
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()[:_DIGITS]


def driver_of(config: EpisodeConfig) -> str:
    """Robot and method of an episode, as ``go2, ours --gamma 0.0``."""
    return f"{config.robot}, {title_of(config.method, config.options.given())}"


def made_with() -> Row:
    """The version and the commit of the code, which name it and do not decide on the bits of what it computes."""
    return {"vuca-nav": importlib.metadata.version("vuca-nav"), "commit": commit()}


@functools.cache
def code_digest() -> str:
    """Hash of the code that an episode runs here, and of the weights that its bodies walk by."""
    return digest_of(_ROOT)


def digest_of(root: Path) -> str:
    """Hash of the code that an episode runs, and of the weights that its bodies walk by.

    Args:
        root: Directory of the packages.
    """
    digest = hashlib.sha256()
    for name, path in sorted(_modules(root, _ENTRY).items()):
        digest.update(f"{name} {_code_of(path)}\n".encode())
    for path in sorted(root.glob(_DATA)):
        digest.update(f"{path.name} {hashlib.sha256(path.read_bytes()).hexdigest()}\n".encode())
    return digest.hexdigest()[:_DIGITS]


def _settings(config: EpisodeConfig) -> Row:
    body = make_body(config.robot, trust=config.trust)
    settings = settings_of(resolve(config.method, config.options), body.spec, body.lidar)
    digest = digest_of_body(body)
    return settings if digest is None else settings | {"robot_sha256": digest}


def _modules(root: Path, entry: str) -> dict[str, Path]:
    """Source files of a module and of those of this project that it imports, directly or not, by name."""
    found: dict[str, Path] = {}
    waiting = [entry]
    while waiting:
        name = waiting.pop()
        path = _source_of(root, name)
        if path is None or name in found:
            continue
        found[name] = path
        waiting += [name.rpartition(".")[0], *_imports(ast.parse(path.read_bytes()))]
    return found


def _source_of(root: Path, module: str) -> Path | None:
    """Source file of a module of this project; None if it is none."""
    if module.partition(".")[0] not in _PACKAGES:
        return None
    place = root.joinpath(*module.split("."))
    return next((path for path in (place.with_suffix(".py"), place / "__init__.py") if path.is_file()), None)


def _imports(tree: ast.Module) -> Iterator[str]:
    """Names that a module imports, wherever in it; some are not those of modules."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def _code_of(path: Path) -> str:
    """What a source file does, as text: its syntax tree without docstrings, whatever Python's version."""
    return _tell(ast.parse(path.read_bytes()))


def _tell(node: Any) -> str:
    if isinstance(node, list):
        return f"[{' '.join(_tell(each) for each in node if not _is_docstring(each))}]"
    if not isinstance(node, ast.AST):
        return repr(node)
    parts = ((name, getattr(node, name, None)) for name in node._fields if name != "kind")
    return f"{type(node).__name__}({' '.join(f'{name}={_tell(v)}' for name, v in parts if v not in (None, []))})"


def _is_docstring(node: Any) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)

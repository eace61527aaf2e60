"""A deployable bundle: a robot and the stack that drives it, as they were exported, read with suspicion.

>>> bundle = load_bundle(Path("my-bundle"))  # doctest: +SKIP
>>> navigator = bundle.navigator()  # doctest: +SKIP
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import yaml

from vuca_nav.build import StackConfig, build_navigator
from vuca_nav.data_files import shown
from vuca_nav.deploy.manifest import CRITIC, NAVIGATOR, POLICY, ROBOT, Manifest, read_manifest
from vuca_nav.deploy.robot_file import RobotFile
from vuca_nav.errors import BadArgument, BadBundle, BadWeights
from vuca_nav.navigator import Navigator
from vuca_nav.plain import from_plain, to_plain
from vuca_nav.telemetry.interface import Telemetry
from vuca_nav.types import BodySpec, LidarSpec
from vuca_nav.yaml_file import Limits, read_yaml

_LIMITS = Limits(nodes=10_000, aliases=0)


@dataclass(frozen=True, slots=True)
class Bundle:
    """A bundle whose files are those that were exported."""

    directory: Path
    manifest: Manifest
    robot: RobotFile
    """The robot: body, lidar, deceleration, frames, topics, rates."""
    config: StackConfig
    """Every setting of the stack; its weights files are those of the bundle."""

    @property
    def body(self) -> BodySpec:
        """The body that is driven."""
        return self.robot.body

    @property
    def lidar(self) -> LidarSpec:
        """The lidar that the bundle was made for."""
        return self.robot.lidar

    def navigator(self, telemetry: Telemetry = Telemetry(), lidar: LidarSpec | None = None) -> Navigator:
        """Build the stack as it was exported.

        Args:
            telemetry: Receives what the stages report.
            lidar: The lidar that the robot really has, where it is not the bundle's.

        Raises:
            BadBundle: The parts do not go together.
        """
        try:
            return build_navigator(self.config, self.body, lidar or self.lidar, telemetry)
        except (BadArgument, BadWeights) as error:
            raise BadBundle(f"{self.directory}: {error}") from error


def load_bundle(directory: Path) -> Bundle:
    """Read a bundle, and see that it is whole and unchanged.

    Args:
        directory: Folder that ``vuca export`` wrote, or a copy of it.

    Raises:
        BadBundle: If a file is missing, too many, changed or cannot be used, the format is newer, or robot and manifest
            do not go together.
    """
    manifest = read_manifest(directory)
    robot = _read(directory / ROBOT, RobotFile)
    if robot.body.name != manifest.robot:
        raise BadBundle(
            f"{directory / ROBOT} is of the robot {shown(repr(robot.body.name))}, the bundle of "
            f"{shown(repr(manifest.robot))}; export the bundle again"
        )
    config = _read(directory / NAVIGATOR, StackConfig)
    config = replace(
        config,
        weights=_inside(directory, manifest, config.weights, POLICY),
        critic=_inside(directory, manifest, config.critic, CRITIC)
        if isinstance(config.critic, Path)
        else config.critic,
    )
    return Bundle(directory, manifest, robot, config)


def as_yaml(config: RobotFile | StackConfig, heading: str) -> bytes:
    """A file of a bundle.

    Args:
        config: Its content.
        heading: A comment before it.
    """
    text = yaml.safe_dump(to_plain(config), sort_keys=False, allow_unicode=True, default_flow_style=None, width=120)
    return f"# {heading}\n{text}".encode()


def _read(path: Path, kind: Any) -> Any:
    """The content of a YAML file of a bundle."""
    return from_plain(kind, read_yaml(path, BadBundle, _LIMITS).value, str(path), BadBundle)


def _inside(directory: Path, manifest: Manifest, given: Path | None, name: str) -> Path | None:
    """The path of a weights file that the stack's description names."""
    if given is None:
        return None
    if str(given) != name or name not in manifest.files:
        raise BadBundle(
            f"{directory / NAVIGATOR}: weights of {shown(repr(str(given)))}, expected the bundle's own {name}"
        )
    return directory / name

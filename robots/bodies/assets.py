"""Paths of the robots' descriptions: example-robot-data, as pip installs it."""

from importlib import metadata
from pathlib import Path

from vuca_nav.errors import VucaError, how_to_install

PACKAGE = "example-robot-data"
ROBOTS_FOLDER = "cmeel.prefix/share/example-robot-data/robots"
"""Folder inside site-packages: the wheel is built by cmeel, which installs under its own prefix."""


class MissingAsset(VucaError):
    """A robot description that is not installed, or a file of it that is not there."""


def robots_folder() -> Path:
    """Find the folder that holds one ``*_description`` folder a robot.

    Raises:
        MissingAsset: If the package is not installed, or not as pip installs it.
    """
    try:
        distribution = metadata.distribution(PACKAGE)
    except metadata.PackageNotFoundError as error:
        raise MissingAsset(
            f"{PACKAGE} is not installed; it holds the robots' meshes: {how_to_install('sim')}"
        ) from error
    folder = Path(str(distribution.locate_file(ROBOTS_FOLDER)))
    if not folder.is_dir():
        raise MissingAsset(
            f"{PACKAGE} {distribution.version} is installed but {folder} is not a folder; "
            f"install the wheel from PyPI: pip install --force-reinstall {PACKAGE}"
        )
    return folder


def asset(path: str) -> Path:
    """Find a file of the package, e.g. ``"tiago_description/robots/tiago.urdf"``.

    Args:
        path: Path relative to the robots folder, or a URI ``package://example-robot-data/robots/...`` as URDFs use.

    Raises:
        MissingAsset: If there is no such file.
    """
    relative = path.removeprefix(f"package://{PACKAGE}/robots/")
    if "://" in relative:
        raise MissingAsset(f"cannot resolve {path!r}: expected package://{PACKAGE}/robots/...")
    folder = robots_folder()
    file = folder / relative
    if not file.is_file():
        raise MissingAsset(f"{PACKAGE} has no file {relative!r} (looked in {folder})")
    return file

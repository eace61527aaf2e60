"""The files of a robot: only those of its own folder are read, each once, and their content is remembered."""

import hashlib
import xml.etree.ElementTree as ElementTree
from pathlib import Path

from vuca_nav.data_files import read_bytes, read_text, shown
from vuca_nav.errors import VucaError

MOST_XML = 8 * 2**20
"""Greatest size of an MJCF or a URDF [bytes]; MuJoCo Menagerie's largest has 0.2 MB."""
MOST_MESH = 64 * 2**20
"""Greatest size of a mesh [bytes]."""
MOST_BYTES = 512 * 2**20
"""Greatest size of all files of a robot together [bytes]."""
_PACKAGE = "package://"


class BadRobot(VucaError):
    """A robot of one's own that cannot be used: its file, its description, or what the two make together."""


class RobotFolder:
    """Reads the files of a robot's folder and no others.

    Args:
        file: The robot's file; its folder holds all the others.
    """

    def __init__(self, file: Path):
        self.file = file
        self._root = file.parent.resolve()
        self._contents: dict[str, bytes] = {}

    @property
    def digest(self) -> str:
        """SHA-256 of the robot's file and of all that has been read, with their names."""
        digest = hashlib.sha256()
        for name, content in sorted(self._contents.items()):
            digest.update(f"{name} {hashlib.sha256(content).hexdigest()}\n".encode())
        return digest.hexdigest()

    def locate(self, name: str, beside: Path, what: str) -> Path:
        """Find a file of the folder.

        Args:
            name: Its path as the other file gives it, or a URI ``package://PACKAGE/...``, whose package is the folder
                itself or one of its folders.
            beside: Folder that a path is relative to.
            what: What refers to it, for messages.

        Raises:
            BadRobot: If the path leads out of the folder, or there is no such file.
        """
        if name.startswith(_PACKAGE):
            package, _, rest = name.removeprefix(_PACKAGE).partition("/")
            places = [self._root / package / rest, self._root / rest]
        elif "://" in name:
            raise self.wrong(what, f"{shown(name)!r} is no file of the robot's folder", "a path in it")
        else:
            places = [beside / name]
        inside = [place for place in map(Path.resolve, places) if place.is_relative_to(self._root)]
        if not inside:
            raise self.wrong(what, f"{shown(name)!r} leads out of the robot's folder {self._root}", "a file in it")
        found = next((place for place in inside if place.is_file()), None)
        if found is None:
            raise self.wrong(what, f"there is no file {shown(name)!r} ({shown(inside[0], 200)})")
        return found

    def read(self, path: Path, most: int = MOST_MESH) -> bytes:
        """Read a file that ``locate`` has found.

        Raises:
            BadRobot: If it cannot be read or is too large, alone or with the others.
        """
        content = read_bytes(path, most, BadRobot)
        self._remember(path, content)
        return content

    def read_xml(self, path: Path) -> ElementTree.Element:
        """Read an XML file, without the parts of XML that expand or refer to other files.

        Raises:
            BadRobot: If it cannot be read, is not XML, or declares a document type.
        """
        text = read_text(path, BadRobot, MOST_XML)
        self._remember(path, text.encode())
        if "<!DOCTYPE" in text or "<!ENTITY" in text:
            raise BadRobot(f"{path} declares a document type or entities; a description without them would be right")
        try:
            return ElementTree.fromstring(text)
        except (ElementTree.ParseError, ValueError, RecursionError) as error:
            raise BadRobot(f"{path} is not XML: {error}") from error

    def wrong(self, where: str, problem: str, right: str = "") -> BadRobot:
        """The error that says what is wrong, and where.

        Args:
            where: Field of the robot's file, or part of its description.
            problem: What is wrong there.
            right: What would be right instead, if the problem does not say it.
        """
        return BadRobot(f"{self.file}: {where}: {problem}{f'; {right} would be right' if right else ''}")

    def _remember(self, path: Path, content: bytes) -> None:
        self._contents[path.resolve().relative_to(self._root).as_posix()] = content
        if sum(map(len, self._contents.values())) > MOST_BYTES:
            raise BadRobot(f"{self.file}: its files are larger than {MOST_BYTES // 2**20} MiB together")

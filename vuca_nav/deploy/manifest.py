"""The manifest of a bundle: which files there are, with their SHA-256, and what they are; written and read whole.

A bundle is a plain folder of files with fixed names. Its manifest holds the SHA-256 of each, and its own, ``digest``,
so that one changed byte anywhere is noticed. That guards against damage and mix-ups, not against somebody who can
write the folder: who needs that keeps the digest elsewhere, or signs ``manifest.json``.
"""

import contextlib
import hashlib
import json
import os
import shutil
import stat
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from vuca_nav.data_files import parse_json, read_bytes, read_text, shown
from vuca_nav.errors import BadBundle

KIND = "vuca-bundle"
FORMAT = 1
"""Version of the format; a greater one is refused."""
MANIFEST = "manifest.json"
NAVIGATOR, ROBOT, STEPS = "navigator.yaml", "robot.yaml", "steps.safetensors"
POLICY, CRITIC = "policy.safetensors", "critic.safetensors"
POLICY_GRAPH, CRITIC_GRAPH = "policy.onnx", "critic.onnx"
_TEXT, _BINARY = 2**20, 256 * 2**20
MOST_BYTES: dict[str, int] = {
    NAVIGATOR: _TEXT, ROBOT: _TEXT, STEPS: _BINARY, POLICY: _BINARY, CRITIC: _BINARY, POLICY_GRAPH: _BINARY,
    CRITIC_GRAPH: _BINARY,
}  # fmt: skip
"""Greatest size of each file that a bundle may have [bytes]."""
NEEDED = (NAVIGATOR, ROBOT, STEPS)
"""Files that every bundle has."""


class Manifest(NamedTuple):
    """A manifest whose folder has been found to be as it says."""

    digest: str
    """SHA-256 of the manifest, and so of the whole bundle."""
    robot: str
    """The robot's name."""
    method: str
    """The method as it was typed, with its options."""
    files: tuple[str, ...]
    """Names of the files beside the manifest."""
    content: dict[str, Any]
    """All of it: contract, versions, figures."""


def write_bundle(out: Path, files: Mapping[str, bytes], about: Mapping[str, Any]) -> str:
    """Write a bundle whole, or not at all.

    Args:
        out: Folder of the bundle; one that is there already is replaced if it is empty or a bundle.
        files: Contents by name.
        about: The rest of the manifest: ``robot``, ``method``, and whatever else is worth telling, as JSON holds it.

    Returns:
        The manifest's digest.

    Raises:
        BadBundle: If there is something else at ``out``, or it cannot be written.
    """
    target = Path(os.path.realpath(out))
    check_target(out)
    hashes = {name: {"bytes": len(data), "sha256": _sha256(data)} for name, data in sorted(files.items())}
    content = {"kind": KIND, "format": FORMAT, **about, "files": hashes}
    content["digest"] = digest_of(content)
    text = f"{json.dumps(content, indent=2, allow_nan=False)}\n"
    aside, old = (target.with_name(f".{target.name}-{os.getpid()}.{end}") for end in ("new", "old"))
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        aside.mkdir()
        for name, data in {**files, MANIFEST: text.encode()}.items():
            with open(aside / name, "xb") as file:
                file.write(data)
                file.flush()
                os.fsync(file.fileno())
        if target.exists() and any(target.iterdir()):
            target.rename(old)
        aside.rename(target)
    except OSError as error:
        raise BadBundle(f"--out {out} cannot be written: {error.strerror}") from error
    finally:
        with contextlib.suppress(OSError):
            if old.exists() and not target.exists():  # an error, or an interrupt
                old.rename(target)
        shutil.rmtree(aside, ignore_errors=True)
        shutil.rmtree(old, ignore_errors=True)
    return content["digest"]


def check_target(out: Path) -> None:
    """Raise BadBundle if there is something at ``out`` that a new bundle must not replace."""
    if not os.path.lexists(out):
        return
    if not out.is_dir():
        raise BadBundle(f"--out {out} is a file, expected a directory")
    names = sorted(os.listdir(out))
    if names and (MANIFEST not in names or set(names) - set(MOST_BYTES) - {MANIFEST}):
        odd = next((name for name in names if name not in MOST_BYTES and name != MANIFEST), names[0])
        raise BadBundle(f"--out {out} holds {shown(odd)}, which is not of a bundle; a new or empty directory would do")


def digest_of(content: Mapping[str, Any]) -> str:
    """SHA-256 of a manifest without its own digest, whatever the order and the spaces of its text."""
    rest = {key: value for key, value in content.items() if key != "digest"}
    return _sha256(json.dumps(rest, sort_keys=True, separators=(",", ":"), allow_nan=False).encode())


def read_manifest(directory: Path) -> Manifest:
    """Read a bundle's manifest, and find every file as it says.

    Raises:
        BadBundle: If it is no bundle, of a newer format, or a file is missing, too many, changed, or no plain file in
            the folder itself.
    """
    try:
        entries = {entry.name: entry.stat(follow_symlinks=False).st_mode for entry in os.scandir(directory)}
    except OSError as error:
        raise BadBundle(
            f"{directory} cannot be read: {error.strerror}; a folder of vuca export would be right"
        ) from error
    if MANIFEST not in entries:
        raise BadBundle(f"{directory} is no bundle: it has no {MANIFEST}; a folder of vuca export would be right")
    for name, mode in sorted(entries.items()):
        if not stat.S_ISREG(mode):
            kind = "a symbolic link" if stat.S_ISLNK(mode) else "no regular file"
            raise BadBundle(f"{directory / shown(name)} is {kind}; a bundle is plain files only")
    source = directory / MANIFEST
    content = parse_json(read_text(source, BadBundle, _TEXT), str(source), BadBundle)
    files = _listed(source, content)
    odd = sorted(set(entries) - set(files) - {MANIFEST})
    if odd:
        raise BadBundle(f"{directory / shown(odd[0])} is not listed in {MANIFEST}; keep files of your own elsewhere")
    for name, entry in files.items():
        if name not in entries:
            raise BadBundle(f"{directory} is incomplete: {name} is missing; copy or export the bundle again")
        data = read_bytes(directory / name, MOST_BYTES[name], BadBundle)
        if len(data) != entry["bytes"] or _sha256(data) != entry["sha256"]:
            raise BadBundle(
                f"{directory / name} is not the file of this bundle: its SHA-256 is not the one in {MANIFEST}; copy or "
                "export the bundle again"
            )
    return Manifest(content["digest"], content["robot"], content["method"], tuple(files), content)


def _listed(source: Path, content: Any) -> dict[str, dict[str, Any]]:
    """The files that a manifest lists, once it is known to be one."""
    if not isinstance(content, dict) or content.get("kind") != KIND:
        raise BadBundle(f"{source}: not the manifest of a bundle; one of vuca export would be right")
    version = content.get("format")
    if not isinstance(version, int) or isinstance(version, bool) or version != FORMAT:
        newer = isinstance(version, int) and version > FORMAT
        advice = "a newer vuca-nav reads it" if newer else f"{FORMAT} would be right"
        raise BadBundle(f"{source}: its format is {shown(repr(version))}, this vuca-nav reads {FORMAT}: {advice}")
    if content.get("digest") != digest_of(content):
        raise BadBundle(f"{source} was changed: its digest is not that of its content; export the bundle again")
    for name in ("robot", "method"):
        if not isinstance(content.get(name), str):
            raise BadBundle(f"{source}: {name} is {shown(repr(content.get(name)))}, expected a name")
    files = content.get("files")
    if not isinstance(files, dict):
        raise BadBundle(f"{source}: files is {shown(repr(files))}, expected an object of names")
    for name, entry in files.items():
        if name not in MOST_BYTES:
            where = "leads out of the folder" if "/" in name or "\\" in name or ".." in name else "is no file of one"
            raise BadBundle(f"{source}: files: {shown(name)!r} {where}; a bundle holds {', '.join(MOST_BYTES)}")
        if not isinstance(entry, dict) or not isinstance(entry.get("sha256"), str) or "bytes" not in entry:
            raise BadBundle(f"{source}: files: {name} is {shown(repr(entry))}, expected its bytes and sha256")
    missing = [name for name in NEEDED if name not in files]
    if missing:
        raise BadBundle(f"{source}: files: {missing[0]} is not listed; export the bundle again")
    return files


def _sha256(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()

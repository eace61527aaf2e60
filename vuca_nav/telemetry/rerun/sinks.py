"""Sinks of a recording: Rerun streams into a file, into a viewer window, or to browsers."""

import os
import shutil
import socket
import sys
from pathlib import Path
from urllib.parse import quote

import rerun as rr
from rerun.experimental import ViewerClient

from vuca_nav.errors import BadArgument
from vuca_nav.files import check_regular

APPLICATION = "vuca_nav"
"""Application id; its recordings share the layout that the user made in the viewer."""

_GRPC_PORT, _WEB_PORT = 9876, 9090
"""Rerun's own defaults; another free port is taken where they are in use."""


def stream_to_file(path: str | os.PathLike[str]) -> rr.RecordingStream:
    """A stream into an ``.rrd`` file; an existing one is overwritten.

    Raises:
        BadArgument: The file cannot be written.
    """
    path = Path(os.fsdecode(path))
    if path.is_dir():
        raise BadArgument(f"cannot record to {str(path)!r}: it is a directory; give a file name as in 'run.rrd'")
    if not path.parent.is_dir():
        raise BadArgument(f"cannot record to {str(path)!r}: there is no directory {str(path.parent)!r}")
    try:
        str(path).encode()
    except UnicodeEncodeError:
        raise BadArgument(f"cannot record to {str(path)!r}: Rerun takes only names that are UTF-8") from None
    try:
        if path.exists():
            check_regular("--record", path)
        path.open("wb").close()
    except OSError as error:
        raise BadArgument(f"cannot record to {str(path)!r}: {error.strerror}") from error
    stream = rr.RecordingStream(APPLICATION)
    try:
        stream.save(path)
    except RuntimeError as error:
        raise BadArgument(f"cannot record to {str(path)!r}: {_one_line(error)}") from error
    return stream


def stream_to_window() -> rr.RecordingStream:
    """A stream into a new viewer window, which outlives this process.

    Raises:
        BadArgument: There is no display, or the viewer does not start.
    """
    if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise BadArgument("no display to open a viewer on; record to a file or serve to a browser instead")
    # The viewer of this environment has the version of the SDK, and need not be in the PATH.
    viewer = shutil.which("rerun", path=str(Path(sys.executable).parent)) or shutil.which("rerun")
    if viewer is None:
        raise BadArgument("the program 'rerun' is not installed; pip install rerun-sdk brings it")
    try:
        client = ViewerClient.spawn(port=_free_port(_GRPC_PORT), hide_welcome_screen=True, executable_path=viewer)
    except (RuntimeError, OSError) as error:
        raise BadArgument(f"the Rerun viewer does not start: {_one_line(error)}") from error
    stream = rr.RecordingStream(APPLICATION)
    stream.connect_grpc(client.url)
    return stream


def stream_to_browsers(*, open_browser: bool) -> tuple[rr.RecordingStream, str]:
    """A stream served to web viewers for as long as it and this process live, and the viewers' address.

    Raises:
        BadArgument: The server does not start.
    """
    stream = rr.RecordingStream(APPLICATION)
    web_port = _free_port(_WEB_PORT)
    try:
        uri = stream.serve_grpc(grpc_port=_free_port(_GRPC_PORT))
        rr.serve_web_viewer(web_port=web_port, open_browser=open_browser, connect_to=uri)
    except (RuntimeError, OSError) as error:
        raise BadArgument(f"the Rerun server does not start: {_one_line(error)}") from error
    return stream, f"http://127.0.0.1:{web_port}/?url={quote(uri, safe='')}"


def _free_port(preferred: int) -> int:
    """The preferred port, or any free one if it is in use."""
    for port in (preferred, 0):
        with socket.socket() as probe:
            try:
                probe.bind(("0.0.0.0", port))
            except OSError:
                continue
            return int(probe.getsockname()[1])
    raise BadArgument("no free network port on this machine")


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())

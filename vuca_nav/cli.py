"""The console script ``vuca``: finds its commands by entry point, turns errors into one line and exit codes.

A command is a function ``(argv) -> exit code`` registered in the group ``vuca.commands``; the first line of
its docstring is its entry in the help. Exit codes: 0 the command did its work, 1 part of it failed, 2 bad
input or no means to do the work, 130 interrupted, 143 terminated, 129 its terminal closed.
"""

import contextlib
import importlib
import io
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from importlib.metadata import EntryPoint, entry_points, version
from types import FrameType
from typing import Any, TextIO, TypeVar

from vuca_nav.errors import UnknownName, VucaError, how_to_install
from vuca_nav.own_packages import prefer_own_packages

Command = Callable[[list[str]], int]
Arguments = TypeVar("Arguments")

GROUP = "vuca.commands"
EXTRA_OF_MODULE = {
    "collada": "sim",
    "cyclonedds": "deploy",
    "dm_control": "sim",
    "gymnasium": "sim",
    "jsonschema": "sim",
    "matplotlib": "sim",
    "mcap": "deploy",
    "mujoco": "sim",
    "onnx": "sim",
    "onnxruntime": "deploy",
    "ray": "distributed",
    "rosbags": "deploy",
    "tensorboard": "train",
    "tensordict": "train",
    "torch": "train",
    "torchrl": "train",
    "tqdm": "sim",
    "trimesh": "sim",
    "zenoh": "zenoh",
}
"""The extra of this project that brings an optional package."""

EXIT_BAD_INPUT = 2
EXIT_INTERRUPTED = 130


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command.

    Args:
        argv: Arguments after ``vuca``; by default the process's own arguments.

    Returns:
        The exit code.
    """
    arguments = list(sys.argv[1:] if argv is None else argv)
    name = arguments[0] if arguments else ""
    return _answer(f"vuca {name}".rstrip(), lambda: _run(name, arguments))


def _run(name: str, arguments: list[str]) -> int:
    """Run the command of this name, the first of the arguments."""
    prefer_own_packages()
    commands = {entry.name: entry for entry in entry_points(group=GROUP)}
    if name in ("", "-h", "--help"):
        print(_overview(commands), file=sys.stdout if arguments else sys.stderr)
        return 0 if arguments else EXIT_BAD_INPUT
    if name == "--version":
        print(version("vuca-nav"))
        return 0
    if name not in commands:
        raise UnknownName("command", name, commands)
    return commands[name].load()(arguments[1:])


def run_module(name: str, main: Callable[[Arguments], object], kind: type[Arguments]) -> None:
    """Run the single command of a module under ``python -m``, with the error lines and exit codes of ``vuca``.

    Args:
        name: The command's name in messages.
        main: The command.
        kind: Its arguments, a dataclass.
    """
    spec = sys.modules["__main__"].__spec__  # none of a script or of -c
    program = f"python -m {spec.name.removesuffix('.__main__')}" if spec else name

    def command() -> int:
        prefer_own_packages()
        main(_parse(kind, program, sys.argv[1:]))
        return 0

    sys.exit(_answer(name, command))


class Terminated(KeyboardInterrupt):
    """The process was asked to end by a signal; work ends as at an interrupt from the keyboard.

    Args:
        number: The signal, SIGTERM or SIGHUP.
    """

    def __init__(self, number: int):
        self.exit_code = 128 + number
        super().__init__()


class ReaderGone(Exception):
    """The reader of stdout, ``head`` for example, has seen enough."""


def show(text: str) -> None:
    """Print a result on stdout at once.

    Args:
        text: The result; where stdout cannot take it, on a full disk for example, it goes to stderr.

    Raises:
        VucaError: If stdout could not take it.
    """
    try:
        print(text, flush=True)
    except VucaError:
        print(text, file=sys.stderr)
        raise


def _answer(name: str, command: Callable[[], int]) -> int:
    """Run a command and return its exit code; an error is printed as one line first."""
    with _standard_streams(), _termination_as_interrupt():
        try:
            code = command()
            sys.stdout.flush()
            return code
        except SystemExit as request:  # of --help, whose text waits in the buffer
            with contextlib.suppress(VucaError, ReaderGone):
                sys.stdout.flush()
            return request.code if isinstance(request.code, int) else 0
        except ReaderGone:
            return 0
        except VucaError as error:
            return _bad_input(name, str(error))
        except ModuleNotFoundError as error:
            return _bad_input(name, _what_to_install(error))
        except Terminated as request:
            print(f"\n{name}: terminated", file=sys.stderr)
            return request.exit_code
        except KeyboardInterrupt:
            print(f"\n{name}: interrupted", file=sys.stderr)
            return EXIT_INTERRUPTED
        except OSError as error:
            where = "" if error.filename is None else f"{os.fsdecode(error.filename)}: "
            return _bad_input(name, f"{where}{error.strerror or error}")


@contextlib.contextmanager
def _standard_streams() -> Iterator[None]:
    """Standard streams that can take any text: a command goes on without a stream that was closed before it.

    A descriptor that is free would be given to the next file that is opened, a file of results for example, and
    libraries that complain on descriptor 2 would write into it.
    """
    for descriptor in range(3):
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest free descriptor, this one
    if sys.stdout is None:
        sys.stdout = open(1, "w", closefd=False)  # noqa: SIM115
    if sys.stderr is None:
        sys.stderr = open(2, "w", closefd=False)  # noqa: SIM115
    with contextlib.redirect_stderr(_Messages(sys.stderr)), contextlib.redirect_stdout(_Results(sys.stdout)):
        yield


class _Stream(io.TextIOBase):
    """A standard stream that takes any text: characters that it does not know become escapes.

    Args:
        stream: Stream that is written to.
    """

    def __init__(self, stream: TextIO):
        self._stream = stream

    @property
    def encoding(self) -> str:  # type: ignore[override]
        """Encoding of the stream."""
        return getattr(self._stream, "encoding", None) or "utf-8"

    def write(self, text: str) -> int:
        """Write text."""
        try:
            self._stream.write(text.encode(self.encoding, "backslashreplace").decode(self.encoding))
        except OSError as error:
            self._give_up(error)
        return len(text)

    def flush(self) -> None:
        """Write what is buffered."""
        try:
            self._stream.flush()
        except OSError as error:
            self._give_up(error)

    def isatty(self) -> bool:
        """Whether the stream is a terminal."""
        return self._stream.isatty()

    def fileno(self) -> int:
        """Descriptor of the stream."""
        return self._stream.fileno()

    def _give_up(self, error: OSError) -> None:
        """Send what is left in the buffer to nowhere, where it cannot fail again when the process ends."""
        with contextlib.suppress(OSError, ValueError), open(os.devnull, "w") as nowhere:
            os.dup2(nowhere.fileno(), self.fileno())


class _Messages(_Stream):
    """Stream of progress and messages: what it cannot take is lost, and the work goes on."""


class _Results(_Stream):
    """Stream of results: what it cannot take ends the work."""

    def _give_up(self, error: OSError) -> None:
        super()._give_up(error)
        if isinstance(error, BrokenPipeError):
            raise ReaderGone from error
        raise VucaError(f"cannot write to stdout: {error.strerror}") from error


@contextlib.contextmanager
def _termination_as_interrupt() -> Iterator[None]:
    """Let SIGTERM end the work as Ctrl-C does, so that workers end and what is finished is kept.

    So does SIGHUP, of a terminal that was closed or a connection that was lost, unless it is ignored (nohup).
    """
    if threading.current_thread() is not threading.main_thread():
        yield  # only the main thread handles signals
        return

    def terminate(number: int, _frame: FrameType | None) -> None:
        raise Terminated(number)

    before = {signal.SIGTERM: signal.getsignal(signal.SIGTERM)}
    if signal.getsignal(signal.SIGHUP) == signal.SIG_DFL:
        before[signal.SIGHUP] = signal.SIG_DFL
    for number in before:
        signal.signal(number, terminate)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextlib.contextmanager
def undisturbed() -> Iterator[None]:
    """Ignore requests to end, for a short last word that must be said: a second Ctrl-C, SIGTERM or SIGHUP is lost."""
    if threading.current_thread() is not threading.main_thread():
        yield  # which is not interrupted
        return
    requests = signal.SIGINT, signal.SIGTERM, signal.SIGHUP
    before = {number: signal.signal(number, signal.SIG_IGN) for number in requests}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def parse(kind: type[Arguments], command: str, argv: list[str]) -> Arguments:
    """The command's arguments as a frozen dataclass.

    Args:
        kind: A dataclass; its fields are the flags, their docstrings the help.
        command: The command's name, for the help.
        argv: Arguments after the command's name.

    Raises:
        VucaError: An argument is unknown, missing or not of its type.
    """
    return _parse(kind, f"vuca {command}", argv)


def optional(metavar: str) -> Any:
    """An argument that may be left out: the help shows it without a default of None.

    Args:
        metavar: Name of its value in the help.
    """
    import tyro

    return tyro.conf.arg(metavar=metavar, help_behavior_hint="")


def _parse(kind: type[Arguments], program: str, argv: list[str]) -> Arguments:
    """Parse arguments as ``parse`` does, for the program that is typed as ``program``."""
    import tyro

    complaint = io.StringIO()
    try:
        with contextlib.redirect_stderr(complaint):
            return tyro.cli(
                kind,
                args=argv,
                prog=program,
                config=(tyro.conf.FlagCreatePairsOff, tyro.conf.OmitArgPrefixes),
            )
    except SystemExit as exit_request:
        if exit_request.code in (0, None):  # --help
            raise
        raise VucaError(f"{_first_paragraph(complaint.getvalue())} (see {program} --help)") from None


def _first_paragraph(box: str) -> str:
    """The message inside one of tyro's boxes, up to its first rule or its list of attempts, as one line.

    Where the terminal has no Unicode, the box has no frame, and a rule of hyphens under its title.
    """
    words: list[str] = []
    in_title = "╭" not in box
    for line in box.splitlines():
        text = line.strip(" │")
        if line.startswith(("╭", "╰")):
            continue
        if text.startswith(("────", "----")):
            if not in_title:
                break
            in_title, words = False, []
            continue
        if text == "Got errors:":
            break
        words += text.split()
    return " ".join(words).replace("{None}|", "").rstrip(".") or "bad arguments"


def _bad_input(name: str, message: str) -> int:
    """Print a message as one line and return the exit code of bad input."""
    print(f"{name}: {' '.join(message.split())}", file=sys.stderr)
    return EXIT_BAD_INPUT


def _what_to_install(error: ModuleNotFoundError) -> str:
    """Advice on the extra that brings the missing package; without one it is a bug, and the error is raised again."""
    module = (error.name or "").partition(".")[0]
    if module not in EXTRA_OF_MODULE:
        raise error
    if module == "dm_control" and sys.version_info >= (3, 13):  # pyproject.toml says why
        return f"needs the package {module!r}: on Python 3.13, run pip install --no-deps dm-control==1.0.50"
    return f"needs the package {module!r}: {how_to_install(EXTRA_OF_MODULE[module])}"


def _overview(commands: dict[str, EntryPoint]) -> str:
    """The help of ``vuca`` itself."""
    width = max((len(name) for name in commands), default=0)
    lines = ["usage: vuca COMMAND [OPTIONS]", ""]
    lines += ["Robot navigation in unknown, crowded, maze-like buildings.", ""]
    lines += ["commands:", *(f"  {name:{width}}  {_summary(commands[name])}" for name in sorted(commands))]
    return "\n".join([*lines, "", "vuca COMMAND --help tells about one command, vuca --version the version."])


def _summary(entry: EntryPoint) -> str:
    """The first line of the command's docstring."""
    try:
        return (entry.load().__doc__ or "").strip().partition("\n")[0]
    except ModuleNotFoundError as error:
        return f"({_what_to_install(error)})"


if __name__ == "__main__":
    # By its name, as the commands know it: here it is __main__, another module.
    sys.exit(importlib.import_module("vuca_nav.cli").main())

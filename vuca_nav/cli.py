"""The console script ``vuca``: finds its commands by entry point, turns errors into one line and exit codes.

A command is a function ``(argv) -> exit code`` registered in the group ``vuca.commands``; the first line of
its docstring is its entry in the help. Exit codes: 0 the command did its work, 1 part of it failed, 2 bad
input, 130 interrupted.
"""

import contextlib
import io
import sys
from collections.abc import Callable, Sequence
from importlib.metadata import EntryPoint, entry_points, version
from typing import TypeVar

from vuca_nav.errors import UnknownName, VucaError, how_to_install

Command = Callable[[list[str]], int]
Arguments = TypeVar("Arguments")

GROUP = "vuca.commands"
EXTRA_OF_MODULE = {
    "PIL": "sim",
    "collada": "sim",
    "dm_control": "sim",
    "gymnasium": "sim",
    "jsonschema": "sim",
    "matplotlib": "train",
    "mujoco": "sim",
    "ray": "distributed",
    "tensorboard": "train",
    "tensordict": "train",
    "torch": "train",
    "torchrl": "train",
    "tqdm": "sim",
    "trimesh": "sim",
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
    commands = {entry.name: entry for entry in entry_points(group=GROUP)}
    if not arguments or arguments[0] in ("-h", "--help"):
        print(_overview(commands), file=sys.stdout if arguments else sys.stderr)
        return 0 if arguments else EXIT_BAD_INPUT
    if arguments[0] == "--version":
        print(version("vuca-nav"))
        return 0
    name = arguments[0]

    def command() -> int:
        if name not in commands:
            raise UnknownName("command", name, commands)
        return commands[name].load()(arguments[1:])

    return _answer(f"vuca {name}", command)


def run_module(name: str, main: Callable[[Arguments], object], kind: type[Arguments]) -> None:
    """Run the single command of a module under ``python -m``, with the error lines and exit codes of ``vuca``.

    Args:
        name: The command's name in messages.
        main: The command.
        kind: Its arguments, a dataclass.
    """
    spec = sys.modules["__main__"].__spec__  # none of a script or of -c
    program = f"python -m {spec.name}" if spec else name

    def command() -> int:
        main(_parse(kind, program, sys.argv[1:]))
        return 0

    sys.exit(_answer(name, command))


def _answer(name: str, command: Callable[[], int]) -> int:
    """Run a command and return its exit code; an error is printed as one line first."""
    try:
        return command()
    except VucaError as error:
        return _bad_input(name, str(error))
    except ModuleNotFoundError as error:
        return _bad_input(name, _what_to_install(error))
    except KeyboardInterrupt:
        print(f"\n{name}: interrupted", file=sys.stderr)
        return EXIT_INTERRUPTED
    except BrokenPipeError:  # the reader of the output, `head` for example, has closed the pipe
        sys.stderr.close()
        return 1


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
    sys.exit(main())

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

from vuca_nav.errors import UnknownName, VucaError

Command = Callable[[list[str]], int]
Arguments = TypeVar("Arguments")

GROUP = "vuca.commands"
EXTRA_OF_MODULE = {
    "PIL": "sim",
    "collada": "sim",
    "dm_control": "sim",
    "jsonschema": "sim",
    "matplotlib": "train",
    "mujoco": "sim",
    "tensorboard": "train",
    "tensordict": "train",
    "torch": "train",
    "torchrl": "train",
    "tqdm": "sim",
    "trimesh": "sim",
}
"""Which of our extras brings an optional package."""

EXIT_BAD_INPUT = 2
EXIT_INTERRUPTED = 130


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command.

    Args:
        argv: What follows ``vuca``; by default the process's own arguments.

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
    try:
        if name not in commands:
            raise UnknownName("command", name, commands)
        return commands[name].load()(arguments[1:])
    except VucaError as error:
        return _bad_input(name, str(error))
    except ModuleNotFoundError as error:
        return _bad_input(name, _what_to_install(error))
    except KeyboardInterrupt:
        print(f"\nvuca {name}: interrupted", file=sys.stderr)
        return EXIT_INTERRUPTED
    except BrokenPipeError:  # the reader of our output, as `head`, has gone
        sys.stderr.close()
        return 1


def run_module(name: str, main: Callable[[Arguments], object], kind: type[Arguments]) -> None:
    """What ``python -m`` of a module with a single command does; bad input ends with the same exit code as elsewhere.

    Args:
        name: For messages.
        main: The command.
        kind: Its arguments, a dataclass.
    """
    import tyro

    try:
        main(tyro.cli(kind, config=(tyro.conf.FlagCreatePairsOff,)))
    except VucaError as error:
        print(f"{name}: {error}", file=sys.stderr)
        sys.exit(EXIT_BAD_INPUT)


def parse(kind: type[Arguments], command: str, argv: list[str]) -> Arguments:
    """The command's arguments as a frozen dataclass.

    Args:
        kind: A dataclass; its fields are the flags, their docstrings the help.
        command: The command's name, for the help.
        argv: What follows the command's name.

    Raises:
        VucaError: An argument is unknown, missing or not of its type.
    """
    import tyro

    complaint = io.StringIO()
    try:
        with contextlib.redirect_stderr(complaint):
            return tyro.cli(
                kind,
                args=argv,
                prog=f"vuca {command}",
                config=(tyro.conf.FlagCreatePairsOff, tyro.conf.OmitArgPrefixes),
            )
    except SystemExit as exit_request:
        if exit_request.code in (0, None):  # --help
            raise
        raise VucaError(f"{_first_paragraph(complaint.getvalue())} (see vuca {command} --help)") from None


def _first_paragraph(box: str) -> str:
    """The message inside one of tyro's boxes, up to its first rule or its list of attempts, as one line."""
    words: list[str] = []
    for line in box.splitlines():
        text = line.strip(" │")
        if line.startswith(("╭", "╰")):
            continue
        if text.startswith("────") or text == "Got errors:":
            break
        words += text.split()
    return " ".join(words).replace("{None}|", "").rstrip(".") or "bad arguments"


def _bad_input(name: str, message: str) -> int:
    """One line, however many the message has."""
    print(f"vuca {name}: {' '.join(message.split())}", file=sys.stderr)
    return EXIT_BAD_INPUT


def _what_to_install(error: ModuleNotFoundError) -> str:
    """Which extra brings the missing package; a package that no extra brings is a bug, and raised again."""
    module = (error.name or "").partition(".")[0]
    if module not in EXTRA_OF_MODULE:
        raise error
    return f"needs the package {module!r}: pip install 'vuca-nav[{EXTRA_OF_MODULE[module]}]'"


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

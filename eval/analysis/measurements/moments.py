"""The last avoidable moments of all collisions of an evaluation: ``vuca explain DIR --all``."""

from collections.abc import Sequence
from pathlib import Path

from eval.analysis.attribution import NotRepeated, config_of, explain
from eval.analysis.measurements.files import measure
from eval.episode import EpisodeConfig
from eval.runner import Crash, key_of
from eval.store import Row

KIND = "moments"
FILE = "moments.jsonl"
_COURSE = ("outcome", "duration", "path_length")
"""Fields that are the same in two runs of an episode that repeats."""


def find_moments(
    rows: Sequence[Row], path: Path, command: str = "", *, trust: bool = False
) -> tuple[list[Row], list[Crash]]:
    """Find the last avoidable moment of every collision; begun again, it goes on where it was.

    Args:
        rows: Rows of episodes, of which those that ended in a collision are run again.
        path: The file of measurements, which gets a line for each.
        command: The command as typed.
        trust: Whether motions of the user's own, in scene files, may be run.

    Returns:
        Of each collision the fields that name the episode, ``outcome``, ``duration``, ``path_length``, ``contact``,
        ``t_inevitable`` [s] (None if no moment was found in 10 s), ``t_inevitable_is_certain``, and ``is_repeated``:
        whether the run came out as the row says. And the episodes that could not be run.

    Raises:
        VucaError: The file cannot be gone on with, or cannot be written.
    """
    collisions = {key_of(row): row for row in rows if row["outcome"] == "collision"}

    def compared(now: Row) -> Row:
        before = collisions[key_of(now)]
        return {**now, "is_repeated": all(now[name] == before.get(name) for name in _COURSE)}

    configs = [config_of(row, trust=trust) for row in collisions.values()]
    return measure(path, KIND, configs, moment_of, command=command, finish=compared) if configs else ([], [])


def moment_of(config: EpisodeConfig) -> Row:
    """Run an episode again, and search for the last moment at which its contact could be avoided."""
    try:
        now = explain(config).row()
    except NotRepeated:
        now = {}
    told = (*_COURSE, "contact", "t_inevitable", "t_inevitable_is_certain")
    return {**config.row(), **{name: now.get(name) for name in told}}

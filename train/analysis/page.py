"""The page of an evaluation of policies: the names of its rows, their contents, and its tables."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from eval.analysis.statistics import wilson_interval
from train.analysis.episodes import EpisodeRecords
from vuca_nav.errors import BadArgument

AS_IT_IS = "as it is"
"""The variant of a policy with its own gate and no shield, and of the dynamic window."""


class GateUse(NamedTuple):
    """Use of a gate in one kind of world."""

    mean: list[float]
    """Mean share of each expert."""
    entropy: float
    """Mean entropy over the decisions [nat]."""
    information: float
    """Mutual information of observation and expert [nat]: 0 if the gate is the same whatever is seen."""


def row_names(files: Sequence[Path]) -> list[str]:
    """Name the rows: by the files' names, and files of the same name by as much of their paths as tells them apart.

    Args:
        files: Weights files.

    Raises:
        BadArgument: If a file is given twice.
    """
    paths = [Path(os.path.abspath(file)).with_suffix("").parts for file in files]
    for path, file in zip(paths, files):
        if paths.count(path) > 1:
            raise BadArgument(f"{file} is given twice")

    def shortest(path: tuple[str, ...]) -> tuple[str, ...]:
        for k in range(1, len(path)):
            if sum(other[-k:] == path[-k:] for other in paths) == 1:
                return path[-k:]
        return path

    return ["/".join(shortest(path)) for path in paths]


def summary(records: EpisodeRecords, gate: GateUse | None = None) -> dict:
    """Make a row of the table."""
    n, successes = len(records.success), int(records.success.sum())
    return {
        "episodes": n, "success": successes / n, "success_interval": wilson_interval(successes, n),
        "collision": float(records.collision.mean()),
        "collision_interval": wilson_interval(int(records.collision.sum()), n),
        "timeout": float(records.timeout.mean()),
        "time_of_successes": float(records.time[records.success].mean()) if successes else None,
        "arsps": float(records.arsps.mean()), "ansps": float(records.ansps.mean()),
        "gate": None if gate is None else gate._asdict(),
    }  # fmt: skip


def markdown(results: dict, worlds: Sequence[str], episodes: int, seed: int) -> str:
    """Write the results as tables in Markdown.

    Args:
        results: Results of ``evaluate``.
        worlds: Kinds of worlds, a table each.
        episodes: Number of episodes in each kind of world.
        seed: Seed of the episodes.
    """
    lines = [f"{episodes} episodes of seed {seed} in each kind of world, the same for all.", ""]
    for kind in worlds:
        lines += [
            f"## {kind}", "",
            "| policy | success % | crash % | time-out % | time [s] | ARSPS | ANSPS x 1000 | gate | gate entropy, "
            "information | difference in success |",
            "|---|---|---|---|---|---|---|---|---|---|",
        ]  # fmt: skip
        for name, variants in results.items():
            for variant, kinds in variants.items():
                row = kinds[kind]
                low, high = row["success_interval"]
                against = row.get("against_as_it_is") or row.get("against_first")
                difference = (
                    "" if against is None else "{:+.1f} ({:+.1f} to {:+.1f})".format(*(100 * x for x in against))
                )
                gate = row["gate"]
                shares = "" if gate is None else " ".join(f"{share:.2f}" for share in gate["mean"])
                entropy = "" if gate is None else f"{gate['entropy']:.2f}, {gate['information']:.3f}"
                time = "" if row["time_of_successes"] is None else f"{row['time_of_successes']:.1f}"
                lines.append(
                    f"| {name if variant == AS_IT_IS else f'{name}, {variant}'} "
                    f"| {100 * row['success']:.1f} ({100 * low:.1f}-{100 * high:.1f}) | {100 * row['collision']:.1f} "
                    f"| {100 * row['timeout']:.1f} | {time} | {row['arsps']:.3f} | {1000 * row['ansps']:.3f} "
                    f"| {shares} | {entropy} | {difference} |"
                )
        lines.append("")
    lines.append(
        "Differences are paired: with the first policy, of a gate that is overruled or commands that are shielded "
        "with the same policy without."
    )
    return "\n".join([*lines, ""])

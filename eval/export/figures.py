"""The figures that a manifest tells: of the training, from the card beside the weights; of evaluations, kept rows."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from eval.analysis.summary import is_result, summarise
from eval.episode import OUTCOMES
from eval.kept import SUFFIX, read_lines, read_stored
from eval.methods import AnyConfig, identity_of
from vuca_nav.data_files import parse_json, read_text
from vuca_nav.errors import BadArgument, VucaError

ROWS = Path(__file__).resolve().parents[2] / "docs" / "results" / "rows"
"""The kept rows of the clone that this code runs from; an installed package has none."""
_LINE = re.compile(r"- (Command|Commit|Steps|Started from|Learnt from|Cross entropy[^:]*): (.*)")


def training_figures(weights: Path, metadata: dict[str, str]) -> dict[str, Any]:
    """What is known of a network's training.

    Args:
        weights: Its weights file; its card is beside it.
        metadata: The file's metadata.
    """
    told: dict[str, Any] = {
        "weights": weights.stem,
        **{key: value for key, value in metadata.items() if key != "observation"},
    }
    card = next((path for path in (weights.with_suffix(".md"), weights.parent / "card.md") if path.is_file()), None)
    if card is None:
        return told | {"card": None, "reason": "there is no card beside the weights"}
    lines = read_text(card, BadArgument).splitlines()
    told["card"] = {found[1]: found[2] for line in lines if (found := _LINE.fullmatch(line))}
    table = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines if line.startswith("|")]
    if len(table) == 3:
        told["at_the_end"] = {
            **dict(zip(table[0], table[2])),
            "of": "the episodes that ended in the last fiftieth of the training, with the noise of exploration",
            "interval": None,
            "reason": "the card does not give their number",
        }
    return told


def evaluation_figures(robot: str, title: str, config: AnyConfig) -> dict[str, Any]:
    """Outcomes of a robot and method in evaluations whose rows are kept, with 95% Wilson intervals.

    Args:
        robot: The robot's name.
        title: The method as it is typed, with its options.
        config: The method's configuration; rows of other weights do not count.
    """
    identity = identity_of(config)
    found = []
    for source in sorted(ROWS.glob(f"*{SUFFIX}")):
        stored = read_stored(source)
        ours = stored.config.get("configurations", {}).get(title)
        if stored.config.get("robots") != [robot] or ours is None:
            continue
        if any(ours.get(key) != identity.get(key) for key in ("weights_sha256", "critic_sha256")):
            continue
        groups = [
            {
                "world": group["world"],
                "region": group["region"],
                "episodes": group["n"],
                **{outcome: group[outcome] for outcome in OUTCOMES},
            }
            for group in summarise([row for row in _rows(source) if is_result(row)])
        ]
        made_by = stored.made_by
        found.append(
            {"rows": source.name, "seeds": stored.config.get("seeds"), "code": made_by.get("code"), "of": groups}
        )
    if not found:
        return {"evaluations": None, "reason": f"docs/results/rows has none of {title} on {robot} with these weights"}
    return {"evaluations": found, "interval": "Wilson, 95%"}


def _rows(source: Path) -> Iterator[dict[str, Any]]:
    place, lines = read_lines(source)
    for number, line in enumerate(lines, start=1):
        row = parse_json(line, f"{place}: row {number}", VucaError)
        if isinstance(row, dict):
            yield row

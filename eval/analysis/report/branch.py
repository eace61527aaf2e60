"""The choice of branch: which of a world's two ways is entered first, over the number of movers on the short one."""

from collections.abc import Sequence

from eval.analysis.report.cells import Cell
from eval.analysis.report.comparisons import QUIET
from eval.analysis.report.tables import Column, Table, Value

WORLD, SHORT = "double_branch", "short"


def branch_cells(cells: Sequence[Cell]) -> list[Cell]:
    """The cells in the world with two ways, in the order of their movers, with nothing else changed of it."""
    found = [
        cell
        for cell in cells
        if cell.task["world"] == WORLD and cell.task["movers"] is not None and not cell.task["without"]
        and cell.task["speed"] in (None, 1.0) and all(cell.task[name] is None for name in ("sighted", "start", "goal"))
    ]  # fmt: skip
    return sorted(found, key=lambda cell: cell.task["movers"])


def branch_table(cells: Sequence[Cell]) -> Table:
    """How often each way was entered first."""
    found = sorted(branch_cells(cells), key=lambda cell: (cell.robot, [c.method for c in cells].index(cell.method)))
    rows: list[list[Value]] = []
    for cell in found:
        quiet, short = (cell.share(lambda row, way=way: row.get("way") == way) for way in (QUIET, SHORT))
        neither, collisions = len(cell.rows) - quiet.count - short.count, cell.share(_collides)
        rows.append([cell.robot, cell.method, cell.task["movers"], len(cell.rows), quiet, short, neither, collisions])
    note = (
        "Which of two ways to the goal was entered first: the short one, on which the movers are, or the longer, quiet "
        "one; neither if the episode ended before. Shares of all episodes with Wilson's 95% intervals."
    )
    titles = ("robot", "method", "movers", "episodes", "quiet", "short", "neither", "collision")
    return Table("branch", "Choice of branch", note, tuple(map(Column, titles)), rows)


def _collides(row: dict) -> bool:
    return row["outcome"] == "collision"

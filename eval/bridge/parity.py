"""``python -m eval.bridge.parity``: rows of vuca deploy and vuca bridge in lockstep, beside those of a single process.

The deployed stack has to drive as the one that was evaluated: each row over the wire is compared with that of the same
mission in one process (``--monitor``), field by field.
"""

from eval.analysis.report.tables import Column, Table, Value, markdown
from eval.bridge.remote_stack import Lockstep
from eval.bridge.trials import Cell, Deployed, TrialArguments, cells_of, differences, drive_alone, drive_over_the_wire
from eval.store import Row
from vuca_nav.cli import run_module, show
from vuca_nav.files import write_whole

NOTE = (
    "Missions of vuca deploy and vuca bridge as two processes in lockstep, beside the same in one process. Rows are "
    "compared to the bit, in all fields but those that measure the computer."
)
COLUMNS = (Column("robot, task"), Column("missions"), Column("equal rows"), Column("arrived"), Column("differences"))


def run(arguments: TrialArguments) -> None:
    """Drive all missions both ways and compare them."""
    lines: list[list[Value]] = []
    for cell in cells_of(arguments):
        alone = drive_alone(cell, arguments)
        deployed = Deployed(cell, arguments, ("--lockstep",), Lockstep(arguments.timeout))
        wire = drive_over_the_wire(cell, arguments, deployed, {"lockstep": True})
        lines.append(_line(cell, wire, alone))
    text = "\n".join(markdown(Table("parity", "Parity over the wire", NOTE, COLUMNS, lines)))
    write_whole(arguments.out / "parity.md", f"{text}\n")
    show(text)


def _line(cell: Cell, wire: list[Row], alone: list[Row]) -> list[Value]:
    """The cell's line of the table."""
    different = [differences(a, b) for a, b in zip(wire, alone, strict=True)]
    named = [f"seed {row['seed']}: {', '.join(names)}" for row, names in zip(wire, different) if names]
    equal = sum(not names for names in different)
    arrived = sum(row["outcome"] == "success" for row in wire)
    return [cell.name, len(wire), equal, arrived, "; ".join(named) or "none"]


if __name__ == "__main__":
    run_module("parity", run, TrialArguments)

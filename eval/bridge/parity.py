"""``python -m eval.bridge.parity``: rows of vuca deploy and vuca bridge in lockstep, beside those of a single process.

The deployed stack has to drive as the one that was evaluated: each row over the wire is compared with that of the same
mission in one process (``--monitor``), field by field.
"""

from collections.abc import Sequence

from eval.analysis.report.tables import Column, Table, Value, markdown
from eval.bridge.remote_stack import Lockstep
from eval.bridge.trials import (
    Deployed,
    Driven,
    TrialArguments,
    cells_of,
    differences,
    drive_alone,
    drive_over_the_wire,
    driven_in,
)
from vuca_nav.cli import run_module, show
from vuca_nav.files import write_whole

SETTINGS = {"lockstep": True}
"""What the rows depend on beside the missions."""
NOTE = (
    "Missions of vuca deploy and vuca bridge as two processes in lockstep, beside the same in one process. Rows are "
    "compared to the bit, in all fields but those that measure the computer."
)
COLUMNS = (Column("robot, task"), Column("missions"), Column("equal rows"), Column("arrived"), Column("differences"))


def run(arguments: TrialArguments) -> None:
    """Drive all missions both ways and compare them."""
    found = []
    for cell in cells_of(arguments):
        drive_alone(cell, arguments)
        deployed = Deployed(cell, arguments, ("--lockstep",), Lockstep(arguments.timeout))
        drive_over_the_wire(cell, arguments, deployed, SETTINGS)
        found.append(driven_in(arguments.out / cell.name))
    text = "\n".join(markdown(table_of([driven for driven in found if driven is not None])))
    write_whole(arguments.out / "parity.md", f"{text}\n")
    show(text)


def table_of(found: Sequence[Driven]) -> Table:
    """The table of cells: how many rows are equal, and in what the others differ."""
    return Table("parity", "Parity over the wire", NOTE, COLUMNS, [_line(driven) for driven in found])


def _line(driven: Driven) -> list[Value]:
    """The cell's line of the table."""
    different = [differences(wire, alone) for wire, alone in zip(driven.wire, driven.alone, strict=True)]
    named = [f"seed {row['seed']}: {', '.join(names)}" for row, names in zip(driven.wire, different) if names]
    equal, (arrived, _) = sum(not names for names in different), driven.arrived()
    return [driven.name, driven.missions, equal, int(arrived.sum()), "; ".join(named) or "none"]


if __name__ == "__main__":
    run_module("parity", run, TrialArguments)

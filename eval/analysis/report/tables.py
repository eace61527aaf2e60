"""Tables of a report, each written in Markdown, as CSV and in HTML from the same cells."""

import csv
import io
from collections.abc import Sequence
from typing import NamedTuple

from eval.analysis.statistics import Estimate, wilson_interval
from vuca_nav.data_files import shown


class Share(NamedTuple):
    """A number of episodes among others, told with Wilson's 95% interval."""

    count: int
    of: int

    @property
    def estimate(self) -> Estimate:
        """The share with its interval; the share of nothing is 0."""
        return Estimate(self.count / self.of if self.of else 0.0, *wilson_interval(self.count, self.of))


Value = str | int | float | Share | Estimate | None


class Column(NamedTuple):
    """A column of a table."""

    title: str
    digits: int = 2
    """Digits after the point."""
    signed: bool = False
    """Whether a plus is written, as before differences."""

    def text(self, value: Value) -> str:
        """A cell as it is read; None is a dash."""
        if isinstance(value, Share):
            low, high = (f"{100 * end:.0f}" for end in value.estimate[1:])
            return f"{value.count} [{low}, {high}%]"
        if isinstance(value, Estimate):
            middle, low, high = map(self._number, value)
            return f"{middle} [{low}, {high}]"
        if isinstance(value, float):
            return self._number(value)
        return "-" if value is None else shown(value, 1000)

    def _number(self, value: float) -> str:
        rounded = round(value, self.digits) + 0.0  # no minus before a zero
        return f"{rounded:{'+' if self.signed else ''}.{self.digits}f}"


class Table(NamedTuple):
    """A table."""

    name: str
    """Name of its file."""
    title: str
    note: str
    """What the cells are, in sentences."""
    columns: tuple[Column, ...]
    rows: list[list[Value]]

    @property
    def header(self) -> list[str]:
        """The titles of the columns."""
        return [column.title for column in self.columns]

    @property
    def texts(self) -> list[list[str]]:
        """The cells as they are read."""
        return [[column.text(value) for column, value in zip(self.columns, row, strict=True)] for row in self.rows]


def markdown(table: Table) -> list[str]:
    """The table as lines of Markdown, with its title and its note."""
    return [f"## {table.title}", "", table.note, "", *grid(table.header, table.texts)]


def grid(header: Sequence[str], rows: Sequence[Sequence[object]]) -> list[str]:
    """A bare table as lines of Markdown."""
    return [_line(header), "|" + "---|" * len(header), *(_line(row) for row in rows)]


def _line(cells: Sequence[object]) -> str:
    """A line of a table; what a folder says is one line of text in it, neither markup nor columns."""
    texts = (shown(cell, 1000).replace("|", "\\|").replace("<", "&lt;") for cell in cells)
    return f"| {' | '.join(texts)} |"


def as_csv(table: Table) -> str:
    """The table as CSV, with numbers in full; an interval takes two further columns, a share its total as well."""
    header: list[str] = []
    parts: list[list[list[Value]]] = []
    cells: list[list[Value]]
    for k, column in enumerate(table.columns):
        values = [row[k] for row in table.rows]
        if any(isinstance(value, Share) for value in values):
            header += [column.title, f"{column.title}: of", f"{column.title}: low", f"{column.title}: high"]
            cells: list[list[Value]] = [
                [v.count, v.of, *v.estimate[1:]] if isinstance(v, Share) else [v, "", "", ""] for v in values
            ]
        elif any(isinstance(value, Estimate) for value in values):
            header += [column.title, f"{column.title}: low", f"{column.title}: high"]
            cells = [list(v) if isinstance(v, Estimate) else [v, "", ""] for v in values]
        else:
            header, cells = [*header, column.title], [[value] for value in values]
        parts.append(cells)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(header)
    for row in zip(*parts, strict=True):
        writer.writerow(["" if v is None else v for cells in row for v in cells])
    return text.getvalue()

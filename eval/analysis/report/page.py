"""The report as one HTML page, which needs nothing else: tables, figures, and failed episodes with their pictures."""

import base64
from collections.abc import Sequence
from itertools import groupby
from typing import Any, NamedTuple

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from eval.analysis.report.failed import Failed, in_detail
from eval.analysis.report.figures.drawing import Picture
from eval.analysis.report.tables import Table
from vuca_nav.data_files import read_bytes, shown
from vuca_nav.errors import BadArgument

MOST_SHOWN = 10
"""Greatest number of failed episodes of a cell that the page shows; the table ``failed.csv`` has all."""
MOST_OF_A_PICTURE = 2**20
"""Greatest size of a picture [bytes]; those of ``vuca explain`` have a tenth."""


class _Group(NamedTuple):
    """The failed episodes of a cell."""

    title: str
    n: int
    members: list[Failed]


def html_page(
    tables: Sequence[Table], pictures: Sequence[Picture], failed: Sequence[Failed], facts: Sequence[Table]
) -> str:
    """The page.

    Args:
        tables: Tables, in their order.
        pictures: Figures.
        failed: Failed episodes, those of a cell in a row.
        facts: What was run, for each evaluation.

    Raises:
        BadArgument: A picture of a failed episode cannot be read.
    """
    environment = Environment(
        loader=PackageLoader("eval.analysis.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"shown": lambda text: shown(text, 1000), "in_detail": _in_detail, "png": _png}
    environment.filters["parts"] = lambda text: text.replace("`", "").split("; ")
    environment.filters["inline"] = lambda picture: Markup(picture.inline)
    groups = [
        _Group(f"{cell.method} on {cell.robot} in {cell.place}", len(members), members[:MOST_SHOWN])
        for cell, members in ((found[0].cell, found) for found in _grouped(failed))
    ]
    content: dict[str, Any] = {"tables": tables, "pictures": pictures, "groups": groups, "facts": facts}
    return f"{environment.get_template('report.html.j2').render(**content)}\n"


def _grouped(failed: Sequence[Failed]) -> list[list[Failed]]:
    return [list(members) for _, members in groupby(failed, key=lambda each: id(each.cell))]


def _in_detail(each: Failed) -> list[str]:
    return in_detail(each.row).splitlines()


def _png(each: Failed) -> str | None:
    """The picture as part of the page; None if there is none."""
    if each.picture is None:
        return None
    content = read_bytes(each.picture, MOST_OF_A_PICTURE, BadArgument)
    if not content.startswith(b"\x89PNG"):
        raise BadArgument(f"{each.picture} is no PNG; remove it, or run vuca explain again")
    return f"data:image/png;base64,{base64.b64encode(content).decode()}"

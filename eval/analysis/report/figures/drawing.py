"""What the figures have in common: their style, colours, bars, lines and legends, and how they become SVG."""

import io
import re
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from eval.analysis.statistics import Estimate
from vuca_nav.data_files import shown

INK = "#14181f"
"""Colour of text and axes; ``inline`` replaces it by that of the page."""
COLOURS = (
    "#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#d55e00", "#8c7a00", "#7b6fd0", "#7f7f7f", "#a05a2c",
    "#2f8f8f", "#c23b5a",
)  # fmt: skip
"""Colours of the methods: those of Okabe and Ito that are read on light and on dark, and others."""
WIDTH = 105
"""Number of letters that fit beside each other in a figure; a column of a legend takes 8 beside its text."""
STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",
    "font.family": "sans-serif",
    "font.size": 9.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "legend.frameon": False,
    **dict.fromkeys(("text.color", "axes.labelcolor", "axes.edgecolor", "xtick.color", "ytick.color"), INK),
}


class Picture(NamedTuple):
    """A figure as SVG, and what it shows."""

    name: str
    title: str
    caption: str
    svg: str

    @property
    def inline(self) -> str:
        """The SVG as part of an HTML page: in the page's own ink, its names apart from those of other figures."""
        svg = self.svg[self.svg.index("<svg") :].replace(INK, "currentColor")
        svg = re.sub(r'(\bid="|href="#|url\(#)', rf"\g<1>{self.name}-", svg)
        return re.sub(r"<metadata>.*?</metadata>", "", svg, flags=re.S)


def colours_of(methods: Iterable[str]) -> dict[str, str]:
    """A colour for each method, in their order."""
    return {method: COLOURS[k % len(COLOURS)] for k, method in enumerate(dict.fromkeys(methods))}


def bars(
    axes: Axes,
    groups: Sequence[str],
    methods: Sequence[str],
    found: dict[tuple[str, str], Estimate | None],
    colours: dict[str, str],
) -> None:
    """Bars in groups, a method each, with their intervals."""
    there = {group: [method for method in methods if found.get((group, method)) is not None] for group in groups}
    width = 0.84 / max([1, *map(len, there.values())])
    style = {"ecolor": INK, "elinewidth": 0.9, "capsize": 1.5}
    for i, group in enumerate(groups):
        for k, method in enumerate(there[group]):
            estimate = found[group, method]
            if estimate is not None:
                x = i + (k - 0.5 * (len(there[group]) - 1)) * width
                axes.bar(x, estimate.value, width, color=colours[method], yerr=_errors([estimate]), error_kw=style)
    axes.set_xticks(range(len(groups)), [label_of(group) for group in groups])


def line(axes: Axes, points: Sequence[tuple[float, Estimate]], colour: str) -> None:
    """A line through estimates, with their intervals."""
    x, y = [place for place, _ in points], [estimate.value for _, estimate in points]
    axes.errorbar(x, y, yerr=_errors(e for _, e in points), color=colour, marker="o", capsize=2, linewidth=1.5)


def _errors(estimates: Iterable[Estimate]) -> list[list[float]]:
    found = list(estimates)
    return [[max(0.0, e.value - e.low) for e in found], [max(0.0, e.high - e.value) for e in found]]


def label_of(text: str) -> str:
    """A text of a folder, so that matplotlib takes no part of it as mathematics."""
    return shown(text, 60).replace("$", r"\$")


def legend(figure: Figure, methods: Sequence[str], colours: dict[str, str]) -> None:
    """The colours of methods, above a figure."""
    patches = [Patch(color=colours[method], label=label_of(method)) for method in methods]
    widest = max(len(str(patch.get_label())) for patch in patches)
    columns = max(1, min(len(methods), 5, WIDTH // (widest + 8)))
    figure.legend(handles=patches, loc="outside upper center", ncols=columns)


def picture_of(name: str, title: str, caption: str, figure: Figure) -> Picture:
    """The figure as SVG: the same bytes for the same content."""
    content = io.StringIO()
    with matplotlib.rc_context({"svg.hashsalt": name}):
        figure.savefig(content, format="svg", metadata={"Date": None}, transparent=True)
    name = re.sub(r"[^\w-]+", "-", name)
    return Picture(name, title, caption, content.getvalue())

"""The figures of a report: bars of five metrics, success over the dials and without V, U, C or A, contacts by class."""

import io
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from eval.analysis.report.cells import Cell, unique
from eval.analysis.statistics import Estimate, interquartile_mean
from eval.contact import CONTACT_CLASSES
from eval.store import Row
from vuca_nav.data_files import shown

INK = "#14181f"
"""Colour of text and axes; ``inline`` replaces it by that of the page."""
COLOURS = (
    "#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#d55e00", "#8c7a00", "#7b6fd0", "#7f7f7f", "#a05a2c",
    "#2f8f8f", "#c23b5a",
)  # fmt: skip
"""Colours of the methods: those of Okabe and Ito that are read on light and on dark, and others."""
CLASS_COLOURS = ("#7f7f7f", "#56b4e9", "#009e73", "#d55e00", "#e69f00", "#cc79a7")
"""Colours of the classes of contacts."""
STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",
    "font.family": "sans-serif",
    "font.size": 9.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "legend.frameon": False,
    **dict.fromkeys(("text.color", "axes.labelcolor", "axes.edgecolor", "xtick.color", "ytick.color"), INK),
}
DIALS = (("movers", "number of movers"), ("speed", "factor on their speeds"), ("sighted", "share that see the robot"))
WITHOUT = ("", "V", "U", "C", "A")


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


def figures_of(cells: Sequence[Cell]) -> list[Picture]:
    """All figures for which there are rows."""
    pictures: list[Picture] = []
    for robot in unique(cell.robot for cell in cells):
        here = [cell for cell in cells if cell.robot == robot]
        colours = {method: COLOURS[k % len(COLOURS)] for k, method in enumerate(unique(cell.method for cell in here))}
        with matplotlib.rc_context(STYLE):  # pyright: ignore[reportArgumentType]
            pictures += _metrics(robot, [cell for cell in here if cell.is_plain] or here, colours)
            pictures += _contacts(robot, [cell for cell in here if cell.is_plain] or here)
            pictures += _dials(robot, here, colours)
            pictures += _without(robot, here, colours)
    return pictures


def _metrics(robot: str, cells: Sequence[Cell], colours: dict[str, str]) -> list[Picture]:
    """Bars of the paper's five metrics."""
    panels = (("success", "success [%]"), ("collision", "collision [%]"), ("arriving_time", "arriving time [s]"),
              ("arsps", "ARSPS"), ("ansps", "ANSPS"))  # fmt: skip
    places, methods = unique(cell.place for cell in cells), unique(cell.method for cell in cells)
    figure = Figure(figsize=(8.0, 9.0), layout="constrained")
    for axes, (measure, label) in zip(figure.subplots(len(panels), 1, sharex=True), panels):
        found = {(cell.place, cell.method): _estimate(cell, measure) for cell in cells}
        _bars(axes, places, methods, found, colours)
        axes.set_ylabel(label)
        if label.endswith("[%]"):
            axes.set_ylim(0.0, 100.0)
    _legend(figure, methods, colours)
    caption = (
        "Shares with Wilson's 95% intervals; arriving time, ARSPS (risk, less is better) and ANSPS (progress, more is "
        "better) as interquartile means with bootstrapped 95% intervals."
    )
    return [_picture(f"metrics-{robot}", f"Five metrics, {robot}", caption, figure)]


def _contacts(robot: str, cells: Sequence[Cell]) -> list[Picture]:
    """Collisions by class, as stacked shares of the episodes."""
    members = [cell for cell in cells if any(row.get("contact") for row in cell.rows.values())]
    if not members:
        return []
    figure = Figure(figsize=(8.0, 1.1 + 0.28 * len(members)), layout="constrained")
    axes = figure.subplots()
    left = [0.0] * len(members)
    places = range(len(members))
    for name, colour in zip(CONTACT_CLASSES, CLASS_COLOURS, strict=True):
        shares = [100.0 * cell.share(lambda row: _class(row) == name).estimate.value for cell in members]  # noqa: B023
        axes.barh(places, shares, left=left, color=colour, label=name, height=0.7)
        left = [a + b for a, b in zip(left, shares, strict=True)]
    own = [
        100.0 * cell.share(lambda row: bool((row.get("contact") or {}).get("own"))).estimate.value for cell in members
    ]
    axes.plot(own, places, "|", color=INK, markersize=11, markeredgewidth=2, label="own")
    axes.set_yticks(places, [_label(f"{cell.method}, {cell.place}") for cell in members])
    axes.set_ylim(len(members) - 0.5, -0.5)
    axes.set_xlim(0.0, 100.0)
    axes.set_xlabel("share of the episodes [%]")
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper center", ncols=7)
    caption = "Collisions by class. The mark is the share in which the robot's point of contact closed in on the other."
    return [_picture(f"contacts-{robot}", f"Contacts by class, {robot}", caption, figure)]


def _dials(robot: str, cells: Sequence[Cell], colours: dict[str, str]) -> list[Picture]:
    """Success over the number, the speed and the sight of the movers."""
    pictures = []
    for world, region in unique((cell.task["world"], cell.task["region"]) for cell in cells):
        here = [cell for cell in cells if (cell.task["world"], cell.task["region"]) == (world, region)]
        panels = [(dial, label, found) for dial, label in DIALS if (found := _over(here, dial))]
        if not panels:
            continue
        place = world if region is None else f"{world} {region}"
        figure = Figure(figsize=(8.0, 3.2), layout="constrained")
        axes_of = figure.subplots(1, len(panels), sharey=True, squeeze=False)[0]
        for axes, (dial, label, found) in zip(axes_of, panels):
            for method in unique(cell.method for cell in found):
                points = [(cell.task[dial], _estimate(cell, "success")) for cell in found if cell.method == method]
                points = [(x, estimate) for x, estimate in points if estimate is not None]
                _line(axes, points, colours[method])
            axes.set_xlabel(label)
            axes.set_xticks(sorted({cell.task[dial] for cell in found}))
            axes.set_ylim(0.0, 100.0)
        axes_of[0].set_ylabel("success [%]")
        _legend(figure, unique(cell.method for _, _, found in panels for cell in found), colours)
        caption = (
            "Success with Wilson's 95% intervals over each dial of the moving obstacles, all else as the world is."
        )
        name = re.sub(r"[^\w-]+", "-", f"dials-{robot}-{place}")
        pictures.append(_picture(name, f"Success over the dials, {robot}, {place}", caption, figure))
    return pictures


def _over(cells: Sequence[Cell], dial: str) -> list[Cell]:
    """The cells in which that dial alone is turned, in its order, of the methods that met several of its values."""
    plain = {"movers": None, "speed": 1.0, "sighted": None, "without": "", "start": None, "goal": None}
    others = {name: value for name, value in plain.items() if name != dial}
    found = [
        cell
        for cell in cells
        if cell.task[dial] is not None and all(cell.task[name] == value for name, value in others.items())
    ]
    found.sort(key=lambda cell: cell.task[dial])
    count = Counter(cell.method for cell in found)
    return [cell for cell in found if count[cell.method] > 1]


def _without(robot: str, cells: Sequence[Cell], colours: dict[str, str]) -> list[Picture]:
    """Success with all of V, U, C and A, and without each."""
    pictures = []
    for world, region in unique((cell.task["world"], cell.task["region"]) for cell in cells):
        here = [
            cell
            for cell in cells
            if (cell.task["world"], cell.task["region"]) == (world, region)
            and cell.task["without"] in WITHOUT
            and (cell.is_plain or cell.place.endswith(f", without {cell.task['without']}"))
        ]
        letters = [letter for letter in WITHOUT if any(cell.task["without"] == letter for cell in here)]
        if len(letters) < 2:
            continue
        names = {letter: f"without {letter}" if letter else "all of V, U, C, A" for letter in letters}
        found = {(names[cell.task["without"]], cell.method): _estimate(cell, "success") for cell in here}
        methods = unique(cell.method for cell in here)
        figure = Figure(figsize=(8.0, 3.4), layout="constrained")
        axes = figure.subplots()
        _bars(axes, list(names.values()), methods, found, colours)
        axes.set_ylabel("success [%]")
        axes.set_ylim(0.0, 100.0)
        _legend(figure, methods, colours)
        place = world if region is None else f"{world} {region}"
        caption = (
            "Success with Wilson's 95% intervals: with all difficulties, and without moving obstacles (V), the unknown "
            "map (U), corridors (C) or the noise of the sensors (A)."
        )
        name = re.sub(r"[^\w-]+", "-", f"difficulties-{robot}-{place}")
        pictures.append(_picture(name, f"Success by difficulty, {robot}, {place}", caption, figure))
    return pictures


def _bars(
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
    axes.set_xticks(range(len(groups)), [_label(group) for group in groups])


def _line(axes: Axes, points: Sequence[tuple[float, Estimate]], colour: str) -> None:
    """A line through estimates, with their intervals."""
    x, y = [place for place, _ in points], [estimate.value for _, estimate in points]
    axes.errorbar(x, y, yerr=_errors(e for _, e in points), color=colour, marker="o", capsize=2, linewidth=1.5)


def _errors(estimates: Iterable[Estimate]) -> list[list[float]]:
    found = list(estimates)
    return [[max(0.0, e.value - e.low) for e in found], [max(0.0, e.high - e.value) for e in found]]


def _estimate(cell: Cell, measure: str) -> Estimate | None:
    """A share in percent, or an interquartile mean."""
    if measure in ("success", "collision"):
        return Estimate(*(100.0 * part for part in cell.share(lambda row: row["outcome"] == measure).estimate))
    return interquartile_mean([cell.values(measure)])


def _label(text: str) -> str:
    """A text of a folder, so that matplotlib takes no part of it as mathematics."""
    return shown(text, 60).replace("$", r"\$")


def _class(row: Row) -> str | None:
    return (row.get("contact") or {}).get("class")


def _legend(figure: Figure, methods: Sequence[str], colours: dict[str, str]) -> None:
    patches = [Patch(color=colours[method], label=_label(method)) for method in methods]
    figure.legend(handles=patches, loc="outside upper center", ncols=min(len(methods), 5))


def _picture(name: str, title: str, caption: str, figure: Figure) -> Picture:
    """The figure as SVG: the same bytes for the same content."""
    content = io.StringIO()
    with matplotlib.rc_context({"svg.hashsalt": name}):
        figure.savefig(content, format="svg", metadata={"Date": None}, transparent=True)
    name = re.sub(r"[^\w-]+", "-", name)
    return Picture(name, title, caption, content.getvalue())

"""The figures of a report: bars of five metrics, success over the dials and without V, U, C or A, contacts by class."""

import re
from collections import Counter
from collections.abc import Sequence

import matplotlib
from matplotlib.figure import Figure

from eval.analysis.report.branch import branch_cells
from eval.analysis.report.cells import Cell, unique
from eval.analysis.report.comparisons import QUIET
from eval.analysis.report.figures.drawing import (
    INK,
    STYLE,
    Picture,
    bars,
    colours_of,
    label_of,
    legend,
    line,
    picture_of,
)
from eval.analysis.statistics import Estimate, interquartile_mean
from eval.contact import CONTACT_CLASSES
from eval.store import Row

CLASS_COLOURS = ("#7f7f7f", "#56b4e9", "#009e73", "#d55e00", "#e69f00", "#cc79a7")
"""Colours of the classes of contacts."""
DIALS = (("movers", "number of movers"), ("speed", "factor on their speeds"), ("sighted", "share that see the robot"))
WITHOUT = ("", "V", "U", "C", "A")


def outcome_figures(cells: Sequence[Cell]) -> list[Picture]:
    """All figures for which there are rows."""
    pictures: list[Picture] = []
    for robot in unique(cell.robot for cell in cells):
        here = [cell for cell in cells if cell.robot == robot]
        colours = colours_of(cell.method for cell in here)
        with matplotlib.rc_context(STYLE):  # pyright: ignore[reportArgumentType]
            pictures += _metrics(robot, [cell for cell in here if cell.is_plain] or here, colours)
            pictures += _contacts(robot, [cell for cell in here if cell.is_plain] or here)
            pictures += _dials(robot, here, colours)
            pictures += _without(robot, here, colours)
            pictures += _branch(robot, here, colours)
    return pictures


def _metrics(robot: str, cells: Sequence[Cell], colours: dict[str, str]) -> list[Picture]:
    """Bars of the paper's five metrics."""
    panels = (("success", "success [%]"), ("collision", "collision [%]"), ("arriving_time", "arriving time [s]"),
              ("arsps", "ARSPS"), ("ansps", "ANSPS"))  # fmt: skip
    places, methods = unique(cell.place for cell in cells), unique(cell.method for cell in cells)
    figure = Figure(figsize=(8.0, 9.0), layout="constrained")
    for axes, (measure, label) in zip(figure.subplots(len(panels), 1, sharex=True), panels):
        found = {(cell.place, cell.method): _estimate(cell, measure) for cell in cells}
        bars(axes, places, methods, found, colours)
        axes.set_ylabel(label)
        if label.endswith("[%]"):
            axes.set_ylim(0.0, 100.0)
    legend(figure, methods, colours)
    caption = (
        "Shares with Wilson's 95% intervals; arriving time, ARSPS (risk, less is better) and ANSPS (progress, more is "
        "better) as interquartile means with bootstrapped 95% intervals."
    )
    return [picture_of(f"metrics-{robot}", f"Five metrics, {robot}", caption, figure)]


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
    axes.set_yticks(places, [label_of(f"{cell.method}, {cell.place}") for cell in members])
    axes.set_ylim(len(members) - 0.5, -0.5)
    axes.set_xlim(0.0, 100.0)
    axes.set_xlabel("share of the episodes [%]")
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper center", ncols=7)
    caption = "Collisions by class. The mark is the share in which the robot's point of contact closed in on the other."
    return [picture_of(f"contacts-{robot}", f"Contacts by class, {robot}", caption, figure)]


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
                line(axes, points, colours[method])
            axes.set_xlabel(label)
            axes.set_xticks(sorted({cell.task[dial] for cell in found}))
            axes.set_ylim(0.0, 100.0)
        axes_of[0].set_ylabel("success [%]")
        legend(figure, unique(cell.method for _, _, found in panels for cell in found), colours)
        caption = (
            "Success with Wilson's 95% intervals over each dial of the moving obstacles, all else as the world is."
        )
        name = re.sub(r"[^\w-]+", "-", f"dials-{robot}-{place}")
        pictures.append(picture_of(name, f"Success over the dials, {robot}, {place}", caption, figure))
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
        bars(axes, list(names.values()), methods, found, colours)
        axes.set_ylabel("success [%]")
        axes.set_ylim(0.0, 100.0)
        legend(figure, methods, colours)
        place = world if region is None else f"{world} {region}"
        caption = (
            "Success with Wilson's 95% intervals: with all difficulties, and without moving obstacles (V), the unknown "
            "map (U), corridors (C) or the noise of the sensors (A)."
        )
        name = re.sub(r"[^\w-]+", "-", f"difficulties-{robot}-{place}")
        pictures.append(picture_of(name, f"Success by difficulty, {robot}, {place}", caption, figure))
    return pictures


def _branch(robot: str, cells: Sequence[Cell], colours: dict[str, str]) -> list[Picture]:
    """The share that takes the quiet branch, over the number of movers on the short one."""
    found = branch_cells(cells)
    movers = sorted({cell.task["movers"] for cell in found})
    if len(movers) < 2:
        return []
    figure = Figure(figsize=(8.0, 3.4), layout="constrained")
    axes = figure.subplots()
    methods = unique(cell.method for cell in cells if cell in found)
    for k, method in enumerate(methods):
        aside = 0.12 * (k - 0.5 * (len(methods) - 1))  # so that intervals do not hide each other
        points = [
            (cell.task["movers"] + aside, _percent(cell.share(lambda row: row.get("way") == QUIET).estimate))
            for cell in found
            if cell.method == method
        ]
        line(axes, points, colours[method])
    axes.set(xlabel="number of movers on the short branch", ylabel="take the quiet branch [%]", ylim=(0.0, 100.0))
    axes.set_xticks(movers)
    legend(figure, methods, colours)
    caption = (
        "Share of the episodes in which the longer, quiet branch is entered first, with Wilson's 95% intervals: with "
        "V^h (paper, ours) and without (paper-dh, ours-dh)."
    )
    return [picture_of(f"branch-{robot}", f"Choice of branch, {robot}", caption, figure)]


def _percent(estimate: Estimate) -> Estimate:
    return Estimate(*(100.0 * part for part in estimate))


def _estimate(cell: Cell, measure: str) -> Estimate | None:
    """A share in percent, or an interquartile mean."""
    if measure in ("success", "collision"):
        return _percent(cell.share(lambda row: row["outcome"] == measure).estimate)
    return interquartile_mean([cell.values(measure)])


def _class(row: Row) -> str | None:
    return (row.get("contact") or {}).get("class")

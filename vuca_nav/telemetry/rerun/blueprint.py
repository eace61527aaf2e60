"""Look of a recording in the Rerun viewer: entity colours, the layout of the panels, and a legend.

A colour family has one meaning: green is true, blue is estimated, orange is dead reckoning, magenta and violet are
wanted, cyan and red are sensed, gold is the goal.
"""

import math

import rerun as rr
import rerun.blueprint as rrb

from vuca_nav.task import NEAR_RANGE

TIMELINE = "time"
"""Seconds of the simulation or robot clock."""

CLOSE_RANGE = NEAR_RANGE
"""Returns nearer than this are drawn red [m]: where the paper's risk score and its reward R_o begin."""

Colour = tuple[int, int, int]
Bounds = tuple[float, float, float, float]
"""x_min, y_min, x_max, y_max [m]."""

TRUE: Colour = (30, 180, 90)
BELIEVED: Colour = (60, 120, 255)
DEAD_RECKONING: Colour = (255, 140, 20)
WANTED: Colour = (255, 0, 190)
SENSED: Colour = (0, 200, 230)
CLOSE: Colour = (255, 40, 40)
PLANNED: Colour = (255, 120, 215)
LABEL: Colour = (235, 235, 235)
GOAL: Colour = (255, 200, 0)
CLOSURE: Colour = (130, 200, 0)
BEST_FRONTIER: Colour = (110, 0, 200)
WORST_FRONTIER: Colour = (215, 185, 240)

CATEGORY_COLOURS: dict[str, Colour] = {
    "wall": (150, 155, 165),
    "block": (120, 135, 160),
    "shelf": (140, 125, 105),
    "pillar": (170, 170, 175),
    "low": (190, 175, 110),
    "cylinder": (235, 120, 90),
    "box": (220, 150, 70),
    "cart": (205, 105, 60),
    "legs": (240, 110, 140),
    "person": (240, 90, 120),
}
OTHER_CATEGORY: Colour = (180, 180, 180)

UNSEEN = 105
"""Grey of unknown cells in the map, and around it; free ones are lighter and occupied ones darker."""

LEVEL_COLOURS: dict[str, Colour] = {"INFO": (170, 190, 210), "WARN": (255, 190, 60), "ERROR": (255, 70, 70)}

ARC_DURATION = 2.0
"""Time for which the drawn command is held [s]."""

PLOT_WINDOW = 20.0
"""Time that the plots of fast signals reach back [s]."""

POSES: tuple[tuple[str, Colour], ...] = (
    ("/world/robot/base", TRUE),
    ("/map/estimate", BELIEVED),
    ("/map/odometry", DEAD_RECKONING),
)
"""Entity path and colour of each pose that is drawn."""

TRAILS: tuple[tuple[str, Colour], ...] = (
    ("/world/trail", TRUE),
    ("/map/trail/estimate", BELIEVED),
    ("/map/trail/odometry", DEAD_RECKONING),
)
"""Entity path and colour of each pose's trail."""

SERIES: tuple[tuple[str, str, Colour], ...] = (
    ("/plots/command/v_x", "v_x forward [m/s]", (80, 200, 255)),
    ("/plots/command/v_y", "v_y left [m/s]", (140, 140, 140)),
    ("/plots/command/w_z", "w_z left [rad/s]", WANTED),
    ("/plots/nearest/range", "nearest return", SENSED),
    ("/plots/nearest/close", f"close: {CLOSE_RANGE} m", CLOSE),
    ("/plots/error/slam", "SLAM", BELIEVED),
    ("/plots/error/odometry", "dead reckoning", DEAD_RECKONING),
    ("/plots/entropy", "entropy", (200, 200, 120)),
    ("/plots/scan_time", "SLAM, a scan", BELIEVED),
)
"""Entity path, name and colour of each curve."""

EXPERT_COLOURS: tuple[Colour, ...] = ((90, 170, 255), (60, 200, 130), (255, 150, 60), (235, 90, 170))
"""Colours of the curves of the experts' shares; a fifth has the first's again."""

LEGEND = f"""
**What the robot knows**: its own map from above; white is free, black occupied, grey not seen yet.
**What is true** is the simulator's scene, riding with the robot, which never gets to see it.

| colour | meaning |
|---|---|
| **blue** | where SLAM believes the robot is, and its trail |
| **green** | where it truly is, and its trail |
| **orange** | dead reckoning alone |
| **cyan** points | returns of the lidar |
| **red** points | returns nearer than {CLOSE_RANGE} m |
| **violet** points | frontiers; the darker, the better |
| **magenta** ring | the chosen frontier |
| **pink** line | planned path, and line to the waypoint |
| **magenta** arc | the command, held for {ARC_DURATION:.0f} s |
| **gold** | the goal |
| **lime** lines | loop closures: submaps that SLAM has tied together |
| orange to pink bodies | what moves |

**Labels of frontiers**: rank, score, and its parts: D for the way to the goal, V for safety. Least is best.

**Why did it turn?** Stop the clock there. *Now* says what it headed for and what was near. Where the magenta
arc leaves the pink line, something close pushed the robot aside; where the pink line itself swings round,
*Events* says what made it choose anew, and the table in *Now* what it chose among.

**Why did it fail?** Click the last line of *Events*. Has blue left green (the map is wrong)? Does the pink line
lead through something that is there (not seen yet, or moving)? Was red ahead, and the arc did not turn away?
"""

_FIELD_OF_VIEW = math.radians(55.0)
"""Vertical field of view of the viewer's camera: the default of re_view_spatial's orbital eye."""
_NARROWEST = 0.85
"""Width over height down to which the view from above still shows the whole scene; in a window of 16:10 it has 0.93."""


def blueprint(
    bounds: Bounds | None, *, gate: bool = False, safety: bool = False, scan_time: bool = False
) -> rrb.Blueprint:
    """The layout of the panels.

    Args:
        bounds: Area that the view from above must show; None without a true scene, as on a robot: the views
            then follow the estimate.
        gate: Whether there are shares of experts to plot.
        safety: Whether there are maps of the critic's safety value.
        scan_time: Whether it is SLAM over a log: its time for each scan is plotted, there is neither command nor truth.
    """
    known = rrb.Spatial3DView(
        name="What the robot knows (its own map, from above)",
        origin="/",
        contents=["+ /map/**", "+ /world/goal/**", "- /map/safety/**"],
        background=(UNSEEN, UNSEEN, UNSEEN),
        line_grid=rrb.LineGrid3D(visible=False),
        eye_controls=_eye_above(bounds),
    )
    true = rrb.Spatial3DView(
        name="What is true (the scene, riding with the robot)" if bounds else "Riding with the robot",
        origin="/map/estimate" if bounds is None else "/world/robot/base",
        contents=[*(["+ /world/**"] if bounds else []), "+ /map/**", "- /map/frontiers/**", "- /map/safety/**"],
        background=(30, 32, 38),
        line_grid=rrb.LineGrid3D(visible=False),
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital,
            position=(-6.5, 0.0, 6.5),
            look_target=(1.5, 0.0, 0.0),
            eye_up=(0.0, 0.0, 1.0),
        ),
    )
    safe = rrb.Spatial3DView(
        name="Safety V^h at the last decision",
        origin="/",
        contents=["+ /map/**", "+ /world/goal/**", "- /map/grid/**", "- /map/trail/**"],
        background=(UNSEEN, UNSEEN, UNSEEN),
        line_grid=rrb.LineGrid3D(visible=False),
        eye_controls=_eye_above(bounds),
    )
    left = rrb.Tabs(known, safe, active_tab=0) if safety else known
    words = rrb.Vertical(
        rrb.TextDocumentView(name="Now", origin="/now"),
        rrb.TextDocumentView(name="How to read this", origin="/legend"),
        row_shares=[5, 4],
    )
    whole_run = rr.TimeRange(start=rrb.TimeRangeBoundary.infinite(), end=rrb.TimeRangeBoundary.infinite())
    about_now = rr.TimeRange(
        start=rrb.TimeRangeBoundary.cursor_relative(seconds=-PLOT_WINDOW),
        end=rrb.TimeRangeBoundary.cursor_relative(seconds=PLOT_WINDOW / 2.0),
    )
    if scan_time:
        plots, shares = [_plot("Time of a scan [ms]", "/plots/scan_time", whole_run)], [3.0]
    else:
        plots = [
            _plot("Command", "/plots/command/**", about_now),
            *([_plot("Shares of the experts", "/plots/gate/**", about_now)] if gate else []),
            _plot("Nearest return [m]", "/plots/nearest/**", about_now),
            _plot("Error of the pose [m]", "/plots/error/**", whole_run),
        ]
        shares = [3.0, *([2.5] if gate else []), 2.0, 2.0]
    plots.append(_plot("Entropy of the map [nat]", "/plots/entropy", whole_run))
    events = rrb.TextLogView(
        name="Events",
        origin="/events",
        columns=rrb.TextLogColumns(timeline_columns=[TIMELINE], text_log_columns=["loglevel", "body"]),
    )
    return rrb.Blueprint(
        rrb.Vertical(
            rrb.Horizontal(left, true, words, column_shares=[4, 4, 2.7]),
            rrb.Horizontal(*plots, events, column_shares=[*shares, 2.0, 3.5]),
            row_shares=[3, 1],
        ),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state="following"),
        auto_views=False,
    )


def _eye_above(bounds: Bounds | None) -> rrb.EyeControls3D:
    if bounds is None:
        return rrb.EyeControls3D(kind=rrb.Eye3DKind.Orbital, tracking_entity="/map/estimate", eye_up=(0.0, 1.0, 0.0))
    x_min, y_min, x_max, y_max = bounds
    x, y = (x_min + x_max) / 2.0, (y_min + y_max) / 2.0
    extent = max((x_max - x_min) / _NARROWEST, y_max - y_min, 1.0)
    height = 0.53 * extent / math.tan(_FIELD_OF_VIEW / 2.0)
    return rrb.EyeControls3D(
        kind=rrb.Eye3DKind.Orbital, position=(x, y, height), look_target=(x, y, 0.0), eye_up=(0.0, 1.0, 0.0)
    )


def _plot(name: str, contents: str, shown: rr.TimeRange) -> rrb.TimeSeriesView:
    return rrb.TimeSeriesView(name=name, origin="/plots", contents=contents, axis_x=rrb.TimeAxis(view_range=shown))

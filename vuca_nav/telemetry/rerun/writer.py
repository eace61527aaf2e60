"""A Rerun stream with a clock: timed and static entries."""

import math

import numpy as np
import rerun as rr

from vuca_nav.telemetry.rerun import blueprint as look
from vuca_nav.telemetry.rerun.drawing import floating_labels, heading_arrow
from vuca_nav.types import FloatArray

MARK_HEIGHT = 0.12
"""Height of marked points above the map, so that nothing hides them [m]."""


class Writer:
    """Logs to one ``RecordingStream``.

    Args:
        stream: The stream that is written to.
        title: Title of the recording, shown in the viewer.
    """

    def __init__(self, stream: rr.RecordingStream, title: str):
        self.stream = stream
        self.time = 0.0
        """Time of all that is logged from now on [s]."""
        self._last_logged: dict[str, float] = {}
        stream.set_log_time_enabled(False)
        stream.set_log_tick_enabled(False)
        stream.send_recording_name(title)
        self.set_time(0.0)
        self._log_constants(title)

    def set_time(self, seconds: float) -> None:
        """Set the time of everything that follows [s]."""
        self.time = seconds
        self.stream.set_time(look.TIMELINE, duration=seconds)

    def due(self, what: str, period: float) -> bool:
        """Whether it is time to log this again; if so, taken as done. A clock set back counts as time."""
        elapsed = self.time - self._last_logged.get(what, -math.inf)
        if 0.0 <= elapsed < period - 1e-6:
            return False
        self._last_logged[what] = self.time
        return True

    def log(self, path: str, what: rr.AsComponents, *, static: bool = False) -> None:
        """Log any component."""
        self.stream.log(path, what, static=static)

    def scalar(self, path: str, value: float) -> None:
        """Log one more point of a curve."""
        self.stream.log(path, rr.Scalars(value))

    def clear(self, path: str) -> None:
        """Clear an entity from now on."""
        self.stream.log(path, rr.Clear(recursive=False))

    def markdown(self, path: str, text: str, *, static: bool = False) -> None:
        """Log a panel's text."""
        self.stream.log(path, rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN), static=static)

    def strip(self, path: str, points: FloatArray, colour: look.Colour, width: float) -> None:
        """Log a line through points (n, 3) [m], ``width`` in points of the screen."""
        self.stream.log(path, rr.LineStrips3D([points], colors=colour, radii=rr.Radius.ui_points(width)))

    def mark(
        self, path: str, point: tuple[float, float], label: str, colour: look.Colour, *, static: bool = False
    ) -> None:
        """Log a point with its name."""
        point_in_space = np.array([[*point, MARK_HEIGHT]])
        dot = rr.Points3D(point_in_space, colors=colour, radii=rr.Radius.ui_points(6.0))
        self.stream.log(path, dot, static=static)
        self.stream.log(f"{path}/label", floating_labels(point_in_space, [label]), static=static)

    def _log_constants(self, title: str) -> None:
        self.markdown("/legend", f"### {title}\n{look.LEGEND}", static=True)
        self.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        for path, colour in look.POSES:
            self.log(f"{path}/arrow", heading_arrow(colour, MARK_HEIGHT), static=True)
        for path, name, colour in look.SERIES:
            self.log(path, rr.SeriesLines(names=name, colors=colour, widths=1.5), static=True)

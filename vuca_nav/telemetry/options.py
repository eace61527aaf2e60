"""The options by which a command shows its run in the Rerun viewer."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from vuca_nav.cli import optional
from vuca_nav.errors import BadArgument

if TYPE_CHECKING:
    from vuca_nav.telemetry.rerun.recorder import RerunTelemetry


@dataclass(frozen=True)
class ViewArguments:
    """Where a run is shown."""

    record: Annotated[Path | None, optional("FILE.rrd")] = None
    """Record the run for the Rerun viewer."""
    spawn: bool = False
    """Show the run in a Rerun viewer as it happens."""
    serve: bool = False
    """Show the run in a browser as it happens."""

    def check_view(self) -> None:
        """Raise BadArgument if several are given."""
        if sum((self.record is not None, self.spawn, self.serve)) > 1:
            raise BadArgument("--record, --spawn and --serve exclude each other; give one of them")

    def open_view(self, title: str) -> RerunTelemetry | None:
        """The recorder; None if the run is not to be shown.

        Args:
            title: Title of the recording.

        Raises:
            BadArgument: The file, the viewer or the server cannot be opened.
        """
        if self.record is None and not self.spawn and not self.serve:
            return None
        from vuca_nav.telemetry.rerun.recorder import RerunTelemetry

        if self.record is not None:
            return RerunTelemetry.record(self.record, title=title)
        return RerunTelemetry.spawn(title=title) if self.spawn else RerunTelemetry.serve(title=title)

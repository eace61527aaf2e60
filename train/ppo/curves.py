"""Learning curves as a picture."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

Panel = tuple[str, tuple[str, ...]]
"""Title of a panel, and the keys of the log that are drawn in it."""


def draw_curves(rows: Sequence[dict], panels: Sequence[Panel], unit: str, picture: Path) -> None:
    """Draw a run's log over its steps, smoothed over a hundredth of them.

    Args:
        rows: Rows of the log.
        panels: Panels to be drawn; keys that the log lacks are left out.
        unit: Unit of a step, in the plural.
        picture: PNG to be written.
    """
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    steps = np.array([row["steps"] for row in rows]) / 1e6
    width = max(len(rows) // 100, 1)
    figure, axes = plt.subplots(1, len(panels), figsize=(4 * len(panels), 3), layout="constrained")
    for axis, (title, keys) in zip(axes, panels):
        for key in (key for key in keys if key in rows[0]):
            smooth = np.convolve([row[key] for row in rows], np.full(width, 1.0 / width), "valid")
            axis.plot(steps[width - 1 :], smooth, lw=1, label=key.rpartition("/")[2])
        axis.set_title(title, fontsize=9)
        axis.set_xlabel(f"million {unit}")
        axis.grid(alpha=0.3)
        if len(keys) > 1:
            axis.legend(fontsize=7)
    figure.savefig(picture, dpi=110)
    plt.close(figure)

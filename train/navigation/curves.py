"""Learning curves as a picture."""

from pathlib import Path

import numpy as np

from train.ppo.run_directory import read_log

_PANELS = (
    ("share of episodes", ("episodes/reached", "episodes/collided", "episodes/timed_out")),
    ("reward a decision", ("reward/total",)),
    ("gate", ("gate/0", "gate/1", "gate/2", "gate/3", "gate/entropy")),
    ("standard deviation of actions", ("std/v_x", "std/v_y", "std/w_z")),
    ("share of the return explained", ("loss/explained",)),
)


def draw_curves(log: Path, picture: Path) -> None:
    """Draw a run's log over its steps, smoothed over a hundredth of them.

    Args:
        log: JSON lines as a run writes them.
        picture: PNG to be written.
    """
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    rows = read_log(log)
    steps = np.array([row["steps"] for row in rows]) / 1e6
    width = max(len(rows) // 100, 1)
    panels = [(title, [key for key in keys if key in rows[0]]) for title, keys in _PANELS]
    if "gate/1" not in rows[0]:
        panels = [panel for panel in panels if panel[0] != "gate"]
    figure, axes = plt.subplots(1, len(panels), figsize=(4 * len(panels), 3), layout="constrained")
    for axis, (title, keys) in zip(axes, panels):
        for key in keys:
            smooth = np.convolve([row[key] for row in rows], np.full(width, 1.0 / width), "valid")
            axis.plot(steps[width - 1 :], smooth, lw=1, label=key.rpartition("/")[2])
        axis.set_title(title, fontsize=9)
        axis.set_xlabel("million decisions")
        axis.grid(alpha=0.3)
        if len(keys) > 1:
            axis.legend(fontsize=7)
    figure.savefig(picture, dpi=110)
    plt.close(figure)

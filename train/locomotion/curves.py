"""Learning curves as a picture."""

from pathlib import Path

import numpy as np

from train.ppo.run_directory import read_log

_PANELS = (
    ("reward a second", ("reward/total",)),
    ("falls a minute", ("falls_per_minute",)),
    ("slow tracking error [m/s, rad/s]", ("slow_error/v_x", "slow_error/v_y", "slow_error/w_z")),
    ("control steps a second", ("speed/total", "speed/collect")),
)


def draw_curves(log: Path, picture: Path) -> None:
    """Draw a run's log over its control steps.

    Args:
        log: JSON lines as a run writes them.
        picture: PNG to be written.
    """
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    rows = read_log(log)
    millions = np.array([row["steps"] for row in rows]) / 1e6
    figure, axes = plt.subplots(1, len(_PANELS), figsize=(4 * len(_PANELS), 3), layout="constrained")
    for axis, (title, keys) in zip(axes, _PANELS):
        for key in keys:
            axis.plot(millions, [row[key] for row in rows], lw=1, label=key.rpartition("/")[2])
        axis.set_title(title, fontsize=9)
        axis.set_xlabel("million control steps")
        axis.set_ylim(bottom=0)
        axis.grid(alpha=0.3)
        if len(keys) > 1:
            axis.legend(fontsize=8)
    figure.savefig(picture, dpi=110)
    plt.close(figure)

"""The learning curve of the critic of V^h as a picture."""

from pathlib import Path

import numpy as np


def draw_curves(rows: list[dict], picture: Path) -> None:
    """Draw the loss over the rounds, and the chances of the last ten rounds against the outcomes; PNG."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, (left, right) = plt.subplots(1, 2, figsize=(8, 3), layout="constrained")
    for key, label in (("loss", "critic, before it learns from the round"), ("baseline", "one chance for everything")):
        left.plot([row["iteration"] for row in rows], [row[key] for row in rows], lw=1, label=label)
    left.set(title="cross entropy", xlabel="round")
    left.legend(fontsize=7)
    count = np.sum([row["count"] for row in rows[-10:]], axis=0)
    some = count > 0
    foreseen, came = (
        np.sum([np.multiply(row["count"], row[key]) for row in rows[-10:]], axis=0)[some] / count[some]
        for key in ("foreseen", "came")
    )
    right.plot([0, 1], [0, 1], "k:", lw=1)
    right.plot(foreseen, came, "o-", ms=4)
    right.set(title="chances of the last ten rounds", xlabel="foreseen", ylabel="came")
    for axis in (left, right):
        axis.grid(alpha=0.3)
    figure.savefig(picture, dpi=110)
    plt.close(figure)

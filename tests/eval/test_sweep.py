import json

import pytest

from eval.sweep import SweepArguments, lines_of, main
from vuca_nav.errors import BadArgument


def group(movers, rate, method="ours"):
    success = {"count": 1, "rate": rate, "interval": [0.1, 0.9]}
    return {"world": "square", "robot": "go2", "method": method, "movers": movers, "success": success}


def test_lines_are_in_order_of_the_movers():
    lines = lines_of([group(24, 0.5), group(8, 0.8), group(None, 0.7), group(8, 0.3, "dwa-dh")])
    assert lines == {
        "square, go2, ours": [(8, 0.8, 0.1, 0.9), (24, 0.5, 0.1, 0.9)],
        "square, go2, dwa-dh": [(8, 0.3, 0.1, 0.9)],
    }


def test_a_plot_is_drawn_from_summaries(tmp_path):
    (tmp_path / "summary.json").write_text(json.dumps({"groups": [group(8, 0.8), group(16, 0.6)]}))
    main(SweepArguments((tmp_path,), tmp_path / "new" / "plot.png"))
    assert (tmp_path / "new" / "plot.png").read_bytes().startswith(b"\x89PNG")


def test_what_cannot_be_drawn_is_said(tmp_path):
    with pytest.raises(BadArgument, match="not the summary of a complete evaluation"):
        main(SweepArguments((tmp_path,)))
    (tmp_path / "summary.json").write_text(json.dumps({"groups": [group(None, 0.8)]}))
    with pytest.raises(BadArgument, match="'vuca eval crowd' does"):
        main(SweepArguments((tmp_path,)))

import json

import pytest

from eval.analysis.sweep import SweepArguments, lines_of, main
from vuca_nav.errors import BadArgument, UnknownName


def group(movers, rate, method="ours"):
    success = {"count": 1, "rate": rate, "interval": [0.1, 0.9]}
    return {"world": "square", "robot": "go2", "method": method, "movers": movers, "success": success}


def test_lines_are_in_order_of_the_movers():
    lines = lines_of([group(24, 0.5), group(8, 0.8), group(None, 0.7), group(8, 0.3, "dwa-dh")])
    assert lines == {
        "square, go2, ours": [(8, 0.8, 0.1, 0.9), (24, 0.5, 0.1, 0.9)],
        "square, go2, dwa-dh": [(8, 0.3, 0.1, 0.9)],
    }


def test_lines_over_another_dial_are_told_apart_by_the_rest():
    groups = [group(8, rate) | {"speed": speed} for speed, rate in ((2.0, 0.3), (0.5, 0.9))]
    assert lines_of([*groups, group(16, 0.1) | {"speed": 1.0}], over="speed") == {
        "square, 8 movers, go2, ours": [(0.5, 0.9, 0.1, 0.9), (2.0, 0.3, 0.1, 0.9)],
        "square, 16 movers, go2, ours": [(1.0, 0.1, 0.1, 0.9)],
    }


def test_the_share_that_took_a_way_is_of_those_that_entered_any():
    ways = {"quiet": {"count": 8, "rate": 0.32, "interval": [0.17, 0.52]}, "short": {"count": 17, "rate": 0.68}}
    none = {"short": {"count": 25, "rate": 1.0, "interval": [0.87, 1.0]}}
    options = {"gamma": 2.0}
    groups = [group(12, 0.7) | {"ways": ways} | options, group(4, 0.7) | {"ways": none} | options]
    (name, points), *others = lines_of(groups, "quiet").items()
    assert not others
    assert name == "square, go2, ours --gamma 2.0"
    assert points[1] == (12, 0.32, 0.17, 0.52)
    assert points[0][:3] == (4, 0.0, 0.0)
    assert points[0][3] == pytest.approx(0.1332, abs=1e-3)  # Wilson's interval of 0 of 25


def test_a_plot_is_drawn_from_summaries(tmp_path):
    (tmp_path / "summary.json").write_text(json.dumps({"groups": [group(8, 0.8), group(16, 0.6)]}))
    main(SweepArguments((tmp_path,), out=tmp_path / "new" / "plot.png"))
    assert (tmp_path / "new" / "plot.png").read_bytes().startswith(b"\x89PNG")


def test_what_cannot_be_drawn_is_said(tmp_path):
    with pytest.raises(BadArgument, match="not the summary of a complete evaluation"):
        main(SweepArguments((tmp_path,)))
    (tmp_path / "summary.json").write_text(json.dumps({"groups": [group(None, 0.8)]}))
    with pytest.raises(BadArgument, match="none of the evaluations varied movers"):
        main(SweepArguments((tmp_path,)))
    with pytest.raises(UnknownName, match="quiet"):
        main(SweepArguments((tmp_path,), ("quiet",)))

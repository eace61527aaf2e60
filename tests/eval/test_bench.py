import time
from types import SimpleNamespace

import pytest

from eval.bench import STAGES, StageClock


def test_inner_calls_are_not_counted_twice():
    place = SimpleNamespace(inner=lambda: time.sleep(0.02))

    def outer():
        time.sleep(0.01)
        place.inner()
        place.inner()
        return "done"

    place.outer = outer
    clock = StageClock()
    with clock.watch("inner", place, "inner"), clock.watch("outer", place, "outer"):
        assert place.outer() == "done"
    assert place.outer is outer
    assert clock.seconds["inner"] == pytest.approx(0.04, rel=0.5)
    assert clock.seconds["outer"] == pytest.approx(0.01, rel=0.9)


def test_every_stage_exists():
    for stage in STAGES:
        assert callable(getattr(stage["owner"], stage["call"])), stage["name"]

from types import SimpleNamespace

from eval.bench import STAGES, StageClock


def test_inner_calls_are_not_counted_twice(monkeypatch):
    now = 0.0

    def work(seconds: float) -> None:
        nonlocal now
        now += seconds

    monkeypatch.setattr("eval.bench.time.perf_counter", lambda: now)
    place = SimpleNamespace(inner=lambda: work(2.0))

    def outer():
        work(1.0)
        place.inner()
        place.inner()
        return "done"

    place.outer = outer
    clock = StageClock()
    with clock.watch("inner", place, "inner"), clock.watch("outer", place, "outer"):
        assert place.outer() == "done"
    assert place.outer is outer
    assert clock.seconds == {"inner": 4.0, "outer": 1.0}


def test_every_stage_exists():
    for stage in STAGES:
        assert callable(getattr(stage["owner"], stage["call"])), stage["name"]

from dataclasses import replace

import numpy as np
import pytest

from train.analysis.bench.arena import Arguments, measure
from train.analysis.episodes import Evaluation
from train.analysis.oracle import solvable
from train.arena.config import ArenaConfig
from vuca_nav.policy.observation import ObservationConfig

CONFIG = replace(ArenaConfig(layouts=2, pairs=16, num_bodies=4), movers=(8, 8)).driven_by("tiago")


def test_without_movers_all_can_be_solved_at_full_speed():
    result = solvable(CONFIG.of("static"), 12, 0)
    assert result.solved.all()
    evaluation = Evaluation(CONFIG.of("static"), ObservationConfig(), 12, 0)
    shortest = evaluation.arena.gather("task")[:, 4]
    # Eight directions are up to 8% longer than the straight way, the tasks' sixteen up to 3%; a cell here and there.
    assert (result.time > 0.95 * shortest - 0.2).all()
    assert (result.time < 1.09 * shortest + 0.4).all()


def test_no_time_no_solution():
    result = solvable(replace(CONFIG.of("mixed"), time_factor=0.5, time_slack=0.0), 6, 0)
    assert not result.solved.any()
    assert np.isinf(result.time).all()


def test_its_movers_are_the_episodes_movers():
    a, b = (Evaluation(CONFIG.of("dynamic"), ObservationConfig(), 5, 1) for _ in range(2))
    rows = np.arange(5)
    for _ in range(20):
        a.arena.shards[0].move(rows, 3)
        for _ in range(3):
            b.arena.shards[0].move(rows, 1)
    np.testing.assert_array_equal(a.arena.gather("movers"), b.arena.gather("movers"))


@pytest.mark.parametrize("kind", ["paper", "tracked"])
def test_the_benchmark_counts_decisions(kind):
    result = measure(CONFIG.of("dynamic"), Arguments(threads=1, rows=16, seconds=0.05, kind=kind))
    assert result["movers"] == 8
    assert 100 < result["per_second"] < 1e7

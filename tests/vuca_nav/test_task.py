import math

import numpy as np
import pytest

from vuca_nav.task import REWARDS, RISK_CLAMP, TERMS, risk_score, time_limit


@pytest.mark.parametrize(
    ("nearest", "score"),
    [
        (math.inf, 0.0),
        (5.0, 0.0),
        (0.6, 0.0),
        (0.5, 0.2),  # 0.1 / 0.5
        (0.3, 1.0),  # 0.3 / 0.3
        (0.2, 2.0),  # 0.4 / 0.2
        (0.1, 5.0),  # 0.5 / 0.1
        (0.05, 5.0),  # clamped
        (0.0, 5.0),
    ],
)
def test_risk_score_by_hand(nearest, score):
    assert risk_score(nearest) == pytest.approx(score)


@pytest.mark.parametrize("nearest", np.linspace(RISK_CLAMP, 2.0, 20))
def test_risk_score_is_the_printed_formula(nearest):
    risk = max(0.6 - nearest, 0.0)
    assert risk_score(nearest) == pytest.approx(risk / (0.6 - risk))


def test_risk_score_of_many_keeps_shape_and_type():
    score = risk_score(np.array([[0.3, 9.0]], np.float32), -0.4)
    assert score.dtype == np.float32
    np.testing.assert_allclose(score, [[-0.4, 0.0]])


def test_time_limit():
    assert time_limit(30.0, 1.0) == 180.0
    assert time_limit(30.0, 0.5) == 300.0


def test_table_one_as_printed():
    by_term = {name: dict(zip(TERMS, weights)) for name, weights in REWARDS.items()}
    assert by_term["go-straight"] == {
        "R_g": 3, "R_o": 0, "R_c": -0.25, "R_r": 1, "R_t": -1, "R_e": -1, "R_a": -0.5
    }  # fmt: skip
    assert by_term["obstacle-avoidance"] == {
        "R_g": 1, "R_o": -0.4, "R_c": -1, "R_r": 0.25, "R_t": 1, "R_e": 1, "R_a": 0
    }  # fmt: skip
    assert by_term["fusion"] == {"R_g": 4, "R_o": 0, "R_c": -1, "R_r": 1, "R_t": 0, "R_e": 0, "R_a": 0}

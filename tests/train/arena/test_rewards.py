import numpy as np
import pytest

from tests.train.navigation.open_ground import Step
from train.arena.rewards import TERMS, find_rewards, reward_terms
from vuca_nav.errors import UnknownName
from vuca_nav.task import risk_score


def terms_of(column, *, progress=0.0, clearance=6.0, turn_rate=0.0, collided=False, reached=False, timed_out=False):
    step = Step(
        np.zeros((1, 1)), np.array([progress]), np.array([clearance]), np.array([turn_rate]), np.array([collided]),
        np.array([reached]), np.array([timed_out]), np.zeros((1, 1)),
    )  # fmt: skip
    out = np.full((len(TERMS), 1), np.nan, np.float32)
    reward_terms(step, find_rewards(column), out)
    return dict(zip(TERMS, out[:, 0]))


def only(**wanted):
    return pytest.approx({term: wanted.get(term, 0.0) for term in TERMS})


@pytest.mark.parametrize(
    ("column", "what", "wanted"),
    [
        ("go-straight", {"progress": 0.1}, {"R_g": 0.3, "R_t": -0.01}),
        ("go-straight", {"progress": -0.1}, {"R_g": -0.3, "R_t": -0.01}),
        ("go-straight", {"clearance": 0.2}, {"R_t": -0.01}),
        ("go-straight", {"collided": True}, {"R_c": -3.75, "R_t": -0.01}),
        ("go-straight", {"reached": True}, {"R_r": 20.0, "R_t": -0.01}),
        ("go-straight", {"timed_out": True}, {"R_e": -5.0, "R_t": -0.01}),
        ("go-straight", {"turn_rate": 0.3}, {"R_t": -0.01}),
        ("go-straight", {"turn_rate": 1.0}, {"R_a": -0.35, "R_t": -0.01}),
        ("obstacle-avoidance", {"progress": 0.1}, {"R_g": 0.1, "R_t": 0.01}),
        ("obstacle-avoidance", {"clearance": 0.3}, {"R_o": -0.4, "R_t": 0.01}),
        ("obstacle-avoidance", {"clearance": 0.2}, {"R_o": -0.8, "R_t": 0.01}),
        ("obstacle-avoidance", {"clearance": 0.1}, {"R_o": -2.0, "R_t": 0.01}),
        ("obstacle-avoidance", {"clearance": -0.01}, {"R_o": -2.0, "R_t": 0.01}),
        ("obstacle-avoidance", {"clearance": np.inf}, {"R_t": 0.01}),
        ("obstacle-avoidance", {"collided": True}, {"R_c": -15.0, "R_t": 0.01}),
        ("obstacle-avoidance", {"reached": True}, {"R_r": 5.0, "R_t": 0.01}),
        ("obstacle-avoidance", {"timed_out": True}, {"R_e": 5.0, "R_t": 0.01}),
        ("obstacle-avoidance", {"turn_rate": 2.0}, {"R_t": 0.01}),
        ("fusion", {"progress": 0.1, "clearance": 0.1, "turn_rate": 2.0}, {"R_g": 0.4}),
        ("fusion", {"collided": True}, {"R_c": -15.0}),
        ("fusion", {"reached": True}, {"R_r": 20.0}),
        ("fusion", {"timed_out": True}, {}),
        ("careful", {"progress": 0.1, "clearance": 0.1, "turn_rate": 2.0}, {"R_g": 0.4}),
        ("careful", {"collided": True}, {"R_c": -45.0}),
        ("careful", {"timed_out": True}, {"R_e": -5.0}),
        ("drl", {"progress": 0.1, "clearance": 0.1, "turn_rate": 1.05}, {"R_g": 0.25}),
        ("drl", {"progress": -0.1}, {"R_g": -0.25}),
        ("drl", {"turn_rate": 1.2}, {"R_a": -0.12}),
        ("drl", {"progress": 0.1, "collided": True}, {"R_g": 0.25, "R_c": -15.0}),
        ("drl", {"progress": 0.1, "reached": True}, {"R_r": 15.0}),
        ("drl", {"timed_out": True}, {}),
    ],
)
def test_a_step_is_paid_as_in_the_table(column, what, wanted):
    assert terms_of(column, **what) == only(**wanted)


def test_an_unknown_column_is_named():
    with pytest.raises(UnknownName, match="fusion"):
        find_rewards("fussion")


@pytest.mark.parametrize("nearest", [0.02, 0.1, 0.37, 0.6, 2.0])
def test_nearness_costs_what_evaluation_counts_as_risk(nearest):
    cost = -terms_of("obstacle-avoidance", clearance=nearest)["R_o"]
    assert cost == pytest.approx(0.4 * risk_score(nearest))

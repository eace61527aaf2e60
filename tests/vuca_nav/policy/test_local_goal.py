import pytest

from vuca_nav.policy.base import FIELD_ERROR, LocalGoal


@pytest.mark.parametrize(
    ("room", "is_round", "margin"),
    [
        (1.0, False, 0.04),
        (0.04 + FIELD_ERROR, False, 0.04),
        (0.03 + FIELD_ERROR, False, 0.03),
        (0.0, False, 0.025),
        (0.02 + FIELD_ERROR, True, 0.02),
        (0.0, True, 0.01),
    ],
)
def test_the_margin_is_what_a_way_leaves(room, is_round, margin):
    goal = LocalGoal((1.0, 0.0), is_final=False, room=room)
    assert goal.margin(0.04, is_round) == pytest.approx(margin)


def test_where_no_way_is_known_the_margin_is_the_usual_one():
    assert LocalGoal((1.0, 0.0), is_final=True).margin(0.05, is_round=True) == 0.05

import math

import numpy as np
import pytest

from vuca_nav.errors import BadArgument, BadLog
from vuca_nav.slam_log.relations import read_relations, relation_errors

STAMPS = np.array([0.0, 1.0, 2.0])
POSES = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, math.pi / 2], [1.0, 2.0, math.pi / 2]])


def test_errors_are_those_worked_by_hand():
    relations = np.array(
        [
            [0.0, 1.0, 1.0, 0.0, math.pi / 2],  # exactly so
            [1.0, 2.0, 1.7, 0.4, math.pi / 2 - math.pi / 2 + math.radians(6.0)],  # 0.3 ahead and 0.4 aside: 0.5 m
        ]
    )
    errors = relation_errors(relations, STAMPS, POSES)
    assert errors.n == 2
    assert errors.m_mean == pytest.approx(0.25)
    assert errors.m_sd == pytest.approx(0.25)
    assert errors.deg_mean == pytest.approx(3.0)
    assert errors.deg_sd == pytest.approx(3.0)


def test_errors_do_not_depend_on_the_frame_of_the_trajectory():
    relations = np.array([[0.0, 2.0, 0.9, 2.1, 1.5], [2.0, 0.0, -2.0, 1.1, -1.6]])
    c, s = math.cos(0.7), math.sin(0.7)
    turned = POSES @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) + [5.0, -3.0, 0.7]
    assert relation_errors(relations, STAMPS, turned) == pytest.approx(relation_errors(relations, STAMPS, POSES))


def test_between_two_poses_the_trajectory_is_interpolated_the_short_way_round():
    poses = np.array([[0.0, 0.0, math.radians(170.0)], [1.0, 0.0, math.radians(-170.0)]])
    relation = np.array([[0.0, 0.5, 0.5 * math.cos(math.radians(170.0)), -0.5 * math.sin(math.radians(170.0)), 0.0]])
    errors = relation_errors(relation, np.array([0.0, 1.0]), poses)
    assert errors.m_mean == pytest.approx(0.0, abs=1e-12)
    assert errors.deg_mean == pytest.approx(10.0)


def test_relations_of_another_log_are_refused():
    with pytest.raises(BadArgument, match="another log"):
        relation_errors(np.array([[100.0, 101.0, 1.0, 0.0, 0.0]]), STAMPS, POSES)


@pytest.mark.parametrize("text", ["0 1 1 0 0 0 0\n", "0 1 x 0 0 0 0 0\n", "0 1 nan 0 0 0 0 0\n", "# nothing\n"])
def test_a_file_of_something_else_is_refused(tmp_path, text):
    path = tmp_path / "a.relations"
    path.write_text(text)
    with pytest.raises(BadLog, match="relation"):
        read_relations(path)


def test_a_relation_is_times_displacement_and_yaw(tmp_path):
    path = tmp_path / "a.relations"
    path.write_text("# of a robot\n1 2 0.5 -0.25 9 8 7 0.125\n")
    assert read_relations(path).tolist() == [[1.0, 2.0, 0.5, -0.25, 0.125]]

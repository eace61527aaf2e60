import math

import numpy as np
import pytest

from vuca_nav.geometry import between, compose
from vuca_nav.mapping.graph.pose_graph import Edge, PoseGraph
from vuca_nav.types import STANDING, Pose2

SQUARE = [Pose2(10.0 * k, 0.0, 0.0) for k in range(4)]
SQUARE += [Pose2(30.0, 10.0 * k, math.pi / 2) for k in range(1, 4)]
SQUARE += [Pose2(30.0 - 10.0 * k, 30.0, math.pi) for k in range(1, 4)]
SQUARE += [Pose2(0.0, 30.0 - 10.0 * k, -math.pi / 2) for k in range(1, 3)]
SURE, DRIVEN = np.diag([1e4, 1e4, 1e5]), np.diag([4e2, 4e2, 1e3])


def driven(yaw_error: float) -> PoseGraph:
    """The square as odometry has it, which turns too far on every way."""
    graph = PoseGraph()
    pose = SQUARE[0]
    graph.add_node(pose)
    for k in range(1, len(SQUARE)):
        step = between(SQUARE[k - 1], SQUARE[k])
        measured = Pose2(step.x, step.y, step.yaw + yaw_error)
        pose = compose(pose, measured)
        graph.add_node(pose)
        graph.edges.append(Edge(k - 1, k, measured, STANDING, DRIVEN, False))
    return graph


def test_a_square_loop_closes():
    graph = driven(0.03)
    assert math.dist(graph.poses[-1][:2], SQUARE[-1][:2]) > 3.0
    last = len(SQUARE) - 1
    graph.edges.append(Edge(0, last, between(SQUARE[0], SQUARE[last]), STANDING, SURE, True))
    graph.optimise()
    assert between(graph.poses[0], graph.poses[-1]) == pytest.approx(between(SQUARE[0], SQUARE[-1]), abs=0.05)
    assert max(math.dist(a[:2], b[:2]) for a, b in zip(graph.poses, SQUARE)) < 1.0
    assert graph.poses[0] == SQUARE[0]


def test_a_closure_may_meet_at_a_place_of_neither_node():
    graph = PoseGraph()
    graph.add_node(STANDING)
    graph.add_node(Pose2(4.0, 1.0, 0.3))
    meeting = Pose2(3.0, 2.0, 0.5)
    truth = Pose2(3.5, 0.5, 0.1)
    graph.edges.append(Edge(0, 1, meeting, between(truth, meeting), SURE, False))
    graph.optimise()
    assert graph.poses[1] == pytest.approx(truth, abs=1e-6)


def test_one_wrong_closure_among_good_ones_loses_its_say():
    graph = driven(0.0)
    last = len(SQUARE) - 1
    for k in range(3):
        graph.edges.append(Edge(k, last - k, between(SQUARE[k], SQUARE[last - k]), STANDING, SURE, True))
    graph.edges.append(Edge(1, 6, between(SQUARE[1], compose(SQUARE[6], Pose2(5.0, 0.0, 0.5))), STANDING, SURE, True))
    for _ in range(5):
        graph.optimise()
    assert max(math.dist(a[:2], b[:2]) for a, b in zip(graph.poses, SQUARE)) < 0.05
    assert graph.deviations()[-1] > 100.0

import numpy as np

from vuca_nav.mapping.submaps import Keyframe, Submap, SubmapStore
from vuca_nav.slam_log.keyframe_map import KeyframeMap
from vuca_nav.types import STANDING, Pose2

WALL = np.column_stack([np.full(41, 2.025), np.linspace(-1.0, 1.0, 41)]).astype(np.float32)


def add(store: SubmapStore, x: float) -> None:
    """A submap with one keyframe, taken at x, of a wall 2.025 m ahead."""
    normals, grazed = np.zeros((41, 2), np.float32), np.zeros(41, np.float32)
    pose = Pose2(x, 0.0, 0.0)
    store.submaps.append(Submap(None, pose, np.eye(3), len(store.keyframes), 1))
    store.keyframes.append(Keyframe(pose, len(store.submaps) - 1, WALL, 41, normals, grazed, (0.0, 0.0)))


def test_a_map_grows_and_is_drawn_anew_where_submaps_have_moved():
    store, drawn = SubmapStore(), KeyframeMap()
    assert not drawn.update(store)
    add(store, 0.0)
    assert not drawn.update(store)
    assert [drawn.grid.state(x, 0.0) for x in (1.0, 2.02, 6.02)] == [-1, 1, 0]
    add(store, 4.0)
    assert not drawn.update(store)
    assert [drawn.grid.state(x, 0.0) for x in (1.0, 2.02, 5.0, 6.02)] == [-1, 1, -1, 1]
    store.submaps[1].map_from_local = Pose2(0.02, 0.0, 0.0)
    assert not drawn.update(store)
    store.submaps[1].map_from_local = Pose2(0.1, 0.0, 0.0)
    assert drawn.update(store)
    assert [drawn.grid.state(x, 0.0) for x in (2.02, 6.02, 6.12)] == [1, -1, 1]
    assert not drawn.update(store)
    np.testing.assert_allclose(drawn.way(store), [[0.0, 0.0], [4.1, 0.0]])
    assert drawn.left_out == 0


def test_a_turn_about_the_submap_counts_as_a_shift_at_its_rim():
    store, drawn = SubmapStore(), KeyframeMap()
    add(store, 0.0)
    drawn.update(store)
    store.submaps[0].map_from_local = STANDING._replace(yaw=0.02)
    assert drawn.update(store)

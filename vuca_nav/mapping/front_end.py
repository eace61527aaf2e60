"""The front end: predict by odometry, match to a submap, keep a keyframe now and then."""

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from vuca_nav.geometry import between, compose, wrap_angle
from vuca_nav.mapping.alignment import Aligner, Alignment, AlignmentConfig, Spread, squared_deviations
from vuca_nav.mapping.grid import GridConfig, OccupancyGrid
from vuca_nav.mapping.odometry_model import Motion, OdometryModel, OdometryModelConfig
from vuca_nav.mapping.returns import Returns
from vuca_nav.mapping.submaps import Keyframe, Submap, SubmapStore, insert_scan, keyframe_of
from vuca_nav.mapping.surfaces import SurfaceGrid
from vuca_nav.types import STANDING, FloatArray, Pose2


@dataclass(frozen=True, slots=True)
class FrontEndConfig:
    """Settings of the front end."""

    grid: GridConfig = field(default_factory=lambda: GridConfig(unit=0.1, hit=6, miss=1, limit=25, block=16.0))
    alignment: AlignmentConfig = field(default_factory=AlignmentConfig)
    odometry: OdometryModelConfig = field(default_factory=OdometryModelConfig)
    keyframe_distance: float = 0.2
    """A scan becomes a keyframe after this much motion [m] ..."""
    keyframe_angle: float = 0.15
    """... or this much turning [rad]."""
    submap_keyframes: int = 70
    """Keyframes of a submap; the next one begins in its middle."""
    good: float = 0.6
    """Quality from which on a match may teach the odometry model."""
    doubted: float = 0.85
    """Quality below which a wider search is made: wheels may slip, and odometry may stop coming."""
    lost: float = 0.5
    """Quality below which a match farther from the prediction than odometry may err is none."""
    maps: float = 0.6
    """Quality below which a scan is not drawn: it would spoil the map if the pose is wrong."""
    few: float = 0.3
    """Share of the beams with returns below which a match is believed only as far as odometry may err: no wider search
    is made, no slip is looked for, and nothing is learnt of odometry."""
    single: float = 0.1
    """... and below which they may be of a single thing, which shows no yaw: it is believed less by the square of their
    number. A person who began to walk turned the pose by a degree with eight returns."""
    wide_position: float = 0.12
    """Spread of the wider search [m]."""
    wide_yaw: float = 0.1
    """[rad]"""
    better: float = 0.05
    """The wider search must improve the share of matched returns by this much."""
    lesson_way: float = 1.0
    """Length of a stretch over which odometry is compared with matches [m]: wheels slip alike over about as much, and
    over less they would seem too good ..."""
    lesson_turn: float = 1.0
    """... or its turning [rad] ..."""
    longest_lesson: float = 10.0
    """... and up to this, until odometry errs by more than the matches: else it could not be told [m or rad]."""
    lesson_off: float = 0.1
    """A match that the returns alone would move by more than this teaches nothing [m]."""
    drift_factor: float = 9.0
    """Errors of neighbouring matches are alike: their covariance grows so many times faster than if they were not."""


class Tracked(NamedTuple):
    """The pose after a scan."""

    local_from_base: Pose2
    alignment: Alignment | None
    """None where nothing was matched."""
    keyframe: Keyframe | None
    """The keyframe, if the scan became one."""
    quality: float
    """Quality of the match, 0 where the scan fits nowhere near; 1 where it shows too little to tell: by odometry."""


@dataclass(slots=True)
class _Lesson:
    """A stretch of the way over which odometry is compared with matches."""

    at: Pose2
    """The match that it begins at."""
    noise: tuple[float, float]
    """Variances of that match: position along an axis [m^2], yaw [rad^2]."""
    odometry: Pose2 = STANDING
    """Motion since by odometry."""
    way: float = 0.0
    """[m]"""
    turn: float = 0.0
    """[rad]"""

    def add(self, motion: Pose2) -> None:
        """Go on by a motion of odometry."""
        self.odometry = compose(self.odometry, motion)
        self.way += math.hypot(motion.x, motion.y)
        self.turn += abs(motion.yaw)


class FrontEnd:
    """``track(returns, motion)`` once a scan."""

    def __init__(self, most_points: int, config: FrontEndConfig = FrontEndConfig()):
        self.config = config
        self.model = OdometryModel(config.odometry)
        self._aligner = Aligner(config.alignment, most_points)
        self._most_points = most_points
        self.reset(Pose2(0.0, 0.0, 0.0))

    def reset(self, start: Pose2, prior_map: OccupancyGrid | None = None) -> None:
        """Forget everything; begin at a pose of the local frame.

        Args:
            start: Pose of the base in the local frame.
            prior_map: A map known beforehand, in the local frame: the only submap, which is never finished.
        """
        self.model.reset()
        self.store = SubmapStore()
        self.local_from_base = start
        self.active = -1
        """Number of the submap that scans are matched to."""
        self._unmatched = [0.0, 0.0]
        """Way and turning since the last match [m, rad]."""
        self._way = self._turn = 0.0
        self._at_keyframe = start
        self._lesson: _Lesson | None = None
        self._drift = np.zeros((3, 3))
        self._information = np.zeros((3, 3))
        self._is_given = prior_map is not None
        if prior_map is not None:
            grid = SurfaceGrid(self.config.grid, start[:2])
            grid.fill(prior_map.level, prior_map.origin)
            self.store.submaps.append(Submap(grid, start, np.zeros((3, 3)), 0))
            self.active = 0

    def track(self, returns: Returns, motion: Pose2, is_sparse: bool = False) -> Tracked:
        """Take in a scan.

        Args:
            returns: The scan's returns.
            motion: Motion since the last scan by odometry.
            is_sparse: Whether it is one of few: then it is drawn however it fits, since no other shows the place.
        """
        motion = self.model.corrected(motion)
        way, turn = math.hypot(motion.x, motion.y), abs(motion.yaw)
        self._unmatched[0] += way
        self._unmatched[1] += turn
        self._way += way
        self._turn += turn
        if self._lesson is not None:
            self._lesson.add(motion)
        predicted = compose(self.local_from_base, motion)
        if self.active < 0:
            self.local_from_base = predicted
            return Tracked(predicted, None, self._keep(returns) if len(returns.points) else None, 1.0)
        alignment = None
        if len(returns.points):
            alignment = self._align(returns, predicted)
        if alignment is None:
            self._lesson = None
            self.local_from_base = predicted
        else:
            if alignment.quality < self.config.good:
                self._lesson = None
            self._information = alignment.information
            self.local_from_base = alignment.pose
            self._unmatched = [0.0, 0.0]
        keyframe = None
        last, here = self._at_keyframe, self.local_from_base
        fits = alignment is not None and alignment.quality >= self.config.maps
        may_draw = fits or (is_sparse and len(returns.points))
        if may_draw and (
            math.hypot(here.x - last.x, here.y - last.y) > self.config.keyframe_distance
            or abs(wrap_angle(here.yaw - last.yaw)) > self.config.keyframe_angle
        ):
            self._learn(returns)
            keyframe = self._keep(returns)
        quality = 0.0 if alignment is None else alignment.quality
        return Tracked(here, alignment, keyframe, 1.0 if self.is_thin(returns) else quality)

    def move(self, motion: Pose2) -> Tracked:
        """Go on by odometry alone: nothing is matched, nothing is drawn.

        Args:
            motion: Motion since the last scan by odometry.
        """
        motion = self.model.corrected(motion)
        self._unmatched[0] += math.hypot(motion.x, motion.y)
        self._unmatched[1] += abs(motion.yaw)
        self.local_from_base = compose(self.local_from_base, motion)
        return Tracked(self.local_from_base, None, None, 0.0)

    def match_here(self, returns: Returns, motion: Pose2 = STANDING) -> Alignment:
        """The match where the robot is by odometry, after a motion; nothing is changed by it."""
        grid = self.store.submaps[self.active].grid
        assert grid is not None  # the active submap is never finished
        motion = self.model.corrected(motion)
        way, turn = self._unmatched
        spread = self.model.spread(way + math.hypot(motion.x, motion.y), turn + abs(motion.yaw))
        predicted = compose(self.local_from_base, motion)
        return self._aligner.align(grid.surface, predicted, spread, returns.points, returns.normals)

    def go_on_at(self, local_from_base: Pose2) -> None:
        """Go on in the same submap, at a pose that a match has confirmed."""
        self.local_from_base = local_from_base
        self._unmatched = [0.0, 0.0]
        self._lesson = None
        self._leave_keyframe()

    def go_on_in(self, number: int, local_from_base: Pose2, covariance: FloatArray) -> None:
        """Go on in a submap where the robot has been found again.

        What was being drawn is finished, and a submap begins with what the old one holds.

        Args:
            number: The old submap's number.
            local_from_base: Where the robot is in it.
            covariance: (3, 3) of that, in the local frame's axes [m, rad].
        """
        store = self.store
        self.go_on_at(local_from_base)
        if self._is_given:
            return
        old = store.submaps[number]
        grid = SurfaceGrid(self.config.grid, local_from_base[:2])
        grid.unpack(store.surfaces_of(number))
        for submap in store.submaps[-2:]:
            if submap.grid is not None:
                submap.packed, submap.grid = submap.grid.pack(), None
        store.continuous_from = len(store.keyframes)
        fresh = Submap(grid, local_from_base, covariance, len(store.keyframes), number)
        fresh.map_from_local = old.map_from_local
        store.submaps.append(fresh)
        self.active = len(store.submaps) - 1
        self._drift = np.zeros((3, 3))

    def is_thin(self, returns: Returns) -> bool:
        """Whether a scan shows too little for a match to be believed against odometry."""
        return len(returns.points) < self.config.few * self._most_points

    def _align(self, returns: Returns, predicted: Pose2) -> Alignment | None:
        """Match a scan; None if its returns contradict the map wherever odometry may have brought the robot."""
        c, grid = self.config, self.store.submaps[self.active].grid
        assert grid is not None  # the active submap is never finished
        surface = grid.surface
        spread = self.model.spread(*self._unmatched)
        allowed = c.alignment.deviations**2
        if self.is_thin(returns):
            share = min(len(returns.points) / (c.single * self._most_points), 1.0)
            held = Spread(spread.position, share**2 * spread.yaw)
            near = self._aligner.align(surface, predicted, held, returns.points, returns.normals)
            return near if squared_deviations(predicted, near.pose, spread) < allowed else None
        near = self._aligner.align(surface, predicted, spread, returns.points, returns.normals)
        if near.quality >= c.doubted:
            return near
        wide = spread._replace(position=max(spread.position, c.wide_position), yaw=max(spread.yaw, c.wide_yaw))
        far = self._aligner.align(surface, predicted, wide, returns.points, returns.normals)
        best = far if far.matched > near.matched + c.better else near
        if best.quality < c.lost and squared_deviations(predicted, best.pose, spread) > allowed:
            return None
        return best

    def _learn(self, returns: Returns) -> None:
        """Compare what the returns alone say and odometry, over a stretch of the way.

        With the pull of the prediction matches would confirm odometry, and the more so the more it is trusted.
        """
        c, lesson = self.config, self._lesson
        if self.is_thin(returns):
            self._lesson = None
            return
        if lesson is not None and not self._is_over(lesson):
            return
        grid, here = self.store.submaps[self.active].grid, self.local_from_base
        assert grid is not None  # the active submap is never finished
        match = self._aligner.refine(grid.surface, here, returns.points, returns.normals, here, Spread(1.0, 1.0))
        off = between(here, match.pose)
        self._lesson = None
        if match.is_degenerate or match.quality < c.good or math.hypot(off.x, off.y) > c.lesson_off:
            return
        noise = self._noise_of(match)
        if lesson is not None:
            motion = between(lesson.at, match.pose)
            self.model.learn(
                Motion(lesson.way, lesson.turn, motion),
                between(motion, lesson.odometry),
                (noise[0] + lesson.noise[0], noise[1] + lesson.noise[1]),
            )
        self._lesson = _Lesson(match.pose, noise)

    def _is_over(self, lesson: _Lesson) -> bool:
        """Whether odometry may have erred by more than the matches at both ends of the stretch."""
        c = self.config
        if lesson.way < c.lesson_way and lesson.turn < c.lesson_turn:
            return False
        position, yaw = self.model.variances(lesson.way, lesson.turn)
        can_tell = position > 2.0 * lesson.noise[0] and yaw > 2.0 * lesson.noise[1]
        return can_tell or lesson.way > c.longest_lesson or lesson.turn > c.longest_lesson

    def _noise_of(self, match: Alignment) -> tuple[float, float]:
        """Variances of position, along an axis, and of yaw of a match without a pull."""
        c = self.config
        covariance = np.linalg.inv(match.information) * (c.drift_factor * c.alignment.return_deviation**2)
        return 0.5 * float(covariance[0, 0] + covariance[1, 1]), float(covariance[2, 2])

    def _keep(self, returns: Returns) -> Keyframe | None:
        """Make the scan a keyframe, in the submap that is matched and in the one that begins."""
        c, store, here = self.config, self.store, self.local_from_base
        if self._is_given:
            self._keep_in_given(returns)
            return None
        self._drift = self._drifted()
        keyframe = keyframe_of(returns, here, max(self.active, 0))
        store.keyframes.append(keyframe)
        half = c.submap_keyframes // 2
        if not store.submaps or store.submaps[-1].num_keyframes >= half:
            self._begin_submap(len(store.keyframes) - 1)
        for submap in store.submaps[-2:]:
            if submap.grid is not None and insert_scan(submap.grid, here, keyframe):
                submap.num_keyframes += 1
        self.active = max(len(store.submaps) - 2, 0)
        if store.submaps[self.active].grid is None:  # it was left when the robot was lost
            self.active += 1
        self._leave_keyframe()
        return keyframe

    def _keep_in_given(self, returns: Returns) -> None:
        """Draw the scan into the map known beforehand."""
        grid = self.store.submaps[0].grid
        assert grid is not None
        insert_scan(grid, self.local_from_base, returns)
        self._leave_keyframe()

    def _leave_keyframe(self) -> None:
        """Count the way from here on."""
        self._at_keyframe = self.local_from_base
        self._way = self._turn = 0.0

    def _begin_submap(self, first_keyframe: int) -> None:
        """Begin a submap here; the one before the last is finished, and its grid is taken for the new one."""
        store, here = self.store, self.local_from_base
        grid = None
        if len(store.submaps) > 1:
            finished = store.submaps[-2]
            grid, finished.grid = finished.grid, None
        if grid is None:
            grid = SurfaceGrid(self.config.grid, here[:2])
        else:
            finished.packed = grid.pack()
            grid.clear(here[:2])
        submap = Submap(grid, here, self._drift, first_keyframe, len(store.submaps) - 1)
        submap.map_from_local = store.submaps[self.active].map_from_local if store.submaps else store.map_from_local
        store.submaps.append(submap)
        self._drift = np.zeros((3, 3))

    def _drifted(self) -> FloatArray:
        """Covariance of the pose now, as the last submap's first keyframe sees it, in the local frame's axes."""
        before, here = self._at_keyframe, self.local_from_base
        lever = np.eye(3)
        lever[0, 2], lever[1, 2] = before.y - here.y, here.x - before.x
        position, yaw = self.model.variances(self._way, self._turn)
        deviation = self.config.alignment.return_deviation
        by_odometry = np.array([1.0 / max(position, 1e-8), 1.0 / max(position, 1e-8), 1.0 / max(yaw, 1e-8)])
        match = np.linalg.inv(self._information / deviation**2 + np.diag(by_odometry))
        return lever @ self._drift @ lever.T + self.config.drift_factor * match

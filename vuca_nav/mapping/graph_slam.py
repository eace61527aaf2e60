"""SLAM as a whole: the front end follows the robot, the back end corrects the map, a slice of work a scan."""

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

from vuca_nav.geometry import between, compose
from vuca_nav.mapping.front_end import FrontEnd, FrontEndConfig, Tracked
from vuca_nav.mapping.graph.back_end import BackEnd, BackEndConfig
from vuca_nav.mapping.graph.loop_closure import warm_up
from vuca_nav.mapping.grid import OccupancyGrid
from vuca_nav.mapping.relocalisation import RelocalisationConfig, Relocaliser
from vuca_nav.mapping.returns import ReturnReader, Returns
from vuca_nav.mapping.standing import Standing
from vuca_nav.mapping.submaps import SubmapStore
from vuca_nav.mapping.tracking import Tracking, TrackingConfig, TrackingMonitor
from vuca_nav.perception.percept import LevelScan
from vuca_nav.types import STANDING, LidarSpec, Pose2


@dataclass(frozen=True, slots=True)
class GraphSlamConfig:
    """Settings of SLAM."""

    reach: float = 20.0
    """Returns from farther away are not matched [m]."""
    surface_thickness: float = 0.1
    """A beam does not empty occupied cells while it is this near to the surface it ends on: two cells [m]."""
    slices: int = 1
    """Slices of the back end's work that are done after a scan."""
    front_end: FrontEndConfig = field(default_factory=FrontEndConfig)
    back_end: BackEndConfig = field(default_factory=BackEndConfig)
    tracking: TrackingConfig = field(default_factory=TrackingConfig)
    relocalisation: RelocalisationConfig = field(default_factory=RelocalisationConfig)


class Anchored(NamedTuple):
    """A pose that moves along with the submap that it was found in."""

    submap: int
    local_from_base: Pose2

    def map_from_base(self, store: SubmapStore) -> Pose2:
        """Where it is by now."""
        return compose(store.submaps[self.submap].map_from_local, self.local_from_base)


class GraphSlam:
    """``update(level, odom_from_base, stamp)`` once a scan.

    Attributes:
        store: Submaps and keyframes.
        back_end: The back end, with the pose graph.
        tracked: What the front end found at the last scan; None before the first.
        place: The last scan's pose.
        tracking: Whether that is to be trusted.
        num_found: Number of times that the robot had been lost and was found again.
    """

    def __init__(self, lidar: LidarSpec, config: GraphSlamConfig = GraphSlamConfig()):
        self.config = config
        self._standing = Standing(lidar, config.reach)
        self._reader = ReturnReader(lidar, config.reach, config.surface_thickness)
        self.front_end = FrontEnd(lidar.num_beams, config.front_end)
        self._monitor = TrackingMonitor(lidar, config.tracking)
        self._relocaliser = Relocaliser(config.front_end.alignment, lidar, config.relocalisation)
        warm_up(config.front_end.alignment)
        self.reset(STANDING)

    def reset(self, start: Pose2, prior_map: OccupancyGrid | None = None) -> None:
        """Forget everything and start at a pose of the map.

        Args:
            start: ``map_from_base`` now.
            prior_map: A map known beforehand: it is the one submap, and grows.
        """
        self.front_end.reset(start, prior_map)
        self.store = self.front_end.store
        self.back_end = BackEnd(self.store, self.config.front_end.alignment, self.config.back_end)
        self.tracked: Tracked | None = None
        self.place = Anchored(0, start)
        self.tracking: Tracking = "tracked"
        self._may_recover = True
        self.num_found = 0
        self._standing.reset()
        self._monitor.reset()
        self._relocaliser.begin()
        self._odom_from_base: Pose2 | None = None
        self._waiting: deque[int] = deque()
        self._work: Iterator[None] | None = None

    @property
    def map_from_local(self) -> Pose2:
        """Transform into the map from the frame in which the robot's way goes on without jumps."""
        store = self.store
        return store.submaps[self.place.submap].map_from_local if store.submaps else store.map_from_local

    def update(self, level: LevelScan, odom_from_base: Pose2, stamp: float) -> Pose2:
        """Localise a scan, and do the next slice of the back end's work.

        Args:
            level: The scan.
            odom_from_base: Odometry at its time.
            stamp: Its time [s].

        Returns:
            ``map_from_base``.
        """
        last, self._odom_from_base = self._odom_from_base, odom_from_base
        motion = STANDING if last is None else between(last, odom_from_base)
        returns = self._reader.read(self._standing.mark(level, odom_from_base, stamp))
        has_jumped = self._has_jumped(level, returns, motion, stamp)
        if has_jumped or self.tracking == "lost":
            if has_jumped:
                self._relocaliser.begin()
            self.tracking = "lost"
            self._find(returns, motion)
        else:
            self._track(returns, motion)
        if self.tracked is not None and self.tracked.keyframe is not None:
            self._waiting.append(len(self.store.keyframes) - 1)
        for _ in range(self.config.slices):
            self._do_slice()
        return compose(self.map_from_local, self.place.local_from_base)

    def _has_jumped(self, level: LevelScan, returns: Returns, motion: Pose2, stamp: float) -> bool:
        """Whether a scan was taken elsewhere than odometry says."""
        if not self._monitor.has_jumped(level, motion, stamp):
            return False
        if self.tracking == "lost" or not self.store.submaps or not len(returns.points):
            return True
        return not self._monitor.refutes(self.front_end.match_here(returns, motion))

    def doubt(self) -> None:
        """Take the robot for lost: odometry has broken off, and nobody knows how far it has moved."""
        self.tracking, self._may_recover = "lost", False
        self._relocaliser.begin()

    @property
    def must_look(self) -> bool:
        """Whether the robot is lost and has to go somewhere else to be found."""
        return self.tracking == "lost" and self._relocaliser.is_ambiguous

    def _track(self, returns: Returns, motion: Pose2) -> None:
        submap = max(self.front_end.active, 0)
        is_first = not self.store.submaps
        is_sparse = self._monitor.is_sparse
        self.tracked = self.front_end.track(returns, motion, is_sparse)
        self.place = Anchored(submap, self.tracked.local_from_base)
        if not is_first and not is_sparse and not self.front_end.is_thin(returns):
            self.tracking = self._monitor.update(self.tracked.alignment)
            if self.tracking == "lost":
                self._relocaliser.begin()

    def _find(self, returns: Returns, motion: Pose2) -> None:
        """Look for the lost robot; go on where it is found."""
        submap = max(self.front_end.active, 0)
        self.tracked = self.front_end.move(motion)
        self.place = Anchored(submap, self.tracked.local_from_base)
        if not self.store.submaps:
            return
        if self._may_recover and len(returns.points):
            alignment = self.front_end.match_here(returns)
            if self._monitor.recovers(alignment):
                self.front_end.go_on_at(alignment.pose)
                self.tracked = Tracked(alignment.pose, alignment, None, alignment.quality)
                self.place = Anchored(submap, alignment.pose)
                self._end_search()
                return
            if not self._monitor.is_done_looking:
                return
        here = self.place.map_from_base(self.store)
        found = self._relocaliser.update(self.store, returns, motion, here)
        if found is None:
            return
        self.front_end.go_on_in(found.submap, found.local_from_base, found.covariance)
        self.place = Anchored(max(self.front_end.active, 0), found.local_from_base)
        self._end_search()
        self.num_found += 1

    def _end_search(self) -> None:
        self._relocaliser.begin()
        self._monitor.reset()
        self.tracking, self._may_recover = "tracked", True

    def _do_slice(self) -> None:
        while self._work is not None or self._waiting:
            if self._work is None:
                self._work = self.back_end.work(self._waiting.popleft())
            try:
                next(self._work)
                return
            except StopIteration:
                self._work = None

    def correct(self, map_correction: Pose2) -> None:
        """Move the whole map."""
        for submap in self.store.submaps:
            submap.map_from_local = compose(map_correction, submap.map_from_local)
        self.store.map_from_local = compose(map_correction, self.store.map_from_local)

    def finish(self) -> None:
        """Do all of the back end's work that is left, and optimise once more."""
        while self._work is not None or self._waiting:
            self._do_slice()
        self.back_end.finish()

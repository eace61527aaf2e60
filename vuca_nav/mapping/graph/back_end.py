"""The back end: ties submaps together by loop closures, and moves them to where all ties agree.

Its work comes in slices, each a few milliseconds long, so that a loop in real time can spread them over its ticks.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import dijkstra

from vuca_nav.geometry import between, compose, inverse
from vuca_nav.mapping.alignment import AlignmentConfig, Spread
from vuca_nav.mapping.graph.loop_closure import Bundle, ClosureConfig, ClosureSearch, bundle_of
from vuca_nav.mapping.graph.pose_graph import Edge, PoseGraph
from vuca_nav.mapping.submaps import SubmapStore
from vuca_nav.types import STANDING, FloatArray, Pose2


@dataclass(frozen=True, slots=True)
class BackEndConfig:
    """Settings of the back end."""

    closure: ClosureConfig = field(default_factory=ClosureConfig)
    search_every: int = 5
    """Keyframes between two looks for closures."""
    candidates: int = 3
    """Submaps that a look goes into: those that the present one is tied to least."""
    near: float = 3.0
    """A submap is looked into if the robot is within this of one of its keyframes, beside the uncertainty [m]."""
    deviations: float = 3.0
    """The window goes so many deviations of the graph's uncertainty each way ..."""
    least_position: float = 0.4
    """... at least this [m] ..."""
    most_position: float = 7.0
    """... at most this [m] ..."""
    least_yaw: float = 0.06
    """[rad]"""
    most_yaw: float = 0.35
    """[rad]"""
    lever: float = 10.0
    """Length over which an error of a submap's yaw becomes one of position [m]."""
    most_trusted: float = 0.05
    """A closure that moves the map by more than this [m], or than the graph's uncertainty allows ..."""
    turn_lever: float = 5.0
    """... with a turn counted as a shift at this distance [m] ..."""
    agree_position: float = 0.05
    """... waits until another one, of other returns, agrees with it to this [m] ..."""
    agree_yaw: float = 0.015
    """... and this [rad] ..."""
    patience: int = 40
    """... for so many keyframes; then it is forgotten."""
    optimise_every: int = 10
    """Least number of keyframes between two optimisations."""


class _Proposal(NamedTuple):
    """A closure that waits for another one to confirm it."""

    keyframe: int
    edge: Edge
    correction: Pose2
    """Transform of the map that it calls for."""
    map_from_base: Pose2
    """Where the robot was, before it."""


class BackEnd:
    """``work(keyframe)`` after each keyframe; the submaps' ``map_from_local`` are what it changes."""

    def __init__(self, store: SubmapStore, alignment: AlignmentConfig, config: BackEndConfig = BackEndConfig()):
        self.config, self.store = config, store
        self.graph = PoseGraph()
        self._search = ClosureSearch(alignment, config.closure)
        self._places: list[FloatArray] = []
        """Positions of each finished submap's keyframes in the local frame (n, 2)."""
        self._costs: list[float] = []
        """Variance of position that each edge adds."""
        self._proposals: list[_Proposal] = []
        self._num_new = 0
        self._optimised_at = 0
        self.num_tried = self.num_closed = self.num_optimised = 0

    def work(self, number: int) -> Iterator[None]:
        """Take in a keyframe: slices of work.

        Args:
            number: The keyframe's number; the latest one's.
        """
        self._take_submaps()
        if number % self.config.search_every == 0 and self._places:
            bundle = None
            for candidate, spread, uncertain in self._candidates(number):
                if bundle is None:
                    continuous_from = self.store.continuous_from if number >= self.store.continuous_from else 0
                    first = max(number + 1 - self.config.closure.bundle, continuous_from)
                    bundle = bundle_of(self.store.keyframes[first : number + 1], self.config.closure)
                yield
                packed = self.store.submaps[candidate].packed
                assert packed is not None  # candidates are finished
                if not self._search.is_ready(candidate):
                    self._search.prepare(candidate, packed)
                    yield
                self._try(number, candidate, spread, uncertain, bundle)
        if self._num_new and number - self._optimised_at >= self.config.optimise_every:
            self._optimised_at = number
            yield
            yield from self._optimise()

    def finish(self) -> None:
        """Optimise with all that is known."""
        self._take_submaps()
        for _ in self._optimise():
            pass

    def _take_submaps(self) -> None:
        store = self.store
        for k in range(len(self.graph.poses), len(store.submaps)):
            submap = store.submaps[k]
            self.graph.add_node(compose(submap.map_from_local, submap.node))
            if submap.previous >= 0:
                before = store.submaps[submap.previous]
                c, s = math.cos(submap.node.yaw), math.sin(submap.node.yaw)
                node_from_local = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
                floor = np.diag([1e-4, 1e-4, 4e-6])
                covariance = node_from_local @ submap.drift @ node_from_local.T + floor
                self.graph.edges.append(
                    Edge(submap.previous, k, between(before.node, submap.node), STANDING, _inverted(covariance), False)
                )
                self._costs.append(self._cost(covariance))
        while len(self._places) < len(store.submaps) and store.submaps[len(self._places)].packed is not None:
            self._places.append(store.places_of(len(self._places)))

    def _cost(self, covariance: FloatArray) -> float:
        return float(covariance[0, 0] + covariance[1, 1] + covariance[2, 2] * self.config.lever**2)

    def _candidates(self, number: int) -> list[tuple[int, Spread, float]]:
        """Finished submaps about the robot, the one that it is tied to least first.

        Returns:
            Their numbers, windows, and how far they may be off by what the graph knows [m].
        """
        c, keyframe = self.config, self.store.keyframes[number]
        active = keyframe.submap
        here = self.store.map_from_base(keyframe)
        n = len(self.graph.poses)
        edges = self.graph.edges
        rows, columns = [e.first for e in edges], [e.second for e in edges]
        if not edges:
            return []
        # Of several ties between two submaps the parallel sum counts.
        ties = sparse.coo_matrix((1.0 / np.array(self._costs), (rows, columns)), shape=(n, n)).tocsr()
        ties.data = np.reciprocal(ties.data)  # pyright: ignore[reportArgumentType, reportCallIssue]
        variance = dijkstra(ties, directed=False, indices=active)
        found = []
        for k in range(min(len(self._places), active - 1)):
            uncertain = c.deviations * math.sqrt(variance[k])
            position = min(max(uncertain, c.least_position), c.most_position)
            yaw = min(max(uncertain / c.lever, c.least_yaw), c.most_yaw)
            in_local = compose(inverse(self.store.submaps[k].map_from_local), here)
            away = math.sqrt(float(((self._places[k] - in_local[:2]) ** 2).sum(axis=1).min()))
            if away < c.near + position:
                found.append((k, Spread(position, yaw), uncertain))
        found.sort(key=lambda item: (-item[2], item[0]))
        return found[: c.candidates]

    def _try(self, number: int, k: int, spread: Spread, uncertain: float, bundle: Bundle) -> None:
        submaps = self.store.submaps
        here = compose(submaps[bundle.submap].map_from_local, bundle.local_from_base)
        centre = compose(inverse(submaps[k].map_from_local), here)
        self.num_tried += 1
        packed = submaps[k].packed
        assert packed is not None
        closure = self._search.find(k, packed, bundle, centre, spread)
        if closure is None:
            return
        edge = Edge(
            k,
            bundle.submap,
            between(submaps[k].node, closure.local_from_base),
            between(submaps[bundle.submap].node, bundle.local_from_base),
            closure.information,
            True,
        )
        found = compose(submaps[k].map_from_local, closure.local_from_base)
        proposal = _Proposal(number, edge, compose(found, inverse(here)), here)
        off = between(here, found)
        shift = max(math.hypot(off.x, off.y), abs(off.yaw) * self.config.turn_lever)
        if shift > min(uncertain, self.config.most_trusted):
            partners = [other for other in self._proposals if self._agree(proposal, other)]
            if not partners:
                self._proposals.append(proposal)
                return
            self._proposals = [other for other in self._proposals if other not in partners]
            for partner in partners:
                self._accept(partner.edge)
        self._accept(edge)

    def _is_near(self, a: Pose2, b: Pose2) -> bool:
        off = between(a, b)
        return math.hypot(off.x, off.y) < self.config.agree_position and abs(off.yaw) < self.config.agree_yaw

    def _agree(self, proposal: "_Proposal", other: "_Proposal") -> bool:
        """Whether two closures that share no returns move the map alike."""
        apart = proposal.keyframe - other.keyframe
        return self.config.closure.bundle <= apart <= self.config.patience and self._is_near(
            compose(proposal.correction, proposal.map_from_base), compose(other.correction, proposal.map_from_base)
        )

    def _accept(self, edge: Edge) -> None:
        self.num_closed += 1
        self.graph.edges.append(edge)
        self._costs.append(self._cost(_inverted(edge.information + np.diag([1.0, 1.0, 100.0]))))
        self._num_new += 1

    def _optimise(self) -> Iterator[None]:
        submaps = self.store.submaps
        self._num_new = 0
        self._proposals.clear()  # they were found from where the submaps were
        self.graph.poses = [compose(submap.map_from_local, submap.node) for submap in submaps]
        yield from self.graph.steps()
        self.num_optimised += 1
        poses = self.graph.poses
        for k, submap in enumerate(submaps):
            if k < len(poses):
                submap.map_from_local = compose(poses[k], inverse(submap.node))
            else:  # it has begun meanwhile, where the one was that the robot came from
                submap.map_from_local = submaps[submap.previous].map_from_local


def _inverted(matrix: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.inv(matrix), np.float64)

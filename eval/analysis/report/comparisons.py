"""The comparisons that claims are made of: each says what the rows or the measurements find, with a 95% interval."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from eval.analysis.measurements.files import Measurement
from eval.analysis.report.cells import Cell, place_of, unique
from eval.analysis.report.results import ended, find, later
from eval.analysis.report.tables import Share
from eval.analysis.statistics import Estimate, mean_difference, mean_over, paired_difference, resampled_totals
from eval.methods import title_of
from eval.store import Row
from eval.suites import find_suite

LEAST_PAIRS = 20
"""Least number of pairs whose times decide."""
LEAST_SEEDS = 10
"""Least number of missions whose correlations decide."""
LEAST_EPISODES = 30
"""Least number of episodes with a situation whose gate decides."""
BEHAVIOURS = ("open floor", "tight passage", "sudden mover", "dead end", "known mover")
"""Situations of ``train.analysis.situations`` that call for a behaviour: all but ``other``."""
DRAWS = 1000
"""Number of draws of the gate's bootstrap."""
QUIET = "quiet"
"""Name of the longer way without moving obstacles, in ``worlds.scenes.double_branch``."""


class Evidence(NamedTuple):
    """What a report is given."""

    cells: Sequence[Cell]
    measurements: Sequence[Measurement] = ()

    def rows(self, kind: str) -> list[Row]:
        """The rows of a kind of measurement; of those of one episode by the same bits, one."""
        found = [row for each in self.measurements if each.kind == kind for row in each.rows]
        return list({repr(sorted(row.items(), key=lambda item: item[0])): row for row in found}.values())


class Scale(NamedTuple):
    """How a number is told."""

    factor: float
    unit: str
    sign: str
    digits: int

    def text(self, value: float) -> str:
        """The number, without its unit."""
        return f"{self.factor * value + 0.0:{self.sign}.{self.digits}f}"


PERCENT, POINTS = Scale(100.0, "%", "", 0), Scale(100.0, " points", "+", 0)
SECONDS, CORRELATION = Scale(1.0, " s", "+", 1), Scale(1.0, "", "+", 2)


class Finding(NamedTuple):
    """A comparison with what was found."""

    words: str
    scale: Scale
    estimate: Estimate | None
    n: int
    what: str
    """What ``n`` counts, as ``episodes``."""
    missing: tuple[tuple[str, str], ...] = ()
    """Methods and places without rows."""
    more: bool = True
    """Whether the claim is that it is more than the bound."""
    bound: float = 0.0
    least: int = 0
    """Least ``n`` that decides."""

    @property
    def holds(self) -> bool | None:
        """Whether the comparison holds; None if that is not decided."""
        if self.estimate is None or self.missing or self.n < self.least:
            return None
        if self.estimate.low > self.bound:
            return self.more
        return not self.more if self.estimate.high < self.bound else None

    def text(self) -> str:
        """The finding in words."""
        if self.estimate is None:
            return f"{self.words}: {'no rows' if self.missing or not self.n else 'too few'}"
        value, low, high = map(self.scale.text, self.estimate)
        holds = {True: "holds", False: "fails", None: "not decided"}[self.holds]
        side = "more" if self.more else "less"
        bound = f" (claimed: {side} than {100 * self.bound:g}%)" if self.scale is PERCENT else ""
        lacking = ", ".join(f"{name} in {place}" for name, place in self.missing)
        without = f", without {lacking}" if lacking else ""
        return (
            f"{self.words}: {value}{self.scale.unit} [{low}, {high}]{bound} in {self.n} {self.what}{without}: {holds}"
        )


class Asked(Protocol):
    """A comparison."""

    def find(self, evidence: Evidence, suite: str, robot: str) -> Finding:
        """What the evidence says of it.

        Args:
            evidence: Rows and measurements.
            suite: The suite or the kind of measurement that decides.
            robot: Name of the robot.
        """
        ...


class Comparison(NamedTuple):
    """A share against a bound, or two methods in the same episodes."""

    words: str
    measure: str
    """``success`` or ``collision``, ``time`` for the arriving times where both arrive, or the name of a way."""
    methods: tuple[str, ...]
    """One method, or one and the other that it is compared with."""
    more: bool
    """Whether the claim is that it is more than the bound."""
    bound: float = 0.0
    places: tuple[str, ...] = ()
    """By default all of the suite."""

    def find(self, evidence: Evidence, suite: str, robot: str) -> Finding:
        """What the rows of a robot say of it."""
        found, missing = _of_methods(evidence, robot, self.methods, self.places or places_of(suite))
        least = LEAST_PAIRS if self.measure == "time" else 0
        estimate, n = self._measure(found)
        scale = PERCENT if len(self.methods) == 1 else SECONDS if self.measure == "time" else POINTS
        what = "episodes" if len(self.methods) == 1 else "pairs"
        return Finding(self.words, scale, estimate, n, what, missing, self.more, self.bound, least)

    def _measure(self, found: Sequence[tuple[Cell, ...]]) -> tuple[Estimate | None, int]:
        if len(self.methods) == 1:
            rows = [row for (cell,) in found for row in cell.rows.values()]
            share = Share(sum(self.measure in (row["outcome"], row.get("way")) for row in rows), len(rows))
            return (share.estimate if rows else None), len(rows)
        pairs = [(cells[1], cells[0]) for cells in found]
        arrived, others, seeds = ended(pairs, "success" if self.measure == "time" else self.measure)
        if self.measure == "time":
            return later(pairs), int((arrived & others).sum())
        return (Estimate(*paired_difference(arrived, others, seeds)) if len(seeds) else None), len(seeds)


class Rise(NamedTuple):
    """The share that takes the quiet branch: its rise from few movers on the short one to many."""

    words: str
    method: str
    against: str | None = None
    """The method than whose share it rises more."""

    def find(self, evidence: Evidence, suite: str, robot: str) -> Finding:
        """What the rows of a robot say: the mean over the upper half of the places less that over the lower half."""
        methods = (self.method,) if self.against is None else (self.method, self.against)
        found, missing = _of_methods(evidence, robot, methods, places_of(suite))
        if missing:
            return Finding(self.words, POINTS, None, 0, "seeds", missing)
        rises = [_rises([cells[k] for cells in found]) for k in range(len(methods))]
        seeds = sorted(set.intersection(*map(set, rises)))
        values = np.array([rises[0][seed] - (rises[1][seed] if len(rises) > 1 else 0.0) for seed in seeds])
        estimate = Estimate(*mean_difference(values, most=float(len(methods)))) if seeds else None
        return Finding(self.words, POINTS, estimate, len(seeds), "seeds")


def _rises(cells: Sequence[Cell]) -> dict[int, float]:
    """The rise of each seed that all cells, in the order of their movers, have."""
    half = len(cells) // 2
    seeds = set.intersection(*(set(cell.rows) for cell in cells))
    taken = {seed: [cell.rows[seed].get("way") == QUIET for cell in cells] for seed in seeds}
    return {seed: float(np.mean(quiet[half:]) - np.mean(quiet[:half])) for seed, quiet in taken.items()}


class Openness(NamedTuple):
    """The rank correlation of V^h and clearance, a mean over moments and then over missions."""

    words: str
    field: str
    """``correlation``, or ``at_same_distance``."""
    method: str

    def find(self, evidence: Evidence, suite: str, robot: str) -> Finding:
        """What the measurements with a robot say; missions of one seed count once."""
        by_seed: dict[int, list[float]] = {}
        rows = [row for row in evidence.rows(suite) if row["robot"] == robot]
        for row in rows:
            told = [moment[self.field] for moment in row["moments"]]
            known = [value for value in told if value is not None]
            if known and title_of(row["method"], row) == self.method:
                by_seed.setdefault(row["seed"], []).append(float(np.mean(known)))
        estimate = mean_over([float(np.mean(values)) for _, values in sorted(by_seed.items())])
        missing = () if by_seed else ((self.method, "the heatmap"),)
        return Finding(self.words, CORRELATION, estimate, len(by_seed), "seeds", missing, least=LEAST_SEEDS)


class Leads(NamedTuple):
    """The share of the decisions in a situation that its leading expert leads.

    The leader is chosen in the episodes of even number, and its share is taken from the others.
    """

    words: str
    policy: str
    situation: str

    def find(self, evidence: Evidence, suite: str, robot: str) -> Finding:
        """What the measurements of the gate say, whatever the robot."""
        chosen, measured = _halves(evidence, suite, self.policy, (self.situation,))
        if chosen is None or measured is None:
            return Finding(self.words, PERCENT, None, 0, "episodes", ((self.policy, "the gate"),), bound=MOSTLY)
        leader = int(chosen.leads[:, 0].sum(axis=0).argmax())
        estimate, n = measured.ratio(measured.leads[:, 0, leader], measured.decisions[:, 0])
        words = f"{self.words}, expert {leader + 1} leads"
        return Finding(words, PERCENT, estimate, n, "episodes", bound=MOSTLY, least=LEAST_EPISODES)


class Differs(NamedTuple):
    """How much more another expert leads, in the situation where it does so most, than the one that leads in all.

    Situation and expert are chosen in the episodes of even number; the difference is taken from the others.
    """

    words: str
    policy: str
    situations: tuple[str, ...]

    def find(self, evidence: Evidence, suite: str, robot: str) -> Finding:
        """What the measurements of the gate say, whatever the robot."""
        chosen, measured = _halves(evidence, suite, self.policy, self.situations)
        if chosen is None or measured is None:
            return Finding(self.words, POINTS, None, 0, "episodes", ((self.policy, "the gate"),))
        totals = chosen.leads.sum(axis=0)  # (situations, experts)
        foremost = int(totals.sum(axis=0).argmax())
        shares = totals / np.maximum(chosen.decisions.sum(axis=0), 1.0)[:, None]
        lead = shares - shares[:, [foremost]]
        lead[:, foremost] = -np.inf
        situation, expert = np.unravel_index(int(lead.argmax()), lead.shape)
        more = measured.leads[:, situation, expert] - measured.leads[:, situation, foremost]
        estimate, n = measured.ratio(more, measured.decisions[:, situation])
        place = self.situations[int(situation)]
        words = f"{self.words}: in {place}, expert {expert + 1} leads more decisions than expert {foremost + 1}"
        return Finding(words, POINTS, estimate, n, "episodes", least=LEAST_EPISODES)


MOSTLY = 0.5
"""Share of the decisions that a leading expert leads."""


class GateCounts(NamedTuple):
    """Decisions of a policy in n episodes and s situations, with e experts."""

    kinds: NDArray[np.int64]
    """Kind of world (n,)."""
    decisions: NDArray[np.floating]
    """(n, s)"""
    leads: NDArray[np.floating]
    """Decisions that each expert leads (n, s, e)."""
    shares: NDArray[np.floating]
    """Sums of each expert's share (n, s, e)."""

    def ratio(self, above: NDArray[np.floating], below: NDArray[np.floating]) -> tuple[Estimate | None, int]:
        """A ratio of totals with its interval, for which whole episodes are drawn again, and its number of episodes."""
        n = int((below > 0).sum())
        if n == 0:
            return None, 0
        draws = resampled_totals(np.column_stack([above, below]), self.kinds, DRAWS, np.random.default_rng(0))
        ratios = draws[:, 0] / np.maximum(draws[:, 1], 1e-9)
        low, high = np.quantile(ratios[draws[:, 1] > 0], (0.025, 0.975))
        return Estimate(float(above.sum() / below.sum()), float(low), float(high)), n


def gate_counts(rows: Sequence[Row], situations: Sequence[str]) -> GateCounts:
    """The counts of a gate's rows in some situations."""
    kinds = {name: k for k, name in enumerate(sorted({row["kind"] for row in rows}))}
    experts = max(len(each["leads"]) for row in rows for each in row["situations"].values())
    nothing: Mapping[str, Any] = {"decisions": 0, "leads": [0] * experts, "shares": [0.0] * experts}
    told = [[row["situations"].get(name, nothing) for name in situations] for row in rows]
    return GateCounts(
        np.array([kinds[row["kind"]] for row in rows]),
        np.array([[each["decisions"] for each in row] for row in told], float),
        *(
            np.array([[[*each[name], *[0] * (experts - len(each[name]))] for each in row] for row in told], float)
            for name in ("leads", "shares")
        ),
    )


def _halves(
    evidence: Evidence, kind: str, policy: str, situations: Sequence[str]
) -> tuple[GateCounts | None, GateCounts | None]:
    rows = [row for row in evidence.rows(kind) if row["policy"] == policy and row["situations"]]
    even, odd = ([row for row in rows if row["seed"] % 2 == rest] for rest in (0, 1))
    if not even or not odd:
        return None, None
    return gate_counts(even, situations), gate_counts(odd, situations)


def places_of(suite: str) -> tuple[str, ...]:
    """The places of a suite in words, in its order."""
    return tuple(unique(place_of({"start": None, "goal": None, **asdict(task)}) for task in find_suite(suite).tasks))


def _of_methods(
    evidence: Evidence, robot: str, methods: Sequence[str], places: Sequence[str]
) -> tuple[list[tuple[Cell, ...]], tuple[tuple[str, str], ...]]:
    """The cells of methods, for each place that all have, and the methods and places without rows."""
    found: list[tuple[Cell, ...]] = []
    missing: list[tuple[str, str]] = []
    for place in places:
        members = [find(evidence.cells, place, robot, method) for method in methods]
        missing += [(method, place) for method, cell in zip(methods, members) if cell is None]
        there = tuple(cell for cell in members if cell is not None)
        if len(there) == len(members):
            found.append(there)
    return found, tuple(missing)

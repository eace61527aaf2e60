"""The paper's claims, each answered by the rows: yes, no or undecided.

What decides. A claim is one or more comparisons, each with a 95% interval: of a share (Wilson), of a difference of two
methods in the same episodes (Agresti and Min, a seed in several worlds counting once), or of the arriving times where
both arrive (interquartile mean, bootstrap). A comparison holds if its whole interval lies on the claimed side of its
bound, and fails if the whole interval lies on the other side; it is not decided while a place or a method lacks its
rows, nor by the times of fewer than 20 pairs, of which a bootstrap's interval is too short. A claim is answered *yes*
if all its comparisons hold, *no* if one of them fails, *undecided* otherwise. Since all must hold for a yes, that is no
more often wrong than one comparison is.
"""

import shlex
from collections.abc import Sequence
from typing import Literal, NamedTuple

from eval.analysis.report.cells import Cell, unique
from eval.analysis.report.results import ended, find, later
from eval.analysis.report.tables import Column, Share, Table, Value
from eval.analysis.statistics import Estimate, paired_difference
from eval.suites import find_suite
from vuca_nav.data_files import shown

RULE = (
    "A comparison holds if its whole 95% interval lies on the claimed side of its bound, and fails if the whole "
    "interval lies on the other side; it is not decided while rows are missing, nor by the times of fewer than 20 "
    "pairs. A claim is answered yes if all its comparisons hold, no if one of them fails, undecided otherwise. The "
    "paper says that methods do well, fail or usually collide without numbers; here that is that more than 80% arrive, "
    "fewer than 20% arrive, more than 50% collide. All other comparisons are of two methods in the same episodes of "
    "all worlds of the suite together, against a difference of zero: shares with Agresti and Min's intervals, a seed "
    "counting once, and interquartile means of the differences of the arriving times where both arrive, with "
    "bootstrapped intervals."
)
LEAST_PAIRS = 20
"""Least number of pairs whose times decide."""
WELL, FAILS, USUALLY = 0.8, 0.2, 0.5
"""Shares that stand for the paper's words "perform well", "cannot reach the goal" and "usually collides"."""

Verdict = Literal["yes", "no", "undecided"]


class Comparison(NamedTuple):
    """A part of a claim."""

    words: str
    measure: str
    """``success`` or ``collision``, or ``time`` for the arriving times where both arrive."""
    methods: tuple[str, ...]
    """One method, or one and the other that it is compared with."""
    more: bool
    """Whether the claim is that it is more than the bound."""
    bound: float = 0.0
    regions: tuple[str, ...] = ()
    """Places; by default all of the suite."""


class Claim(NamedTuple):
    """A claim of the paper."""

    words: str
    system: str
    """Whose claim it is: ``paper``, ``ours``, or ``both systems``."""
    suite: str
    comparisons: tuple[Comparison, ...]


class Finding(NamedTuple):
    """A comparison with what the rows say."""

    comparison: Comparison
    estimate: Estimate | None
    n: int
    """Number of episodes, or of pairs."""
    missing: tuple[tuple[str, str], ...]
    """Methods and places without rows."""

    @property
    def holds(self) -> bool | None:
        """Whether the comparison holds; None if that is not decided."""
        comparison = self.comparison
        if self.estimate is None or self.missing or (comparison.measure == "time" and self.n < LEAST_PAIRS):
            return None
        if self.estimate.low > comparison.bound:
            return comparison.more
        return not comparison.more if self.estimate.high < comparison.bound else None


def verdict(findings: Sequence[Finding]) -> Verdict:
    """The answer to a claim (see the module's text)."""
    held = [finding.holds for finding in findings]
    if False in held:
        return "no"
    return "yes" if all(held) else "undecided"


def _versus(measure: str, first: str, second: str, more: bool) -> Comparison:
    words = {
        ("success", True): "arrives more often than",
        ("collision", False): "collides less often than",
        ("time", True): "arrives later than",
        ("time", False): "arrives sooner than",
    }[measure, more]
    return Comparison(f"{first} {words} {second}", measure, (first, second), more)


def _claims() -> tuple[Claim, ...]:
    base = ("move_base", "move_base+dh", "drl")
    system, ablation = "paper-system", "paper-ablation"
    claims = [
        Claim(
            "all methods do well in region 1",
            own,
            system,
            tuple(
                Comparison(f"{m} arrives", "success", (m,), True, WELL, ("factory 1",))
                for m in (*base, f"{own}-dh", own)
            ),
        )
        for own in ("paper", "ours")
    ]
    claims += [
        Claim(
            "drl fails in regions 3 and 4",
            "both systems",
            system,
            tuple(
                Comparison(f"drl arrives in {place}", "success", ("drl",), False, FAILS, (place,))
                for place in ("factory 3", "factory 4")
            ),
        ),
        Claim(
            "move_base collides in the square",
            "both systems",
            system,
            (Comparison("move_base collides", "collision", ("move_base",), True, USUALLY, ("square",)),),
        ),
        Claim(
            "D^h shortens the arriving time",
            "both systems",
            system,
            (_versus("time", "move_base+dh", "move_base", False),),
        ),
    ]
    for own in ("paper", "ours"):
        bare = f"{own}-dh"
        claims += [
            Claim(f"{bare} succeeds more than move_base+dh", own, system,
                  (_versus("success", bare, "move_base+dh", True),)),
            Claim("V^h raises success", own, system, (_versus("success", own, bare, True),)),
            Claim("V^h costs time", own, system, (_versus("time", own, bare, True),)),
        ]  # fmt: skip
    straight, avoidance = "go-straight", "obstacle-avoidance"
    claims += [
        Claim("go-straight is faster", "both systems", ablation, (_versus("time", straight, avoidance, False),)),
        Claim(
            "obstacle-avoidance is safer", "both systems", ablation, (_versus("collision", avoidance, straight, False),)
        ),
    ]
    for own, fused in (("paper", "fusion"), ("ours", "fusion-plus")):
        claims += [
            Claim(
                f"{fused} is better than the experts in all",
                own,
                ablation,
                tuple(
                    _versus(measure, fused, expert, more)
                    for expert in (straight, avoidance)
                    for measure, more in (("success", True), ("collision", False), ("time", False))
                ),
            ),
            Claim(
                f"{fused} is slower but safer than drl",
                own,
                ablation,
                (_versus("time", fused, "drl", True), _versus("collision", fused, "drl", False)),
            ),
        ]
    return tuple(claims)


CLAIMS = _claims()


def answer(claim: Claim, cells: Sequence[Cell], robot: str) -> list[Finding]:
    """What the rows of a robot say of each comparison of a claim."""
    return [_finding(claim, comparison, cells, robot) for comparison in claim.comparisons]


def _finding(claim: Claim, comparison: Comparison, cells: Sequence[Cell], robot: str) -> Finding:
    places = comparison.regions or _places(claim.suite)
    found: list[tuple[Cell, ...]] = []
    missing = []
    for place in places:
        members = [find(cells, place, robot, method) for method in comparison.methods]
        missing += [(m, place) for m, cell in zip(comparison.methods, members) if cell is None]
        there = tuple(cell for cell in members if cell is not None)
        if len(there) == len(members):
            found.append(there)
    estimate, n = _measure(comparison, found)
    return Finding(comparison, estimate, n, tuple(missing))


def _measure(comparison: Comparison, found: Sequence[tuple[Cell, ...]]) -> tuple[Estimate | None, int]:
    if len(comparison.methods) == 1:
        rows = [row for (cell,) in found for row in cell.rows.values()]
        share = Share(sum(row["outcome"] == comparison.measure for row in rows), len(rows))
        return (share.estimate if rows else None), len(rows)
    pairs = [(cells[1], cells[0]) for cells in found]
    arrived, others, seeds = ended(pairs, "success" if comparison.measure == "time" else comparison.measure)
    if comparison.measure == "time":
        return later(pairs), int((arrived & others).sum())
    return (Estimate(*paired_difference(arrived, others, seeds)) if len(seeds) else None), len(seeds)


def claims_table(cells: Sequence[Cell], claims: Sequence[Claim] = CLAIMS) -> Table:
    """The claims with their answers: for each robot that has rows."""
    robots = sorted({cell.robot for cell in cells})
    found = [(claim, robot, answer(claim, cells, robot)) for claim in claims for robot in robots]
    lacking: dict[tuple[str, str], list[str]] = {}
    for claim, robot, findings in found:
        names = [name for finding in findings for name, _ in finding.missing]
        lacking[claim.suite, robot] = unique([*lacking.get((claim.suite, robot), []), *names])
    rows: list[list[Value]] = []
    for claim, robot, findings in found:
        told = "; ".join(_words(finding) for finding in findings)
        is_lacking = any(finding.missing for finding in findings)
        command = _command(claim.suite, robot, lacking[claim.suite, robot]) if is_lacking else None
        rows.append([claim.words, claim.system, robot, verdict(findings), told, command])
    titles = ("claim", "for", "robot", "answer", "because", "rows missing: made by")
    return Table("claims", "The paper's claims", RULE, tuple(map(Column, titles)), rows)


def _words(finding: Finding) -> str:
    estimate, comparison = finding.estimate, finding.comparison
    if estimate is None:
        return f"{comparison.words}: no rows"
    alone = len(comparison.methods) == 1
    unit = " s" if comparison.measure == "time" else "%" if alone else " points"
    scale, sign, digits = (1.0, "+", 1) if unit == " s" else (100.0, "" if alone else "+", 0)
    value, low, high = (f"{scale * part + 0.0:{sign}.{digits}f}" for part in estimate)
    holds = {True: "holds", False: "fails", None: "not decided"}[finding.holds]
    bound = f" (claimed: {'more' if comparison.more else 'less'} than {100 * comparison.bound:g}%)" if alone else ""
    few = f", without {', '.join(f'{m} in {place}' for m, place in finding.missing)}" if finding.missing else ""
    what = "episodes" if alone else "pairs"
    return f"{comparison.words}: {value}{unit} [{low}, {high}]{bound} in {finding.n} {what}{few}: {holds}"


def _command(suite: str, robot: str, methods: Sequence[str]) -> str:
    """The command that makes the rows that the claims on a suite lack."""
    words = ["vuca", "eval", suite, "--robot", shown(robot), "--method", ",".join(methods)]
    return shlex.join([*words, "--out", f"runs/{suite}-{shown(robot)}"])


def _places(suite: str) -> tuple[str, ...]:
    return tuple(
        task.world if task.region is None else f"{task.world} {task.region}" for task in find_suite(suite).tasks
    )

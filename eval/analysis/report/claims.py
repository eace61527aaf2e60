"""The paper's claims, each answered by the rows: yes, no or undecided.

What decides. A claim is one or more comparisons (``eval.analysis.report.comparisons``), each with a 95% interval: of a
share (Wilson), of a difference of two methods in the same episodes (Agresti and Min, a seed in several worlds counting
once), of the arriving times where both arrive (interquartile mean, bootstrap), or of a measurement. A
comparison holds if its whole interval lies on the claimed side of its bound, and fails if the whole interval lies on
the other side; it is not decided while a place or a method lacks its rows, nor by the times of fewer than 20 pairs, of
which a bootstrap's interval is too short. A claim is answered *yes* if all its comparisons hold, *no* if one of them
fails, *undecided* otherwise. Since all must hold for a yes, that is no more often wrong than one comparison is.
"""

import shlex
from collections.abc import Sequence
from typing import Literal, NamedTuple

from eval.analysis.report.cells import unique
from eval.analysis.report.comparisons import (
    BEHAVIOURS,
    MOSTLY,
    QUIET,
    Asked,
    Comparison,
    Differs,
    Evidence,
    Finding,
    Leads,
    Openness,
    Rise,
    places_of,
)
from eval.analysis.report.tables import Column, Table, Value
from eval.suites import FRESH, SUITES
from vuca_nav.data_files import shown

RULE = "\n\n".join(
    (
        "A comparison holds if its whole 95% interval lies on the claimed side of its bound, and fails if the whole "
        "interval lies on the other side; it is not decided while rows are missing, nor by the times of fewer than 20 "
        "pairs. A claim is answered yes if all its comparisons hold, no if one of them fails, undecided otherwise.",
        "The paper says that methods do well, fail or usually collide without numbers; here that is that more than 80% "
        "arrive, fewer than 20% arrive, more than 50% collide. Other comparisons are of two methods in the same "
        "episodes of all worlds of the suite together, against a difference of zero: shares with Agresti and Min's "
        "intervals, a seed counting once, and interquartile means of the differences of the arriving times where both "
        "arrive, with bootstrapped intervals.",
        "The quiet branch: the share of episodes that take it, with 8 and 12 movers on the short branch less with 0 "
        "and 4.",
        f"The gate: an expert leads a behaviour if it leads more than {100 * MOSTLY:g}% of the decisions in that "
        "situation; it is chosen in one half of the episodes and measured in the other, in 30 episodes or more.",
        "The heatmap: rank correlations of V^h and the clearance of the places in sight, means over moments, with "
        "Student's intervals over 10 seeds or more.",
    )
)
WELL, FAILS, USUALLY = 0.8, 0.2, 0.5
"""Shares that stand for the paper's words "perform well", "cannot reach the goal" and "usually collides"."""

WHATEVER = "all"
"""Robot of a claim on the gate, which is measured on many bodies at once."""

Verdict = Literal["yes", "no", "undecided"]


class Claim(NamedTuple):
    """A claim of the paper."""

    words: str
    system: str
    """Whose claim it is: ``paper``, ``ours``, or ``both systems``."""
    suite: str
    """The suite whose rows decide, or the kind of measurement."""
    comparisons: tuple[Asked, ...]


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
    crowded = places_of("paper-branch")[-1]
    for own, policy in (("paper", "paper"), ("ours", "fusion-plus")):
        claims += [
            Claim(
                "robots take the quiet branch",
                own,
                "paper-branch",
                (
                    Rise(f"{own} takes it more often with many movers than with few", own),
                    Rise(f"that rises more than with {own}-dh", own, f"{own}-dh"),
                    Comparison(f"{own} takes it in {crowded}", QUIET, (own,), True, USUALLY, (crowded,)),
                ),
            ),
            Claim(
                "each behaviour has a leading expert",
                own,
                "gate",
                (
                    *(Leads(f"in {situation}", policy, situation) for situation in BEHAVIOURS),
                    Differs("not the same everywhere", policy, BEHAVIOURS),
                ),
            ),
            Claim(
                "open space is safer in the heatmap",
                own,
                "heatmap",
                (
                    Openness("V^h rises with the clearance", "correlation", own),
                    Openness("it does at the same distance from the robot", "at_same_distance", own),
                ),
            ),
        ]
    return tuple(claims)


CLAIMS = _claims()


def answer(claim: Claim, evidence: Evidence, robot: str) -> list[Finding]:
    """What the rows of a robot, or the measurements with it, say of each comparison of a claim."""
    return [comparison.find(evidence, claim.suite, robot) for comparison in claim.comparisons]


def claims_table(evidence: Evidence, claims: Sequence[Claim] = CLAIMS) -> Table:
    """The claims with their answers, for each robot that has rows; none if there are no rows of the claims' tasks."""
    places = {place for claim in claims if claim.suite in SUITES for place in places_of(claim.suite)}
    if not evidence.measurements and places.isdisjoint(cell.place for cell in evidence.cells):
        claims = ()
    robots = sorted({cell.robot for cell in evidence.cells} | {row["robot"] for row in evidence.rows("heatmap")})
    found = [
        (claim, robot, answer(claim, evidence, robot))
        for claim in claims
        for robot in ([WHATEVER] if claim.suite == "gate" else robots)
    ]
    lacking: dict[tuple[str, str], list[str]] = {}
    for claim, robot, findings in found:
        names = [name for finding in findings for name, _ in finding.missing]
        lacking[claim.suite, robot] = unique([*lacking.get((claim.suite, robot), []), *names])
    rows: list[list[Value]] = []
    for claim, robot, findings in found:
        told = "; ".join(finding.text() for finding in findings)
        names = [name for finding in findings for name, _ in finding.missing]
        command = _command(claim.suite, robot, lacking[claim.suite, robot], names[0]) if names else None
        rows.append([claim.words, claim.system, robot, verdict(findings), told, command])
    titles = ("claim", "for", "robot", "answer", "because", "rows missing: made by")
    return Table("claims", "Why: the comparisons of each claim", RULE, tuple(map(Column, titles)), rows)


def answers_table(claims: Table) -> Table:
    """The answers alone, a column for each robot.

    Args:
        claims: Result of ``claims_table``.
    """
    robots = unique(row[2] for row in claims.rows)
    found: dict[tuple[Value, Value], dict[Value, Value]] = {}
    for claim, system, robot, verdict_of, *_ in claims.rows:
        found.setdefault((claim, system), {})[robot] = verdict_of
    rows: list[list[Value]] = [[*key, *(answers.get(robot) for robot in robots)] for key, answers in found.items()]
    columns = (Column("claim"), Column("for"), *(Column(str(robot)) for robot in robots))
    note = "Yes or no where the intervals decide, with the reasons below."
    return Table("answers", "The paper's claims", note, columns, rows)


def _command(suite: str, robot: str, methods: Sequence[str], method: str) -> str:
    """The command that makes the rows, or the measurement, that the claims on a suite lack.

    Args:
        suite: The suite, or the kind of measurement.
        robot: The robot.
        methods: The methods that all claims on the suite lack.
        method: The first that this claim lacks.
    """
    name = shown(robot)
    if suite in SUITES:
        words = ["vuca", "eval", suite, "--robot", name, "--method", ",".join(methods), "--out", f"runs/{suite}-{name}"]
    elif suite == "gate":
        files = [f"vuca_nav/policy/weights/{policy}.safetensors" for policy in methods]
        words = ["python", "-m", "train.analysis.gate", *files, "--out", "runs/gate"]
    else:
        words = ["python", "-m", "eval.analysis.measurements.openness", "--robot", name, "--method", method]
        words += ["--seeds", f"{FRESH}:{FRESH + 20}", "--out", f"runs/{suite}-{name}-{method}.jsonl"]
    return shlex.join(words)

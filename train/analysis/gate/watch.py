"""Analysis of the experts of a fused policy: their shares in open floor, tight passages, dead ends, before movers.

``python -m train.analysis.gate FILE... --out DIR`` prints tables and writes ``summary.json`` and two pictures.
"""

import hashlib
import json
import shlex
import sys
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import torch
import tyro
from numpy.typing import NDArray
from tqdm import tqdm

from eval.analysis.measurements.files import head_line, run_of
from eval.analysis.statistics import paired_difference
from train.analysis.episodes import Evaluation
from train.analysis.evaluate import EvaluateArguments, episodes_of
from train.analysis.gate.play import Decisions, Scene, Watched, play_without, watch
from train.analysis.gate.plots import draw_moments, draw_shares
from train.analysis.gate.summary import episode_rows, summarise
from train.analysis.gate.tables import tables
from train.analysis.situations import DEFINITIONS, PRECEDENCE, SITUATIONS
from train.arena.config import KINDS
from train.navigation.networks import FusedActor
from train.navigation.weights import actor_of
from vuca_nav.errors import BadArgument
from vuca_nav.files import prepare_directory, write_whole
from vuca_nav.policy.weights_file import PolicyWeights, load_weights

KIND = "gate"
"""Name of the measurement that ``gate.jsonl`` is."""
LEAST_SHARE = 0.01
"""Least average share in a situation of an expert that is knocked out there: with less, hardly anything would
change."""


@dataclass(frozen=True)
class GateArguments:
    """Watch the gate of fused policies at every decision, sorted by the situation that the robot is in.

    The policies play unseen worlds by their mean actions. By the truth, every decision is taken in open floor, in a
    tight passage, before a sudden or a known mover, in a dead end, or in none of these; the output says how each is
    defined. For each situation it has the experts' shares, the leader, what is commanded then, and what each expert
    alone would command, with 95% intervals for which whole episodes are drawn again: as tables on stdout and in
    summary.json, and as pictures, NAME_shares.png and NAME_moments.png. gate.jsonl has the counts of each episode, for
    vuca report.
    """

    files: tyro.conf.Positional[tuple[Path, ...]]
    """Weights files of fused policies."""
    out: Path = Path("gate")
    """Directory of the results."""
    episodes: int = 500
    """Number of episodes in each kind of world."""
    seed: int = 0
    """Seed of the episodes and of the intervals; that of python -m train.analysis.evaluate by default."""
    kinds: tuple[Literal["static", "dynamic", "mixed", "square", "corridor"], ...] = KINDS  # type: ignore[assignment]
    """Kinds of worlds."""
    knock_outs: bool = False
    """Play the same episodes also without each expert in each situation: some ten times as long."""
    decision_rate: int | None = None
    """Decisions a second [Hz]; by default the rate that each policy was trained at."""


def analyse(name: str, source: PolicyWeights, arguments: GateArguments) -> tuple[dict, list[dict]]:
    """Watch one policy, and draw its pictures.

    Returns:
        The tables of ``summarise``, ``success`` in each kind of world, and ``knock_outs`` if they are asked for; and
        the counts of each episode.
    """
    actor = actor_of(source)
    per_kind = EvaluateArguments(
        arguments.files, arguments.out, arguments.episodes, arguments.seed, decision_rate=arguments.decision_rate
    )
    evaluations = [episodes_of(source, kind, per_kind) for kind in arguments.kinds]
    with _bar(arguments.episodes * len(arguments.kinds), name) as bar:
        watched = [watch(actor, source.observation, evaluation, bar) for evaluation in evaluations]
    rate = evaluations[0].arena.config.decision_rate
    decisions, scenes = _join(watched, arguments.episodes)
    kinds = np.repeat(np.arange(len(watched)), arguments.episodes)
    result = summarise(decisions, kinds, arguments.kinds, arguments.seed)
    result["success"] = {kind: float(w.success.mean()) for kind, w in zip(arguments.kinds, watched)}
    what = f"{name}: {len(kinds):,} episodes of seed {arguments.seed} in {', '.join(arguments.kinds)} worlds"
    draw_shares(result, what, arguments.out / f"{name}_shares.png")
    draw_moments(
        decisions, scenes, rate, f"{what}; for each situation a typical moment of its foremost expert",
        arguments.out / f"{name}_moments.png",
    )  # fmt: skip
    if arguments.knock_outs:
        result["knock_outs"] = knock_outs(actor, evaluations, watched, result, name)
    return result, episode_rows(decisions, kinds, arguments.kinds, name)


def _join(watched: list[Watched], episodes: int) -> tuple[Decisions, dict[tuple[int, int], Scene]]:
    """Join the decisions of all kinds of worlds, numbering their episodes on."""
    parts = [w.decisions._replace(episode=w.decisions.episode + k * episodes) for k, w in enumerate(watched)]
    scenes = {(i + k * episodes, age): scene for k, w in enumerate(watched) for (i, age), scene in w.scenes.items()}
    return Decisions.join(parts), scenes


def knock_outs(
    actor: FusedActor, evaluations: list[Evaluation], watched: list[Watched], result: dict, name: str
) -> list[dict]:
    """Measure the success lost if an expert has no share in one situation, and the gate is as trained elsewhere.

    Only episodes are played again in which the situation came up: up to its first decision in it, and so to its end if
    there is none, an episode is the same with and without the expert.

    Args:
        actor: The policy.
        evaluations: Its episodes, for each kind of world.
        watched: Their records.
        result: Its tables.
        name: Title of the progress bar.

    Returns:
        A row for each situation and ``expert`` (from 1): ``episodes`` in which the situation came up, the shares of
        success ``with`` and ``without`` the expert, and the paired ``difference`` with its 95% interval; the latter
        three are None for an expert that has less than LEAST_SHARE there.
    """
    there = [[_met(w, situation) for w in watched] for situation in range(len(SITUATIONS))]
    shares = [
        [0.0 if expert["share"] is None else expert["share"][0] for expert in result["situations"][s]["experts"]]
        for s in SITUATIONS
    ]
    total = sum(int(met.sum()) * sum(a >= LEAST_SHARE for a in own) for mets, own in zip(there, shares) for met in mets)
    rows = []
    with _bar(total, f"{name}: knock-outs") as bar:
        for situation, title in enumerate(SITUATIONS):
            mets = there[situation]
            before = np.concatenate([w.success[met] for w, met in zip(watched, mets)])
            for expert, share in enumerate(shares[situation]):
                row = {"situation": title, "expert": expert + 1, "share": share, "episodes": len(before)}
                after = None
                if share >= LEAST_SHARE:
                    after = np.concatenate(
                        [
                            play_without(actor, evaluation, met, expert, situation, bar)[met]
                            for evaluation, met in zip(evaluations, mets)
                        ]
                    )
                rows.append(
                    row | {
                        "with": None if after is None else float(before.mean()),
                        "without": None if after is None else float(after.mean()),
                        "difference": None if after is None else paired_difference(before, after),
                    }
                )  # fmt: skip
    return rows


def _met(watched: Watched, situation: int) -> NDArray[np.bool_]:
    """Whether the situation came up in each episode, (episodes,)."""
    met = np.zeros(len(watched.success), np.bool_)
    met[watched.decisions.episode[watched.decisions.situation == situation]] = True
    return met


def _bar(total: int, title: str) -> tqdm:
    return tqdm(total=total, unit="episode", desc=title, file=sys.stderr)


def main(arguments: GateArguments) -> None:
    """Watch, print and write.

    Raises:
        BadArgument: If there is nothing to be watched, two policies have the same name, or the results have no place.
        BadWeights: If a file is missing or broken.
    """
    if not arguments.files or not arguments.kinds or arguments.episodes < 1:
        raise BadArgument("give one or more weights files, one or more --kinds, and --episodes of 1 or more")
    weights = {path.stem: load_weights(path) for path in arguments.files}
    if len(weights) < len(arguments.files) or len(set(arguments.kinds)) < len(arguments.kinds):
        raise BadArgument("two of the files, or of the kinds of worlds, have the same name")
    for path, source in zip(arguments.files, weights.values()):
        if source.experts == 1:
            raise BadArgument(
                f"{path} is one network without a gate; fused policies have one, as fusion and fusion-plus"
            )
    prepare_directory(arguments.out)
    torch.set_num_threads(1)
    analysed = {name: analyse(name, source, arguments) for name, source in weights.items()}
    policies = {name: result for name, (result, _) in analysed.items()}
    summary = {
        "arguments": {key: str(value) if key == "out" else value for key, value in asdict(arguments).items()},
        "definitions": DEFINITIONS,
        "precedence": [SITUATIONS[k] for k in PRECEDENCE], "policies": policies,
    }  # fmt: skip
    summary["arguments"]["files"] = [str(path) for path in arguments.files]
    write_whole(arguments.out / "summary.json", json.dumps(summary, indent=2) + "\n")
    command = shlex.join(["python", "-m", "train.analysis.gate", *sys.argv[1:]])
    digests = {name: hashlib.sha256(source.path.read_bytes()).hexdigest() for name, source in weights.items()}
    made_by = {"weights_sha256": digests, "episodes": arguments.episodes, "seed": arguments.seed}
    rows = [row for _, found in analysed.values() for row in found]
    lines = "".join(f"{json.dumps(row)}\n" for row in rows)
    write_whole(arguments.out / f"{KIND}.jsonl", head_line(KIND, made_by, [run_of(command)]) + lines)
    print(
        f"{arguments.episodes} episodes of seed {arguments.seed} in each kind of world: {', '.join(arguments.kinds)}."
    )
    for name, result in policies.items():
        print(f"\n## {name}\n\n{tables(result)}")
    print(f"Written: {arguments.out}/summary.json, {KIND}.jsonl, NAME_shares.png and NAME_moments.png of each policy")

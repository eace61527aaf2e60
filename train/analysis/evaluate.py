"""Evaluation of weights files in unseen worlds of the arena: every policy meets the same episodes.

``python -m train.analysis.evaluate FILE... --out DIR`` writes ``evaluation.json`` and ``evaluation.md``.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np
import tyro
from numpy.typing import NDArray
from tqdm import tqdm

from eval.analysis.statistics import paired_difference
from train.analysis.episodes import EpisodeRecords, Evaluation
from train.analysis.local_policies import ArenaPolicies, ArenaShield
from train.analysis.page import AS_IT_IS, GateUse, markdown, row_names, summary
from train.arena.config import KINDS, ArenaConfig
from vuca_nav.cli import run_module
from vuca_nav.errors import BadArgument
from vuca_nav.files import prepare_directory, write_whole
from vuca_nav.policy.dynamic_window import DynamicWindow
from vuca_nav.policy.observation import ObservationConfig
from vuca_nav.policy.weights_file import PolicyWeights, load_weights

if TYPE_CHECKING:  # so that bad arguments are reported at once, and a missing torch in one line
    import torch

    from train.navigation.networks import FusedActor


@dataclass(frozen=True)
class EvaluateArguments:
    """Compare policies in the training arena's unseen worlds."""

    files: tyro.conf.Positional[tuple[Path, ...]]
    """Weights files; the first is what the others are compared with. Rows are named after the files, and files of the
    same name by as much of their paths as tells them apart."""
    out: Path = Path("evaluation")
    """Directory of the results."""
    episodes: int = 500
    """Number of episodes in each kind of world."""
    seed: int = 0
    kinds: tuple[Literal["static", "dynamic", "mixed", "square", "corridor"], ...] = KINDS  # type: ignore[assignment]
    """Kinds of worlds."""
    knock_outs: bool = False
    """Play also with the gate overruled: uniform, its own average in each kind of world, and without each expert."""
    shield: bool = False
    """Play also under the robot's shield."""
    dynamic_window: bool = False
    """Play also the dynamic window, at the stack's rate."""
    decision_rate: int | None = None
    """Decisions a second [Hz]; by default the rate that each policy was trained at."""
    speeds: tuple[float, float] | None = None
    """Speeds of the movers, as multiples of the body's greatest; by default 0.2 to 2."""
    threads: int = 1


STACK_RATE = 30
"""Rate of decisions on a robot [Hz]."""


class Played(NamedTuple):
    """A policy in one kind of world."""

    records: EpisodeRecords
    gate: GateUse


def play(
    actor: FusedActor,
    evaluation: Evaluation,
    overrule: NDArray[np.float32] | None = None,
    title: str = "",
    *,
    shielded: bool = False,
) -> Played:
    """Play all episodes with the policy's mean actions.

    Args:
        actor: The policy.
        evaluation: Fresh episodes.
        overrule: (experts,) shares to be used whatever the gate says, or a mask (experts,) of zeros and negative
            infinities to be added to the logarithms of the gate's shares: see ``knock_outs``.
        title: Title of the progress bar.
        shielded: Play under the robot's shield.
    """
    import torch

    shield = ArenaShield(evaluation.arena) if shielded else None
    total, entropy, count = torch.zeros(len(actor.layers[0].bias)), 0.0, 0
    with tqdm(total=evaluation.arena.n, unit="episode", desc=title, leave=False) as bar, torch.no_grad():
        while (active := evaluation.active).any():
            observation = torch.from_numpy(evaluation.observation[active])
            shares = actor.gate(observation)
            if overrule is not None:
                shares = _overruled(shares, torch.from_numpy(overrule))
            total += shares.sum(0)
            entropy += float(-(shares * shares.clamp_min(1e-12).log()).sum())
            count += len(shares)
            action = np.zeros((len(active), 3), np.float32)
            action[active] = actor.mean(observation, shares).numpy()
            if shield is not None:
                shield.filter(np.flatnonzero(active), action)
            evaluation.step(action)
            bar.update(int((~evaluation.active).sum()) - bar.n)
    mean = total / count
    of_mean = float(-(mean * mean.clamp_min(1e-12).log()).sum())
    return Played(evaluation.records(), GateUse(mean.tolist(), entropy / count, of_mean - entropy / count))


def play_dynamic_window(evaluation: Evaluation, title: str) -> EpisodeRecords:
    """Play all episodes, driven by the dynamic window."""
    windows = ArenaPolicies(evaluation.arena, DynamicWindow)
    with tqdm(total=evaluation.arena.n, unit="episode", desc=title, leave=False) as bar:
        while (active := evaluation.active).any():
            action = np.zeros((len(active), 3), np.float32)
            windows.decide(np.flatnonzero(active), action)
            evaluation.step(action)
            bar.update(int((~evaluation.active).sum()) - bar.n)
    return evaluation.records()


def _overruled(shares: torch.Tensor, overrule: torch.Tensor) -> torch.Tensor:
    if overrule.isinf().any():
        kept = shares * (overrule == 0.0)
        return kept / kept.sum(1, keepdim=True)
    return overrule.expand_as(shares)


def knock_outs(experts: int, mean: Sequence[float]) -> dict[str, NDArray[np.float32]]:
    """Make the shares that overrule a gate: its own average, equal shares, and each expert left out.

    Args:
        experts: Number of experts.
        mean: (experts,) average shares of the gate.
    """
    named = {"gate's average": np.array(mean, np.float32), "uniform": np.full(experts, 1.0 / experts, np.float32)}
    for k in range(experts):
        named[f"without {k + 1}"] = np.where(np.arange(experts) == k, -np.inf, 0.0).astype(np.float32)
    return named


def evaluate(arguments: EvaluateArguments) -> dict:
    """Play all policies and variants in all kinds of worlds.

    Returns:
        ``{policy: {variant: {kind: row}}}``, of which ``AS_IT_IS`` is one; its rows have paired differences with the
        first policy's same kind (``against_first``), other variants' with their own policy's (``against_as_it_is``).

    Raises:
        BadArgument: If there is nothing to be compared, a file is given twice, or a number is out of its range.
        BadWeights: If a file is missing or broken.
    """
    weights = _policies(arguments)
    import torch

    from train.navigation.weights import actor_of

    torch.set_num_threads(arguments.threads)
    results: dict = {name: {} for name in weights}
    for kind in arguments.kinds:
        first: Played | None = None
        for name, source in weights.items():
            actor = actor_of(source)
            learned = play(actor, episodes_of(source, kind, arguments), None, f"{kind}: {name}")
            row = summary(*learned)
            if first is None:
                first = learned
            else:
                row["against_first"] = paired_difference(first.records.success, learned.records.success)
            results[name].setdefault(AS_IT_IS, {})[kind] = row
            if arguments.shield:
                other = play(
                    actor, episodes_of(source, kind, arguments), None, f"{kind}: {name} shielded", shielded=True
                )
                row = summary(*other)
                row["against_as_it_is"] = paired_difference(learned.records.success, other.records.success)
                results[name].setdefault("shielded", {})[kind] = row
            if not arguments.knock_outs or source.experts == 1:
                continue
            for variant, overrule in knock_outs(source.experts, learned.gate.mean).items():
                other = play(actor, episodes_of(source, kind, arguments), overrule, f"{kind}: {name} {variant}")
                row = summary(*other)
                row["against_as_it_is"] = paired_difference(learned.records.success, other.records.success)
                results[name].setdefault(variant, {})[kind] = row
        if arguments.dynamic_window:
            records = play_dynamic_window(
                _arena(kind, STACK_RATE, arguments, ObservationConfig()), f"{kind}: dynamic window"
            )
            row = summary(records)
            if first is not None:
                row["against_first"] = paired_difference(first.records.success, records.success)
            results.setdefault("dynamic window", {}).setdefault(AS_IT_IS, {})[kind] = row
    return results


def _policies(arguments: EvaluateArguments) -> dict[str, PolicyWeights]:
    """Policies by the names of their rows, once all arguments are checked; raises the errors of ``evaluate``."""
    for name, least in (("episodes", 1), ("threads", 1), ("seed", 0)):
        if getattr(arguments, name) < least:
            raise BadArgument(f"--{name} must be {least} or more, got {getattr(arguments, name)}")
    if (arguments.shield or arguments.dynamic_window) and arguments.threads > 1:
        raise BadArgument(f"--shield and --dynamic-window go with --threads 1, got {arguments.threads}")
    if not arguments.files:
        raise BadArgument("give one or more weights files to evaluate")
    if not arguments.kinds:
        raise BadArgument(f"--kinds must name one or more of {', '.join(KINDS)}, got none")
    weights = dict(zip(row_names(arguments.files), map(load_weights, arguments.files)))
    for source in weights.values():
        _config(arguments.kinds[0], _rate(source, arguments), arguments)
    return weights


def _rate(source: PolicyWeights, arguments: EvaluateArguments) -> int:
    """Rate at which a policy decides [Hz]."""
    if arguments.decision_rate is not None:
        return arguments.decision_rate
    try:
        return round(float(source.metadata["decision_rate"]))
    except (KeyError, ValueError) as error:
        raise BadArgument(f"{source.path} names no decision_rate [Hz]; give --decision-rate") from error


def _config(kind: str, rate: int, arguments: EvaluateArguments) -> ArenaConfig:
    config = ArenaConfig(decision_rate=rate).of(kind)
    return config if arguments.speeds is None else replace(config, mover_speeds=arguments.speeds)


def episodes_of(source: PolicyWeights, kind: str, arguments: EvaluateArguments) -> Evaluation:
    """The unseen episodes of one kind of world, as the policy sees them.

    Raises:
        BadArgument: If the weights name no rate to decide at, and the arguments do not either.
    """
    return _arena(kind, _rate(source, arguments), arguments, source.observation)


def _arena(kind: str, rate: int, arguments: EvaluateArguments, observation: ObservationConfig) -> Evaluation:
    config = _config(kind, rate, arguments)
    return Evaluation(config, observation, arguments.episodes, arguments.seed, arguments.threads)


def main(arguments: EvaluateArguments) -> None:
    """Play, and write the results.

    Raises:
        BadArgument: See ``evaluate``; or if ``--out`` cannot be written.
        BadWeights: If a file is missing or broken.
    """
    _policies(arguments)
    prepare_directory(arguments.out)
    results = evaluate(arguments)
    write_whole(arguments.out / "evaluation.json", json.dumps(results, indent=2) + "\n")
    text = markdown(results, arguments.kinds, arguments.episodes, arguments.seed)
    write_whole(arguments.out / "evaluation.md", text)
    print(text)


if __name__ == "__main__":
    run_module("evaluate", main, EvaluateArguments)

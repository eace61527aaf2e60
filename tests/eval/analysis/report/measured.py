"""Measurements that were never made: files by formulas, so that each test knows what the report must say."""

import base64
import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from eval.episode import EpisodeConfig

SCENE = {
    "bounds": [0.0, 0.0, 10.0, 8.0], "start": [1.0, 1.0], "goal": [9.0, 7.0], "boxes": [[5.0, 4.0, 0.3, 2.0, 1.0]],
    "cylinders": [[3.0, 6.0, 0.4]],
}  # fmt: skip


def write_measurement(path: Path, kind: str, rows: Iterable[dict[str, Any]]) -> Path:
    """A file of measurements with these rows."""
    run = {"began": "2026-01-01T10:00:00+00:00", "command": f"python -m made.up --out {path}", "commit": "abc"}
    head = {"measurement": kind, "made_by": {"code": "c0de"}, "runs": [run]}
    path.write_text("".join(f"{json.dumps(line)}\n" for line in (head, *rows)))
    return path


def moment_row(seed: int, seconds: float | None, own: bool, **changes: Any) -> dict[str, Any]:
    """The last avoidable moment of a collision."""
    config = EpisodeConfig("square", robot="go2", method="ours", seed=seed).row()
    contact = {"class": "front", "own": own}
    found = {"contact": contact, "t_inevitable": seconds, "t_inevitable_is_certain": True, "is_repeated": True}
    return {**config, **found, **changes}


def heatmap_row(seed: int, plain: float | None, at_same: float | None, **changes: Any) -> dict[str, Any]:
    """Correlations of a mission: two moments, alike."""
    config = EpisodeConfig("factory", 4, method="ours", seed=seed).row()
    moment = {"time": 10.0, "places": 300, "correlation": plain, "at_same_distance": at_same}
    return {**config, "moments": [moment, moment], "view": None, **changes}


def view() -> dict[str, Any]:
    """V^h of 4 x 4 places."""
    levels = base64.b64encode(bytes(range(0, 160, 10))).decode()
    return {
        "time": 20.0, "pose": [2.0, 2.0, 0.5], "half_side": 2.0, "scale": [0.5, 1.0], "levels": levels,
        "movers": [[2.5, 2.5, 0.3]], "scene": SCENE,
    }  # fmt: skip


def course_row(method: str, outcome: str = "success", shares: list[list[float]] | None = None) -> dict[str, Any]:
    """The course of a mission."""
    config = EpisodeConfig("factory", 4, method=method, seed=2000).row()
    path = [[1.0, 1.0], [4.0, 1.5], [9.0, 7.0]]
    own = {"outcome": outcome, "path": path, "expert_shares": shares, "period": 0.5, "scene": SCENE}
    return {**config, **own, "is_repeated": True}


def gate_row(seed: int, policy: str, situations: dict[str, list[int]]) -> dict[str, Any]:
    """The decisions of an episode that each expert leads, by situation."""
    told = {
        name: {"decisions": sum(leads), "leads": leads, "shares": [float(lead) for lead in leads]}
        for name, leads in situations.items()
    }
    return {"policy": policy, "kind": "static", "seed": seed, "situations": told}


def write_each(folder: Path) -> list[Path]:
    """A file of each kind of measurement."""
    shares = [[], [0.7, 0.3], [0.2, 0.8]]
    rows = {
        "moments": [moment_row(1, 0.5, True)],
        "heatmap": [heatmap_row(1, 0.1, 0.1, view=view())],
        "gate": [gate_row(1, "paper", {"open floor": [3, 1]})],
        "courses": [course_row("ours", shares=shares), course_row("drl", "collision")],
    }
    return [write_measurement(folder / f"{kind}.jsonl", kind, found) for kind, found in rows.items()]

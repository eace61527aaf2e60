"""``vuca check``: whether a bundle is whole, computes here what it computed where it was made, and how fast."""

from __future__ import annotations

import json
import os
import platform
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import tyro

from vuca_nav.cli import parse, show
from vuca_nav.provenance import machine, usable_cores, version_of

if TYPE_CHECKING:
    from vuca_nav.deploy.bundle import Bundle
    from vuca_nav.deploy.examination import Report

LIBRARIES = ("vuca-nav", "numpy", "numba", "llvmlite", "scipy", "safetensors", "onnxruntime")


@dataclass(frozen=True)
class CheckArguments:
    """Check a bundle: that it is whole, that its networks agree, how fast it is here, all versions."""

    bundle: tyro.conf.Positional[Path]
    """Folder of vuca export."""
    json: bool = False
    """End with one JSON object on stdout."""


def check(argv: list[str]) -> int:
    """Check a bundle: that it is whole, that its networks agree, how fast it is here, all versions."""
    arguments = parse(CheckArguments, "check", argv)
    from vuca_nav.deploy.bundle import load_bundle
    from vuca_nav.deploy.examination import examine
    from vuca_nav.deploy.manifest import STEPS
    from vuca_nav.deploy.steps import read_steps
    from vuca_nav.progress import CountedProgress

    bundle = load_bundle(arguments.bundle)
    steps = read_steps(arguments.bundle / STEPS)
    with CountedProgress(sys.stderr, "recorded ticks replayed", len(steps.commands)) as progress:
        report = examine(bundle, steps, progress)
    show(_told(bundle, report))
    if arguments.json:
        show(json.dumps(_row(bundle, report), allow_nan=False))
    return 0 if report.is_sound else 1


def _told(bundle: Bundle, report: Report) -> str:
    """The report for a terminal."""
    from vuca_nav.deploy.examination import TOLERANCE

    manifest = bundle.manifest
    lines = [
        f"bundle of {manifest.robot}, {manifest.method}: {len(manifest.files) + 1} files, whole and unchanged",
        f"  digest {manifest.digest}",
        "",
        f"{'parity':56} {'steps':>6} {'greatest difference':>20}  at most {TOLERANCE:g}",
    ]
    for parity in report.parities:
        verdict = "yes" if parity.holds else "NO"
        lines.append(f"  {parity.name:54} {parity.steps:6,} {parity.greatest:20.2e}  {verdict}")
    for name, same in report.contracts.items():
        lines.append(f"  {f'the contract in {name} is the one in the manifest':82}  {'yes' if same else 'NO'}")
    if not report.parities:
        lines.append("  no network drives: nothing to compare")
    stack = report.stack
    lines += [
        "",
        f"the whole stack over the recorded ticks: {stack.equal:,} of {stack.ticks:,} commands equal to the bit",
    ]
    if stack.first is not None:
        why = (
            "NO, on a machine of the same kind" if report.is_same_machine else "another processor, C library or version"
        )
        lines.append(f"  from tick {stack.first} on they differ, by up to {stack.greatest:.2g}: {why}")
    lines += ["", f"{'latency here [ms]':56} {'steps':>6} {'median':>9} {'99%':>9} {'99.9%':>9}"]
    for latency in report.latencies:
        name, steps, *times = latency
        lines.append(f"  {name:54} {steps:6,} " + " ".join(f"{value:9.3f}" for value in times))
    lines.append(f"  {'the period of ticks':54} {'':6} {1000.0 / bundle.config.navigator.rate:9.3f}")
    load, cores = os.getloadavg()[0], usable_cores()
    if load > cores:
        lines.append(
            f"  a load of {load:.1f} on {cores} cores: the longest times are those of other work on this machine"
        )
    lines += ["", f"{'version':16} {'here':>14} {'at export':>14}"]
    lines += [f"  {name:14} {here or '-':>14} {there or '-':>14}" for name, here, there in _versions(bundle)]
    lines += ["", "sound" if report.is_sound else "NOT SOUND: see NO above; export the bundle again"]
    return "\n".join(lines)


def _versions(bundle: Bundle) -> list[tuple[str, str | None, str | None]]:
    """Name of each library, its version here, and where the bundle was made."""
    made_by = bundle.manifest.content.get("made_by")
    made_by = made_by if isinstance(made_by, dict) else {}
    there = made_by.get("versions")
    there = there if isinstance(there, dict) else {}
    rows = [(name, version_of(name), _text(there.get(name))) for name in LIBRARIES]
    at_export = made_by.get("machine")
    python = _text(at_export.get("python")) if isinstance(at_export, dict) else None
    return [*rows, ("python", platform.python_version(), python)]


def _text(value: Any) -> str | None:
    """A version of the manifest as a table may show it."""
    return value[:14] if isinstance(value, str) and value.isprintable() else None


def _row(bundle: Bundle, report: Report) -> dict[str, Any]:
    """The report as JSON holds it."""
    from vuca_nav.deploy.examination import TOLERANCE

    manifest = bundle.manifest
    finite = [parity._replace(greatest=min(parity.greatest, sys.float_info.max)) for parity in report.parities]
    return {
        "robot": manifest.robot,
        "method": manifest.method,
        "digest": manifest.digest,
        "sound": report.is_sound,
        "tolerance": TOLERANCE,
        "parity": [{**parity._asdict(), "holds": parity.holds} for parity in finite],
        "contracts": report.contracts,
        "same_machine": report.is_same_machine,
        "stack": report.stack._replace(greatest=min(report.stack.greatest, sys.float_info.max))._asdict(),
        "latency": [latency._asdict() for latency in report.latencies],
        "versions": {name: {"here": here, "at_export": there} for name, here, there in _versions(bundle)},
        "machine": machine(),
        "load": os.getloadavg()[0],
    }

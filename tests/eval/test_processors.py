"""Rows of short missions on processors that are imitated, against those on this one."""

import json
import os
import platform
import subprocess
import sys
from pathlib import Path

import pytest

from eval.metrics import TIMING_FIELDS

ROOT = Path(__file__).parents[2]
MISSIONS = [
    ("--world", world, "--robot", robot, "--method", method, "--seed", "4")
    for robot in ("tiago", "go2")
    for world, method in (("dynamic", "ours"), ("static", "ours-dh"))
]
PROCESSORS = {
    "blas": {"OPENBLAS_CORETYPE": "Prescott"},
    "numba": {"NUMBA_CPU_NAME": "generic"},
    "numpy": {"NPY_DISABLE_CPU_FEATURES": "AVX512_ICL X86_V4 X86_V3"},
}
"""The environment variables by which each library takes the processor for an older one."""


def row_of(mission: tuple[str, ...], variables: dict[str, str]) -> dict[str, object]:
    command = [sys.executable, "-m", "vuca_nav.cli", "run", *mission, "--json"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT), **variables}
    result = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    row = json.loads(result.stdout.splitlines()[-1])
    return {key: value for key, value in row.items() if key not in (*TIMING_FIELDS, "made_by")}


@pytest.mark.slow
@pytest.mark.skipif(platform.machine() != "x86_64", reason="the imitated processors are x86-64")
@pytest.mark.parametrize("mission", MISSIONS, ids=" ".join)
def test_rows_are_the_same_bits_on_any_processor(mission):
    here = row_of(mission, {})
    for name, variables in PROCESSORS.items():
        assert row_of(mission, variables) == here, name

"""The machine's arithmetic, on processors that are imitated: by variables that libraries read as they are loaded."""

import os
import platform
import subprocess
import sys
from pathlib import Path

import pytest

from robots.arithmetic import fingerprint

ROOT = Path(__file__).parents[2]
OLDER_C_LIBRARY = {"GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-AVX2_Usable,-FMA_Usable"}


def fingerprint_with(variables: dict[str, str]) -> str:
    code = "from robots.arithmetic import fingerprint; print(fingerprint())"
    environment = {**os.environ, "PYTHONPATH": str(ROOT), **variables}
    result = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    return result.stdout.strip()


def test_neither_blas_nor_numpy_nor_numbas_target_change_the_arithmetic():
    features = "AVX512_ICL X86_V4 X86_V3" if platform.machine() == "x86_64" else ""
    others = {"OPENBLAS_CORETYPE": "Prescott", "NUMBA_CPU_NAME": "generic", "NPY_DISABLE_CPU_FEATURES": features}
    assert fingerprint_with(others) == fingerprint()


@pytest.mark.skipif(
    platform.libc_ver()[0] != "glibc" or " fma " not in Path("/proc/cpuinfo").read_text(),
    reason="needs glibc on a processor with fused products",
)
def test_a_c_library_for_another_processor_is_told_apart():
    assert fingerprint_with(OLDER_C_LIBRARY) != fingerprint()

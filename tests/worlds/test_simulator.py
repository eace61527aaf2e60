import os
import subprocess
import sys

import pytest

CODE = "import robots, mujoco; from worlds.mjcf import RootElement; print(RootElement(), mujoco.mj_versionString())"


@pytest.mark.parametrize(
    "environment",
    [{"MUJOCO_GL": "bogus"}, {"MUJOCO_GL": "egl", "PYOPENGL_PLATFORM": "osmesa"}],
    ids=lambda environment: "-".join(environment.values()),
)
def test_the_simulator_is_imported_whatever_renderer_the_environment_names(environment):
    result = subprocess.run(
        [sys.executable, "-c", f"{CODE}; import os; print(os.environ['MUJOCO_GL'])"],
        env={**os.environ, **environment}, capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    assert result.returncode == 0, result.stderr
    assert result.stdout.splitlines()[-1] == environment["MUJOCO_GL"]

"""A fingerprint of this machine's arithmetic: with the same one, an episode's row is the same to the bit.

The project's own sums run in a fixed order in kernels without fast-math, so that neither the processor's type nor BLAS
changes them. What is left to the machine is the C library's elementary functions: glibc chooses among several
implementations by the processor, which differ in the last bit, and MuJoCo calls them at every step.
"""

import functools
import hashlib
import math

import mujoco
import numpy as np

from vuca_nav.kernel_cache import njit
from vuca_nav.types import FloatArray

_ARGUMENTS = 20_000
"""Number of arguments: where two implementations of a function differ, they do for one in 2,000 or so."""
_GOLDEN = 0.618033988749895
"""Step of the sequence of arguments, which fills the interval evenly."""
_STEPS = 300
"""Steps of the small model: a second, in which it tumbles and comes to rest."""
_MODEL = """
<mujoco>
  <option timestep="0.0033333333333333335" cone="elliptic"/>
  <worldbody>
    <geom type="plane" size="5 5 1"/>
    <body pos="0 0 0.5" euler="20 35 10">
      <freejoint/>
      <geom type="box" size="0.2 0.1 0.05"/>
      <body pos="0.25 0 0">
        <joint name="arm" type="hinge" axis="0 1 0" damping="0.01"/>
        <geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.03"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position joint="arm" kp="2"/>
  </actuator>
</mujoco>
"""


@functools.cache
def fingerprint() -> str:
    """Hash of results of all that an episode's bits are made of; takes some hundredths of a second, once a process."""
    digest = hashlib.sha256()
    arguments = ((np.arange(1, _ARGUMENTS + 1) * _GOLDEN) % 1.0) * 8.0 - 4.0
    results = np.empty((_ARGUMENTS, 14))
    _evaluate(arguments, results)
    digest.update(results.tobytes())
    for values in (np.sin(arguments), np.cos(arguments), np.hypot(arguments, 1.0), np.cumsum(arguments)):
        digest.update(values.tobytes())
    digest.update(np.random.default_rng(0).standard_normal(_ARGUMENTS).tobytes())
    digest.update(_tumble().tobytes())
    return digest.hexdigest()[:16]


def _tumble() -> FloatArray:
    """State of the small model after a second."""
    model = mujoco.MjModel.from_xml_string(_MODEL)  # type: ignore[attr-defined]
    data = mujoco.MjData(model)  # type: ignore[attr-defined]
    for step in range(_STEPS):
        data.ctrl[0] = 0.01 * (step % 50)
        mujoco.mj_step(model, data)  # type: ignore[attr-defined]
    return np.concatenate([data.qpos, data.qvel])


@njit(cache=True)
def _evaluate(arguments, results):
    for i in range(len(arguments)):
        x = arguments[i]
        single, positive, share = np.float32(x), abs(x) + 0.001, 0.25 * x
        results[i, 0], results[i, 1], results[i, 2] = math.sin(x), math.cos(x), math.tan(x)
        results[i, 3], results[i, 4], results[i, 5] = math.asin(share), math.acos(share), math.atan2(x, share + 0.3)
        results[i, 6], results[i, 7], results[i, 8] = math.exp(x), math.log(positive), positive**share
        results[i, 9], results[i, 10] = math.hypot(x, share), math.log1p(positive)
        results[i, 11], results[i, 12] = math.tanh(single), math.expm1(single)
        results[i, 13] = x * share + positive  # rounded twice, unless it is fused

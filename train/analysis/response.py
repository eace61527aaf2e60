"""Response of a body's velocity to its command: gain, lag, delay and noise of each axis, identified in MuJoCo.

The training arena moves its robots by this model; evaluation runs the body itself. Run as
``python -m train.analysis.response --robot go2 --out DIR``; its result is kept as
robots/bodies/responses/go2.json, its plot as docs/images/response_go2.png.
"""

import json
import math
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import least_squares
from tqdm import tqdm

from robots.bodies.body import Body
from robots.noise import NoiseConfig
from robots.registry import make_body
from robots.simulation import Simulation
from vuca_nav.cli import run_module
from vuca_nav.errors import BadArgument, VucaError
from vuca_nav.files import prepare_directory, write_whole
from vuca_nav.geometry import between
from vuca_nav.kernel_cache import njit
from vuca_nav.types import FloatArray, Pose2, VelocityCommand
from worlds.world import World

RATE = 30.0
"""Rate of commands and measurements [Hz]."""
AXES = ("v_x", "v_y", "w_z")
MAX_DELAY, MIN_LAG, MAX_LAG = 0.3, 0.002, 1.0
"""Bounds of the fit [s]."""
NUM_RUNS = 3
"""Number of runs that are fitted together, each with noise and commands of its own."""
_HALL = 400.0
"""Side of the empty hall: nothing is ever near [m]."""


@dataclass(frozen=True, slots=True)
class AxisResponse:
    """Response of one axis, and the noise that remains.

    The body lets the command change by at most its own limit ``a``, then follows it late, as a first-order lag:
    ``s += clip(u - s, -a dt, a dt); v += (1 - exp(-dt / lag)) (gain s(t - delay) - v)``.
    """

    gain: float
    lag: float
    """[s]"""
    delay: float
    """[s]"""
    acceleration: float
    """The body's own limit of the command's change [m/s^2 or rad/s^2]."""
    noise: float
    """Standard deviation of the momentary velocity about the model [m/s or rad/s]."""
    explained: float
    """Share of the measured variance that the model explains."""


def excite(body: Body, axis: int, seed: int, seconds: float = 60.0) -> tuple[FloatArray, FloatArray]:
    """Command steps, then a chirp, on one axis, with the others at rest.

    Returns:
        Command (n,) and the velocity over the same tick (n,).
    """
    spec = body.spec
    low, high = ((spec.min_v_x, spec.max_v_x), (-spec.max_v_y, spec.max_v_y), (-spec.max_w_z, spec.max_w_z))[axis]
    rng = np.random.default_rng(seed)
    n = round(seconds * RATE / 2.0)
    steps = np.repeat(rng.uniform(low, high, math.ceil(n / RATE / 1.5)), round(1.5 * RATE))[:n]
    t = np.arange(n) / RATE
    # From 0.1 to 1.5 Hz, linear.
    chirp = 0.5 * (low + high) + 0.45 * (high - low) * np.sin(2.0 * math.pi * (0.1 * t + 0.5 * 1.4 / t[-1] * t * t))
    commands = np.concatenate((steps, chirp))
    middle = Pose2(_HALL / 2.0, _HALL / 2.0, 0.0)
    world = World("hall", 0, (0.0, 0.0, _HALL, _HALL), (), (), middle, (1.0, 1.0))
    simulation = Simulation(world, body, seed, noise=NoiseConfig())
    simulation.reset()
    measured = np.empty(len(commands))
    for k, command in enumerate(commands):
        before = simulation.true_pose
        simulation.step(VelocityCommand(*(float(command) if a == axis else 0.0 for a in range(3))))
        if simulation.fallen:
            raise VucaError(f"{spec.name} fell at {k / RATE:.1f} s of the {AXES[axis]} commands, seed {seed}")
        measured[k] = RATE * between(before, simulation.true_pose)[axis]
    return commands, measured


@njit(cache=True)
def respond(commands, gain, lag, delay, acceleration, dt):
    """Velocity of the model (n,) for commands (n,) at intervals of dt [s]; see AxisResponse."""
    slewed, out = np.empty(len(commands)), np.empty(len(commands))
    wanted, velocity, keep = 0.0, 0.0, math.exp(-dt / lag)
    late = int(delay / dt)
    share = delay / dt - late  # a delay between two ticks is a mixture of them
    for k in range(len(commands)):
        wanted += min(max(commands[k] - wanted, -acceleration * dt), acceleration * dt)
        slewed[k] = wanted
        newer = slewed[k - late] if k >= late else 0.0
        older = slewed[k - late - 1] if k >= late + 1 else 0.0
        velocity += (1.0 - keep) * (gain * (newer + share * (older - newer)) - velocity)
        out[k] = velocity
    return out


def fit(runs: Sequence[tuple[FloatArray, FloatArray]], acceleration: float) -> AxisResponse:
    """Fit gain, lag and delay by least squares from several beginnings, as lag and delay can stand in for each other.

    Args:
        runs: Commands (n,) and measured velocities (n,) of each run.
        acceleration: The body's own limit of the command's change [m/s^2 or rad/s^2].
    """
    dt = 1.0 / RATE

    def residuals(parameters: FloatArray) -> FloatArray:
        gain, lag, delay = parameters.tolist()
        return np.concatenate(
            [respond(commands, gain, lag, delay, acceleration, dt) - measured for commands, measured in runs]
        )

    best: Any = None
    for delay in np.linspace(0.1, 0.9, 5) * MAX_DELAY:
        for lag in (0.02, 0.08):
            found = least_squares(
                residuals, (1.0, lag, delay), bounds=((0.5, MIN_LAG, 0.0), (1.5, MAX_LAG, MAX_DELAY)),
                x_scale=(1.0, 0.1, 0.1), diff_step=1e-4,
            )  # fmt: skip
            if best is None or found.cost < best.cost:
                best = found
    gain, lag, delay = best.x.tolist()
    error = 2.0 * best.cost / len(best.fun)
    variance = float(np.var(np.concatenate([measured for _, measured in runs])))
    return AxisResponse(gain, lag, delay, acceleration, math.sqrt(error), 1.0 - error / max(variance, 1e-12))


def identify(body: Body, out: Path, seed: int) -> dict[str, AxisResponse]:
    """Excite and fit each axis of the body; write the model as JSON and a plot of fit against measurement.

    Raises:
        BadArgument: If ``out`` cannot be written.
    """
    prepare_directory(out)
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    spec = body.spec
    limits = ((spec.max_v_x, spec.max_a_x), (spec.max_v_y, spec.max_a_y), (spec.max_w_z, spec.max_a_w))
    axes = [a for a in range(3) if limits[a][0] > 0.0]
    figure, panels = plt.subplots(len(axes), 1, figsize=(11, 2.4 * len(axes)), layout="constrained", squeeze=False)
    responses = {}
    for panel, axis in zip(panels[:, 0], tqdm(axes, desc="axes", unit="axis", file=sys.stderr)):
        runs = [excite(body, axis, NUM_RUNS * seed + k) for k in range(NUM_RUNS)]
        response = fit(runs, limits[axis][1])
        responses[AXES[axis]] = response
        commands, measured = runs[0]
        fitted = respond(commands, response.gain, response.lag, response.delay, response.acceleration, 1.0 / RATE)
        t = np.arange(len(commands)) / RATE
        panel.plot(t, commands, lw=0.8, c="0.6", label="command")
        panel.plot(t, measured, lw=0.8, label="measured")
        panel.plot(t, fitted, lw=0.8, label="model")
        panel.set_title(
            f"{spec.name} {AXES[axis]}: gain {response.gain:.3f}, lag {response.lag:.3f} s, delay "
            f"{response.delay:.3f} s, noise {response.noise:.3f}, explained {response.explained:.3f}", fontsize=9,
        )  # fmt: skip
        panel.grid(alpha=0.3)
    panels[0, 0].legend(fontsize=8, loc="upper right")
    panels[-1, 0].set_xlabel("s")
    figure.savefig(out / f"response_{spec.name}.png", dpi=90)
    plt.close(figure)
    rows = {name: {k: round(v, 5) for k, v in asdict(response).items()} for name, response in responses.items()}
    write_whole(out / f"{spec.name}.json", json.dumps({"robot": spec.name, **rows}, indent=2) + "\n")
    return responses


@dataclass(frozen=True)
class ResponseArguments:
    """Identify how a body's velocity follows its command."""

    out: Path
    """Directory of the model and the plot."""
    robot: str = "go2"
    seed: int = 0


def main(arguments: ResponseArguments) -> None:
    """Identify the response and print it.

    Raises:
        BadArgument: If the seed is negative or the directory cannot be written.
        UnknownName: If there is no such robot.
    """
    if arguments.seed < 0:
        raise BadArgument(f"--seed must be 0 or more, got {arguments.seed}")
    for name, response in identify(make_body(arguments.robot), arguments.out, arguments.seed).items():
        print(name, asdict(response))


if __name__ == "__main__":
    run_module("response", main, ResponseArguments)

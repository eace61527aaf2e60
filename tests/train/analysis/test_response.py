import json
import math

import numpy as np
import pytest

from robots.bodies.tiago import Tiago
from train.analysis.response import RATE, excite, fit, identify, respond

DT = 1.0 / RATE


def commands(seed: int, seconds: float = 60.0):
    rng = np.random.default_rng(seed)
    return np.repeat(rng.uniform(-0.6, 1.2, round(seconds / 1.5)), round(1.5 * RATE))


def test_a_first_order_lag():
    """Without a limit that is felt, a step is answered by 1 - exp(-t / lag)."""
    answer = respond(np.ones(60), 0.9, 0.2, 0.0, 1e9, DT)
    t = DT * np.arange(1, 61)
    assert answer == pytest.approx(0.9 * (1.0 - np.exp(-t / 0.2)))


@pytest.mark.parametrize("ticks", [0, 1, 3])
def test_a_delay_of_whole_ticks_shifts(ticks):
    u = commands(0, 6.0)
    late = respond(u, 1.1, 0.1, ticks * DT, 2.0, DT)
    at_once = respond(u, 1.1, 0.1, 0.0, 2.0, DT)
    assert late[ticks:] == pytest.approx(at_once[: len(u) - ticks], abs=1e-9)
    assert not late[:ticks].any()


def test_a_delay_between_ticks_is_between():
    u = commands(0, 6.0)
    one, half, two = (respond(u, 1.0, 0.1, ticks * DT, 2.0, DT) for ticks in (1.0, 1.5, 2.0))
    assert half == pytest.approx(0.5 * (one + two), abs=1e-9)


def test_the_limit_is_the_commands():
    """A step to 1 m/s at 2 m/s^2 is a ramp of half a second, and then followed at once."""
    answer = respond(np.ones(30), 1.0, 1e-6, 0.0, 2.0, DT)
    assert answer == pytest.approx(np.minimum(2.0 * DT * np.arange(1, 31), 1.0))


@pytest.mark.parametrize(
    ("gain", "lag", "delay"), [(1.05, 0.08, 0.10), (0.97, 0.15, 0.05), (1.10, 0.30, 0.0), (1.0, 0.03, 0.14)]
)
def test_fit_recovers_what_made_the_data(gain, lag, delay):
    rng = np.random.default_rng(1)
    runs = []
    for seed in range(3):
        u = commands(seed)
        runs.append((u, respond(u, gain, lag, delay, 2.0, DT) + 0.03 * rng.standard_normal(len(u))))
    found = fit(runs, 2.0)
    assert found.gain == pytest.approx(gain, abs=0.01)
    assert found.lag == pytest.approx(lag, abs=0.012)
    assert found.delay == pytest.approx(delay, abs=0.01)
    assert found.noise == pytest.approx(0.03, rel=0.05)
    variance = np.var(np.concatenate([measured for _, measured in runs]))
    assert found.explained == pytest.approx(1.0 - found.noise**2 / variance)
    assert found.acceleration == 2.0


@pytest.fixture(scope="module")
def tiago():
    return Tiago()


def test_excitation_covers_the_range_and_is_the_same_for_a_seed(tiago):
    u, measured = excite(tiago, 0, 3, seconds=12.0)
    again = excite(tiago, 0, 3, seconds=12.0)
    assert (u == again[0]).all()
    assert (measured == again[1]).all()
    assert len(u) == len(measured) == 360
    spec = tiago.spec
    assert spec.min_v_x <= u.min() < 0.0
    assert 0.7 * spec.max_v_x < u.max() <= spec.max_v_x
    assert np.corrcoef(u[3:], measured[3:])[0, 1] > 0.7


@pytest.mark.slow
def test_identify_writes_what_it_found(tiago, tmp_path):
    responses = identify(tiago, tmp_path, 0)
    assert set(responses) == {"v_x", "w_z"}
    written = json.loads((tmp_path / "response_tiago.json").read_text())
    assert written["v_x"]["lag"] == pytest.approx(responses["v_x"].lag, abs=1e-5)
    assert math.isfinite(written["w_z"]["noise"])
    assert all(response.explained > 0.99 for response in responses.values())
    assert (tmp_path / "response_tiago.png").stat().st_size > 1000

import math

import numpy as np
import pytest

from vuca_nav.mapping.odometry_model import Motion, OdometryModel
from vuca_nav.types import Pose2

GOOD_MATCH = (1e-5, 1e-6)
METRE = Pose2(1.0, 0.0, 0.0)


def learn(model: OdometryModel, residuals: np.ndarray, noise: tuple[float, float] = GOOD_MATCH) -> None:
    """Teach metres of driving straight on; residuals (n, 2) along the way [m] and of the yaw [rad]."""
    for ahead, yaw in residuals:
        model.learn(Motion(1.0, 0.0, METRE), Pose2(ahead, 0.0, yaw), noise)


def test_rates_follow_what_odometry_errs():
    rng = np.random.default_rng(3)
    model = OdometryModel()
    learn(model, rng.normal(0.0, 1.0, (400, 2)) * (0.06, 0.05))
    position, _, yaw, _ = model.rates
    # Half of the variance along the way for each axis.
    assert math.sqrt(2.0 * position) == pytest.approx(0.06, rel=0.4)
    assert math.sqrt(yaw) == pytest.approx(0.05, rel=0.4)


def test_matches_that_know_less_than_odometry_teach_nothing():
    model, fresh = OdometryModel(), OdometryModel()
    learn(model, np.full((50, 2), 0.02), noise=(math.inf, math.inf))
    assert model.rates == fresh.rates
    assert model.corrected(METRE) == METRE


def test_a_scale_counts_once_it_is_beyond_chance():
    rng = np.random.default_rng(4)
    slipping, scaled = OdometryModel(), OdometryModel()
    noise = rng.normal(0.0, 1.0, (60, 2)) * (0.02, 0.01)
    learn(slipping, noise)
    assert slipping.corrected(METRE).x == 1.0
    for ahead, yaw in noise:
        factor = scaled.corrected(METRE).x
        learn(scaled, np.array([[factor * 1.04 - 1.0 + ahead, yaw]]))
    assert scaled.corrected(METRE).x == pytest.approx(1.0 / 1.04, abs=0.01)

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.vuca_nav.rooms import disc_body
from vuca_nav.errors import BadArgument
from vuca_nav.footprint import EXCESS, cover_by_discs, half_way, outline_ranges, size_of

RECTANGLE = np.array([[-0.3, -0.2], [0.5, -0.2], [0.5, 0.2], [-0.3, 0.2]])


@given(st.floats(0.2, 1.0), st.floats(0.2, 1.0))
def test_discs_cover_the_footprint(length, width):
    outline = np.array([[-length, -width], [length, -width], [length, width], [-length, width]]) / 2.0
    discs = cover_by_discs(outline)
    rng = np.random.default_rng(0)
    inside = rng.uniform(-0.5, 0.5, (500, 2)) * (length, width)
    away = np.hypot(inside[:, None, 0] - discs[:, 0], inside[:, None, 1] - discs[:, 1])
    if length >= 0.7 * width:
        assert (away <= discs[:, 2] + 1e-9).any(axis=1).all()
    assert size_of(discs) >= np.hypot(length, width) / 2.0 - 1e-9
    assert discs[:, 2].max() <= 0.5 * width + EXCESS + 1e-9  # so little reaches out beside it


def test_a_way_is_the_footprint_and_ten_centimetres():
    assert half_way(RECTANGLE) == pytest.approx(0.25)
    assert half_way(disc_body(0.3).footprint) == pytest.approx(0.35)


def test_a_round_body_is_one_disc():
    np.testing.assert_allclose(cover_by_discs(disc_body(0.3).footprint), [[0.0, 0.0, 0.3]])


def test_the_circle_about_discs_reaches_to_the_farthest_edge():
    assert size_of(np.array([[0.0, 0.0, 0.4], [0.3, -0.4, 0.2], [-0.1, 0.0, 0.3]])) == pytest.approx(0.7)


def test_the_outline_along_each_beam():
    # Beams of 8: -180, -135, -90, -45, 0, 45, 90, 135 degrees; the rectangle's edges along them by hand.
    by_hand = [0.3, 0.2 * math.sqrt(2.0), 0.2, 0.2 * math.sqrt(2.0), 0.5, 0.2 * math.sqrt(2.0), 0.2]
    assert outline_ranges(RECTANGLE, 8)[:7] == pytest.approx(by_hand)


def test_an_outline_that_does_not_enclose_the_origin_is_refused():
    with pytest.raises(BadArgument, match="enclose"):
        outline_ranges(RECTANGLE + np.array([1.0, 0.0]), 8)

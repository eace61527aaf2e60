"""The bodies of the arena: TIAGo and Go2 as identified in MuJoCo, and drawn ones around and beyond them."""

import json
import math
from dataclasses import dataclass
from decimal import Decimal
from importlib.resources import files

import numpy as np
from numpy.random import Generator

from robots.bodies.go2 import GO2
from robots.bodies.tiago import (
    FOOTPRINT,
    HEIGHT,
    MAX_A_W,
    MAX_A_X,
    MAX_V_X,
    MAX_W_Z,
    MIN_V_X,
    WHEEL_MAX_SPEED,
    WHEEL_RADIUS,
    WHEEL_SEPARATION,
)
from robots.bodies.tiago import LIDAR as TIAGO_LIDAR
from train.arena.config import ArenaConfig
from vuca_nav.types import BodySpec, FloatArray

LARGEST_RADIUS = 0.45
"""Radius of a drawn body's circumscribed circle, at most [m]; Go2's is 0.41 m."""
WHEEL_SPEED = WHEEL_RADIUS * WHEEL_MAX_SPEED
"""Greatest speed of TIAGo's wheels at the rim [m/s]."""
GAIN, LAG, DELAY, NOISE = range(4)
"""Columns of a body's response."""
RADIUS, LIDAR_HEIGHT, HEIGHT_OVER_ALL, WHEEL_ARM = range(4)
"""Columns of a body's shape."""
LOWEST, HIGHEST, ACCELERATION = range(3)
"""Columns of a body's limits."""


@dataclass(frozen=True, slots=True)
class ArenaBody:
    """A body, and how its velocity follows its command."""

    spec: BodySpec
    response: FloatArray
    """Gain, lag [s], delay [s] and noise [m/s or rad/s] of v_x, v_y and w_z, (3, 4), as ``train.analysis.response``
    identifies them."""
    lidar_height: float
    """[m]"""
    height: float
    """Height over all [m]."""
    wheel_arm: float = 0.0
    """Half the distance of the drive wheels; 0 for a body whose axes do not limit each other [m]."""


def identified_response(robot: str) -> FloatArray:
    """Response of a robot's velocity to its command, as ``train.analysis.response`` found it in MuJoCo.

    Rounded to thousandths: no identification is more exact. An axis that the robot does not have follows as fast as
    v_x does.

    Args:
        robot: Name of the robot.

    Returns:
        (3, 4): of v_x, v_y and w_z the gain, lag [s], delay [s] and noise [m/s or rad/s].
    """
    text = (files("robots.bodies") / "responses" / f"{robot}.json").read_text()
    axes = json.loads(text, parse_float=lambda number: float(round(Decimal(number), 3)))
    absent = {"gain": 1.0, "lag": axes["v_x"]["lag"], "delay": 0.0, "noise": 0.0}
    columns = ("gain", "lag", "delay", "noise")
    return np.array([[axes.get(axis, absent)[column] for column in columns] for axis in ("v_x", "v_y", "w_z")])


def tiago() -> ArenaBody:
    """Make TIAGo as it was identified."""
    spec = BodySpec("tiago", FOOTPRINT, MAX_V_X, MIN_V_X, 0.0, MAX_W_Z, MAX_A_X, 0.0, MAX_A_W)
    return ArenaBody(spec, identified_response("tiago"), TIAGO_LIDAR.height, HEIGHT, WHEEL_SEPARATION / 2.0)


def go2() -> ArenaBody:
    """Make Go2 as it was identified."""
    return ArenaBody(GO2.spec, identified_response("go2"), GO2.lidar.height, GO2.height)


def random_body(rng: Generator) -> ArenaBody:
    """Draw a disc, a box or an oval, quick or slow, with or without sideways motion."""
    long = rng.uniform(0.2, LARGEST_RADIUS)
    wide = long * rng.uniform(0.5, 1.0)
    if rng.random() < 0.5:
        angles = 2.0 * math.pi * (np.arange(16) + 0.5) / 16
        footprint = np.column_stack([long * np.cos(angles), wide * np.sin(angles)])
    else:
        turn = math.atan2(wide, long)
        x, y = long * math.cos(turn), long * math.sin(turn)
        footprint = np.array([(x, -y), (x, y), (-x, y), (-x, -y)])
    footprint[:, 0] += rng.uniform(-0.2, 0.2) * (LARGEST_RADIUS - long)
    sideways = rng.random() < 0.5
    spec = BodySpec(
        name="random",
        footprint=footprint,
        max_v_x=rng.uniform(0.5, 1.6),
        min_v_x=-rng.uniform(0.1, 0.8),
        max_v_y=rng.uniform(0.2, 0.6) if sideways else 0.0,
        max_w_z=rng.uniform(0.7, 2.0),
        max_a_x=rng.uniform(0.7, 3.0),
        max_a_y=rng.uniform(0.7, 3.0) if sideways else 0.0,
        max_a_w=rng.uniform(1.5, 6.0),
    )
    response = np.column_stack(
        [rng.uniform(0.95, 1.1, 3), rng.uniform(0.01, 0.12, 3), rng.uniform(0.0, 0.12, 3), rng.uniform(0.0, 0.06, 3)]
    )
    return ArenaBody(spec, response, rng.uniform(0.08, 0.4), rng.uniform(0.4, 1.4))


@dataclass(frozen=True, slots=True)
class BodyColumns:
    """Arrays of all bodies, b rows."""

    bodies: tuple[ArenaBody, ...]
    first: np.ndarray
    """Index of the first body of each kind, and the number of all bodies, (kinds + 1,)."""
    footprints: FloatArray
    """Outlines of the footprints, padded, (b, c, 2) [m]."""
    corners: np.ndarray
    """Number of corners of each outline, (b,)."""
    shape: FloatArray
    """Radius, lidar's height, height [m], and half the distance of the drive wheels or 0, (b, 4)."""
    limits: FloatArray
    """Lowest velocity, highest velocity and acceleration of each axis, (b, 3, 3)."""
    response: FloatArray
    """Gain, lag, delay and noise of each axis, (b, 3, 4)."""


def body_columns(config: ArenaConfig) -> BodyColumns:
    """Make TIAGo, Go2 and the drawn bodies, always the same for the same number."""
    rng = np.random.default_rng(np.random.SeedSequence((config.world_seed, 7)))
    bodies = (tiago(), go2(), *(random_body(rng) for _ in range(config.num_bodies)))
    corners = np.array([len(body.spec.footprint) for body in bodies])
    footprints = np.zeros((len(bodies), int(corners.max()), 2))
    limits = np.zeros((len(bodies), 3, 3))
    for b, body in enumerate(bodies):
        spec = body.spec
        footprints[b, : corners[b]] = spec.footprint
        limits[b] = (
            (spec.min_v_x, spec.max_v_x, spec.max_a_x),
            (-spec.max_v_y, spec.max_v_y, spec.max_a_y),
            (-spec.max_w_z, spec.max_w_z, spec.max_a_w),
        )
    shape = np.array([(b.spec.radius, b.lidar_height, b.height, b.wheel_arm) for b in bodies])
    response = np.stack([body.response for body in bodies])
    first = np.array([0, 1, 2, len(bodies)])
    return BodyColumns(bodies, first, footprints, corners, shape, limits, response)

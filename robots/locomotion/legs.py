"""Kinematics of a three-joint leg: abduction about x, then two hinges about y. Compiled, without allocation.

With ``x`` forward and ``h`` down in the leg's plane and ``d`` the plane's signed offset from the abduction axis,

    x = -l1 sin(q1) - l2 sin(q1 + q2),   h = l1 cos(q1) + l2 cos(q1 + q2),
    foot = hip + (x, d cos(q0) + h sin(q0), d sin(q0) - h cos(q0)).
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from robots.locomotion.config import QuadrupedConfig
from robots.urdf import BadUrdf, Urdf
from vuca_nav.types import FloatArray


class Legs(NamedTuple):
    """Where the legs are and how long."""

    hips: FloatArray
    """Abduction axes in base_link, (4, 3) [m]."""
    offsets: FloatArray
    """Signed sideways offset of a leg's plane from its abduction axis, (4,) [m]."""
    thigh: float
    """[m]"""
    shank: float
    """To the foot's centre [m]."""
    foot_radius: float
    """[m]"""


def legs_of(config: QuadrupedConfig, urdf: Urdf) -> Legs:
    """The legs' dimensions as the URDF has them.

    Raises:
        BadUrdf: If a joint is missing, or does not turn about the axis that a leg of this kind has.
    """
    hips, offsets = np.empty((4, 3)), np.empty(4)
    lengths = []
    for i, leg in enumerate(config.leg_names):
        hip, thigh, calf = (joint_of(urdf, leg, name) for name in config.joint_names)
        for joint, axis in ((hip, (1, 0, 0)), (thigh, (0, 1, 0)), (calf, (0, 1, 0))):
            if not np.allclose(joint.axis, axis):
                raise BadUrdf(f"robot {urdf.name!r}: joint {joint.name!r} turns about {joint.axis}, expected {axis}")
        foot = urdf.transform(calf.child, f"{leg}_{config.link_names[3]}", {})[:3, 3]
        hips[i] = urdf.transform(config.base, hip.child, {})[:3, 3]
        offsets[i] = thigh.parent_from_joint[1, 3]
        lengths.append((-calf.parent_from_joint[2, 3], -foot[2]))
    if not np.allclose(lengths, lengths[0]):
        raise BadUrdf(f"robot {urdf.name!r}: legs of different lengths {lengths}")
    return Legs(hips, offsets, float(lengths[0][0]), float(lengths[0][1]), config.foot_radius)


def joint_of(urdf: Urdf, leg: str, name: str):
    """A leg's joint, e.g. ``FL_thigh_joint``.

    Raises:
        BadUrdf: If the URDF lacks it; lists those it has.
    """
    joint = urdf.joints.get(f"{leg}_{name}")
    if joint is None:
        movable = sorted(j.name for j in urdf.joints.values() if j.kind != "fixed")
        raise BadUrdf(f"robot {urdf.name!r} has no joint '{leg}_{name}' (movable joints: {', '.join(movable)})")
    return joint


@njit(cache=True)
def foot_position(legs, leg, q, out):
    """Centre of a foot in base_link. q: the leg's three angles. out: (3,)."""
    x = -legs.thigh * math.sin(q[1]) - legs.shank * math.sin(q[1] + q[2])
    h = legs.thigh * math.cos(q[1]) + legs.shank * math.cos(q[1] + q[2])
    d, c, s = legs.offsets[leg], math.cos(q[0]), math.sin(q[0])
    out[0] = legs.hips[leg, 0] + x
    out[1] = legs.hips[leg, 1] + d * c + h * s
    out[2] = legs.hips[leg, 2] + d * s - h * c


@njit(cache=True)
def foot_jacobian(legs, leg, q, out):
    """Of ``foot_position`` by the leg's angles. out: (3, 3)."""
    x = -legs.thigh * math.sin(q[1]) - legs.shank * math.sin(q[1] + q[2])
    h = legs.thigh * math.cos(q[1]) + legs.shank * math.cos(q[1] + q[2])
    dx, dh = -legs.shank * math.cos(q[1] + q[2]), -legs.shank * math.sin(q[1] + q[2])
    d, c, s = legs.offsets[leg], math.cos(q[0]), math.sin(q[0])
    out[0, 0], out[0, 1], out[0, 2] = 0.0, -h, dx
    out[1, 0], out[1, 1], out[1, 2] = -d * s + h * c, x * s, dh * s
    out[2, 0], out[2, 1], out[2, 2] = d * c + h * s, -x * c, -dh * c


@njit(cache=True)
def leg_angles(legs, leg, x, y, z, out):
    """Inverse kinematics, knee backwards; a point out of reach is approached. x, y, z in base_link. out: (3,)."""
    x, y, z = x - legs.hips[leg, 0], y - legs.hips[leg, 1], z - legs.hips[leg, 2]
    d = legs.offsets[leg]
    h = math.sqrt(max(y * y + z * z - d * d, 1e-6))
    out[0] = math.atan2(d * z + h * y, d * y - h * z)
    cos_knee = (x * x + h * h - legs.thigh**2 - legs.shank**2) / (2.0 * legs.thigh * legs.shank)
    knee = -math.acos(min(max(cos_knee, -1.0), 1.0))
    out[1] = math.atan2(-x, h) - math.atan2(legs.shank * math.sin(knee), legs.thigh + legs.shank * math.cos(knee))
    out[2] = knee

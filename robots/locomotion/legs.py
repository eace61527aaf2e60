"""Kinematics of a three-joint leg: abduction about x, then two hinges about y. Compiled, without allocation.

With ``x`` forward and ``h`` down in the leg's plane and ``d`` the plane's signed offset from the abduction axis,

    x = -l1 sin(q1) - l2 sin(q1 + q2),   h = l1 cos(q1) + l2 cos(q1 + q2),
    foot = hip + (x, d cos(q0) + h sin(q0), d sin(q0) - h cos(q0)).
"""

import math
from typing import NamedTuple

import numpy as np

from robots.bodies.urdf import BadUrdf, Joint, Urdf
from robots.locomotion.config import QuadrupedConfig
from vuca_nav.kernel_cache import njit
from vuca_nav.types import FloatArray


class Legs(NamedTuple):
    """Positions and dimensions of the legs."""

    hips: FloatArray
    """Abduction axes in base_link, (4, 3) [m]."""
    offsets: FloatArray
    """Signed sideways offset of a leg's plane from its abduction axis, (4,) [m]."""
    thigh: float
    """Length from the hip to the knee [m]."""
    shank: float
    """Length from the knee to the foot's centre [m]."""
    foot_radius: float
    """[m]"""


def legs_of(config: QuadrupedConfig, urdf: Urdf) -> Legs:
    """Read the legs' dimensions from the URDF.

    Raises:
        BadUrdf: If a joint is missing, does not turn, turns about another axis than a leg of this kind has or without
            limits, or if a link does not hang on the base.
    """
    hips, offsets = np.empty((4, 3)), np.empty(4)
    lengths = []
    joints = [[joint_of(urdf, leg, name) for name in config.joint_names] for leg in config.leg_names]
    _check_tree(config.base, urdf)
    for i, (leg, (hip, thigh, calf)) in enumerate(zip(config.leg_names, joints)):
        for joint, axis in ((hip, (1, 0, 0)), (thigh, (0, 1, 0)), (calf, (0, 1, 0))):
            _check_joint(urdf, joint, axis)
        foot = urdf.transform(calf.child, f"{leg}_{config.link_names[3]}", {})[:3, 3]
        hips[i] = urdf.transform(config.base, hip.child, {})[:3, 3]
        offsets[i] = thigh.parent_from_joint[1, 3]
        lengths.append((-calf.parent_from_joint[2, 3], -foot[2]))
    if not np.allclose(lengths, lengths[0]):
        raise BadUrdf(f"robot {urdf.name!r}: legs of different lengths {lengths}")
    return Legs(hips, offsets, float(lengths[0][0]), float(lengths[0][1]), config.foot_radius)


def _check_joint(urdf: Urdf, joint: Joint, axis: tuple[int, int, int]) -> None:
    where = f"robot {urdf.name!r}: joint {joint.name!r}"
    if joint.kind != "revolute":
        raise BadUrdf(f"{where} is {joint.kind}, expected revolute")
    if not np.allclose(joint.axis, axis):
        raise BadUrdf(f"{where} turns about {joint.axis}, expected {axis}")
    if not (math.isfinite(joint.lower) and math.isfinite(joint.upper) and joint.lower < joint.upper):
        raise BadUrdf(f"{where} has the limits {joint.lower} to {joint.upper}, expected finite ones, lower < upper")


def _check_tree(base: str, urdf: Urdf) -> None:
    """Check that each link hangs on the base, or its mass would be lost."""
    parent_of = {joint.child: joint.parent for joint in urdf.joints.values()}
    for link in urdf.links:
        above = link
        for _ in urdf.links:  # a ring of joints ends, too
            above = parent_of.get(above, above) if above != base else base
        if above != base:
            raise BadUrdf(f"robot {urdf.name!r}: link {link!r} does not hang on {base!r} by any joints")


def joint_of(urdf: Urdf, leg: str, name: str) -> Joint:
    """Find a leg's joint, e.g. ``FL_thigh_joint``.

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
    """Compute the centre of a foot in base_link. q: the leg's three angles. out: (3,)."""
    x = -legs.thigh * math.sin(q[1]) - legs.shank * math.sin(q[1] + q[2])
    h = legs.thigh * math.cos(q[1]) + legs.shank * math.cos(q[1] + q[2])
    d, c, s = legs.offsets[leg], math.cos(q[0]), math.sin(q[0])
    out[0] = legs.hips[leg, 0] + x
    out[1] = legs.hips[leg, 1] + d * c + h * s
    out[2] = legs.hips[leg, 2] + d * s - h * c


@njit(cache=True)
def foot_jacobian(legs, leg, q, out):
    """Compute the Jacobian of ``foot_position`` by the leg's angles. out: (3, 3)."""
    x = -legs.thigh * math.sin(q[1]) - legs.shank * math.sin(q[1] + q[2])
    h = legs.thigh * math.cos(q[1]) + legs.shank * math.cos(q[1] + q[2])
    dx, dh = -legs.shank * math.cos(q[1] + q[2]), -legs.shank * math.sin(q[1] + q[2])
    d, c, s = legs.offsets[leg], math.cos(q[0]), math.sin(q[0])
    out[0, 0], out[0, 1], out[0, 2] = 0.0, -h, dx
    out[1, 0], out[1, 1], out[1, 2] = -d * s + h * c, x * s, dh * s
    out[2, 0], out[2, 1], out[2, 2] = d * c + h * s, -x * c, -dh * c


@njit(cache=True)
def leg_angles(legs, leg, x, y, z, out):
    """Solve the inverse kinematics, knee backwards, for a point x, y, z in base_link. out: (3,).

    A point out of reach is approached.
    """
    x, y, z = x - legs.hips[leg, 0], y - legs.hips[leg, 1], z - legs.hips[leg, 2]
    d = legs.offsets[leg]
    h = math.sqrt(max(y * y + z * z - d * d, 1e-6))
    out[0] = math.atan2(d * z + h * y, d * y - h * z)
    cos_knee = (x * x + h * h - legs.thigh**2 - legs.shank**2) / (2.0 * legs.thigh * legs.shank)
    knee = -math.acos(min(max(cos_knee, -1.0), 1.0))
    out[1] = math.atan2(-x, h) - math.atan2(legs.shank * math.sin(knee), legs.thigh + legs.shank * math.cos(knee))
    out[2] = knee

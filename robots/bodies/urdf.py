"""A small URDF reader: links, joints, inertias and visuals, forward kinematics, and the fusion of links.

It reads only what a body needs to be built from a description. Format: http://wiki.ros.org/urdf/XML.
"""

import math
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from vuca_nav.data_files import read_xml
from vuca_nav.errors import VucaError
from vuca_nav.types import FloatArray


class BadUrdf(VucaError):
    """A robot description that cannot be read."""


@dataclass(frozen=True, slots=True)
class Inertia:
    """Mass, centre of mass and rotational inertia, in one common frame."""

    mass: float
    """[kg]"""
    centre: FloatArray
    """Centre of mass, (3,) [m]."""
    tensor: FloatArray
    """Inertia about the centre of mass, along the frame's axes, (3, 3) [kg m^2]."""

    def transformed(self, a_from_b: FloatArray) -> "Inertia":
        """Give the same inertia in frame a instead of b; ``a_from_b`` is (4, 4)."""
        rotation = a_from_b[:3, :3]
        centre = (rotation * self.centre).sum(axis=1) + a_from_b[:3, 3]
        return Inertia(self.mass, centre, _product(rotation, self.tensor, rotation.T))

    def mjcf(self) -> dict[str, Any]:
        """Attributes of the ``inertial`` element of a body with this frame."""
        t = self.tensor
        full = (t[0, 0], t[1, 1], t[2, 2], t[0, 1], t[0, 2], t[1, 2])
        return {"mass": self.mass, "pos": self.centre, "fullinertia": full}


def combine(inertias: Iterable[Inertia]) -> Inertia:
    """Combine several inertias in the same frame into one rigid body (parallel axis theorem)."""
    pieces = [piece for piece in inertias if piece.mass > 0.0]
    mass = sum(piece.mass for piece in pieces)
    if mass == 0.0:
        return Inertia(0.0, np.zeros(3), np.zeros((3, 3)))
    centre = sum((piece.mass * piece.centre for piece in pieces), np.zeros(3)) / mass
    tensor = np.zeros((3, 3))
    for piece in pieces:
        d = piece.centre - centre
        tensor += piece.tensor + piece.mass * ((d * d).sum() * np.eye(3) - np.outer(d, d))
    return Inertia(mass, centre, tensor)


@dataclass(frozen=True, slots=True)
class Visual:
    """The shape of a link: a mesh file, or a primitive."""

    link_from_visual: FloatArray
    """Pose of the shape in the link, (4, 4)."""
    kind: str
    """"mesh", "box", "cylinder" or "sphere"."""
    size: tuple[float, ...]
    """Scale of a mesh; edge lengths of a box; radius and length of a cylinder; radius of a sphere."""
    mesh: str
    """URI of the mesh file, else empty."""
    colour: tuple[float, float, float]
    """RGB, 0-1."""


@dataclass(frozen=True, slots=True)
class Link:
    """A rigid link."""

    name: str
    inertia: Inertia
    """Inertia in the link's frame."""
    visuals: tuple[Visual, ...]


@dataclass(frozen=True, slots=True)
class Joint:
    """The connection of a child link to its parent."""

    name: str
    kind: str
    """"fixed", "revolute", "continuous" or "prismatic"."""
    parent: str
    child: str
    parent_from_joint: FloatArray
    """Transform at position zero, (4, 4)."""
    axis: FloatArray
    """Axis in the joint's frame, (3,)."""
    effort: float
    """Largest torque or force, 0 if not given [N m or N]."""
    velocity: float
    """Largest speed, 0 if not given [rad/s or m/s]."""
    lower: float = -math.inf
    """[rad or m]"""
    upper: float = math.inf
    """[rad or m]"""

    def transform(self, position: float) -> FloatArray:
        """Compute ``parent_from_child`` at a joint position [rad or m], (4, 4)."""
        motion = np.eye(4)
        if self.kind == "prismatic":
            motion[:3, 3] = position * self.axis
        elif self.kind in ("revolute", "continuous"):
            motion[:3, :3] = _axis_rotation(self.axis, position)
        return _product(self.parent_from_joint, motion)


@dataclass(frozen=True)
class Urdf:
    """A robot description: a tree of links."""

    name: str
    links: Mapping[str, Link]
    joints: Mapping[str, Joint]
    _joint_above: dict[str, Joint] = field(init=False, repr=False)

    def __post_init__(self):
        object.__setattr__(self, "_joint_above", {joint.child: joint for joint in self.joints.values()})

    def transform(self, frame: str, link: str, positions: Mapping[str, float]) -> FloatArray:
        """Compute ``frame_from_link`` at the given joint positions (others at zero), (4, 4)."""
        root_from_frame, frame_from_root = self._root_from(frame, positions), np.eye(4)
        rotation = root_from_frame[:3, :3].T
        frame_from_root[:3, :3], frame_from_root[:3, 3] = rotation, -(rotation * root_from_frame[:3, 3]).sum(axis=1)
        return _product(frame_from_root, self._root_from(link, positions))

    def fuse(self, frame: str, links: Iterable[str], positions: Mapping[str, float]) -> Inertia:
        """Fuse links, frozen at the given joint positions, into one body in link ``frame``'s frame."""
        return combine(self.links[link].inertia.transformed(self.transform(frame, link, positions)) for link in links)

    def _root_from(self, link: str, positions: Mapping[str, float]) -> FloatArray:
        if link not in self.links:
            raise BadUrdf(f"robot {self.name!r} has no link {link!r}")
        joint = self._joint_above.get(link)
        if joint is None:
            return np.eye(4)
        return _product(self._root_from(joint.parent, positions), joint.transform(positions.get(joint.name, 0.0)))


def read_urdf(path: Path) -> Urdf:
    """Read a robot description.

    Raises:
        BadUrdf: If the file cannot be read, is not XML, declares a document type, or a link or a number is missing or
            broken; says which.
    """
    robot = read_xml(path, BadUrdf)
    if robot.tag != "robot":
        raise BadUrdf(f"{path}: the root element is <{robot.tag}>, expected <robot>")
    palette = {
        material.get("name", ""): _colour(colour)
        for material in robot.findall("material")
        if (colour := material.find("color")) is not None
    }
    links, joints = {}, {}
    for element in (*robot.findall("link"), *robot.findall("joint")):
        name = element.get("name", "?")
        try:
            if element.tag == "link":
                links[name] = _link(element, palette)
            else:
                joints[name] = _joint(element)
        except (AttributeError, KeyError, ValueError, IndexError) as error:
            raise BadUrdf(f"{path}: {element.tag} {name!r} is incomplete or has a bad number: {error}") from error
    for joint in joints.values():
        for link in (joint.parent, joint.child):
            if link not in links:
                raise BadUrdf(f"{path}: joint {joint.name!r} refers to link {link!r}, which is not there")
    return Urdf(robot.get("name", path.stem), links, joints)


def _link(element: ElementTree.Element, palette: Mapping[str, tuple[float, float, float]]) -> Link:
    visuals = tuple(_visual(visual, palette) for visual in element.findall("visual"))
    inertial = element.find("inertial")
    if inertial is None:
        return Link(element.attrib["name"], combine(()), visuals)
    mass = float(_child(inertial, "mass").attrib["value"])
    i = {key: float(value) for key, value in _child(inertial, "inertia").attrib.items()}
    tensor = np.array([[i["ixx"], i["ixy"], i["ixz"]], [i["ixy"], i["iyy"], i["iyz"]], [i["ixz"], i["iyz"], i["izz"]]])
    in_own_frame = Inertia(mass, np.zeros(3), tensor)
    return Link(element.attrib["name"], in_own_frame.transformed(_origin(inertial)), visuals)


def _joint(element: ElementTree.Element) -> Joint:
    axis, limit = element.find("axis"), element.find("limit")
    direction = np.array([1.0, 0.0, 0.0]) if axis is None else _numbers(axis.attrib["xyz"], 3)
    return Joint(
        name=element.attrib["name"],
        kind=element.attrib["type"],
        parent=_child(element, "parent").attrib["link"],
        child=_child(element, "child").attrib["link"],
        parent_from_joint=_origin(element),
        axis=direction,
        effort=0.0 if limit is None else float(limit.get("effort", 0.0)),
        velocity=0.0 if limit is None else float(limit.get("velocity", 0.0)),
        lower=-math.inf if limit is None else float(limit.get("lower", -math.inf)),
        upper=math.inf if limit is None else float(limit.get("upper", math.inf)),
    )


def _visual(element: ElementTree.Element, palette: Mapping[str, tuple[float, float, float]]) -> Visual:
    shape = _child(element, "geometry")[0]
    match shape.tag:
        case "mesh":
            size = tuple(_numbers(shape.get("scale", "1 1 1"), 3))
        case "box":
            size = tuple(_numbers(shape.attrib["size"], 3))
        case "cylinder":
            size = (float(shape.attrib["radius"]), float(shape.attrib["length"]))
        case "sphere":
            size = (float(shape.attrib["radius"]),)
        case other:
            raise ValueError(f"unknown geometry <{other}>")
    colour = (0.7, 0.7, 0.7)
    material = element.find("material")
    if material is not None:
        own = material.find("color")
        colour = palette.get(material.get("name", ""), colour) if own is None else _colour(own)
    return Visual(_origin(element), shape.tag, size, shape.get("filename", ""), colour)


def _child(element: ElementTree.Element, tag: str) -> ElementTree.Element:
    child = element.find(tag)
    if child is None:
        raise KeyError(f"<{tag}> is missing in <{element.tag}>")
    return child


def _origin(element: ElementTree.Element) -> FloatArray:
    transform, origin = np.eye(4), element.find("origin")
    if origin is not None:
        transform[:3, 3] = _numbers(origin.get("xyz", "0 0 0"), 3)
        roll, pitch, yaw = _numbers(origin.get("rpy", "0 0 0"), 3)
        x, y, z = np.eye(3)
        transform[:3, :3] = _product(_axis_rotation(z, yaw), _axis_rotation(y, pitch), _axis_rotation(x, roll))
    return transform


def _colour(element: ElementTree.Element) -> tuple[float, float, float]:
    red, green, blue, _ = _numbers(element.attrib["rgba"], 4)
    return float(red), float(green), float(blue)


def _numbers(text: str, count: int) -> FloatArray:
    numbers = np.array([float(word) for word in text.split()])
    if len(numbers) != count or not np.isfinite(numbers).all():
        raise ValueError(f"expected {count} numbers, got {text!r}")
    return numbers


def _axis_rotation(axis: FloatArray, angle: float) -> FloatArray:
    """Rotation about an axis by Rodrigues' formula; a zero axis gives the identity."""
    length = math.sqrt((axis * axis).sum())
    if length == 0.0:
        return np.eye(3)
    x, y, z = axis / length
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + math.sin(angle) * cross + (1.0 - math.cos(angle)) * _product(cross, cross)


def _product(first: FloatArray, *others: FloatArray) -> FloatArray:
    """Matrix product. BLAS adds and rounds in the way of the processor's type, and the model would be another."""
    for other in others:
        first = (first[:, :, None] * other[None]).sum(axis=1)
    return first

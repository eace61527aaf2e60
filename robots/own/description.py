"""An MJCF or a URDF made into a model that goes into any scene: one body tree, its meshes, and nothing else.

The description is read with suspicion: no files beyond the robot's folder, no parts of MJCF that would make a scene of
their own or more than a robot needs. MuJoCo then writes it as one canonical MJCF.
"""

# pyright: reportAttributeAccessIssue=false, reportOptionalMemberAccess=false
# (MuJoCo's compiled bindings are invisible to a static checker.)

import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import NamedTuple

import mujoco

from robots.own.compiling import as_bad_robot
from robots.own.folder import BadRobot, RobotFolder
from vuca_nav.data_files import shown

MOST_ELEMENTS = 20_000
"""Greatest number of elements of a description, those included too."""
MOST_INCLUDES = 50
MESH_SUFFIXES = (".stl", ".obj", ".msh")
"""Meshes that MuJoCo reads."""
_REFUSED = (
    "plugin", "extension", "replicate", "composite", "flexcomp", "flex", "skin", "hfield", "model", "attach",
    "deformable",
)  # fmt: skip
"""Parts of MJCF that no base needs, and of which some can be of any size."""
_LEFT_OUT = ("option", "size", "visual", "statistic", "keyframe", "custom", "light", "camera", "texture")
"""Parts that are a scene's, or only seen."""

_NOT_FINITE = frozenset(sign + word for sign in ("", "+", "-") for word in ("nan", "inf", "infinity"))


class Description(NamedTuple):
    """A robot's canonical MJCF."""

    xml: str
    """Angles in radians; the one body of its world body is base_link, at the origin and without a joint."""
    assets: dict[str, bytes]
    """Contents of the meshes by their names in the MJCF."""
    base: str
    """Name of that body."""


def read_description(folder: RobotFolder, name: str) -> Description:
    """Read an MJCF or a URDF.

    Args:
        folder: The robot's folder.
        name: Path of the description, relative to the robot's file.

    Raises:
        BadRobot: If it cannot be read or is not one robot; says which part, and what would be right.
    """
    path = folder.locate(name, folder.file.parent, "model")
    reader = _Reader(folder, path)
    root = reader.read()
    text = ElementTree.tostring(root, encoding="unicode")
    with as_bad_robot(path):
        spec = mujoco.MjSpec.from_string(text, assets=reader.assets)
        base = _only_body(path, spec)
        for joint in list(base.joints):
            if joint.type != mujoco.mjtJoint.mjJNT_FREE:
                raise BadRobot(
                    f"{path}: the base {base.name!r} has the joint {joint.name!r}; a base without any but a free joint "
                    "would be right"
                )
            spec.delete(joint)
        base.pos, base.quat = (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)
        base.alt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
        for index, body in enumerate(spec.bodies):
            body.name = body.name or f"body-{index}"
        named = (*spec.bodies, *spec.joints, *spec.geoms, *spec.sites, *spec.actuators, *spec.sensors)
        bad = next((each.name for each in named if "/" in each.name), None)
        if bad is not None:
            raise BadRobot(f"{path}: the name {shown(bad)!r} has a slash; one without would be right")
        spec.compile()
        return Description(spec.to_xml(), reader.assets, base.name)


def _only_body(path: Path, spec: mujoco.MjSpec) -> mujoco.MjsBody:
    """The one body of the world body."""
    world = spec.worldbody
    bodies = list(world.bodies)
    loose = [kind for kind, own in (("geom", world.geoms), ("site", world.sites)) for _ in own]
    if loose:
        raise BadRobot(
            f"{path}: a {loose[0]} belongs to no body of the robot, as a scene's floor does; the robot alone would be "
            "right"
        )
    if len(bodies) != 1:
        raise BadRobot(f"{path}: it has {len(bodies)} bodies in its world body; one, the robot's base, would be right")
    return bodies[0]


class _Reader:
    """Reads a description and the files that it names, and gives them names of their own."""

    def __init__(self, folder: RobotFolder, path: Path):
        self._folder, self._path = folder, path
        self.assets: dict[str, bytes] = {}
        self._includes = 0

    def read(self) -> ElementTree.Element:
        """The description as one tree, whose meshes are those of ``assets``."""
        root = self._folder.read_xml(self._path)
        if root.tag == "robot":
            self._bring_urdf(root)
        elif root.tag == "mujoco":
            self._bring_mjcf(root)
        else:
            raise BadRobot(f"{self._path}: the root element is <{shown(root.tag)}>, expected <mujoco> or <robot>")
        for element in root.iter():
            for name, value in element.attrib.items():
                if any(word in _NOT_FINITE for word in value.lower().split()):
                    where = f"<{shown(element.tag)}> has {name} = {shown(value)!r}"
                    raise BadRobot(f"{self._path}: {where}; finite numbers would be right")
        return root

    def _bring_mjcf(self, root: ElementTree.Element) -> None:
        self._expand(root, self._path.parent, 0)
        elements = list(root.iter())
        if len(elements) > MOST_ELEMENTS:
            raise BadRobot(f"{self._path}: it has {len(elements)} elements; at most {MOST_ELEMENTS} would be right")
        for element in elements:
            if element.tag in _REFUSED:
                raise BadRobot(f"{self._path}: <{element.tag}> is not taken in a robot; one without would be right")
        meshes = self._path.parent
        for compiler in root.iter("compiler"):
            for attribute in ("meshdir", "assetdir", "texturedir", "strippath"):
                place = compiler.attrib.pop(attribute, "")
                if attribute in ("meshdir", "assetdir") and place:
                    meshes = self._path.parent / place
        for parent in elements:
            for child in [child for child in parent if child.tag in _LEFT_OUT]:
                parent.remove(child)
        if root.find("worldbody/frame") is not None:
            raise BadRobot(f"{self._path}: a <frame> in the world body; the robot's base itself would be right")
        for world in root.findall("worldbody"):
            for floor in [geom for geom in world.findall("geom") if geom.get("type") == "plane"]:
                world.remove(floor)
        for material in root.iter("material"):
            material.attrib.pop("texture", None)
            for layer in list(material):
                material.remove(layer)
        for mesh in root.iter("mesh"):
            if "file" in mesh.attrib:
                name = mesh.attrib["file"]
                mesh.attrib.setdefault("name", Path(name).stem)
                mesh.attrib["file"] = self._take(name, meshes, f"mesh {shown(mesh.attrib['name'])!r}")
                mesh.attrib.pop("content_type", None)
        self._check_inertia_stated(root)

    def _expand(self, element: ElementTree.Element, beside: Path, depth: int) -> None:
        """Put what is included in the place of the includes."""
        for index, child in reversed(list(enumerate(element))):
            if child.tag != "include":
                self._expand(child, beside, depth)
                continue
            self._includes += 1
            if depth >= 8 or self._includes > MOST_INCLUDES:
                raise BadRobot(f"{self._path}: too many includes; at most {MOST_INCLUDES}, 8 deep, would be right")
            path = self._folder.locate(child.get("file", ""), self._path.parent, "include")
            included = self._folder.read_xml(path)
            self._expand(included, beside, depth + 1)
            element[index : index + 1] = list(included)

    def _check_inertia_stated(self, root: ElementTree.Element) -> None:
        """Refuse bodies whose mass MuJoCo would make up: shapes of the density of water."""
        stated = ("mass", "density")
        defaults = [geom for default in root.iter("default") for geom in default.findall("geom")]
        compiler = root.find("compiler")
        if compiler is not None and compiler.get("inertiafromgeom") == "true":
            return
        if any(name in geom.attrib for geom in defaults for name in stated):
            return
        for body in root.iter("body"):
            geoms = [geom for frame in (body, *body.findall("frame")) for geom in frame.findall("geom")]
            told = any(name in geom.attrib for geom in geoms for name in stated)
            if body.find("inertial") is None and geoms and not told:
                raise BadRobot(
                    f"{self._path}: the body {shown(body.get('name', '?'))!r} has shapes but no inertia; an "
                    "<inertial>, or the mass or density of its geoms, would be right"
                )

    def _bring_urdf(self, root: ElementTree.Element) -> None:
        elements = list(root.iter())
        if len(elements) > MOST_ELEMENTS:
            raise BadRobot(f"{self._path}: it has {len(elements)} elements; at most {MOST_ELEMENTS} would be right")
        if any("xacro" in element.tag for element in elements):
            raise BadRobot(f"{self._path}: it has parts of xacro; the URDF that xacro makes of it would be right")
        for extension in root.findall("mujoco"):
            root.remove(extension)
        for link in root.findall("link"):
            if link.find("inertial") is None and (link.find("collision") is not None or self._moves(root, link)):
                raise BadRobot(
                    f"{self._path}: the link {shown(link.get('name', '?'))!r} has no inertia; an <inertial> would be "
                    "right"
                )
        for link in root.findall("link"):
            for shape in (*link.findall("visual"), *link.findall("collision")):
                for mesh in shape.iter("mesh"):
                    what = f"link {shown(link.get('name', '?'))!r}"
                    name = mesh.get("filename", "")
                    if shape.tag == "visual" and not name.lower().endswith(MESH_SUFFIXES):
                        self._folder.locate(name, self._path.parent, what)
                        link.remove(shape)  # only seen, in a format that MuJoCo does not read
                        break
                    mesh.attrib["filename"] = self._take(name, self._path.parent, what)
        extension = ElementTree.SubElement(root, "mujoco")
        ElementTree.SubElement(extension, "compiler", fusestatic="false", discardvisual="false", strippath="false")

    def _moves(self, root: ElementTree.Element, link: ElementTree.Element) -> bool:
        """Whether a link hangs on a joint that moves."""
        for joint in root.findall("joint"):
            child = joint.find("child")
            if child is not None and child.get("link") == link.get("name"):
                return joint.get("type") != "fixed"
        return False

    def _take(self, name: str, beside: Path, what: str) -> str:
        """Read a mesh; returns its name among the assets."""
        path = self._folder.locate(name, beside, what)
        if path.suffix.lower() not in MESH_SUFFIXES:
            raise BadRobot(
                f"{self._path}: {what}: {shown(name)!r} is not a mesh that MuJoCo reads; {', '.join(MESH_SUFFIXES)} "
                "would be right"
            )
        content, suffix = self._folder.read(path), path.suffix.lower()
        for known, other in self.assets.items():
            if other == content and known.endswith(suffix):
                return known
        key = f"{len(self.assets)}{suffix}"
        self.assets[key] = content
        return key

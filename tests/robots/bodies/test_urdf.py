import math

import numpy as np
import pytest

from robots.bodies.assets import MissingAsset, asset
from robots.bodies.urdf import BadUrdf, Inertia, combine, read_urdf

ARM = """<robot name="arm">
  <material name="red"><color rgba="1 0 0 1"/></material>
  <link name="base"><inertial><origin xyz="0 0 1"/><mass value="2"/>
    <inertia ixx="1" ixy="0" ixz="0" iyy="2" iyz="0" izz="3"/></inertial></link>
  <link name="upper"><inertial><origin xyz="1 0 0"/><mass value="3"/>
    <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.2" iyz="0" izz="0.3"/></inertial>
    <visual><origin xyz="0 0 2"/><geometry><box size="1 2 3"/></geometry><material name="red"/></visual></link>
  <link name="slide"/>
  <joint name="shoulder" type="revolute"><origin xyz="0 0 1" rpy="0 0 1.5707963267948966"/>
    <parent link="base"/><child link="upper"/><axis xyz="0 0 2"/><limit effort="6" velocity="7"/></joint>
  <joint name="rail" type="prismatic"><origin xyz="1 0 0" rpy="1.5707963267948966 0 0"/>
    <parent link="upper"/><child link="slide"/><axis xyz="0 0 1"/></joint>
</robot>"""


@pytest.fixture
def arm(tmp_path):
    file = tmp_path / "arm.urdf"
    file.write_text(ARM)
    return read_urdf(file)


def test_transforms_are_multiplied_in_a_fixed_order(arm):
    """Every product and sum is rounded once, from left to right, whatever the processor."""

    def product(a, b):
        terms = [[[a[i][k] * b[k][j] for k in range(4)] for j in range(4)] for i in range(4)]
        return [[((t[0] + t[1]) + t[2]) + t[3] for t in row] for row in terms]

    for angle in np.linspace(0.1, 3.0, 30).tolist():
        shoulder, rail = (arm.joints[name] for name in ("shoulder", "rail"))
        upper_from_slide = rail.transform(0.3 * angle)
        base_from_upper = shoulder.transform(angle)
        motion = np.eye(4)
        c, s = math.cos(angle), math.sin(angle)
        motion[:2, :2] = (1.0 - (1.0 - c), -s), (s, 1.0 - (1.0 - c))
        assert base_from_upper.tolist() == product(shoulder.parent_from_joint.tolist(), motion.tolist())
        expected = product(base_from_upper.tolist(), upper_from_slide.tolist())
        root = product(np.eye(4).tolist(), expected)
        assert arm.transform("base", "slide", {"shoulder": angle, "rail": 0.3 * angle}).tolist() == root


def test_forward_kinematics_by_hand(arm):
    # The shoulder turns 90 + 90 degrees: x of upper points along -x of base.
    base_from_upper = arm.transform("base", "upper", {"shoulder": math.pi / 2.0})
    np.testing.assert_allclose(base_from_upper @ (1, 0, 0, 1), (-1, 0, 1, 1), atol=1e-12)
    # The rail's own z points along -y of upper, which is +y of base; 0.5 m along it.
    base_from_slide = arm.transform("base", "slide", {"shoulder": math.pi / 2.0, "rail": 0.5})
    np.testing.assert_allclose(base_from_slide[:3, 3], (-1.0, 0.5, 1.0), atol=1e-12)
    identity = arm.transform("slide", "base", {"rail": 0.3}) @ arm.transform("base", "slide", {"rail": 0.3})
    np.testing.assert_allclose(identity, np.eye(4), atol=1e-12)


def test_fusion_by_hand(arm):
    # Masses 2 kg at (0, 0, 1) and 3 kg at (0, 1, 1): centre at y = 0.6. Parallel axes: 2 * 0.36 + 3 * 0.16 = 1.2
    # about x and z. The upper arm is turned by 90 degrees about z: its xx and yy swap.
    fused = arm.fuse("base", ["base", "upper"], {})
    assert fused.mass == 5.0
    np.testing.assert_allclose(fused.centre, (0.0, 0.6, 1.0), atol=1e-12)
    np.testing.assert_allclose(fused.tensor, np.diag([1.0 + 0.2 + 1.2, 2.0 + 0.1, 3.0 + 0.3 + 1.2]), atol=1e-12)


def test_combining_two_halves_of_a_rod_gives_the_rod():
    mass, length = 4.0, 2.0
    halves = [
        Inertia(mass / 2, np.array([x, 0.0, 0.0]), np.diag([0.0, 1.0, 1.0]) * mass / 2 * (length / 2) ** 2 / 12)
        for x in (-length / 4, length / 4)
    ]
    np.testing.assert_allclose(combine(halves).tensor, np.diag([0.0, 1.0, 1.0]) * mass * length**2 / 12)


def test_reads_limits_and_visuals(arm):
    assert (arm.joints["shoulder"].effort, arm.joints["shoulder"].velocity) == (6.0, 7.0)
    (visual,) = arm.links["upper"].visuals
    assert (visual.kind, visual.size, visual.colour) == ("box", (1.0, 2.0, 3.0), (1.0, 0.0, 0.0))
    assert arm.links["slide"].inertia.mass == 0.0


@pytest.mark.parametrize(
    ("wrong", "right", "complaint"),
    [
        ('mass value="2"', 'mass value="two"', "link 'base'"),
        ('<axis xyz="0 0 2"/>', '<axis xyz="0 2"/>', "joint 'shoulder'"),
        ('<child link="slide"/>', '<child link="slider"/>', "'slider'"),
        ("</robot>", "", "not XML"),
    ],
)
def test_a_broken_file_is_answered_with_what_and_where(tmp_path, wrong, right, complaint):
    file = tmp_path / "broken.urdf"
    file.write_text(ARM.replace(wrong, right))
    with pytest.raises(BadUrdf, match=complaint):
        read_urdf(file)


def test_a_missing_asset_is_named():
    with pytest.raises(MissingAsset, match=r"nowhere\.urdf"):
        asset("tiago_description/nowhere.urdf")
    with pytest.raises(MissingAsset, match="package://other"):
        asset("package://other/mesh.stl")
    uri = "package://example-robot-data/robots/tiago_description/meshes/pmb2/wheels/wheel.stl"
    assert asset(uri).name == "wheel.stl"


def test_a_description_with_entities_is_refused(tmp_path):
    file = tmp_path / "bomb.urdf"
    levels = "".join(f'<!ENTITY a{k + 1} "{f"&a{k};" * 10}">' for k in range(9))
    file.write_text(f'<!DOCTYPE r [<!ENTITY a0 "x">{levels}]><robot name="&a9;"/>')
    with pytest.raises(BadUrdf, match="declares a document type"):
        read_urdf(file)
    with pytest.raises(BadUrdf, match="Is a directory"):
        read_urdf(tmp_path)

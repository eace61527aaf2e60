import pytest

from robots.own.body import OwnRobot
from robots.own.folder import BadRobot
from robots.registry import check_robot, make_body, runs_user_code
from tests.robots.own.robots import write_robot
from vuca_nav.errors import BadArgument, UnknownName, VucaError

MESH = '<asset><mesh name="shell" file="{}"/></asset><worldbody>'
WHEEL = '<joint name="left_wheel" axis="0 0 1"/>'
LEFT_TYRE = '<geom name="left_tyre" type="cylinder" size="0.1 0.02" mass="1"/>'
BOX = '<geom name="box" type="box" size="0.25 0.15 0.05" pos="0 0 0.05"/>'
INERTIAL = '<inertial mass="10" pos="0 0 0.02" diaginertia="0.2 0.3 0.4"/>'
DRIVE = "drive: {type: differential, left: [left_wheel], right: [right_wheel]}"

DESCRIPTIONS = {
    "mesh that is not there": (("<worldbody>", MESH.format("shell.stl")), "no file 'shell.stl'"),
    "mesh out of the folder": (("<worldbody>", MESH.format("../shell.stl")), "leads out of the robot's folder"),
    "mesh by an absolute path": (("<worldbody>", MESH.format("/etc/passwd")), "leads out of the robot's folder"),
    "mesh of an unknown kind": (("<worldbody>", MESH.format("robot.yaml")), "not a mesh that MuJoCo reads"),
    "include that is not there": (("<worldbody>", '<include file="more.xml"/><worldbody>'), "no file 'more.xml'"),
    "include of itself": (("<worldbody>", '<include file="cart.xml"/><worldbody>'), "too many includes"),
    "entities": (('<mujoco model="cart">', '<!DOCTYPE m [<!ENTITY a "1">]><mujoco model="cart">'), "document type"),
    "not XML": (("</mujoco>", ""), "not XML"),
    "replicas without end": (("<worldbody>", '<worldbody><replicate count="1000000000"/>'), "<replicate> is not taken"),
    "a plugin": (("<worldbody>", '<extension><plugin plugin="x"/></extension><worldbody>'), "is not taken in a robot"),
    "a body without inertia": (
        (INERTIAL, ""),
        "the body 'base' has shapes but no inertia",
    ),
    "a moving body of nothing": ((LEFT_TYRE, ""), "mass and inertia of moving bodies"),
    "an impossible inertia": (('diaginertia="0.2 0.3 0.4"', 'diaginertia="0.1 0.1 9"'), "A + B >= C"),
    "an inertia as of a house": (('diaginertia="0.2 0.3 0.4"', 'diaginertia="200 300 400"'), "more than 3 m far"),
    "too heavy": (('mass="10"', 'mass="10000"'), "mass is 10002 kg"),
    "masks that miss the floor": (
        (LEFT_TYRE, LEFT_TYRE.replace("/>", ' contype="4" conaffinity="2"/>')),
        "'left_tyre' has the contact masks 4 and 2, which miss a floor's",
    ),
    "a wheel that is only seen": (
        (LEFT_TYRE, LEFT_TYRE.replace("/>", ' contype="0" conaffinity="0"/>')),
        "has no geom that can touch the floor",
    ),
    "a wheel in the air": (('pos="0 0.2 0" euler', 'pos="0 0.2 0.02" euler'), "does not touch the floor as the robot"),
    "wheels of two sizes": ((LEFT_TYRE, LEFT_TYRE.replace("0.1 0.02", "0.12 0.02")), "its wheels differ"),
    "no casters": (('<geom name="caster" type="sphere" size="0.03" pos="-0.2 0 -0.07"',
                    '<geom name="caster" type="sphere" size="0.03" pos="-0.2 0 0.1"'), "does not come to rest"),
    "casters that brake": (('name="caster" type="sphere" size="0.03" pos="-0.2 0 -0.07" friction="0.001" condim="1"',
                            'name="caster" type="sphere" size="0.03" pos="-0.2 0 -0.07" friction="9"'),
                           "does not move as it is told to"),
    "an axis forwards": ((WHEEL, '<joint name="left_wheel" axis="1 0 0"/>'), "turns about"),
    "a wheel that slides": ((WHEEL, '<joint name="left_wheel" type="slide"/>'), "is no hinge"),
    "a wall of its own": (("<worldbody>", '<worldbody><geom type="box" size="1 1 1"/>'), "belongs to no body"),
    "two robots": (("</worldbody>", '<body name="b"><geom size="0.1" mass="1"/></body></worldbody>'), "2 bodies"),
}  # fmt: skip

FILES = {
    "a wheel that hits nothing": ((DRIVE, DRIVE.replace("left_wheel", "left_weel")), "did you mean 'left_wheel'"),
    "a caster that hits nothing": ((DRIVE, DRIVE.replace("left:", "casters: [c], left:")), "no geom and no body"),
    "sides changed": (
        (DRIVE, "drive: {type: differential, left: [right_wheel], right: [left_wheel]}"),
        "left ones where y is greater",
    ),
    "a wheel twice": ((DRIVE, DRIVE.replace("[right_wheel]", "[left_wheel]")), "names the joint 'left_wheel' twice"),
    "a drive without wheels": ((DRIVE, "drive: {type: skid-steer}"), "left missing"),
    "a model that is not there": (("cart.xml", "card.xml"), "no file 'card.xml'"),
    "a model out of the folder": (("cart.xml", "../cart.xml"), "leads out of the robot's folder"),
    "a limit without its source": (
        ("max_v_x: {value: 1.0, source: a test}", "max_v_x: {value: 1.0}"),
        "limits.max_v_x: source missing (line 6)",
    ),
    "an unknown field": (("beams: 271", "beems: 271"), "did you mean 'beams'"),
    "a lidar of no kind": (("rate: 15.0", "rate: 90.0"), "lidar.rate: 90.0 is greater than the maximum of 40"),
    "a range of nothing": (("max_range: 10.0", "max_range: 0.01"), "min_range must be below max_range"),
    "a number that is none": (("height: 0.2", "height: .nan"), "lidar.height: nan is not a finite number"),
    "sideways on two wheels": (
        ("  max_a_w:", "  max_v_y: {value: 0.3, source: a test}\n  max_a_w:"),
        "does not move sideways",
    ),
    "an empty footprint": (("odometry:", "footprint: [[0.1, 0], [0.2, 0], [0.3, 0]]\nodometry:"), "not a convex out"),
    "a footprint that is too small": (
        ("odometry:", "footprint: [[0.1, -0.1], [0.1, 0.1], [-0.1, 0.1], [-0.1, -0.1]]\nodometry:"),
        "sticks out of it by 0.15 m",
    ),
    "a footprint beside base_link": (
        ("odometry:", "footprint: [[0.1, -0.3], [0.5, -0.3], [0.5, 0.3], [0.1, 0.3]]\nodometry:"),
        "base_link, at 0, 0, is not inside",
    ),
    "the wrong odometry": (("{model: wheels}", "{model: skid-steer}"), "does not go with a drive of the type differ"),
    "a slash in the name": (("name: cart\n", "name: a/cart\n"), "name: 'a/cart'"),
}  # fmt: skip


def refusal(file):
    with pytest.raises(VucaError) as refused:
        OwnRobot(file)
    message = str(refused.value)
    assert "\n" not in message
    return message


@pytest.mark.parametrize(("change", "told"), DESCRIPTIONS.values(), ids=DESCRIPTIONS)
def test_a_description_with_a_fault_is_refused(tmp_path, change, told):
    file = write_robot(tmp_path / "robot", change)
    (tmp_path / "shell.stl").write_bytes(b"")
    assert told in refusal(file)


@pytest.mark.parametrize(("change", "told"), FILES.values(), ids=FILES)
def test_a_file_with_a_fault_is_refused(tmp_path, change, told):
    message = refusal(write_robot(tmp_path / "robot", change))
    assert told in message
    assert "robot.yaml" in message


def test_a_robot_that_falls_through_the_floor_is_noticed(tmp_path):
    # Its contacts are so soft that the floor does not carry it: no mask is wrong.
    soft = ' solref="5 1"'
    names = ("left_tyre", "right_tyre", "caster", "caster_front", "box")
    changes = [(f'name="{name}" ', f'name="{name}"{soft} ') for name in names]
    assert "falls through the floor" in refusal(write_robot(tmp_path, *changes))


def test_a_link_without_inertia_is_refused(tmp_path):
    collision = '<collision><geometry><box size="1 1 1"/></geometry></collision>'
    urdf = f'<robot name="r"><link name="base">{collision}</link></robot>'
    file = write_robot(tmp_path, ("model: cart.xml", "model: cart.urdf"), cart__urdf=urdf)
    assert "the link 'base' has no inertia" in refusal(file)


def test_a_link_through_a_symbolic_link_out_of_the_folder_is_refused(tmp_path):
    (tmp_path / "secret.xml").write_text("<mujoco/>")
    file = write_robot(tmp_path / "robot", ("model: cart.xml", "model: link.xml"))
    (tmp_path / "robot" / "link.xml").symlink_to(tmp_path / "secret.xml")
    assert "leads out of the robot's folder" in refusal(file)


def test_an_interface_that_cannot_be_loaded_is_told(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    changes = [(DRIVE, "drive: {type: own, interface: no_such_drive:Drive}"), ("{model: wheels}", "{model: velocity}")]
    file = write_robot(tmp_path, *changes)
    with pytest.raises(BadArgument, match=r"drive.interface: there is no module 'no_such_drive'"):
        OwnRobot(file, trust=True)
    with pytest.raises(BadArgument, match=r"no_such_drive:Drive is Python code of your own; --trust runs it"):
        make_body(f"mjcf:{file}")  # whatever command forgets to ask


def test_only_an_interface_of_ones_own_is_code(tmp_path):
    assert not runs_user_code("rover")
    assert not runs_user_code(f"mjcf:{write_robot(tmp_path / 'wheels')}")
    changes = [(DRIVE, "drive: {type: own, interface: no_such_drive:Drive}"), ("{model: wheels}", "{model: velocity}")]
    assert runs_user_code(f"mjcf:{write_robot(tmp_path / 'own', *changes)}")


def test_names_that_are_no_robots_are_refused(tmp_path):
    with pytest.raises(UnknownName, match=r"available: .*mjcf:robot"):
        check_robot("rovver")
    with pytest.raises(BadArgument, match="given by its file as mjcf:"):
        check_robot("robot.yaml")
    with pytest.raises(BadRobot, match="cannot be read"):
        make_body(f"mjcf:{tmp_path / 'robot.yaml'}")

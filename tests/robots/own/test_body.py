import math

import numpy as np
import pytest

from robots.noise import NoiseConfig
from robots.own.body import OwnRobot
from robots.registry import ROVER_FILE, make_body
from robots.simulation import Simulation
from tests.robots.own.robots import write_robot
from vuca_nav.types import STOP, Pose2, VelocityCommand
from worlds.world import Box, Obstacle, World

START = Pose2(20.0, 20.0, 0.5)
PERFECT = NoiseConfig.none()
URDF = """<robot name="cart">
<link name="base">
  <inertial><origin xyz="0 0 0.02"/><mass value="10"/>
    <inertia ixx="0.2" iyy="0.3" izz="0.4" ixy="0" ixz="0" iyz="0"/></inertial>
  <visual><geometry><mesh filename="package://cart/shell.stl"/></geometry></visual>
  <collision><origin xyz="0 0 0.05"/><geometry><box size="0.5 0.3 0.1"/></geometry></collision>
</link>
<link name="caster"><inertial><mass value="0.001"/>
  <inertia ixx="1e-6" iyy="1e-6" izz="1e-6" ixy="0" ixz="0" iyz="0"/></inertial>
  <collision><origin xyz="0.2 0 0"/><geometry><sphere radius="0.03"/></geometry></collision>
  <collision><origin xyz="-0.2 0 0"/><geometry><sphere radius="0.03"/></geometry></collision></link>
<joint name="caster_mount" type="fixed"><parent link="base"/><child link="caster"/><origin xyz="0 0 -0.07"/></joint>
<link name="left"><inertial><mass value="1"/>
  <inertia ixx="0.0026" iyy="0.0026" izz="0.005" ixy="0" ixz="0" iyz="0"/></inertial>
  <collision><geometry><cylinder radius="0.1" length="0.04"/></geometry></collision></link>
<link name="right"><inertial><mass value="1"/>
  <inertia ixx="0.0026" iyy="0.0026" izz="0.005" ixy="0" ixz="0" iyz="0"/></inertial>
  <collision><geometry><cylinder radius="0.1" length="0.04"/></geometry></collision></link>
<joint name="left_wheel" type="continuous"><parent link="base"/><child link="left"/>
  <origin xyz="0 0.2 0" rpy="-1.57079632679 0 0"/><axis xyz="0 0 1"/></joint>
<joint name="right_wheel" type="continuous"><parent link="base"/><child link="right"/>
  <origin xyz="0 -0.2 0" rpy="-1.57079632679 0 0"/><axis xyz="0 0 1"/></joint>
</robot>
"""


def simulate(body, commands, noise=PERFECT, obstacles=()):
    world = World("hall", 0, (0.0, 0.0, 40.0, 40.0), obstacles, (), START, (1.0, 1.0))
    simulation = Simulation(world, body, 0, noise=noise)
    _, odometry = simulation.reset()
    for command, ticks in commands:
        for _ in range(ticks):
            _, odometry = simulation.step(command)
    return simulation, odometry


def moved(simulation):
    """Motion since the start, in the frame of the start."""
    dx, dy = simulation.true_pose.x - START.x, simulation.true_pose.y - START.y
    c, s = math.cos(START.yaw), math.sin(START.yaw)
    return c * dx + s * dy, c * dy - s * dx, simulation.true_pose.yaw - START.yaw


@pytest.fixture(scope="module")
def cart(tmp_path_factory):
    return OwnRobot(write_robot(tmp_path_factory.mktemp("cart")))


def test_what_the_stack_knows_is_what_the_file_and_the_shapes_say(cart):
    spec, lidar = cart.spec, cart.lidar
    assert (spec.name, spec.max_v_x, spec.min_v_x, spec.max_v_y, spec.max_w_z) == ("cart", 1.0, -0.5, 0.0, 1.5)
    # Box of 0.5 x 0.3 m between wheels whose tyres reach 0.22 m to the side.
    assert spec.footprint[:, 0].max() == pytest.approx(0.25, abs=1e-3)
    assert spec.footprint[:, 1].max() == pytest.approx(0.22, abs=1e-3)
    assert cart.height == pytest.approx(0.2, abs=1e-3)
    assert cart.base_height == pytest.approx(0.1, abs=1e-3)
    assert (lidar.num_beams, lidar.rate, lidar.height, lidar.min_range) == (271, 15.0, 0.2, 0.05)
    assert lidar.angles_in_base()[[0, -1]] == pytest.approx([-math.radians(135), math.radians(135)], abs=1e-6)


def test_it_drives_as_commanded(cart):
    simulation, odometry = simulate(cart, [(VelocityCommand(1.0, 0.0, 0.0), 90)])
    x, y, yaw = moved(simulation)
    assert x == pytest.approx(2.5, abs=0.05)  # 3 s less half of the second that speeding up takes
    assert (y, yaw) == pytest.approx((0.0, 0.0), abs=0.02)
    assert odometry.odom_from_base.x == pytest.approx(x, abs=0.02)
    simulation, _ = simulate(cart, [(VelocityCommand(0.0, 0.0, 1.0), 60)])
    assert moved(simulation)[2] == pytest.approx(2.0 - 1.0 / 6.0, rel=0.15)  # wide tyres scrub as it turns


def test_the_same_seed_gives_the_same_bits(cart):
    runs = [simulate(cart, [(VelocityCommand(0.7, 0.0, 0.4), 40)], NoiseConfig()) for _ in range(2)]
    assert runs[0][0].true_pose == runs[1][0].true_pose
    assert runs[0][1] == runs[1][1]


def test_a_urdf_gives_the_same_robot_as_its_mjcf(cart, tmp_path):
    file = write_robot(
        tmp_path,
        ("model: cart.xml", "model: cart.urdf"),
        ("drive: {type: differential,", "drive: {type: differential, casters: [caster],"),
        cart__urdf=URDF,
    )
    binary_stl(tmp_path / "shell.stl")
    body = OwnRobot(file)
    assert body.spec.footprint == pytest.approx(cart.spec.footprint, abs=1e-3)
    assert body.assembly.mass == pytest.approx(cart.assembly.mass, abs=0.01)
    simulation, _ = simulate(body, [(VelocityCommand(0.5, 0.0, 0.5), 60)])
    other, _ = simulate(cart, [(VelocityCommand(0.5, 0.0, 0.5), 60)])
    assert moved(simulation) == pytest.approx(moved(other), abs=0.02)
    assert {part.body for part in body.visuals()} == {"base", "caster", "left", "right"}


def test_a_base_link_without_mass_carries_its_chassis(cart, tmp_path):
    # As of most robots of ROS: links that are only frames.
    urdf = URDF.replace('<link name="base">', '<link name="base_link"/><link name="base">', 1).replace(
        "</robot>",
        '<joint name="fix" type="fixed"><parent link="base_link"/><child link="base"/></joint>'
        '<link name="laser"/><joint name="laser_mount" type="fixed"><parent link="base"/><child link="laser"/>'
        '<origin xyz="0.1 0 0.2"/></joint><gazebo reference="base"><mu1>1</mu1></gazebo></robot>',
    )
    changes = [
        ("model: cart.xml", "model: cart.urdf"),
        ("drive: {type: differential,", "drive: {type: differential, casters: [caster],"),
    ]
    file = write_robot(tmp_path, *changes, cart__urdf=urdf)
    binary_stl(tmp_path / "shell.stl")
    assert OwnRobot(file).spec.footprint == pytest.approx(cart.spec.footprint, abs=1e-3)


def test_a_floor_of_the_description_is_left_out(cart, tmp_path):
    change = ("<worldbody>", '<worldbody><light pos="0 0 3"/><geom name="floor" type="plane" size="5 5 1"/>')
    body = OwnRobot(write_robot(tmp_path, change))
    assert body.spec.footprint == pytest.approx(cart.spec.footprint)


def binary_stl(path):
    """Write a tetrahedron."""
    corners = np.array([(0, 0, 0), (0.1, 0, 0), (0, 0.1, 0), (0, 0, 0.1)], np.float32)
    content = bytearray(80) + np.uint32(4).tobytes()
    for face in ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)):
        content += np.zeros(3, np.float32).tobytes() + corners[list(face)].tobytes() + b"\0\0"
    path.write_bytes(bytes(content))


def test_meshes_reach_the_scene(tmp_path):
    change = (
        '<geom name="box" type="box" size="0.25 0.15 0.05" pos="0 0 0.05"/>',
        '<geom name="box" type="box" size="0.25 0.15 0.05" pos="0 0 0.05"/><geom name="horn" type="mesh" mesh="tip" '
        'pos="0.25 0 0.05" mass="0.1"/>',
    )
    asset = ("<worldbody>", '<asset><mesh name="tip" file="meshes/tip.stl"/></asset><worldbody>')
    file = write_robot(tmp_path, change, asset)
    (tmp_path / "meshes").mkdir()
    binary_stl(tmp_path / "meshes" / "tip.stl")
    body = OwnRobot(file)
    assert body.spec.footprint[:, 0].max() == pytest.approx(0.35, abs=2e-3)  # the tip of the tetrahedron
    digest = body.digest
    content = bytearray((tmp_path / "meshes" / "tip.stl").read_bytes())
    content[0] ^= 1  # of the header, which means nothing
    (tmp_path / "meshes" / "tip.stl").write_bytes(bytes(content))
    assert OwnRobot(file).digest != digest


def test_it_touches_walls(cart):
    wall = Obstacle("wall", Box(START.x + 0.8, START.y + 0.4, 0.1, 3.0, 0.5, 1.0))
    simulation, _ = simulate(cart, [(VelocityCommand(1.0, 0.0, 0.0), 60)], obstacles=(wall,))
    assert simulation.contact == "wall"


def test_an_omnidirectional_base_goes_sideways(tmp_path):
    file = write_robot(
        tmp_path,
        ("drive: {type: differential, left: [left_wheel], right: [right_wheel]}",
         "drive: {type: omnidirectional, wheels: [left_wheel, right_wheel]}"),
        ("  max_a_w:", "  max_v_y: {value: 0.5, source: a test}\n  max_a_y: {value: 1.0, source: a test}\n  max_a_w:"),
        ("odometry: {model: wheels}", "odometry: {model: velocity}"),
    )  # fmt: skip
    simulation, odometry = simulate(OwnRobot(file), [(VelocityCommand(0.0, 0.5, 0.0), 90)])
    x, y, yaw = moved(simulation)
    assert (x, y, yaw) == pytest.approx((0.0, 0.5 * 2.75, 0.0), abs=0.05)
    assert odometry.odom_from_base.y == pytest.approx(y, abs=0.02)


def test_an_interface_of_ones_own_drives(tmp_path, monkeypatch):
    motors = "".join(f'<velocity name="{s}" joint="{s}_wheel" kv="3"/>' for s in ("left", "right"))
    file = write_robot(
        tmp_path,
        ("drive: {type: differential, left: [left_wheel], right: [right_wheel]}",
         "drive: {type: own, interface: own_cart_drive:Drive}"),
        ("odometry: {model: wheels}", "odometry: {model: velocity}"),
        ("</worldbody>", f"</worldbody><actuator>{motors}</actuator>"),
    )  # fmt: skip
    (tmp_path / "own_cart_drive.py").write_text(
        "from robots.own.interface import VelocityInterface\n"
        "class Drive(VelocityInterface):\n"
        "    def reset(self):\n"
        "        names = (self.robot.prefix + side for side in ('left', 'right'))\n"
        "        self.left, self.right = (self.robot.model.actuator(name).id for name in names)\n"
        "    def apply(self, command):\n"
        "        self.robot.data.ctrl[self.left] = (command.v_x - 0.2 * command.w_z) / 0.1\n"
        "        self.robot.data.ctrl[self.right] = (command.v_x + 0.2 * command.w_z) / 0.1\n"
    )
    monkeypatch.chdir(tmp_path)
    simulation, _ = simulate(OwnRobot(file, trust=True), [(VelocityCommand(0.5, 0.0, 0.0), 90)])
    assert moved(simulation)[0] == pytest.approx(0.5 * 2.75, abs=0.1)


def test_a_heading_from_the_wheels_errs_with_their_radii(tmp_path):
    gyro = OwnRobot(write_robot(tmp_path / "gyro"))
    change = ("odometry: {model: wheels}", "odometry: {model: wheels, heading: wheels}")
    wheels = OwnRobot(write_robot(tmp_path / "wheels", change))
    straight = [(VelocityCommand(1.0, 0.0, 0.0), 150)]
    errors = [abs(simulate(body, straight, NoiseConfig())[1].odom_from_base.yaw) for body in (gyro, wheels)]
    assert errors[1] > 5.0 * errors[0]


def test_noise_of_the_file_takes_the_place_of_the_common_one(tmp_path):
    change = (
        "odometry: {model: wheels}",
        "odometry: {model: wheels, noise: {encoder_scale_sigma: {value: 0.0, source: a test}, "
        "slip_sigma: {value: 0.0, source: a test}}}",
    )
    simulation, odometry = simulate(
        OwnRobot(write_robot(tmp_path, change)), [(VelocityCommand(1.0, 0.0, 0.0), 90)], NoiseConfig()
    )
    assert odometry.odom_from_base.x == pytest.approx(moved(simulation)[0], abs=0.01)


def test_the_rover_has_jackals_size_and_lidar():
    body = make_body("rover")
    extent = body.spec.footprint.max(axis=0) - body.spec.footprint.min(axis=0)
    assert extent == pytest.approx([0.508, 0.430], abs=1e-3)
    assert (body.lidar.num_beams, body.lidar.max_range, body.spec.max_v_x) == (720, 30.0, 2.0)
    assert body.lidar.angles_in_base()[-1] == pytest.approx(math.radians(135.0), abs=1e-4)


def test_the_rover_skids_when_it_turns():
    body = OwnRobot(ROVER_FILE)
    simulation, _ = simulate(body, [(VelocityCommand(0.0, 0.0, 1.0), 90), (STOP, 30)])
    angles = [simulation.data.qpos[simulation.model.joint(f"rover/{w.joint}").qposadr[0]] for w in body.assembly.right]
    turned = moved(simulation)[2] % (2.0 * math.pi)
    rolled = float(np.mean(angles)) * body.assembly.radius
    assert turned == pytest.approx(3.0, abs=0.35)
    assert rolled > 1.3 * turned * 0.5 * body.assembly.track  # farther than wheels that do not skid

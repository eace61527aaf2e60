"""Small robots as files, and changes to them."""

from pathlib import Path

MJCF = """<mujoco model="cart">
  <compiler angle="degree"/>
  <worldbody>
    <body name="base" pos="0 0 0.1">
      <freejoint/>
      <inertial mass="10" pos="0 0 0.02" diaginertia="0.2 0.3 0.4"/>
      <geom name="box" type="box" size="0.25 0.15 0.05" pos="0 0 0.05"/>
      <geom name="caster" type="sphere" size="0.03" pos="-0.2 0 -0.07" friction="0.001" condim="1" priority="1"/>
      <geom name="caster_front" type="sphere" size="0.03" pos="0.2 0 -0.07" friction="0.001" condim="1" priority="1"/>
      <body name="left" pos="0 0.2 0" euler="-90 0 0">
        <joint name="left_wheel" axis="0 0 1"/>
        <geom name="left_tyre" type="cylinder" size="0.1 0.02" mass="1"/>
      </body>
      <body name="right" pos="0 -0.2 0" euler="-90 0 0">
        <joint name="right_wheel" axis="0 0 1"/>
        <geom name="right_tyre" type="cylinder" size="0.1 0.02" mass="1"/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""

ROBOT = """format: vuca-robot-1
name: cart
model: cart.xml
drive: {type: differential, left: [left_wheel], right: [right_wheel]}
limits:
  max_v_x: {value: 1.0, source: a test}
  min_v_x: {value: -0.5, source: a test}
  max_w_z: {value: 1.5, source: a test}
  max_a_x: {value: 1.0, source: a test}
  max_a_w: {value: 3.0, source: a test}
lidar:
  mount: {x: 0.1, y: 0.0, yaw: 0.0}
  height: 0.2
  field_of_view: 4.71238898
  beams: 271
  min_range: 0.05
  max_range: 10.0
  rate: 15.0
odometry: {model: wheels}
"""


def write_robot(folder: Path, *changes: tuple[str, str], **files: str) -> Path:
    """Write the cart with texts replaced in its files; returns the robot's file.

    Args:
        folder: Folder to write to.
        changes: Texts to be replaced, each there once in one of the files, and what takes their place.
        files: Other files by their names, a double underscore for the dot.
    """
    texts = {"robot.yaml": ROBOT, "cart.xml": MJCF}
    for old, new in changes:
        (name,) = [name for name, text in texts.items() if text.count(old) == 1]
        texts[name] = texts[name].replace(old, new)
    for name, text in {**texts, **{name.replace("__", "."): text for name, text in files.items()}}.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    return folder / "robot.yaml"

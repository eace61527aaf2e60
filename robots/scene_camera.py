"""Pictures of a simulation's scene, drawn by MuJoCo without a window."""

# pyright: reportAttributeAccessIssue=false, reportOptionalMemberAccess=false
# (MuJoCo's compiled bindings and dm_control's generated elements are invisible to a static checker.)

import atexit
import importlib
import os
import sys
import warnings
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from robots.simulation import Simulation
from vuca_nav.errors import VucaError

WIDTH, HEIGHT = 640, 480
"""Size of a picture [pixels]: that of MuJoCo's framebuffer unless a model asks for another."""
DISTANCE = 8.0
"""Distance of the camera from the robot [m]: the corridors about it are in the picture."""
ELEVATION = -60.0
"""Angle at which the camera looks at the robot [deg]: steep enough to see over walls of 2.5 m."""
DIFFUSE = 0.45
"""Diffuse light of each of the two lamps, the camera's and the scene's: together they leave a bright floor below
white."""
MAX_GEOMS = 10_000
"""Greatest number of shapes in a picture: the default of MuJoCo's own renderer."""
BACKENDS = {"linux": ("egl", "glfw"), "darwin": ("cgl", "glfw")}
"""Modules of ``mujoco`` that make an OpenGL context, tried in order where ``MUJOCO_GL`` names none; EGL needs no
display."""
_FONT = mujoco.mjtFontScale.mjFONTSCALE_100.value


class NoOpenGL(VucaError):
    """This process cannot draw."""


class SceneCamera:
    """A camera above the robot that follows it. North (y of the world) is up.

    Raises:
        NoOpenGL: If this process cannot draw.
    """

    def __init__(self):
        self._opengl = self._drawing = self._model = None
        self._opengl = _open_opengl()

    def picture(self, simulation: Simulation) -> NDArray[np.uint8]:
        """Draw the scene as it is now.

        Args:
            simulation: A simulation that has been reset.

        Returns:
            (HEIGHT, WIDTH, 3) red, green and blue.

        Raises:
            NoOpenGL: If this process cannot draw.
        """
        if self._opengl is None:
            self._opengl = _open_opengl()
        self._opengl.make_current()
        if self._model is not simulation.scene_model:
            self._take_model(simulation.scene_model)
        simulation.copy_scene(self._data)
        x, y, _ = simulation.true_pose
        self._view.lookat[:] = x, y, 0.0
        mujoco.mjv_updateScene(
            self._model, self._data, self._option, None, self._view, mujoco.mjtCatBit.mjCAT_ALL.value, self._scene
        )
        for light in self._scene.lights[: self._scene.nlight]:
            light.diffuse[:] = DIFFUSE
        area = mujoco.MjrRect(0, 0, WIDTH, HEIGHT)
        mujoco.mjr_render(area, self._scene, self._drawing)
        pixels = np.empty((HEIGHT, WIDTH, 3), np.uint8)
        mujoco.mjr_readPixels(pixels, None, area, self._drawing)
        return pixels[::-1].copy()  # OpenGL's first row is the lowest

    def close(self) -> None:
        """Give back what the graphics driver holds; a picture taken later asks for it again."""
        if self._opengl is None:
            return
        self._opengl.make_current()
        if self._drawing is not None:
            self._drawing.free()
        self._opengl.free()
        atexit.unregister(self._opengl.free)
        self._opengl = self._drawing = self._model = None

    def __del__(self):
        if not sys.is_finalizing():  # at the end of the process the driver has given back everything already
            self.close()

    def _take_model(self, model: mujoco.MjModel) -> None:
        if self._drawing is not None:
            self._drawing.free()
        self._drawing = _drawing_of(model)
        self._model, self._data = model, mujoco.MjData(model)
        self._scene, self._option = mujoco.MjvScene(model, MAX_GEOMS), mujoco.MjvOption()
        self._scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = False  # without a graphics card, nine tenths of the time
        self._option.geomgroup[:] = True  # the robot's collision shapes are in groups that are hidden otherwise
        self._view = mujoco.MjvCamera()
        self._view.type = mujoco.mjtCamera.mjCAMERA_FREE
        self._view.distance, self._view.elevation, self._view.azimuth = DISTANCE, ELEVATION, 90.0


def _open_opengl() -> Any:
    """Make an OpenGL context that MuJoCo can draw in, and let it be the current one."""
    reasons = []
    for backend in _backends():
        try:
            return _new_context(backend)
        except Exception as error:  # every library fails in a way of its own; the error below repeats what it said
            reasons.append(f"{backend}: {' '.join(str(error).split()) or type(error).__name__}")
    raise NoOpenGL(
        f"no OpenGL to draw with ({'; '.join(reasons)}); without a display, MUJOCO_GL=egl with Mesa's or the graphics "
        "driver's libEGL, or MUJOCO_GL=osmesa with libOSMesa, would be right"
    )


def _new_context(backend: str) -> Any:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # GLFW's that there is no display: the error says so
        context = importlib.import_module(f"mujoco.{backend}").GLContext(WIDTH, HEIGHT)
    atexit.register(context.free)  # before the library, which registered earlier, closes itself
    context.make_current()
    _drawing_of(mujoco.MjModel.from_xml_string("<mujoco/>")).free()  # fails in a context without a display
    return context


def _backends() -> tuple[str, ...]:
    """Backends to try, in order: the one that ``MUJOCO_GL`` names, if it does."""
    wanted = os.environ.get("MUJOCO_GL", "").strip().lower()
    if wanted in ("", "enable", "enabled", "on", "true", "1"):
        return BACKENDS.get(sys.platform, ("glfw",))
    if wanted in ("cgl", "egl", "glfw", "osmesa"):
        return (wanted,)
    if wanted in ("glx", "wgl"):
        return ("glfw",)
    raise NoOpenGL(f"MUJOCO_GL={wanted} lets nothing be drawn; egl, osmesa or glfw would be right")


def _drawing_of(model: mujoco.MjModel) -> mujoco.MjrContext:
    """What MuJoCo keeps in the current OpenGL context for a model."""
    drawing = mujoco.MjrContext(model, _FONT)
    mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, drawing)
    return drawing

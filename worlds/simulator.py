"""MuJoCo and dm_control, imported for their physics whatever the environment says of rendering."""

import os
import warnings


def import_simulator() -> None:
    """Import MuJoCo and dm_control for the first time; both choose a renderer then, by ``MUJOCO_GL``.

    Where the one that is chosen does not load, as ``MUJOCO_GL=osmesa`` without its library, or does not exist, they
    are imported without any: nothing is rendered in a mission, an evaluation or a training.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # on a machine without a display they warn that rendering is impossible
        try:
            _import()
        except (AttributeError, ImportError, OSError, RuntimeError, TypeError):  # whatever a renderer's library raises
            chosen = os.environ.get("MUJOCO_GL")
            os.environ["MUJOCO_GL"] = "disabled"
            try:
                _import()  # what is wrong with anything but rendering is wrong again
            finally:
                if chosen is None:
                    del os.environ["MUJOCO_GL"]
                else:
                    os.environ["MUJOCO_GL"] = chosen


def _import() -> None:
    import mujoco  # noqa: F401
    from dm_control import mjcf  # noqa: F401

"""TIAGo and the TA11 gripper in MuJoCo: importing it registers the environments with gymnasium.

On Linux without a display it also sets ``MUJOCO_GL=egl`` where the variable is unset, so that rendering works at once.
That is read when ``mujoco`` is imported: import ``tiago_mj`` first, or set the variable yourself.
"""

from tiago_mj.registration import ENVIRONMENTS, register
from tiago_mj.view.headless import choose_gl, load_triton_before_mesa

__version__ = "0.1.0"
__all__ = ["ENVIRONMENTS", "__version__", "register"]

choose_gl()
load_triton_before_mesa()
register()

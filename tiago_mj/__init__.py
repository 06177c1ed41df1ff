"""TIAGo and the TA11 gripper in MuJoCo: importing it registers the environments with gymnasium."""

from tiago_mj.registration import ENVIRONMENTS, register

__version__ = "0.1.0"
__all__ = ["ENVIRONMENTS", "__version__", "register"]

register()

"""TIAGo and the TA11 gripper in MuJoCo."""

__version__ = "0.1.0"

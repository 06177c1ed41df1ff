"""A model as its robot is run: with its base held, and its motors under position controllers of stated gains."""

from __future__ import annotations

from pathlib import Path

import mujoco

from tiago_mj.models import bounded, gains
from tiago_mj.models.actuators import actuator_interface
from tiago_mj.models.held_base import with_held_base


def load(path: Path, *, fixed: bool = False, stated: str | None = None) -> mujoco.MjModel:
    """The model of a file, as it is run.

    Args:
        path: of the MJCF.
        fixed: whether its floating base is held.
        stated: gains of the controllers in its motors, as :func:`tiago_mj.models.gains.parsed` reads them.

    Raises:
        ValueError: there is no such file, nothing floats, or the gains do not fit its actuators; one line.
    """
    if not path.is_file():
        raise ValueError(f"model {path}: no such file")
    model = bounded.load_model(path, f"model {path.name}")
    if fixed:
        model = with_held_base(path)
    if stated is not None:
        _control(model, path.name, gains.parsed(stated))
    return model


def _control(model: mujoco.MjModel, name: str, stated: gains.Gains) -> None:
    """Make position servos of a model's motors; what a motor can give is what it could before."""
    for k in range(model.nu):
        actuator = model.actuator(k).name
        if actuator_interface(model, k) != "effort":
            raise ValueError(f"model {name}: --gains is of motors, and {actuator!r} is a servo that has its gains")
        if model.actuator_gear[k, 0] != 1.0 or model.actuator_gainprm[k, 0] != 1.0:
            raise ValueError(f"model {name}: --gains needs motors without a gear, and {actuator!r} has one")
        kp, kv = (gains.of(stated, actuator, gain) for gain in gains.GAINS)
        if kp is None or kp.value is None:
            raise ValueError(f"model {name}: --gains says no stiffness of {actuator!r}: give values, kp=20,kv=0.5")
        if model.actuator_ctrllimited[k]:  # of a motor that is its torque
            model.actuator_forcerange[k] = model.actuator_ctrlrange[k]
            model.actuator_forcelimited[k], model.actuator_ctrllimited[k] = True, False
        model.actuator_biastype[k] = mujoco.mjtBias.mjBIAS_AFFINE
        model.actuator_gainprm[k, 0] = kp.value
        model.actuator_biasprm[k, :3] = 0.0, -kp.value, 0.0 if kv is None or kv.value is None else -kv.value

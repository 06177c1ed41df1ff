"""Gains of a servo that feels as it does behind a spring: elasticity where a second joint is not to be had."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import mujoco

from tiago_mj.effects import EFFECTS, Entry
from tiago_mj.effects.now import Wiring
from tiago_mj.effects.spec import arrays

EFFECT: Final = "joint_elasticity"


def soften(model: mujoco.MjModel, wiring: Wiring, entries: Sequence[Entry]) -> None:
    """Lower the gains of servos behind springs in a compiled model, in place.

    A motor without mass between servo and spring moves so that both forces agree. With share = k / (kp + k) the joint
    feels stiffness share · kp at rest; where it follows its set point, motor and joint move alike and it trails by
    kv / kp times its speed as before, as with damping share · kv.

    Args:
        model: compiled; changed.
        wiring: its parts.
        entries: of ``joint_elasticity``.
    """
    if not entries:
        return
    targets = wiring.targets
    said = arrays(EFFECTS[EFFECT], [entries], targets)
    for k, joint in enumerate(targets.actuated):
        if not said.present[0, joint]:
            continue
        actuator = int(wiring.actuators[k])
        gear = float(model.actuator_gear[actuator, 0])
        spring = float(said.stiffness[0, joint]) / gear**2  # type: ignore[attr-defined]
        share = spring / (spring - float(model.actuator_biasprm[actuator, 1]))
        model.actuator_gainprm[actuator, 0] *= share
        model.actuator_biasprm[actuator, 1] *= share
        model.actuator_biasprm[actuator, 2] *= share

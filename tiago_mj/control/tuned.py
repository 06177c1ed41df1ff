"""Gains of the force controller that were searched for, beside the documented ones.

``tuned_pi.json`` holds the best gains that ``benchmarks/pi_search.py`` found for the nominal gripper and a centred
object, one set a servo, with as many environment steps as an agent is trained on: what a learned policy is compared
with.
"""

from __future__ import annotations

import json
from importlib.resources import files
from typing import Any, Final

import gymnasium

from tiago_mj.control.force_pi import ForcePI, Gains
from tiago_mj.envs.flat import core_of

#: The file beside this module.
FILE: Final = "tuned_pi.json"


def tuned_gains(servo: str) -> Gains:
    """The searched gains for ``servo="pal"`` or ``"ideal"``.

    Raises:
        ValueError: there are none for that servo.
    """
    table = json.loads(files("tiago_mj.control").joinpath(FILE).read_text(encoding="utf-8"))
    if servo not in table:
        raise ValueError(f"policy pi-tuned has no gains for servo {servo!r}: there are some for {', '.join(table)}")
    return Gains(**table[servo])


def tuned_pi(env: gymnasium.Env[Any, Any]) -> ForcePI:
    """The force controller with the gains that were searched for the environment's servo.

    Raises:
        ValueError: there are no gains for its servo, or the environment has no load cells.
    """
    return ForcePI.for_env(env, tuned_gains(core_of(env).servo))

"""An actuator's element of MJCF with other gains, limits and delays, in the element's own words where it has them."""

from __future__ import annotations

import mujoco
import numpy as np

from tiago_mj.effects import model_file
from tiago_mj.export.mjcf_text import Element
from tiago_mj.export.numbers import numbers

#: What only the short forms have, and ``general`` says otherwise.
_SHORT = ("kp", "kv", "dampratio", "timeconst", "inheritrange")


def actuator_changes(
    element: Element, model: mujoco.MjModel, wanted: mujoco.MjModel, actuator: int
) -> tuple[str | None, dict[str, str | None]]:
    """A new name of the element, or None, and the attributes that change (None: taken away).

    Args:
        element: as it is written.
        model: that the element was compiled to.
        wanted: that it is to be compiled to.
        actuator: its index.
    """
    name, changes = _gains(element, model, wanted, actuator)
    for field in ("actuator_forcerange", "actuator_ctrlrange"):
        if actuator in model_file.differing_rows(model, wanted, field):
            changes[field.removeprefix("actuator_")] = numbers(*getattr(wanted, field)[actuator])
    limited = int(wanted.actuator_forcelimited[actuator])
    if limited != int(model.actuator_forcelimited[actuator]):
        changes["forcelimited"] = "true" if limited else "false"
    return name, changes


def _gains(
    element: Element, model: mujoco.MjModel, wanted: mujoco.MjModel, actuator: int
) -> tuple[str | None, dict[str, str | None]]:
    gain, bias = wanted.actuator_gainprm[actuator], wanted.actuator_biasprm[actuator]
    before, before_bias = model.actuator_gainprm[actuator], model.actuator_biasprm[actuator]
    if np.allclose(gain, before, rtol=1e-13) and np.allclose(bias, before_bias, rtol=1e-13):
        return None, {}
    kp, kv = float(gain[0]), float(-bias[2])
    if element.name in ("position", "intvelocity") and bias[1] == -kp and not bias[0]:
        changes: dict[str, str | None] = {}
        if kp != before[0]:
            changes["kp"] = numbers(kp)
        if kv != -before_bias[2] or "dampratio" in element.attributes:
            changes |= {"kv": numbers(kv), "dampratio": None}
        return None, changes
    if element.name == "velocity" and kv == kp and not bias[:2].any():
        return None, {"kv": numbers(kp)}
    own = {"gainprm": _trimmed(gain), "biasprm": _trimmed(bias)}
    if element.name == "general":
        differ = [("gainprm", gain, before), ("biasprm", bias, before_bias)]
        return None, {key: own[key] for key, one, other in differ if not np.allclose(one, other, rtol=1e-13)}
    if not bias.any():
        return "general", {**dict.fromkeys(_SHORT), "gainprm": own["gainprm"]}
    return "general", {**dict.fromkeys(_SHORT), "gaintype": "fixed", "biastype": "affine", **own}


def _trimmed(values: np.ndarray) -> str:
    """Without the zeros at the end."""
    last = int(np.flatnonzero(values)[-1]) + 1 if values.any() else 1
    return numbers(*values[:last])

"""What a model's own text elements say of its numbers, for a diagnosis: which gains were guessed, how well masses are
known."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

import mujoco

#: Name of the text in which a converted model says how well its numbers are known: effects and one standard deviation
#: of their first parameter each, as a sidecar's ``uncertainty`` has them.
UNCERTAINTY: Final = "uncertainty"
#: Standard deviation of the logarithm of a link's mass where a URDF is all there is: drawings leave out motors, screws
#: and cables. With 0.1, 0.2 and 0.4 an arm whose links are 5 and 13 % heavier has no gap, and with none a clock that
#: is 0.4 % fast (docs/diagnosis.md).
URDF_MASSES: Final = 0.2


def text(model: mujoco.MjModel, name: str) -> str | None:
    """A text element of a model; None: it has none of that name."""
    index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_TEXT, name)
    if index < 0:
        return None
    begin = int(model.text_adr[index])
    return bytes(model.text_data[begin : begin + int(model.text_size[index])]).rstrip(b"\0").decode(errors="replace")


def written(known: Mapping[str, float]) -> str:
    """The text of :data:`UNCERTAINTY`."""
    return ",".join(f"{effect}={deviation:g}" for effect, deviation in known.items())


def uncertainty(model: mujoco.MjModel) -> dict[tuple[str, str | None], float]:
    """What a converted model says of how well its numbers are known, by effect, of all targets; nothing where its text
    is another's."""
    found: dict[tuple[str, str | None], float] = {}
    for part in (text(model, UNCERTAINTY) or "").split(","):
        effect, _, said = part.partition("=")
        try:
            deviation = float(said)
        except ValueError:
            return {}
        if not 0 < deviation < math.inf:
            return {}
        found[effect, None] = deviation
    return found

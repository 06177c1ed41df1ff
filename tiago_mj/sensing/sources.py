"""Where the newtons on a pad are read from.

* ``contact``: net force of all contacts of pad and object along the cell's axis: the paper's f_contact. Nothing else.
* ``touch``: normal forces of every contact on the pad, whatever touches it, the table too; no friction.
* ``force``: force through the load-cell body along its axis, less the tare taken at reset. As a real cell it also feels
  the weight and inertia of what hangs on it.

All three are MuJoCo sensors (a batch of simulations reports nothing else) and agree in a static, straight grasp; a test
holds them against each other. In a scene without an object ``contact`` is always 0. All describe the state one physics
step before the end of the control step, as every acceleration-stage sensor does after ``mj_step`` (manual, "Sensors").
"""

from __future__ import annotations

from typing import Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from tiago_mj.io.quoting import quoted
from tiago_mj.models import names
from tiago_mj.sensing.columns import columns, joined

Array = NDArray[np.float64]

SOURCES: Final = ("contact", "touch", "force")


class PadForces:
    """Reads the forces on both pads out of ``sensordata``; every array is (..., 2), right and left."""

    def __init__(self, model: mujoco.MjModel, source: str = "contact") -> None:
        if source not in SOURCES:
            raise ValueError(f"force source {quoted(source)} is unknown: use one of {', '.join(SOURCES)}")
        self.source = source
        self._object = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, names.OBJECT_BODY) >= 0
        if self._object:
            force = _addresses(model, names.CONTACT_SENSOR)[:, None] + np.arange(1, 4)
            axis = _addresses(model, names.AXIS_SENSOR)[:, None] + np.arange(3)
            # Of x, y and z, right and then left, the force and the axis, (12,): one indexing finds all.
            self._pressed = np.stack([force, axis], axis=-1).ravel()
        if source != "contact":
            self._source = _addresses(model, names.TOUCH_SENSOR if source == "touch" else names.FORCE_SENSOR)

    def in_contact(self, sensordata: Array) -> NDArray[np.bool_]:
        """Whether pad and object press on each other, from the simulator's contacts and without noise."""
        return self.truth(sensordata) > 0

    def truth(self, sensordata: Array) -> Array:
        """Net contact force between pad and object along the axis of each load cell, positive when the pad is pressed
        [N]."""
        if not self._object:
            return np.zeros((*sensordata.shape[:-1], 2))
        rx, rx_axis, ry, ry_axis, rz, rz_axis, lx, lx_axis, ly, ly_axis, lz, lz_axis = columns(
            sensordata.take(self._pressed, axis=-1)
        )
        # The sensor gives the force of the pad on the object, and the pad site's x axis points from the face into the
        # finger: a pressed pad reads positive. A sum that begins with 0.0 is never -0.0.
        right = -(0.0 + rx * rx_axis + ry * ry_axis + rz * rz_axis)
        left = -(0.0 + lx * lx_axis + ly * ly_axis + lz * lz_axis)
        return joined((right, left))

    def read(self, sensordata: Array, tare: Array | float = 0.0) -> Array:
        """Force of the chosen source, minus the tare [N]."""
        if self.source == "contact":
            return self.truth(sensordata) - tare
        return sensordata[..., self._source] - tare

    def tare(self, sensordata: Array) -> Array:
        """The reading to subtract, taken without contact: weight on the ``force`` source, nothing on the others."""
        if self.source != "force":
            return np.zeros((*sensordata.shape[:-1], 2))
        return self.read(sensordata)


def _addresses(model: mujoco.MjModel, sensors: dict[str, str]) -> NDArray[np.intp]:
    """First number of each side's sensor in ``sensordata``."""
    try:
        return np.array([model.sensor(sensors[side]).adr[0] for side in names.SIDES], dtype=np.intp)
    except KeyError as missing:
        raise ValueError(f"this robot has no sensor {sensors['right']!r}: choose another force source") from missing

"""Simulators drawn from a diagnosis's posterior, as numbers of a user's model: what domain randomisation is written of.

A target is given a table of draws, not ranges: which numbers go together, which explanation they are of and where they
end is then kept, however the target's own distributions look. Each row is one simulator, and one as likely as another.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any, Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from tiago_mj.effects import model_file
from tiago_mj.export.drives import Drive, numbers_of
from tiago_mj.export.found import Robot
from tiago_mj.export.numbers import number
from tiago_mj.randomisation.posterior import Posterior

Array = NDArray[np.float64]

#: Of a table. Quantiles of so many draws are known to √(0.05 · 0.95 / 500) = 1 % of probability at the ends of a
#: 90 % interval.
COUNT: Final = 500
SEED: Final = 0
FILE: Final = "draws.json"
#: Numbers of a drive that a draw may change.
OF_DRIVES: Final = ("stiffness", "damping", "friction", "joint_damping", "armature", "effort", "velocity", "delay")
#: Fields of a compiled model that a draw may change, and of what their rows are; the last ones follow from others.
KINDS: Final[Mapping[str, str]] = MappingProxyType(
    {
        **dict.fromkeys(model_file.OF_JOINTS, "dof"),
        **dict.fromkeys(model_file.OF_WHOLE_JOINTS, "joint"),
        **dict.fromkeys(model_file.OF_BODIES, "body"),
        **dict.fromkeys(model_file.OF_ACTUATORS, "actuator"),
        **{"dof_invweight0": "dof", "body_invweight0": "body", "body_subtreemass": "body"},
    }
)


@dataclass(frozen=True)
class Draws:
    """A table of simulators.

    Attributes:
        source: the diagnosis.
        drives: numbers that vary, by drive's field, then joint, (n,) each, as :class:`Drive` has them.
        fields: of the compiled model that vary, by field, then name of joint, body or actuator, (n, ...) each, in
            MuJoCo's units.
    """

    source: str
    drives: Mapping[str, Mapping[str, Array]]
    fields: Mapping[str, Mapping[str, Array]]

    def lags(self, step: float) -> dict[str, tuple[int, int]]:
        """Ends of the 90 % interval of each joint's delay, in whole physics steps, where they vary."""
        ends = {joint: np.quantile(own, (0.05, 0.95)) for joint, own in self.drives.get("delay", {}).items()}
        return {joint: (max(round(low / step), 0), max(round(high / step), 0)) for joint, (low, high) in ends.items()}


def draws_of(robot: Robot, posterior: Posterior, count: int = COUNT, seed: int = SEED) -> Draws:
    """Draw simulators of a robot.

    Args:
        robot: the user's model; what the diagnosis's calibration says of it is not used.
        posterior: of the diagnosis.
        count: rows.
        seed: of the draws.

    Raises:
        ValueError: the posterior names a part that the model does not have; one line.
    """
    posterior.check_fits(robot.model, robot.wiring)
    rng = np.random.default_rng(seed)
    drives: list[tuple[Drive, ...]] = []
    models: list[mujoco.MjModel] = []
    for _ in range(count):
        numbers = numbers_of(replace(robot, entries=posterior.sample(rng)))
        drives.append(numbers.drives)
        models.append(numbers.exact)
    return Draws(posterior.source, _drives(drives), _fields(models))


def _drives(rows: Sequence[Sequence[Drive]]) -> dict[str, dict[str, Array]]:
    out: dict[str, dict[str, Array]] = {}
    for key in OF_DRIVES:
        for k, drive in enumerate(rows[0]):
            values = np.array([getattr(row[k], key) for row in rows])
            if np.isfinite(values).all() and np.ptp(values) > 0:
                out.setdefault(key, {})[drive.joint] = values
    return out


def _fields(models: Sequence[mujoco.MjModel]) -> dict[str, dict[str, Array]]:
    out: dict[str, dict[str, Array]] = {}
    for field, kind in KINDS.items():
        values = np.array([getattr(model, field) for model in models], dtype=float)
        for row in np.flatnonzero(np.ptp(values, axis=0).reshape(values.shape[1], -1).any(axis=1)).tolist():
            out.setdefault(field, {})[_name(models[0], kind, row)] = values[:, row]
    return out


def _name(model: mujoco.MjModel, kind: str, row: int) -> str:
    if kind == "dof":
        kind, row = "joint", int(model.dof_jntid[row])
    return str(getattr(model, kind)(row).name)


def table(source: str, columns: Mapping[str, Mapping[str, Array]], about: str) -> str:
    """A table as JSON text.

    Args:
        source: the diagnosis.
        columns: by quantity, then name, (n, ...) each.
        about: units and meaning, in a sentence.
    """
    counts = {len(values) for own in columns.values() for values in own.values()}
    data = {
        "about": about,
        "source": source,
        "count": counts.pop() if counts else 0,
        "columns": {key: {name: _plain(values) for name, values in own.items()} for key, own in columns.items()},
    }
    return json.dumps(data, ensure_ascii=False) + "\n"


def _plain(values: Array) -> Any:
    """With as many digits as other files have."""
    return [_plain(one) for one in values] if values.ndim > 1 else [float(number(float(one))) for one in values]

"""Effects on any MuJoCo model, in three lines: a stepper that is commanded and measured as the real robot is.

robot = apply(mujoco.MjModel.from_xml_path("my_robot.xml"), "diagnosis/calibration.yaml")
robot.reset()
robot.step({"elbow": 0.3})
"""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from tiago_mj.effects import read_effects, written
from tiago_mj.effects.model_file import MARK
from tiago_mj.effects.runner import LoadCells, Runner
from tiago_mj.effects.wiring import wire
from tiago_mj.gap.simulation.plant import substeps
from tiago_mj.io.quoting import quoted
from tiago_mj.recordings.record.plain import interface_of, scalar_joints, touch_sensors

Array = NDArray[np.float64]

#: What a calibration of a plain robot says beside its effects, and :func:`apply` takes from it.
KEYS: Final = ("rate_hz", "interface", "timestep", "joints", "actuators")


class Stepper:
    """One simulation with effects in it.

    Attributes:
        model, data: MuJoCo's own, the true state; the model is a copy of the user's.
        joints, actuators: names, in the order of the arrays.
        period: of control [s].
        position, velocity: as measured, (njoints,) [m, rad], per second.
        force: of the model's touch sensors as measured, (nsensors,) [N].
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        effects: Any,
        *,
        rate_hz: float,
        interface: str,
        timestep: float,
        joints: Sequence[str],
        actuators: Sequence[str],
        seed: int,
    ) -> None:
        self.model = copy.copy(model)
        self.period = 1 / rate_hz
        self._substeps = substeps(self.period, timestep)
        self.model.opt.timestep = self.period / self._substeps
        self.data = mujoco.MjData(self.model)
        touch = touch_sensors(model)
        self._cells = LoadCells(touch.newtons)
        self._wiring = wire(
            self.model,
            joints=joints,
            actuators=actuators,
            sensors=touch.names,
            interface=interface,
        )
        self.joints, self.actuators = self._wiring.targets.joint, self._wiring.targets.command
        self._seed = seed
        self._runner = Runner.of_one(self.data, self._wiring, read_effects(effects), self._uniform)
        self.reset()

    def reset(
        self,
        qpos: ArrayLike | Mapping[str, float] | None = None,
        qvel: ArrayLike | None = None,
        set_point: Mapping[str, float] | None = None,
    ) -> None:
        """Begin anew.

        Args:
            qpos: joint positions by name, as they are measured, the rest as in the model's first keyframe or reference
                pose; or all of MuJoCo's ``qpos``, (nq,), the robot's joints in it as they are measured.
            qvel: (nv,); at rest if None.
            set_point: by actuator, of servos that hold one; if None where their joints are.

        Raises:
            ValueError: an unknown name, or a shape that is not the model's; one line.
        """
        self._runner.restore()
        model, data, wiring = self.model, self.data, self._wiring
        if model.nkey:
            mujoco.mj_resetDataKeyframe(model, data, 0)
        else:
            mujoco.mj_resetData(model, data)
        if isinstance(qpos, Mapping):
            for name, value in qpos.items():
                data.qpos[wiring.qpos[_place(name, self.joints, "joint")]] = value
        elif qpos is not None:
            data.qpos[:] = _shaped(qpos, (model.nq,), "qpos")
        if qvel is not None:
            data.qvel[:] = _shaped(qvel, (model.nv,), "qvel")
        points = data.qpos[wiring.qpos[list(wiring.targets.actuated)]].copy()
        for name, value in (set_point or {}).items():
            points[_place(name, self.actuators, "actuator")] = value
        stateful = wiring.act >= 0
        data.act[wiring.act[stateful]] = points[stateful]
        data.qpos[wiring.qpos] = self._runner.chain.true_position(data.qpos[wiring.qpos][None])[0]
        self._rng = np.random.default_rng(self._seed)
        self._runner.start(self.period, self._substeps, held=points[None])
        mujoco.mj_forward(model, data)
        self._command = points if wiring.interface == "position" else np.zeros(len(self.actuators))
        self._measure()

    def step(self, command: ArrayLike | Mapping[str, float]) -> None:
        """Let a command act for one control period, and measure.

        Args:
            command: (nactuators,) in the order of ``actuators``, or by name: others keep theirs.

        Raises:
            ValueError: an unknown name, another shape, or no finite number; one line.
        """
        if isinstance(command, Mapping):
            wanted = self._command.copy()
            for name, value in command.items():
                wanted[_place(name, self.actuators, "actuator")] = value
        else:
            wanted = _shaped(command, (len(self.actuators),), "command")
        if not np.isfinite(wanted).all():
            name = self.actuators[int(np.flatnonzero(~np.isfinite(wanted))[0])]
            raise ValueError(f"command of {name!r} is no finite number: give one")
        self._command = wanted
        self._runner.advance(wanted[None])
        self._measure()

    def _measure(self) -> None:
        measured = self._runner.measured(self._cells)
        self.position, self.velocity, self.force = measured.position[0], measured.velocity[0], measured.reading[0]

    def _uniform(self, shape: tuple[int, ...]) -> Array:
        return self._rng.random(shape)


def apply(
    model: mujoco.MjModel,
    calibration: Any,
    *,
    rate_hz: float | None = None,
    interface: str | None = None,
    timestep: float | None = None,
    joints: Sequence[str] | None = None,
    actuators: Sequence[str] | None = None,
    seed: int = 0,
    numbers: bool = True,
) -> Stepper:
    """A model with effects, as a stepper.

    What is not given is taken from the calibration, as the diagnosis of a plain model writes it.

    Args:
        model: any, without the effects; it is not changed.
        calibration: path of a ``calibration.yaml``, or effects in any other form (docs/effects.md).
        rate_hz: of the commands [Hz].
        interface: ``position``, ``velocity`` or ``effort``; else what the actuators take.
        timestep: longest physics step [s]; else the model's own. Whole steps of at most this make a control period.
        joints: that are measured; else all hinges and slides.
        actuators: that are commanded; else all.
        seed: of effects that draw at random.
        numbers: whether the model's own numbers as the diagnosis fitted them act beside the effects.

    Raises:
        ValueError: the effects do not fit the model, nothing says the rate, or the model is a repaired one, which has
            them; one line.
    """
    if mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_TEXT, MARK) >= 0:
        raise ValueError("this model is a repaired one, which has the effects: give the one that was diagnosed")
    said = _said(calibration)
    rate_hz = rate_hz or said.get("rate_hz")
    if rate_hz is None or not rate_hz > 0:
        raise ValueError("nothing says how often the robot is commanded: give rate_hz=")
    return Stepper(
        model,
        read_effects(calibration, numbers=numbers),
        rate_hz=float(rate_hz),
        interface=interface or said.get("interface") or interface_of(model),
        timestep=float(timestep or said.get("timestep") or model.opt.timestep),
        joints=tuple(joints or said.get("joints") or scalar_joints(model)),
        actuators=tuple(actuators or said.get("actuators") or (model.actuator(a).name for a in range(model.nu))),
        seed=seed,
    )


def _said(calibration: Any) -> Mapping[str, Any]:
    """What a calibration says beside its effects; empty for effects alone."""
    if isinstance(calibration, (str, Path)):
        calibration = written.load(calibration)
    if isinstance(calibration, Mapping) and "schema" in calibration:
        said = written.calibration(calibration)
        return {key: said[key] for key in KEYS if said.get(key) is not None}
    return {}


def _place(name: str, names: Sequence[str], what: str) -> int:
    if name not in names:
        raise ValueError(f"there is no {what} {quoted(name)}: this robot has {', '.join(names)}")
    return list(names).index(name)


def _shaped(values: ArrayLike, shape: tuple[int, ...], what: str) -> Array:
    out = np.array(values, dtype=float)
    if out.shape != shape:
        raise ValueError(f"{what} has shape {out.shape}: give {shape}, or numbers by name")
    return out

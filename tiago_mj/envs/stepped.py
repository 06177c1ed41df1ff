"""One simulated robot, stepped by its commands under effects."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import replace
from typing import Any, Final

import mujoco
import numpy as np
from gymnasium_robotics.envs.robot_env import MujocoRobotEnv
from numpy.typing import NDArray

from tiago_mj.effects import Entry, read_effects
from tiago_mj.effects.now import Wiring
from tiago_mj.effects.runner import Runner
from tiago_mj.effects.wiring import wire
from tiago_mj.envs import checks, copies
from tiago_mj.envs.drive import Drive
from tiago_mj.envs.fixed import Fixed
from tiago_mj.envs.sensors import Measured, OneOf, Sensors
from tiago_mj.models import names

Array = NDArray[np.float64]

#: Warnings with which MuJoCo gives a simulation up and resets it (manual, "Simulation", "Diagnostics").
UNSTABLE: Final = slice(int(mujoco.mjtWarning.mjWARN_BADQPOS), int(mujoco.mjtWarning.mjWARN_BADQACC) + 1)
#: What ``n_substeps`` may be set to.
MOST_SUBSTEPS: Final = 10_000


class SteppedRobot(MujocoRobotEnv):  # type: ignore[misc]
    """What lets commands act for one control period after another; a derived class makes the scene and its start."""

    joints: Fixed[tuple[str, ...]] = Fixed()
    control: Fixed[str] = Fixed()
    servo: Fixed[str] = Fixed()
    drive: Drive
    sensors: Sensors
    _effects: tuple[Entry, ...]
    _runner: Runner
    _period: float
    _ctrl: NDArray[np.intp]

    @abstractmethod
    def contact(self) -> tuple[float, float, int] | None:
        """Stiffness [N/m], damping [N·s/m] and contact points of one pad with the present object; None without one."""

    @property
    def effects(self) -> tuple[Entry, ...]:
        """What acts on this robot; :meth:`give_effects` changes it."""
        return self._effects

    @property
    def set_points(self) -> Array:
        """The servos' set points, (N,) [m, rad]."""
        points: Array = self.data.act[self._ctrl].copy()
        return points

    def _act_under(self, effects: tuple[Entry, ...]) -> None:
        """Let effects act on what is commanded and measured, by the same runner that the diagnosis simulates with."""
        self._runner = Runner.of_one(self.data, self.wiring(), effects, self._uniform)
        self._effects = effects
        chain = self._runner.chain
        self._measured: Measured | None = None if chain.passes_readings else OneOf(chain)

    def _uniform(self, shape: tuple[int, ...]) -> Array:
        return self.np_random.random(shape)

    def give_effects(self, effects: Any) -> None:
        """Let other effects act from now on; the episode goes on from where it is.

        What an effect remembers begins anew, and what it changes of an episode's start is changed at the next reset.

        Args:
            effects: as for the constructor; None for none.

        Raises:
            ValueError: they do not fit this robot; one line. Those before act on.
        """
        self._runner.restore()
        try:
            self._act_under(read_effects(effects))
        finally:
            data = self.data
            state = data.qpos.copy(), data.qvel.copy(), data.act.copy()
            self._runner.start(self._period, self.n_substeps, self.contact())
            data.qpos[:], data.qvel[:], data.act[:] = state
            mujoco.mj_forward(self.model, data)

    def make_nominal(self) -> None:
        """Take back what effects did to the model, until the next reset."""
        self._runner.restore()

    def wiring(self) -> Wiring:
        """Where commands, joints and sensors are, for effects and the diagnosis."""
        wiring = wire(
            self.model,
            joints=self.joints,
            actuators=self.joints,
            sensors=names.SIDES if self.sensors.pads is not None else (),
            interface=self.control,
        )
        return replace(wiring, ideal=self.servo == "ideal")

    def _set_action(self, action: Array) -> None:
        self.command = self.drive.command(action, self.data.act)

    def _mujoco_step(self, command: Array) -> None:
        self._runner.advance(command[None])

    @property
    def diverged(self) -> bool:
        """Whether MuJoCo has given this episode's simulation up."""
        return bool(np.count_nonzero(self.data.warning.number[UNSTABLE]))

    def __getstate__(self) -> dict[str, Any]:
        """All that ``copy.deepcopy`` and ``pickle`` keep, in mid-episode too; a renderer's window or context is not."""
        return copies.kept(self)

    def __setstate__(self, state: dict[str, Any]) -> None:
        copies.restore(self, state)

    @property
    def n_substeps(self) -> int:
        """Physics steps in a control step. Set, it acts from the next step on.

        Raises:
            ValueError: no whole number from 1 to :data:`MOST_SUBSTEPS`.
            AttributeError: effects act, which reckon with the physics step.
        """
        return self._n_substeps

    @n_substeps.setter
    def n_substeps(self, count: Any) -> None:
        made = "_runner" in vars(self)
        if made and self._effects:
            raise AttributeError("n_substeps cannot be changed while effects act: set it first, then give_effects")
        self._n_substeps = checks.whole_number("n_substeps", count, MOST_SUBSTEPS)
        if made:
            self._runner.chain.now.substeps = self._n_substeps

    @property
    def dt(self) -> float:
        """Control period by the clock of whoever commands [s]."""
        return self._period

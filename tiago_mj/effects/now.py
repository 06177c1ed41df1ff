"""What an effect's hook may know and use: where the plant's parts are, the simulations, the time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tiago_mj.effects.host import Host
from tiago_mj.effects.targets import Targets

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Wiring:
    """Where the chain finds the plant's parts.

    Attributes:
        targets: names and nominal limits.
        actuators: ids, (nactuators,).
        ctrl, act: addresses of their inputs and set points, (nactuators,); act is -1 where there is none.
        qpos, dof: addresses of the joints, (njoints,).
        servo: per actuator, whether it is a position servo whose set point the chain may move.
        span: limits of the set points, (nactuators, 2) [m, rad]; infinite where there are none.
        interface: ``velocity``, ``position`` or ``effort``.
        ideal: whether set points are kept from running away from the joints (servo="ideal").
        tool: body that a payload hangs on.
        grasp_axis: unit vector from the right to the left finger in the world, (3,).
        partner: per actuator, the one that a coupling error couples it to.
        carrier: per joint, the one of them that carries it and moves as it does, turning or sliding; -1: there is none.
        object_qpos, object_body, object_geom, pairs: of the object between the pads; None without one.
    """

    targets: Targets
    actuators: NDArray[np.intp]
    ctrl: NDArray[np.intp]
    act: NDArray[np.intp]
    qpos: NDArray[np.intp]
    dof: NDArray[np.intp]
    servo: NDArray[np.bool_]
    span: Array
    interface: str
    ideal: bool
    tool: int
    grasp_axis: Array
    partner: NDArray[np.intp]
    carrier: NDArray[np.intp]
    object_qpos: int | None = None
    object_body: int | None = None
    object_geom: int | None = None
    pairs: tuple[int, ...] = ()


class Now:
    """What an effect's hook may know and use: the wiring, the host, the time, the joints, random numbers."""

    def __init__(self, host: Host, wiring: Wiring, uniform: Callable[[tuple[int, ...]], Array]) -> None:
        self.host = host
        self.wiring = wiring
        self.uniform = uniform
        self.nsim = host.nsim
        self.step = 0
        self.dt = np.zeros(host.nsim)
        self.clock = np.ones(host.nsim)
        """True seconds in one second of the recorder's clock, (nsim,)."""
        self.substeps = 1
        """Physics steps in a control period."""
        self.elapsed = np.zeros(host.nsim)
        """True time since the episode began, (nsim,) [s]."""
        self.idle = np.zeros((host.nsim, len(wiring.actuators)))
        """What an actuator was commanded before the first command, (nsim, nactuators)."""
        self.resting = self.idle
        """Input of the servos before the first command, (nsim, nactuators)."""
        self.takes_set_points = np.zeros(len(wiring.actuators), dtype=bool)
        """Which actuators are plain position servos, (nactuators,): their input is the set point itself."""
        self.set_point = self.idle
        """Set points at the start, (nsim, nactuators) [m, rad]."""
        self.contact: tuple[float, float, int] | None = None
        """Stiffness [N/m], damping [N·s/m] and contact points of one pad with the object; None without one."""
        self.rebuild = False
        """An effect sets it when it changed masses or inertias, whose derived constants must follow."""

    @property
    def time(self) -> Array:
        """Since the episode began, (nsim, 1) [s]."""
        return self.elapsed[:, None]

    @property
    def period(self) -> Array:
        """Control period, (nsim, 1) [s]."""
        return self.dt[:, None]

    @property
    def joint_position(self) -> Array:
        """True joint positions, (nsim, njoints) [m, rad]."""
        return self.host.state("qpos")[:, self.wiring.qpos]

    @property
    def joint_velocity(self) -> Array:
        """True joint velocities, (nsim, njoints) [m/s, rad/s]."""
        return self.host.state("qvel")[:, self.wiring.dof]

    @property
    def joint_effort(self) -> Array:
        """Actuator forces on the joints as of the last physics step, (nsim, njoints) [N, N·m]."""
        return self.host.output("qfrc_actuator")[:, self.wiring.dof]

    def fill(self, name: str, where: NDArray[np.bool_], values: Sequence[float]) -> None:
        """Write a row of numbers into a joint field, (nsim, nv, k), where (nsim, njoints) says."""
        field = self.host.field(name)
        sim, joint = np.nonzero(where)
        field[sim, self.wiring.dof[joint]] = values

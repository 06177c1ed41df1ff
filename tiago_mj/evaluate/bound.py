"""The least cost of an episode of the paper's task: what no controller can stay below.

Cost is minus the paper's reward, Σ_t Σ_i |f_i − goal| [sensor units]. It follows from three facts of the nominal model:

1. *No finger is ahead of one that closes at the speed limit from the first step on.* Without contact a servo and its
   finger are linear in the commanded speed, and what a pulse of speed moves the finger by has one sign at all times
   (a test takes the response of both servos): every command below the limit leaves the finger behind. Contact with the
   object only pushes it back.
2. *A pad that does not touch reads 0.* Before the near finger can reach the object both fingers cost their goals. Until
   the distance between the pads can be the object's width, wherever the object has been pushed to, one of them does.
   (An object in the middle: both at the same time. Else it is taken to stay upright.)
3. *A force's reading is the goal at best.*

That is :attr:`LeastCost.exact`. With the sensor's noise ε, independent of the force, E|f + ε − goal| is least at
f = goal and grows with the distance from it; at those forces it is :attr:`LeastCost.expected`: no controller's *mean*
can be below.

:attr:`LeastCost.pressed` adds what the force takes to rise: that of a finger which goes on closing at the speed limit,
until it is at the goal. It is the bound if no way of closing has more force earlier, which is not proven here; the
search of ``benchmarks/force_bound.py`` has found none.
"""

from __future__ import annotations

import copy
import math
from dataclasses import dataclass
from typing import Any, Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from tiago_mj.effects.runner import Runner
from tiago_mj.envs.hold_force import HoldForce
from tiago_mj.models import names, scene
from tiago_mj.models.objects import GraspObject

Array = NDArray[np.float64]

#: Where nothing can be touched: the object is put so far from the robot along x [m].
AWAY: Final = 5.0


@dataclass(frozen=True)
class LeastCost:
    """The bound of one episode [sensor units, summed over fingers and steps].

    Attributes:
        steps: of the episode.
        first_contact: first control step whose reading the near finger's contact can be in.
        both_contacts: the same of both fingers at once.
        exact: without noise.
        expected: mean with the sensor's noise.
        pressed: without noise, and with the rise of the force of fingers that go on closing.
        pressed_expected: the same with the sensor's noise.
    """

    steps: int
    first_contact: int
    both_contacts: int
    exact: float
    expected: float
    pressed: float
    pressed_expected: float


def least_cost(core: Any, steps: int) -> LeastCost:
    """The bound of the episode that a core environment is at the start of.

    Args:
        core: a :class:`HoldForce` of the gripper alone, after ``reset``; it is not changed.
        steps: of the episode.

    Raises:
        ValueError: there is no bound for this environment; says why.
    """
    check(core)
    item, offset, goal = core.item, core.offset, np.asarray(core.goal, dtype=np.float64)
    travel = free_travel(core, steps)
    opening = scene.opening(copy.copy(core.model))
    gaps = (opening - item.width) / 2 + offset * np.array([1.0, -1.0])  # right, left: the offset is to the left
    near = _first(travel > gaps)
    both = _first(travel.sum(axis=1, keepdims=True) > opening - item.width)
    least = np.tile(goal, (steps, 1))  # the force nearest to the goal that each reading can have
    least[:near] = 0.0
    cheaper = int(np.argmin(goal))  # between the two instants one finger reads 0: the one whose goal is smaller
    least[near:both, cheaper] = 0.0
    risen = least.copy()
    forces = closing_forces(core, steps)
    for i in range(2):
        there = _first(forces[:, i] >= goal[i])
        risen[both:there, i] = np.minimum(forces[both:there, i], goal[i])
    noise = core.load_cell.noises
    return LeastCost(
        steps=steps,
        first_contact=near + 1,
        both_contacts=both + 1,
        exact=float((goal - least).sum()),
        expected=float(expected_distance(goal - least, noise).sum()),
        pressed=float((goal - risen).sum()),
        pressed_expected=float(expected_distance(goal - risen, noise).sum()),
    )


def check(core: Any) -> None:
    """Refuse an environment for which the bound does not hold.

    Raises:
        ValueError: says why.
    """
    if not isinstance(core, HoldForce) or core.force_type == "none":
        raise ValueError("the bound is of holding a force that load cells feel: use GripperTactile-v0")
    if core.joints != names.FINGERS:
        raise ValueError("the bound is of the gripper alone: an arm can carry a finger to the object")
    if core.effects:
        raise ValueError("the bound is of the nominal model: leave the effects out")
    if core.load_cell.average != 1 or np.any(np.asarray(core.load_cell.bias)):
        raise ValueError("the bound is of a load cell without averaging and bias")
    if core.force_source != "contact":
        raise ValueError("the bound is of force_source 'contact': another source feels more than the object")


def expected_distance(distance: Array, noise: Array) -> Array:
    """E|distance + ε|, ε ~ N(0, noise²): the folded normal's mean (Leone, Nelson and Nottingham 1961)."""
    noise = np.broadcast_to(np.asarray(noise, dtype=np.float64), distance.shape)
    scaled = np.divide(distance, noise, out=np.full(distance.shape, np.inf), where=noise > 0)
    erf = np.vectorize(math.erf)(scaled / math.sqrt(2))
    return np.where(
        noise > 0,
        noise * math.sqrt(2 / math.pi) * np.exp(-(np.minimum(np.abs(scaled), 1e3) ** 2) / 2) + distance * erf,
        np.abs(distance),
    )


def free_travel(core: Any, steps: int) -> Array:
    """Distance that each finger closes at the speed limit without an obstacle, (steps, 2) [m].

    Row t is what the readings of control step t + 1 are of: the state one physics step before its end.
    """
    data, runner = _start(core, core.item, np.array([AWAY, 0.0]))
    begin = np.array(data.qpos[core.qpos_address])
    rows = []
    for _ in range(steps):
        rows.append(begin - _closing_step(core, data, runner))
    return np.array(rows)


def closing_forces(core: Any, steps: int) -> Array:
    """Readings without noise of both fingers closing at the speed limit on the object in their middle, (steps, 2)."""
    data, runner = _start(core, core.item, core.object_place(0.0))
    rows = []
    for _ in range(steps):
        _closing_step(core, data, runner)
        rows.append(core.load_cell.signal(core.sensors.pads.truth(data.sensordata)))
    return np.array(rows)


def _start(core: Any, item: GraspObject, place: Array) -> tuple[mujoco.MjData, Runner]:
    data = mujoco.MjData(core.model)
    data.qpos[:] = core.start_qpos(item, place)
    data.act[:] = core.start_act(data.qpos)
    runner = Runner.of_one(data, core.wiring(), (), np.zeros)
    runner.start(core.dt, core.n_substeps)
    mujoco.mj_forward(core.model, data)
    return data, runner


def _closing_step(core: Any, data: mujoco.MjData, runner: Runner) -> Array:
    """One control step at the limit; the fingers' positions one physics step before its end, (2,) [m]."""
    seen = [np.array(data.qpos[core.qpos_address])]
    command = core.drive.command(-np.ones(2), data.act)
    runner.advance(
        command[None],
        parts=core.n_substeps,
        between=lambda part: seen.append(np.array(data.qpos[core.qpos_address])),
    )
    return seen[-1]


def _first(when: NDArray[np.bool_]) -> int:
    """Index of the first row where it is so for any finger; the number of rows where it never is."""
    rows = np.logical_or.reduce(np.atleast_2d(when.T), axis=0)
    return int(np.argmax(rows)) if rows.any() else len(rows)

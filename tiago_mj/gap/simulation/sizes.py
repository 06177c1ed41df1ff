"""How large the forces, speeds and masses of a robot are, so that effects are sought at magnitudes that fit it.

The library's bounds are those of TIAGo: 12 N·m of friction are plausible on its arm, lock a hobby servo and are next to
nothing on an industrial arm. A plain model brings its own scale: what its actuators do in the nominal replay, and what
its joints carry.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.effects.fields import Parameter
from tiago_mj.effects.inertia import removable_inertia
from tiago_mj.gap.simulation.plant import Plant
from tiago_mj.gap.simulation.replay import Signals
from tiago_mj.recordings.recording import Trial

Array = NDArray[np.float64]

#: Bounds of an effect in units of the joint's size: a friction that takes all of the actuator's force, a damping that
#: takes three times of it at the fastest that the joint was, a spring that takes three times of it over the way that
#: the joint went, gears that reflect thirty times the inertia of what is moved (a small motor's rotor behind 300:1), a
#: tool three times as heavy as what there is. What inertia may lack is what can be taken away
#: (:func:`tiago_mj.effects.inertia.removable_inertia`).
FRICTION: Final = 1.0
DAMPING: Final = 3.0
SPRING: Final = 3.0
INERTIA: Final = 30.0
MASS: Final = (-0.9, 3.0)
#: Units of what has such bounds.
ESTIMATED: Final = frozenset({"N", "N·m", "N·s/m", "N·m·s/rad", "N/m", "N·m/rad", "kg", "kg·m²"})


@dataclass(frozen=True)
class Size:
    """Of one joint.

    Attributes:
        force: the largest of its actuator in the nominal replay, or commanded, and what its servo adds where the
            recording departs from that: friction that stops a light joint takes more than its motion [N, N·m].
        speed: the fastest that was measured [m/s, rad/s].
        travel: from the lowest to the highest position that was measured [m, rad].
        inertia: that it moves [kg, kg·m²].
        removable: what of that reality may lack [kg, kg·m²].
        mass: of what it carries [kg].
    """

    force: float
    speed: float
    travel: float
    inertia: float
    removable: float
    mass: float

    def within(self, added: Parameter, low: float, high: float) -> tuple[float, float]:
        """Bounds of what an effect adds, as they fit the joint; ``low`` and ``high`` where it has no scale for them.

        Args:
            added: the parameter; its unit says of what it is an amount.
            low, high: its bounds in the library. What cannot be taken away there cannot be here.
        """
        friction = FRICTION * self.force
        damping = DAMPING * self.force / self.speed if self.speed > 0 else np.inf
        spring = SPRING * self.force / self.travel if self.travel > 0 else np.inf
        own = {
            ("N", "N·m"): (-friction, friction),
            ("N·s/m", "N·m·s/rad"): (-damping, damping),
            ("N/m", "N·m/rad"): (-spring, spring),
            ("kg", "kg·m²"): (-self.removable, INERTIA * self.inertia),
            ("kg", "kg"): (MASS[0] * self.mass, MASS[1] * self.mass),
        }.get(added.unit)
        if added.identity != 0 or own is None or not own[1] > 0 or not np.isfinite(own[1]):
            return low, high
        return (own[0] if low < 0 else 0.0), own[1]


def sizes(plant: Plant, trials: Sequence[Trial], nominal: Signals) -> tuple[Size, ...] | None:
    """Sizes of the joints; None for the package's own robots, which the library's bounds are made for.

    Args:
        plant, trials: what was replayed.
        nominal: one row a trial.
    """
    if plant.environment is not None:
        return None
    found = []
    stiffness = _stiffnesses(plant)
    forces, nominal_speeds = largest(trials, nominal.effort), largest(trials, nominal.velocity)
    removable = removable_inertia(plant.model, plant.wiring.dof)
    for j, (name, dof) in enumerate(zip(plant.joints, plant.wiring.dof, strict=True)):
        measured = [trial.velocities[name] for trial in trials if name in trial.velocities]
        speeds = [float(np.nanmax(np.abs(v))) for v in measured if np.isfinite(v).any()]
        body = int(plant.model.dof_bodyid[dof])
        found.append(
            Size(
                force=float(forces[j] + stiffness[j] * _departs(trials, nominal, name, j)),
                speed=max(speeds, default=float(nominal_speeds[j])),
                travel=_travel(trials, nominal, name, j),
                inertia=float(plant.model.dof_M0[dof]),
                removable=float(removable[j]),
                mass=float(plant.model.body_subtreemass[body]),
            )
        )
    return tuple(found)


def largest(trials: Sequence[Trial], signals: Array) -> Array:
    """The largest absolute value of signals of joints while each trial lasts, (njoints,).

    Rows that fill a shorter trial up to the longest are no part of it. At the first row no command was sent yet: a
    servo's force there would be that of its distance from zero, 260 kN on an axis that moves with 145 N.

    Args:
        trials: recorded.
        signals: one row a trial, (ntrials, T, njoints).
    """
    each = [
        np.abs(one[1 : len(trial.time)]).max(axis=0, initial=0.0) for trial, one in zip(trials, signals, strict=True)
    ]
    found: Array = np.max(each, axis=0)
    return found


def _travel(trials: Sequence[Trial], nominal: Signals, name: str, joint: int) -> float:
    """From a joint's lowest to its highest position [m, rad], in the nominal replay where none was measured."""
    each = [trial.positions.get(name, nominal.position[k, : len(trial.time), joint]) for k, trial in enumerate(trials)]
    seen = np.concatenate([one[np.isfinite(one)] for one in each])
    return float(np.ptp(seen)) if len(seen) else 0.0


def _stiffnesses(plant: Plant) -> Array:
    """Of the position servos of each joint, (njoints,) [N/m, N·m/rad]; 0 without one."""
    found, model, wiring = np.zeros(len(plant.joints)), plant.model, plant.wiring
    for actuator, joint, servo in zip(wiring.ctrl, wiring.targets.actuated, wiring.servo, strict=True):
        if servo:
            found[joint] -= model.actuator_biasprm[actuator, 1] * model.actuator_gear[actuator, 0] ** 2
    return found


def _departs(trials: Sequence[Trial], nominal: Signals, name: str, joint: int) -> float:
    """How far a joint's recorded positions are from the nominal replay at most [m, rad]; 0 where none are."""
    each = [
        np.abs(trial.positions[name] - nominal.position[k, : len(trial.time), joint])
        for k, trial in enumerate(trials)
        if name in trial.positions
    ]
    return max((float(np.nanmax(one)) for one in each if np.isfinite(one).any()), default=0.0)

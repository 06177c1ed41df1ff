"""Play and elasticity between motor and joint as MJCF: a second joint in the body, the idiom of MuJoCo's manual.

The manual (Modeling, "Backlash"; MuJoCo 4.0) puts two joints at the same place and axis into a body and lets the
actuator act on the first. Here the user's joint becomes the motor's and keeps its name, so that actuators stay as they
are; the second has a range of the play's width, or a spring. What the user's joint had of range, friction, damping,
armature and spring belongs to both together: a fixed tendon over the two has it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import mujoco
import numpy as np

from tiago_mj.effects import EFFECTS, Entry
from tiago_mj.effects.spec import arrays
from tiago_mj.export.found import Robot
from tiago_mj.export.mjcf_text import Element, Mjcf
from tiago_mj.export.numbers import numbers

#: Inertia of a motor that is said to have none, in servo stiffness times the physics step squared: before play this
#: many, or as many more as keep it below a share of the joint's inertia. What files leave of the mean squared gap on
#: four joints with play, in smooth motion at a step of 2 ms: 11 to 92 % with 1, 0.9 to 9 % with 4, 0.1 to 1.2 % with
#: 16; in jerky motion of a light joint heavier motors are worse. Smaller steps are better with any.
PLAY_LEAST: Final = 4.0
PLAY_MOST: Final = 16.0
PLAY_SHARE: Final = 0.05
#: And no less than this share of what the servo's damping does in a step, which MuJoCo's constraints do not see: on a
#: UR5e, whose damping times the step is as much as the inertia of its joints, 12 to 79 % are left so, and with half as
#: much or nothing 14 to 84 and 44 to 560 %; twice as much again is worse.
PLAY_DAMPED: Final = 0.5
#: Before a spring: in jerky motion 0.85 and 0.13 of what the effect does is left with 1, 2.7 and 0.14 with 4.
SPRING: Final = 1.0
#: In the joint's own inertia: MuJoCo's mass matrix is near singular below.
LIGHTEST_SHARE: Final = 1e-4
#: The teeth: a time constant of two steps is the shortest that MuJoCo takes, and an impedance near 1 lets nothing in.
TEETH_SOLIMP: Final = "0.99 0.9999 0.0001 0.5 2"
TEETH_STEPS: Final = 2.0
#: Elements that name a joint and mean both together afterwards, with the names of those that measure a tendon.
OF_TENDONS: Final = {"jointpos": "tendonpos", "jointvel": "tendonvel"}
#: Elements that name a joint and go on meaning the motor's.
OF_THE_MOTOR: Final = ("jointactuatorfrc",)


@dataclass(frozen=True)
class Play:
    """One joint that is split in two.

    Attributes:
        effect: that it is of.
        joint: its name.
        index: of the joint.
        width: of the play [m, rad]; 0: there is none.
        stiffness, damping: of the spring between motor and joint [N/m, N·m/rad], [N·s/m, N·m·s/rad]; 0: there is none.
        inertia: of the motor [kg, kg·m²].
        light: whether the motor was said to have none.
        step: physics step [s].
    """

    effect: str
    joint: str
    index: int
    width: float
    stiffness: float
    damping: float
    inertia: float
    light: bool
    step: float

    @property
    def second(self) -> str:
        """Name of the second joint."""
        return f"{self.joint}_{'play' if self.width else 'spring'}"

    @property
    def both(self) -> str:
        """Name of the tendon over both."""
        return f"{self.joint}_total"

    @property
    def how(self) -> str:
        """The form in which the file has it."""
        what = "a second joint with a range" if self.width else "a second joint with a spring"
        motor = f"the motor has {numbers(float(f'{self.inertia:.3g}'))} kg·m² (kg)"
        return f"{what}; {motor}{', as little as the physics step bears' if self.light else ''}"

    @property
    def told(self) -> str:
        """What a user has to know."""
        return (
            f"{self.joint} is the motor's position now, and {self.joint} + {self.second} the joint's: read the tendon "
            f"{self.both}. A shorter physics step brings the file nearer to {self.effect.replace('_', ' ')}."
        )


def plays(robot: Robot, by_name: Mapping[str, Sequence[Entry]]) -> tuple[Play, ...]:
    """Joints that a second joint gives play or elasticity, of effects that no number holds.

    A joint that nothing drives has neither. Nothing is split where a joint would have both.
    """
    out: dict[str, Play] = {}
    for effect in ("backlash", "joint_elasticity"):
        for one in _of(robot, effect, by_name.get(effect, ())):
            if one.joint in out:
                return ()
            out[one.joint] = one
    return tuple(out.values())


def _of(robot: Robot, effect: str, entries: Sequence[Entry]) -> list[Play]:
    if not entries:
        return []
    targets, model = robot.wiring.targets, robot.model
    said = arrays(EFFECTS[effect], [entries], targets)
    out = []
    for k, name in enumerate(targets.joint):
        if not said.present[0, k] or k not in targets.actuated:
            continue
        actuator = int(robot.wiring.actuators[targets.actuated.index(k)])
        width = float(said.width[0, k]) if effect == "backlash" else 0.0  # type: ignore[attr-defined]
        stiffness = 0.0 if effect == "backlash" else float(said.stiffness[0, k])  # type: ignore[attr-defined]
        damping = 0.0 if effect == "backlash" else float(said.damping[0, k])  # type: ignore[attr-defined]
        given = float(said.motor[0, k])  # type: ignore[attr-defined]
        step = float(model.opt.timestep)
        gear = float(model.actuator_gear[actuator, 0])
        held = -float(model.actuator_biasprm[actuator, 1]) * gear**2 + stiffness
        own = 1 / float(model.dof_invweight0[robot.wiring.dof[k]])
        damped = -float(model.actuator_biasprm[actuator, 2]) * gear**2 * step
        inertia = given or max(_lightest(held * step**2, damped, own, bool(width)), LIGHTEST_SHARE * own)
        index = model.joint(name).id
        out.append(Play(effect, name, index, width, stiffness, damping, inertia, not given, step))
    return out


def _lightest(stiff: float, damped: float, own: float, has_play: bool) -> float:
    """Inertia of a motor that is said to have none.

    Args:
        stiff: what the motor is held by [kg, kg·m²]: stiffness times the physics step squared.
        damped: the servo's damping times the physics step [kg, kg·m²].
        own: inertia of the joint [kg, kg·m²].
        has_play: whether play follows the motor, else a spring.
    """
    if not has_play:
        return SPRING * stiff
    return max(PLAY_LEAST * stiff, min(PLAY_MOST * stiff, PLAY_SHARE * own), PLAY_DAMPED * damped)


def split(mjcf: Mjcf, model: mujoco.MjModel, one: Play) -> None:
    """Give a joint its second one, and what it had to a tendon over both.

    Raises:
        ValueError: the joint is not written out, or something else than actuators and sensors refers to it; one line.
    """
    joint = mjcf.joint(one.joint)
    if joint is None:
        raise ValueError(f"joint {one.joint!r} is not written out in the model's files: write it out")
    _turn_sensors(mjcf, one)
    dof = int(model.jnt_dofadr[one.index])
    tendon = {
        "name": one.both,
        **_limits(model, one.index),
        **_nonzero("armature", max(model.dof_armature[dof] - (0.0 if one.light else one.inertia), 0.0)),
        **_nonzero("damping", model.dof_damping[dof]),
        **_nonzero("frictionloss", model.dof_frictionloss[dof]),
    }
    if model.dof_frictionloss[dof]:
        tendon["solreffriction"] = numbers(*model.dof_solref[dof])
        tendon["solimpfriction"] = numbers(*model.dof_solimp[dof])
    if model.jnt_stiffness[one.index]:
        tendon["stiffness"] = numbers(float(np.max(model.jnt_stiffness[one.index])))
        tendon["springlength"] = numbers(float(model.qpos_spring[model.jnt_qposadr[one.index]]))
    mjcf.insert_after(joint, f"<joint {_attributes(_second(mjcf, joint, model, one))}/>")
    mjcf.set(joint, _motor(joint, model, one))
    both = f'<joint joint="{one.joint}" coef="1"/><joint joint="{one.second}" coef="1"/>'
    mjcf.append(f"  <tendon>\n    <fixed {_attributes(tendon)}>{both}</fixed>\n  </tendon>")


def _second(mjcf: Mjcf, joint: Element, model: mujoco.MjModel, one: Play) -> dict[str, str]:
    """Attributes of the second joint: place and axis of the first, and nothing else of it."""
    kept = {key: joint.attributes[key] for key in ("class", "type", "pos", "axis") if key in joint.attributes}
    none = {"armature": "0", "damping": "0", "frictionloss": "0"}
    if not one.width:
        spring = {"stiffness": numbers(one.stiffness), "damping": numbers(one.damping)}
        return {"name": one.second, **kept, "limited": "false", **none, **spring, "springref": "0", "ref": "0"}
    hinge = model.jnt_type[one.index] == mujoco.mjtJoint.mjJNT_HINGE
    half = np.degrees(one.width / 2) if hinge and mjcf.in_degrees else one.width / 2
    reference = numbers(TEETH_STEPS * one.step, 1.0)
    limits = {"limited": "true", "range": numbers(-half, half)}
    teeth = {"solreflimit": reference, "solimplimit": TEETH_SOLIMP}
    return {"name": one.second, **kept, **limits, **teeth, **none, "stiffness": "0", "ref": "0"}


def _motor(joint: Element, model: mujoco.MjModel, one: Play) -> dict[str, str | None]:
    """What changes of the user's joint, which becomes the motor's."""
    dof = int(model.jnt_dofadr[one.index])
    changes: dict[str, str | None] = {"armature": numbers(float(f"{one.inertia:.6g}"))}
    for name, value in (("damping", model.dof_damping[dof]), ("frictionloss", model.dof_frictionloss[dof])):
        if np.any(value):
            changes[name] = "0"
    changes |= {key: None for key in ("solreffriction", "solimpfriction") if key in joint.attributes}
    if model.jnt_stiffness[one.index]:
        changes["stiffness"] = "0"
    if model.jnt_limited[one.index]:
        changes |= {"limited": "false", "range": None}
    return changes


def _limits(model: mujoco.MjModel, joint: int) -> dict[str, str]:
    if not model.jnt_limited[joint]:
        return {}
    return {
        "limited": "true",
        "range": numbers(*model.jnt_range[joint]),
        "solreflimit": numbers(*model.jnt_solref[joint]),
        "solimplimit": numbers(*model.jnt_solimp[joint]),
    }


def _turn_sensors(mjcf: Mjcf, one: Play) -> None:
    """Let sensors of the joint measure both together."""
    for element in mjcf.elements:
        naming = [key for key in ("joint", "joint1", "joint2") if element.attributes.get(key) == one.joint]
        above = element.parent.name if element.parent is not None else ""
        if not naming or above == "actuator" or element.name in OF_THE_MOTOR:
            continue
        if element.name not in OF_TENDONS:
            raise ValueError(
                f"{element.name} refers to joint {one.joint!r}, which {one.effect} splits in two: take it away, or use "
                "tiago_mj.gap.apply"
            )
        mjcf.set(element, {"joint": None, "tendon": one.both}, OF_TENDONS[element.name])


def lengthen_keys(mjcf: Mjcf, model: mujoco.MjModel, splits: Sequence[Play]) -> None:
    """Give keyframes a 0 for each second joint."""
    for element in mjcf.elements:
        if element.name != "key":
            continue
        for attribute, addresses in (("qpos", model.jnt_qposadr), ("qvel", model.jnt_dofadr)):
            if attribute not in element.attributes:
                continue
            values = element.attributes[attribute].split()
            for one in sorted(splits, key=lambda each: each.index, reverse=True):
                values.insert(int(addresses[one.index]) + 1, "0")
            mjcf.set(element, {attribute: " ".join(values)})


def check(model: mujoco.MjModel, wanted: mujoco.MjModel, splits: Sequence[Play], name: str) -> None:
    """Refuse a compiled model that is not the wanted one with second joints.

    Raises:
        ValueError: one line.
    """
    there = all(mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, one.second) >= 0 for one in splits)
    grown = model.nv == wanted.nv + len(splits) and model.nu == wanted.nu
    same = np.allclose(model.body_mass, wanted.body_mass) and np.allclose(model.body_inertia, wanted.body_inertia)
    if not (there and grown and same):
        raise ValueError(f"{name} does not take {splits[0].effect} as a second joint: use tiago_mj.gap.apply")


def _nonzero(name: str, value: float | np.ndarray) -> dict[str, str]:
    return {name: numbers(float(np.max(value)))} if np.any(value) else {}


def _attributes(values: Mapping[str, str]) -> str:
    return " ".join(f'{key}="{value}"' for key, value in values.items())

"""The object, its contact, and gravity."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np

from benchmarks.blind.effects.base import Effect
from benchmarks.blind.robots import Robot, press
from tiago_mj.models import names
from tiago_mj.models.objects import give_object


def _swap(robot: Robot, **changes: float) -> None:
    """Give the robot's object other numbers; sizes and contacts follow."""
    assert robot.item is not None
    robot.item = replace(robot.item, **changes)  # type: ignore[arg-type]
    give_object(robot.model, robot.item)
    press(robot.model, robot.item.stiffness, robot.item.damping)
    robot.model.pair_friction[:, :2] = robot.item.friction


class ContactStiffness(Effect):
    def build(self, robot: Robot) -> None:
        assert robot.item is not None
        _swap(robot, stiffness=robot.item.stiffness * self.values["factor"])


class ContactDamping(Effect):
    def build(self, robot: Robot) -> None:
        assert robot.item is not None
        _swap(robot, damping=robot.item.damping * self.values["factor"])


class ContactFriction(Effect):
    def build(self, robot: Robot) -> None:
        assert robot.item is not None
        robot.model.pair_friction[:, :2] = robot.item.friction * self.values["factor"]


class ObjectSize(Effect):
    def build(self, robot: Robot) -> None:
        assert robot.item is not None
        _swap(robot, width=robot.item.width + 2 * self.values["radius"])


class ObjectOffset(Effect):
    """The object stands elsewhere along the grasp axis than the user says."""

    def build(self, robot: Robot) -> None:
        robot.middle = robot.middle + self.values["distance"] * robot.along


class ObjectMass(Effect):
    def build(self, robot: Robot) -> None:
        assert robot.item is not None
        _swap(robot, mass=robot.item.mass * self.values["factor"])


class Payload(Effect):
    """A lump at the tool that nobody told the gravity compensation of."""

    def build(self, robot: Robot) -> None:
        model, mass = robot.model, self.values["mass"]
        body = model.body(names.GRIPPER_BODY).id if robot.item is not None else _last(model)
        offset = np.array([0.0, 0.0, -0.05]) if robot.item is None and "gripper" in model.body(body).name else 0.0
        old = float(model.body_mass[body])
        share = mass / (old + mass)
        model.body_ipos[body] = (1 - share) * model.body_ipos[body] + share * (model.body_ipos[body] + offset)
        model.body_mass[body] = old + mass
        model.body_gravcomp[body] *= old / (old + mass)
        if np.any(offset):  # a lump beside a body's centre adds to its inertia, too
            _turn_with(model, body, share * old, np.asarray(offset))
        mujoco.mj_setConst(model, mujoco.MjData(model))


def _turn_with(model: mujoco.MjModel, body: int, mass: float, arm: np.ndarray) -> None:
    """Add to a body's inertia what two parts have about their common centre: their reduced mass at a distance."""
    turn = np.zeros(9)
    mujoco.mju_quat2Mat(turn, model.body_iquat[body])
    axes = turn.reshape(3, 3)
    whole = axes @ np.diag(model.body_inertia[body]) @ axes.T + mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    moments, axes = np.linalg.eigh(whole)
    axes[:, 2] *= np.sign(np.linalg.det(axes))
    quaternion = np.zeros(4)
    mujoco.mju_mat2Quat(quaternion, axes.ravel())
    model.body_inertia[body], model.body_iquat[body] = moments, quaternion


def _last(model: mujoco.MjModel) -> int:
    """The gripper's body where there is one, else the last body."""
    index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, names.GRIPPER_BODY)
    return index if index >= 0 else model.nbody - 1


class GravityTilt(Effect):
    """The table leans about the grasp axis, so that things slide along the other horizontal axis."""

    def build(self, robot: Robot) -> None:
        angle = self.values["angle"]
        axis = np.array([*robot.along, 0.0]) if robot.item is not None else np.array([0.0, 1.0, 0.0])
        down = robot.model.opt.gravity.copy()
        robot.model.opt.gravity[:] = down * np.cos(angle) + np.cross(axis, down) * np.sin(angle)

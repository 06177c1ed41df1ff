"""A test bench for compliant contacts: two pads on slides face an object, as a parallel gripper does.

It depends on MuJoCo alone, so that what it finds about ``tiago_mj.models.compliance`` does not rest on the rest of the
package.
"""

from __future__ import annotations

import mujoco
import numpy as np
from scipy.linalg import expm
from scipy.optimize import least_squares

SIDES = ("right", "left")
PAD = np.array([0.0029, 0.01475, 0.01475])  #: half sizes [m] of the TA11's pad
FINGER_MASS = 0.11  #: [kg]
FINGER_DAMPING = 80.0  #: [N·s/m]
SERVO_STIFFNESS = 2000.0  #: [N/m]
EFFORT = 16.0  #: [N]

SHAPES = {
    "cylinder": (mujoco.mjtGeom.mjGEOM_CYLINDER, lambda half: [half, 0.05, 0]),
    "box": (mujoco.mjtGeom.mjGEOM_BOX, lambda half: [half, 0.02, 0.05]),
    "sphere": (mujoco.mjtGeom.mjGEOM_SPHERE, lambda half: [half, 0, 0]),
    "capsule": (mujoco.mjtGeom.mjGEOM_CAPSULE, lambda half: [half, 0.05, 0]),
    "ellipsoid": (mujoco.mjtGeom.mjGEOM_ELLIPSOID, lambda half: [half, 0.03, 0.04]),
}


def gripper(
    shape: str = "cylinder",
    *,
    half_width: float = 0.02,
    mass: float = 0.421,
    timestep: float = 1 / 960,
    servo: bool = True,
    table: bool = True,
    gap: float = 0.003,
    offset: float = 0.0,
    impratio: float = 10.0,
    finger_damping: float = FINGER_DAMPING,
) -> mujoco.MjModel:
    """Pads that close along x on an object; ``ctrl`` is their advance [m], or their force [N] without a servo."""
    spec = mujoco.MjSpec()
    spec.option.timestep = timestep
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = impratio
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    for sign, side in zip((-1, 1), SIDES, strict=True):
        body = spec.worldbody.add_body(name=side, pos=[sign * (half_width + PAD[0] + gap), 0, 0.05])
        body.add_joint(name=side, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[-sign, 0, 0], damping=finger_damping)
        body.add_geom(name=side, type=mujoco.mjtGeom.mjGEOM_BOX, size=PAD, mass=FINGER_MASS)
        actuator = spec.add_actuator(name=side, target=side, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        actuator.set_to_position(kp=SERVO_STIFFNESS) if servo else actuator.set_to_motor()
        actuator.forcelimited, actuator.forcerange = 1, [-EFFORT, EFFORT]
    body = spec.worldbody.add_body(name="object", pos=[offset, 0, 0.05])
    body.add_freejoint()
    kind, size = SHAPES[shape]
    body.add_geom(name="object", type=kind, size=size(half_width), mass=mass)
    friction = [1, 1, 0.005, 1e-4, 1e-4]
    for side in SIDES:
        spec.add_pair(name=side, geomname1=side, geomname2="object", condim=4, friction=friction)
    if table:
        spec.worldbody.add_geom(name="table", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[1, 1, 0.1])
        spec.add_pair(name="table", geomname1="object", geomname2="table", condim=4, friction=[0.5, 0.5, 0.005, 0, 0])
    else:
        spec.option.gravity = [0, 0, 0]
    return spec.compile()


def pad_forces(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    """Normal contact force on each pad [N], (2,), right and left."""
    forces, wrench = np.zeros(2), np.zeros(6)
    for index, contact in enumerate(data.contact):
        names = {model.geom(contact.geom1).name, model.geom(contact.geom2).name}
        for i, side in enumerate(SIDES):
            if side in names:
                mujoco.mj_contactForce(model, data, index, wrench)
                forces[i] += wrench[0]
    return forces


def approach(model: mujoco.MjModel, data: mujoco.MjData, gap: float = 0.003) -> np.ndarray:
    """How far each pad and the (centred) object have come closer since they touched [m], (2,)."""
    x = data.body("object").xpos[0]
    return np.array([data.joint("right").qpos[0] - x, data.joint("left").qpos[0] + x]) - gap


def squeeze(model: mujoco.MjModel, levels: np.ndarray, seconds: float = 1.5) -> tuple[np.ndarray, np.ndarray, float]:
    """Press with each force [N] in turn; the settled forces and approaches, (levels, 2), and the fastest speed left."""
    data = mujoco.MjData(model)
    forces, distances, speed = [], [], 0.0
    for level in levels:
        data.ctrl[:] = level
        mujoco.mj_step(model, data, round(seconds / model.opt.timestep))
        mujoco.mj_forward(model, data)
        forces.append(pad_forces(model, data))
        distances.append(approach(model, data))
        speed = max(speed, float(np.abs(data.qvel).max()))
    return np.array(forces), np.array(distances), speed


def closing(
    model: mujoco.MjModel, *, speed: float = 0.08, travel: float = 0.009, seconds: float = 0.4, rate: float = 240.0
) -> np.ndarray:
    """Pad forces [N], (steps, 2), at ``rate`` [Hz] while the set point closes at ``speed`` [m/s] and then holds."""
    data = mujoco.MjData(model)
    substeps = round(1 / (rate * model.opt.timestep))
    forces = []
    for step in range(round(seconds * rate)):
        data.ctrl[:] = min(speed * (step + 1) / rate, travel)
        mujoco.mj_step(model, data, substeps)
        mujoco.mj_forward(model, data)
        forces.append(pad_forces(model, data))
    return np.array(forces)


def drop(
    shape: str = "sphere", *, mass: float = 0.421, timestep: float = 1 / 960, height: float = 0.01
) -> mujoco.MjModel:
    """An object above a plane, both in the pair ``contact``; it starts ``height`` [m] above the plane."""
    kind, size = SHAPES[shape]
    spec = mujoco.MjSpec()
    spec.option.timestep = timestep
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.worldbody.add_geom(name="table", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[1, 1, 0.1])
    body = spec.worldbody.add_body(name="object", pos=[0, 0, 0.05 + height])
    body.add_freejoint()
    body.add_geom(name="object", type=kind, size=size(0.05 if shape == "sphere" else 0.02), mass=mass)
    spec.add_pair(name="contact", geomname1="object", geomname2="table", condim=4)
    return spec.compile()


def first_touch(model: mujoco.MjModel, seconds: float = 0.5) -> tuple[np.ndarray, np.ndarray]:
    """From touch to lift-off (or the end): (δ, δ̇, δ̈) as (steps, 3) in SI units, and the contact force [N], (steps,)."""
    data, wrench = mujoco.MjData(model), np.zeros(6)
    states, forces = [], []
    for _ in range(round(seconds / model.opt.timestep)):
        mujoco.mj_step(model, data)
        mujoco.mj_forward(model, data)
        force = 0.0
        for index in range(data.ncon):
            mujoco.mj_contactForce(model, data, index, wrench)
            force += wrench[0]
        if force > 0.0:
            states.append([0.05 - data.qpos[2], -data.qvel[2], -data.qacc[2]])
            forces.append(force)
        elif states:
            break
    return np.array(states), np.array(forces)


def oscillator(
    states: np.ndarray, timestep: float, *, stiffness: float, damping: float, mass: float, virtual_mass: float
) -> np.ndarray:
    """Stiffness and damping of the path δ(t) of a dropped body, (2,), as shares of the given ones.

    Fits (m + M) δ̈ + C δ̇ + K δ = m g, solved exactly, to the positions alone, from the first state's δ and δ̇ on.
    """
    inertia = mass + virtual_mass

    def path(scale: np.ndarray) -> np.ndarray:
        k, c = scale * (stiffness, damping)
        step = expm(timestep * np.array([[0, 1, 0], [-k / inertia, -c / inertia, mass * 9.81 / inertia], [0, 0, 0]]))
        state, positions = np.array([*states[0, :2], 1.0]), []
        for _ in states:
            positions.append(state[0])
            state = step @ state
        return np.array(positions)

    depth = states[:, 0].max()
    return np.asarray(least_squares(lambda scale: (path(scale) - states[:, 0]) / depth, [1.0, 1.0]).x)


def creep_speed(model: mujoco.MjModel, squeeze_force: float = 8.0) -> float:
    """How fast an object sinks [m/s] that two pads without a servo hold against its weight."""
    data = mujoco.MjData(model)
    data.ctrl[:] = squeeze_force
    mujoco.mj_step(model, data, round(1.0 / model.opt.timestep))
    model.opt.gravity[2] = -9.81
    mujoco.mj_step(model, data, round(0.5 / model.opt.timestep))
    start = data.body("object").xpos[2]
    mujoco.mj_step(model, data, round(0.5 / model.opt.timestep))
    return float((start - data.body("object").xpos[2]) / 0.5)

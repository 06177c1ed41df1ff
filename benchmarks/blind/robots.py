"""The robots of the blind check as they really are: the nominal models, made different by a few per cent everywhere.

The bodies come from the published models. Everything that the diagnosis would have to be right about (servos, sensing,
every effect) is written in this folder again, and differently. The servos are not MuJoCo's: they are computed here, at
another time step, with another integrator, and act through plain motors.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from benchmarks.blind import six_joints
from tiago_mj.io import atomic
from tiago_mj.models import names, scene
from tiago_mj.models.objects import GraspObject

Array = NDArray[np.float64]

#: Physics step of robots that are compared with reality [s]. At 1 ms, forces after a contact's onset are off by three
#: times what noise leaves in means of a quarter of a second at 240 Hz.
STEP: Final = 5e-4
#: Longest step at which everything is stable but stiff effects (bristles, gear teeth) and the arm, whose wrists are
#: light and firmly damped [s]: where only differences between two simulations count.
COARSE_STEP: Final = 1e-3
#: Physics step of reality [s]. At 0.5 ms a hinge's readings are off by up to 0.9 variances of
#: their noise, the arm's light wrist's by 2; and where both fingers press with about their limits, the step decides
#: which of them gives way, by millimetres (benchmarks/truth_audit).
FINE_STEP: Final = 1.25e-4
#: Impedance of the pads' contacts: not the nominal 0.5, so that the artefact of MuJoCo's contacts (a virtual mass)
#: differs too.
IMPEDANCE: Final = 0.35
#: Noise floor of what an encoder gives: the learning_fc project's for the real fingers [m]; ours for the rest.
FINGER_NOISE: Final = (2.7e-5, 5e-4)
ARM_NOISE: Final = (1.0e-4, 2e-3)
TORSO_NOISE: Final = (5e-5, 5e-4)
#: Real TA11 (paper, section III-B) [sensor units].
FORCE_NOISE: Final = 0.0077
FINGER_SPEED: Final = 0.08
#: Points at which a flat pad touches an upright cylinder.
POINTS: Final = 2
#: Sensor units per newton of the nominal load cell: 100 · newtons / 606.06.
UNITS_PER_NEWTON: Final = 330 / 2000


@dataclass
class Robot:
    """A robot ready to be simulated; arrays over joints, (n,).

    Attributes:
        model: compiled, with one plain motor a joint.
        joints: names, in the order of every array.
        stiffness, damping: of the servos [N/m, N·s/m or N·m/rad, N·m·s/rad].
        limit: of the servos' forces [N, N·m].
        speed: limit of the set points [m/s, rad/s].
        low, high: range of the joints [m, rad].
        start: initial configuration, (nq,).
        inertia: effective inertia of the joints at the start [kg, kg·m²].
        noise: standard deviations of position and velocity, (2, n).
        units: sensor units per newton, (2,); empty without load cells.
        force_noise: standard deviation [sensor units].
        pads: (2, 2, 3) indices of contact force and axis in ``sensordata``; None without load cells.
        item: the object as it really is; None without.
        middle, along: place between the fingers and grasp axis on the table, (2,).
        step, coarse: physics step, and the longest that is stable [s].
        truth: extra facts for the label.
        models: with several robots in one simulation, each trial's; arrays over joints are then (ntrials, n).
    """

    model: mujoco.MjModel
    joints: tuple[str, ...]
    stiffness: Array
    damping: Array
    limit: Array
    speed: Array
    low: Array
    high: Array
    start: Array
    inertia: Array
    noise: Array
    units: Array
    force_noise: float
    pads: NDArray[np.intp] | None
    item: GraspObject | None
    middle: Array
    along: Array
    turned: Array
    step: float = STEP
    coarse: float = COARSE_STEP
    truth: dict[str, Any] = field(default_factory=dict)
    models: list[mujoco.MjModel] = field(default_factory=list)

    @property
    def qpos(self) -> NDArray[np.intp]:
        """Addresses of the joints' positions, (n,)."""
        return np.array([self.model.joint(name).qposadr[0] for name in self.joints])

    @property
    def dof(self) -> NDArray[np.intp]:
        """Addresses of the joints' velocities, (n,)."""
        return np.array([self.model.joint(name).dofadr[0] for name in self.joints])


class Jitter:
    """Factors about 1 that nobody knows: truncated normal, ``spread`` wide; exactly 1 where it is 0. And centres of
    mass, of which each coordinate is ``off_centre`` of the link's reach off."""

    def __init__(self, rng: np.random.Generator, spread: float, off_centre: float = 0.0) -> None:
        self._rng, self.spread, self._off_centre = rng, spread, off_centre

    def __call__(self, shape: Any = (), share: float = 1.0) -> Any:
        """Factors of a shape; ``share`` of the spread."""
        drawn = np.clip(self._rng.standard_normal(shape), -2, 2)
        return 1.0 + self.spread * share * drawn

    def move_centres(self, model: mujoco.MjModel) -> None:
        """Move the centre of mass of every body that a joint carries."""
        if not self._off_centre:
            return
        for body in np.flatnonzero(model.body_weldid):
            ends = [model.body_ipos[body], *model.body_pos[np.flatnonzero(model.body_parentid == body)]]
            reach = max(float(np.linalg.norm(end)) for end in ends)
            model.body_ipos[body] += self._off_centre * reach * np.clip(self._rng.standard_normal(3), -2, 2)
        mujoco.mj_setConst(model, mujoco.MjData(model))


def robot_of(
    setting: str, jitter: Jitter, *, folder: Path | None = None, other_source: bool = False, fine: bool = False
) -> Robot:
    """The real robot of a setting.

    Args:
        setting: ``gripper``, ``arm``, ``plain`` or ``six``.
        jitter: of every nominal number.
        folder: where the model lies that a user brings along.
        other_source: its masses are those of another publication than the nominal model's.
        fine: whether it takes steps of :data:`FINE_STEP`.
    """
    if setting in MODELS:
        assert folder is not None
        made = _plain(setting, folder, jitter)
    else:
        made = _tiago(setting, jitter, other_source)
    if fine:
        made.step = FINE_STEP
    return made


def nominal_object() -> GraspObject:
    """What the user believes to be on the table."""
    return GraspObject()


def _tiago(setting: str, jitter: Jitter, other_source: bool) -> Robot:
    believed = nominal_object()
    truth: dict[str, Any] = {}
    item = GraspObject(
        width=believed.width * float(jitter(share=0.1)),
        height=believed.height,
        mass=believed.mass * float(jitter()),
        stiffness=believed.stiffness * float(jitter()),
        damping=believed.damping * float(jitter()),
        friction=believed.friction * float(jitter()),
    )
    robot = "gripper_ta11" if setting == "gripper" else "tiago_ta11"
    thing = item if setting == "gripper" else None
    config = scene.SceneConfig(robot=robot, item=thing, timestep=STEP, velocity_limits={})
    spec, nominal = scene.build_spec(config)
    joints = names.FINGERS if setting == "gripper" else names.TIAGO_JOINTS
    ids = [nominal.actuator(name).id for name in joints]
    stiffness = nominal.actuator_gainprm[ids, 0] * jitter(len(ids))
    damping = -nominal.actuator_biasprm[ids, 2] * jitter(len(ids))
    limit = nominal.actuator_forcerange[ids, 1] * jitter(len(ids))
    speed = nominal.actuator_ctrlrange[ids, 1].copy()
    speed[[joints.index(name) for name in names.FINGERS]] = FINGER_SPEED
    keyed = np.array(nominal.key("pre_grasp").qpos)
    if other_source:
        truth["other_source"] = _other_masses(spec, setting)
    for body in spec.bodies:
        if body.name and body.name != names.OBJECT_BODY and body.mass > 0:
            scale = float(jitter())
            body.mass *= scale
            body.fullinertia = np.array(body.fullinertia) * scale
            body.inertia = np.array(body.inertia) * scale
    for joint in spec.joints:
        if joint.name in joints:
            joint.damping = np.array(joint.damping) * float(jitter())
            joint.frictionloss *= float(jitter())
    motors(spec, joints)
    _options(spec)
    model = spec.compile()
    jitter.move_centres(model)
    if thing is not None:
        press(model, item.stiffness, item.damping)
        model.pair_friction[:, :2] = item.friction
    made = _assemble(model, joints, stiffness, damping, limit, speed, keyed, jitter)
    made.item, made.truth = thing, truth
    made.coarse = COARSE_STEP if thing is not None else STEP
    fingers = np.isin(joints, names.FINGERS)
    made.noise = np.where(fingers, np.array(FINGER_NOISE)[:, None], np.array(ARM_NOISE)[:, None])
    made.noise = np.where(np.isin(joints, names.TORSO), np.array(TORSO_NOISE)[:, None], made.noise)
    if thing is not None:
        made.units = UNITS_PER_NEWTON * jitter(2)
        made.pads = np.array(
            [
                [model.sensor(table[side]).adr[0] + first + np.arange(3) for side in names.SIDES]
                for table, first in ((names.CONTACT_SENSOR, 1), (names.AXIS_SENSOR, 0))
            ]
        )
        _grasp_frame(made)
    return made


#: From other publications than the nominal model's: pal-robotics/tiago_robot 9c460fb, google-deepmind/mujoco_menagerie
#: dd150f1b [kg]; the finger is the standard one's, which models of the TA11 finger keep by mistake.
OTHER_MASSES: Final = {
    "gripper": {"gripper_right_finger_link": 0.107001, "gripper_left_finger_link": 0.107001},
    "arm": {"arm_3_link": 1.8, "arm_1_link": 2.08308, "arm_4_link": 1.89279, "arm_5_link": 1.07424},
}
#: Mass of load cell and fingertip, which the standard finger's figure holds already [kg].
_BEHIND_FINGER: Final = 0.0463 + 0.0053


def _other_masses(spec: mujoco.MjSpec, setting: str) -> dict[str, float]:
    for name, mass in OTHER_MASSES[setting].items():
        body = spec.body(name)
        new = mass - (_BEHIND_FINGER if setting == "gripper" else 0.0)
        scale = new / body.mass
        body.mass = new
        body.fullinertia = np.array(body.fullinertia) * scale
    return dict(OTHER_MASSES[setting])


def motors(spec: mujoco.MjSpec, joints: tuple[str, ...]) -> None:
    """Replace every actuator by a motor without dynamics of its own, one a joint; the servos are ours."""
    for actuator in list(spec.actuators):
        spec.delete(actuator)
    for key in list(spec.keys):
        spec.delete(key)
    for name in joints:
        motor = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        motor.set_to_motor()


def _options(spec: mujoco.MjSpec) -> None:
    spec.option.timestep = STEP
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_EULER


def press(model: mujoco.MjModel, stiffness: float, damping: float) -> None:
    """Give both pads' contacts a spring and a damper [N/m, N·s/m].

    For one of n points that share the load, MuJoCo's reference acceleration k, b (direct ``solref``) makes a force of
    d/(1 - d) · (k δ + b δ') / (Â d) a point in equilibrium of the two bodies' inverse weights Â (manual, Computation,
    "Parameters"), d being the impedance: totals K = n k / ((1 - d) Â) and C = n b / ((1 - d) Â).
    """
    for pair in range(model.npair):
        bodies = model.geom_bodyid[[model.pair_geom1[pair], model.pair_geom2[pair]]]
        weight = float(model.body_invweight0[bodies, 0].sum())
        # Stable while (h C + h² K / 2) (1 - d) Â / (n d) stays below 2 (semi-implicit Euler of the two bodies).
        least = (COARSE_STEP * damping + COARSE_STEP**2 * stiffness / 2) * weight / POINTS / 1.2
        impedance = max(IMPEDANCE, least / (1 + least))
        per = (1 - impedance) * weight / POINTS
        model.pair_solref[pair] = -stiffness * per, -damping * per
        model.pair_solimp[pair] = impedance, impedance, 0.001, 0.5, 2.0


def _assemble(
    model: mujoco.MjModel,
    joints: tuple[str, ...],
    stiffness: Array,
    damping: Array,
    limit: Array,
    speed: Array,
    start: Array,
    jitter: Jitter,
) -> Robot:
    data = mujoco.MjData(model)
    data.qpos[: len(start)] = start
    mujoco.mj_forward(model, data)
    inverse = np.zeros((model.nv, model.nv))
    mujoco.mj_solveM(model, data, inverse, np.eye(model.nv))
    dof = [int(model.joint(name).dofadr[0]) for name in joints]
    ranges = np.array([model.joint(name).range for name in joints])
    return Robot(
        model=model,
        joints=joints,
        stiffness=stiffness,
        damping=damping,
        limit=limit,
        speed=speed,
        low=ranges[:, 0],
        high=ranges[:, 1],
        start=data.qpos.copy(),
        inertia=1 / np.diag(inverse)[dof],
        noise=np.zeros((2, len(joints))),
        units=np.zeros(0),
        force_noise=FORCE_NOISE * float(jitter()),
        pads=None,
        item=None,
        middle=np.zeros(2),
        along=np.zeros(2),
        turned=np.array([1.0, 0, 0, 0]),
    )


def _grasp_frame(robot: Robot) -> None:
    data = mujoco.MjData(robot.model)
    data.qpos[:] = robot.start
    mujoco.mj_kinematics(robot.model, data)
    right, left = (data.site(names.PAD_SITE[side]).xpos for side in names.SIDES)
    across = (left - right)[:2]
    robot.along = across / np.linalg.norm(across)
    robot.middle = np.array(data.site(names.GRASP_SITE).xpos[:2])
    yaw = np.arctan2(across[1], across[0])
    robot.turned = np.array([np.cos(yaw / 2), 0, 0, np.sin(yaw / 2)])


# A plain model -------------------------------------------------------------------------------------------------------

PLAIN_FILE: Final = "pendulum.xml"
#: A link of 0.6 kg, 0.25 m long, on a position servo: numbers of a medium hobby servo.
PLAIN: Final = """<mujoco model="pendulum">
  <compiler angle="radian"/>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <body name="link" pos="0 0 1">
      <joint name="hinge" type="hinge" axis="0 1 0" range="-1.6 1.6" damping="0.25" armature="0.02"/>
      <geom name="rod" type="capsule" fromto="0 0 0 0 0 -0.25" size="0.015" mass="0.15"/>
      <geom name="bob" type="sphere" pos="0 0 -0.25" size="0.04" mass="0.45"/>
    </body>
  </worldbody>
  <actuator>
    <position name="hinge" joint="hinge" kp="25" kv="0.6" ctrlrange="-1.6 1.6" forcerange="-6 6"/>
  </actuator>
</mujoco>
"""
PLAIN_NOISE: Final = (5e-4, 5e-3)
#: Models that a user brings along: file, text, noise of positions and velocities.
MODELS: Final = {"plain": (PLAIN_FILE, PLAIN, PLAIN_NOISE), "six": (six_joints.FILE, six_joints.MJCF, ARM_NOISE)}


def put_model(setting: str, folder: Path) -> Path | None:
    """Write the model that a user has of a setting's robot; None where it is one of this project's."""
    if setting not in MODELS:
        return None
    name, text, _ = MODELS[setting]
    atomic.write_text(folder / name, text)
    return folder / name


def _plain(setting: str, folder: Path, jitter: Jitter) -> Robot:
    name, _, noise = MODELS[setting]
    spec = mujoco.MjSpec.from_file(str(folder / name))
    nominal = spec.compile()
    joints, n = tuple(actuator.name for actuator in spec.actuators), nominal.nu
    for geom in spec.geoms:
        geom.mass *= float(jitter())
    for joint in spec.joints:
        joint.damping = np.array(joint.damping) * float(jitter())
        joint.armature *= float(jitter())
    motors(spec, joints)
    _options(spec)
    model = spec.compile()
    jitter.move_centres(model)
    made = _assemble(
        model,
        joints,
        nominal.actuator_gainprm[:, 0] * jitter(n),
        -nominal.actuator_biasprm[:, 2] * jitter(n),
        nominal.actuator_forcerange[:, 1] * jitter(n),
        np.full(n, np.inf),
        np.zeros(n),
        jitter,
    )
    made.noise = np.repeat(np.array(noise)[:, None], n, axis=1)
    return made


# Several robots at once ----------------------------------------------------------------------------------------------


def stack(several: list[Robot], each: int) -> Robot:
    """One simulation of several robots of a kind: each for so many trials, one robot after the other."""
    first = several[0]

    def rows(name: str) -> Array:
        return np.repeat(np.array([getattr(robot, name) for robot in several]), each, axis=0)

    arrays = ("stiffness", "damping", "limit", "speed", "low", "high", "units", "inertia", "middle")
    return replace(
        first,
        models=[robot.model for robot in several for _ in range(each)],
        **{name: rows(name) for name in arrays},
    )

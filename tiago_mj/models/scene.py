"""Scenes: a robot beside a table, an object between its fingers, ready to be compiled.

World frame of the TIAGo scenes: the robot's base footprint at the origin, x forward, z up. The gripper-only robot is
mounted where TIAGo's pre-grasp pose has its gripper: pads at the same height over the same table, levelled (TIAGo's own
hand is 2.6 degrees nose-down there) and turned so that it points along x and closes along y.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from tiago_mj.io.quoting import is_one_of, quoted
from tiago_mj.models import compliance, names
from tiago_mj.models.files import model_file
from tiago_mj.models.objects import SHAPES, GraspObject, give_object

ROBOTS: Final = ("gripper_ta11", "tiago_ta11", "tiago_pal_gripper")
SERVOS: Final = ("pal", "ideal")

#: Box 0.55 m wide and deep whose top stands at 0.545 m, centred 0.7 m before the robot (llach/tiago_rl cc5ce92).
TABLE_HALF: Final = (0.275, 0.275, 0.275)
TABLE_CENTRE: Final = (0.7, 0.0, 0.27)
TABLE_TOP: Final = TABLE_CENTRE[2] + TABLE_HALF[2]

#: Pads' height in the gripper-only scene [m]: that of the object of the same project's TIAGo scenes, (0.73, 0.07, 0.6).
GRIPPER_GRASP_POINT: Final = (0.7, 0.0, 0.6)
#: gripper_link's axes in the world: x (right finger opens) -> -y, y -> z, z -> -x (the hand points along -z).
GRIPPER_QUATERNION: Final = (0.5, 0.5, -0.5, -0.5)

#: A site of the world that an environment moves to its goal, for the eye only.
GOAL_SITE: Final = "goal"

#: Contact points that share the load of one flat pad on an object of that shape, as MuJoCo's collider finds them
#: (:func:`tiago_mj.models.contact_points.shared_contact_points`; a test compares).
CONTACT_POINTS: Final = {"cylinder": 2, "box": 4}


@dataclass(frozen=True)
class SceneConfig:
    """Contents of a scene: robot, table and object.

    Attributes:
        robot: one of :data:`ROBOTS`.
        item: the object on the table, or None for an empty table.
        servo: ``pal``: a velocity command moves the set point of the position servo that the real robot has;
            ``ideal``: the velocity is tracked almost at once, within the effort limit, as the 2021 project's constraint
            did. It needs a time step of about half a millisecond to be stiff.
        timestep: of the physics [s].
        velocity_limits: by joint [m/s, rad/s], where they differ from the robot's.
        goal_radius: of a sphere that shows a goal in space [m]; None for none.
        visual: whether the geoms that are only seen are there.
    """

    robot: str
    item: GraspObject | None = None
    servo: str = "pal"
    timestep: float = 1 / 960
    velocity_limits: Mapping[str, float] = field(default_factory=dict)
    goal_radius: float | None = None
    visual: bool = True

    def __post_init__(self) -> None:
        for name, value, known in (("robot", self.robot, ROBOTS), ("servo", self.servo, SERVOS)):
            if not is_one_of(value, known):
                raise ValueError(f"{name} {quoted(value)} is unknown: use one of {', '.join(known)}")


def build(config: SceneConfig) -> mujoco.MjModel:
    """Compile the scene. The keyframe ``pre_grasp`` holds the robot's pose before a grasp."""
    return build_spec(config)[1]


def build_spec(config: SceneConfig) -> tuple[mujoco.MjSpec, mujoco.MjModel]:
    """The scene as an editable spec, and compiled; the object's contact compliance is set in the model only."""
    spec = mujoco.MjSpec.from_file(str(model_file(f"robots/{config.robot}.xml")))
    spec.option.timestep = config.timestep
    if config.robot.startswith("gripper"):
        _mount_gripper(spec)
    _furnish(spec)
    spec.add_sensor(
        name=names.GRASP_SENSOR,
        type=mujoco.mjtSensor.mjSENS_FRAMEPOS,
        objtype=mujoco.mjtObj.mjOBJ_SITE,
        objname=names.GRASP_SITE,
    )
    if config.goal_radius is not None:
        spec.worldbody.add_site(name=GOAL_SITE, size=[config.goal_radius] * 3, rgba=[0.16, 0.62, 0.32, 0.4])
    if config.item is not None:
        _add_object(spec, config.item)
    for actuator in spec.actuators:
        limit = config.velocity_limits.get(actuator.name)
        if limit is not None:
            actuator.ctrlrange = [-limit, limit]
    if not config.visual:
        for geom in [g for g in spec.geoms if g.contype == g.conaffinity == 0]:
            spec.delete(geom)
    model = spec.compile()
    if config.servo == "ideal":
        _make_ideal(model)
    if config.item is not None:
        set_object(model, config.item)
    return spec, model


#: What :func:`set_object` changes in a model.
OBJECT_FIELDS: Final = (
    "geom_type",
    "geom_size",
    "geom_rbound",
    "geom_aabb",
    "geom_friction",
    "bvh_aabb",
    "body_mass",
    "body_inertia",
    "body_subtreemass",
    "body_invweight0",
    "dof_invweight0",
    "dof_M0",
    "dof_length",
    "light_poscom0",
    "pair_friction",
    "pair_solref",
    "pair_solimp",
)


def set_object(model: mujoco.MjModel, item: GraspObject, scratch: mujoco.MjData | None = None) -> None:
    """Give a compiled scene another object, compliance of the pads' contacts included.

    Args:
        model, item, scratch: as of :func:`tiago_mj.models.objects.give_object`.
    """
    give_object(model, item, scratch)
    for side in names.SIDES:
        pair = model.pair(f"{side}_pad_object").id
        model.pair_friction[pair, :2] = item.friction
        compliance.set_pair_compliance(model, pair, item.compliance, contact_points=CONTACT_POINTS[item.shape])


def opening(model: mujoco.MjModel) -> float:
    """Clear width between the pads when both fingers are fully open [m]."""
    data = mujoco.MjData(model)
    for joint in names.FINGERS:
        data.joint(joint).qpos = model.joint(joint).range[1]
    mujoco.mj_kinematics(model, data)
    right, left = (model.geom(names.PAD_GEOM[side]).id for side in names.SIDES)
    return float(mujoco.mj_geomDistance(model, data, right, left, 1.0, np.zeros(6)))


def _mount_gripper(spec: mujoco.MjSpec) -> None:
    hand = spec.body(names.GRIPPER_BODY)
    reach = np.zeros(3)
    rotated = np.zeros(3)
    reach[:] = spec.site(names.GRASP_SITE).pos
    mujoco.mju_rotVecQuat(rotated, reach, np.array(GRIPPER_QUATERNION))
    hand.quat = GRIPPER_QUATERNION
    hand.pos = np.array(GRIPPER_GRASP_POINT) - rotated


def _furnish(spec: mujoco.MjSpec) -> None:
    """Add floor, light and table; the table is part of the world body."""
    world = spec.worldbody
    spec.visual.headlight.ambient = [0.35, 0.35, 0.35]
    spec.visual.headlight.diffuse = [0.35, 0.35, 0.35]
    spec.add_texture(
        name="sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=[0.86, 0.9, 0.94],
        rgb2=[0.62, 0.7, 0.78],
        width=64,
        height=384,
    )
    spec.add_texture(
        name="floor",
        type=mujoco.mjtTexture.mjTEXTURE_2D,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_CHECKER,
        rgb1=[0.74, 0.76, 0.78],
        rgb2=[0.68, 0.7, 0.72],
        width=256,
        height=256,
    )
    spec.add_material(name="floor", texrepeat=[8, 8]).textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "floor"
    world.add_light(pos=[1.5, -1.5, 3], dir=[-0.4, 0.5, -1], diffuse=[0.6, 0.6, 0.6])
    world.add_geom(name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[3, 3, 0.1], material="floor")
    world.add_geom(
        name=names.TABLE_GEOM,
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=TABLE_HALF,
        pos=TABLE_CENTRE,
        rgba=[0.78, 0.71, 0.62, 1],
    )


def _add_object(spec: mujoco.MjSpec, item: GraspObject) -> None:
    half = item.half_extents()
    start = np.array([*GRIPPER_GRASP_POINT[:2], TABLE_TOP + half[2]])
    body = spec.worldbody.add_body(name=names.OBJECT_BODY, pos=start)
    body.add_freejoint(name=names.OBJECT_JOINT)
    body.add_geom(
        name=names.OBJECT_GEOM,
        type=SHAPES[item.shape],
        size=item.geom_size(),
        mass=item.mass,
        rgba=[0.85, 0.33, 0.24, 1],
    )
    for side in names.SIDES:
        pad = names.PAD_GEOM[side]
        spec.add_pair(name=f"{side}_pad_object", geomname1=pad, geomname2=names.OBJECT_GEOM, condim=4)
        # The net force of all contacts of pad and object, in the world frame, and the axis to project it on: both are
        # sensors because mujoco.Batch reports no contacts.
        spec.add_sensor(
            name=names.CONTACT_SENSOR[side],
            type=mujoco.mjtSensor.mjSENS_CONTACT,
            objtype=mujoco.mjtObj.mjOBJ_GEOM,
            objname=pad,
            reftype=mujoco.mjtObj.mjOBJ_GEOM,
            refname=names.OBJECT_GEOM,
            intprm=[_contact_data("found", "force"), _NETFORCE, 1],
        )
        spec.add_sensor(
            name=names.AXIS_SENSOR[side],
            type=mujoco.mjtSensor.mjSENS_FRAMEXAXIS,
            objtype=mujoco.mjtObj.mjOBJ_SITE,
            objname=names.PAD_SITE[side],
        )
    for key in spec.keys:
        key.qpos = np.concatenate([key.qpos, start, [1, 0, 0, 0]])


#: XML reference, sensor/contact: reduce="netforce".
_NETFORCE: Final = 3


def _contact_data(*fields: str) -> int:
    """Bits of the contact sensor's ``data`` fields, in mjtConDataField's order."""
    return sum(1 << int(getattr(mujoco.mjtConDataField, f"mjCONDATA_{name.upper()}")) for name in fields)


def _make_ideal(model: mujoco.MjModel) -> None:
    """Turn every position servo into one that follows a commanded velocity as fast as the time step allows.

    An effort limit is applied to the force computed at the start of a step, so a servo may ask for no more than what
    the joint's inertia m can take in one step h: damping m / h (dead beat) and stiffness m / (4 h²), which follow a
    velocity with a lag of 4 h. m is the joint's effective inertia, 1 / (M⁻¹)_jj, in the pre-grasp pose.
    """
    data = mujoco.MjData(model)
    data.qpos[:] = pose(model)
    mujoco.mj_forward(model, data)
    inverse = np.zeros((model.nv, model.nv))
    mujoco.mj_solveM(model, data, inverse, np.eye(model.nv))
    for actuator in range(model.nu):
        dof = model.jnt_dofadr[model.actuator_trnid[actuator, 0]]
        inertia, step = 1 / inverse[dof, dof], model.opt.timestep
        stiffness = inertia / (4 * step**2)
        damping = max(inertia / step - float(np.max(model.dof_damping[dof])), 0.0)
        model.actuator_gainprm[actuator, 0] = stiffness
        model.actuator_biasprm[actuator, 1:3] = -stiffness, -damping


def pose(model: mujoco.MjModel) -> NDArray[np.float64]:
    """The pre-grasp configuration, (nq,)."""
    return np.array(model.key("pre_grasp").qpos)

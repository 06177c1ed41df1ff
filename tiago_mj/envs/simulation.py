"""The robot at its table, simulated: what every environment steps, senses and shows, whatever its task is.

It follows gymnasium-robotics: a ``MujocoRobotEnv`` with its hooks. :class:`~tiago_mj.envs.robot_env.RobotEnv` makes a
goal environment of it.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import fields
from types import MappingProxyType
from typing import Any, ClassVar

import mujoco
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from tiago_mj.effects import read_effects
from tiago_mj.envs import checks
from tiago_mj.envs.arguments import RENDER_MODES, SimulationArguments
from tiago_mj.envs.choices import Interval, ObjectChoice, check_fits
from tiago_mj.envs.drive import Drive
from tiago_mj.envs.fixed import Fixed
from tiago_mj.envs.replay_specification import ReplaySpecification
from tiago_mj.envs.sensors import Sensors
from tiago_mj.envs.start import Start, contact_of, grasp_frame, put_object
from tiago_mj.envs.stepped import SteppedRobot
from tiago_mj.io import mujoco_log
from tiago_mj.io.quoting import did_you_mean, is_one_of, quoted
from tiago_mj.models import names, scene
from tiago_mj.models.files import model_file
from tiago_mj.models.objects import GraspObject
from tiago_mj.sensing.load_cell import MovingAverage
from tiago_mj.sensing.noise import NoiseBlocks
from tiago_mj.view import headless

Array = NDArray[np.float64]


class RobotSimulation(SteppedRobot, ABC):
    """A robot of :data:`tiago_mj.models.scene.ROBOTS` at a table, commanded at a fixed rate.

    Args:
        robot: which one.
        joints: commanded and observed joints, in the order of action and observation.
        item: the object and its place, or None for an empty table.
        **arguments: how the robot is simulated, commanded, sensed and shown: :class:`SimulationArguments`.

    Raises:
        ValueError: an argument is unusable; one line says which and what is possible.
    """

    #: Names of what every environment takes beside its own.
    ARGUMENTS: ClassVar = tuple(field.name for field in fields(SimulationArguments))

    metadata: dict[str, Any] = {  # noqa: RUF012  (gymnasium's own form)
        "render_modes": RENDER_MODES,
        "render_fps": 240,
    }

    force_source: Fixed[str] = Fixed()
    velocity_limit: Fixed[Array] = Fixed()
    _place_asked: Array | None = None

    #: Whether the fingers, the last two joints, stay where they start, whatever the action says of them.
    FINGERS_HELD = False
    #: Joint positions at the start of an episode, by name, where they differ from the pre-grasp pose.
    START: Mapping[str, float] = MappingProxyType({})
    #: Radius of the sphere that shows a goal in space [m]; None: the goal is no place.
    GOAL_RADIUS: float | None = None
    #: Where the free camera stands: close to the fingers, or far enough to see the whole robot. A task may override it.
    CLOSE_UP: Mapping[str, Any] = {
        "lookat": np.array([0.66, 0.0, 0.6]),
        "distance": 0.5,
        "azimuth": 125,
        "elevation": -30,
    }
    OVERVIEW: Mapping[str, Any] = {
        "lookat": np.array([0.35, 0.0, 0.6]),
        "distance": 2.0,
        "azimuth": 125,
        "elevation": -18,
    }

    def __init__(self, *, robot: str, joints: tuple[str, ...], item: ObjectChoice | None, **arguments: Any) -> None:
        given = SimulationArguments(**arguments)
        if not isinstance(joints, (list, tuple)) or not joints:
            raise ValueError(f"joints is {quoted(joints)}: give a list of names")
        self.joints = tuple(joints)
        self.control, self.servo, self.force_source = given.control, given.servo, given.force_source
        self.load_cell = given.load_cell
        self.object_choice = item
        self._effects = read_effects(given.effects)
        self._load_cells = given.load_cells or item is not None
        self._scene = given.scene(robot, None if item is None else item.first(), self.GOAL_RADIUS)
        self._period = 1 / given.control_hz
        self.metadata = {**self.metadata, "render_fps": round(given.control_hz)}
        super().__init__(
            model_path=str(model_file(f"robots/{robot}.xml")),
            initial_qpos=None,
            n_actions=len(joints),
            n_substeps=given.substeps,
            default_camera_config=dict(self.CLOSE_UP if robot.startswith("gripper") else self.OVERVIEW),
            render_mode=given.render_mode,
            width=given.width,
            height=given.height,
        )
        self.observation_space = self._observation_space()

    # Hooks of a task -----------------------------------------------------------------------------------------------

    @abstractmethod
    def _observation_space(self) -> spaces.Dict:
        """What observations are in."""

    def _object_position(self, offset: float) -> Array:
        """Where the object's axis meets the table at reset, (2,) [m]: between the fingers."""
        return self._middle + offset * self._towards_left

    def _draw_start(self, rng: np.random.Generator) -> Start | None:
        """The object and its place for one episode; None on an empty table."""
        if self.object_choice is None:
            return None
        item, offset = self.object_choice.draw(rng)
        return Start(item, offset, self.object_place(offset))

    # What others may ask and set ------------------------------------------------------------------------------------

    def draw_start(self, rng: np.random.Generator) -> Start | None:
        """The object and its place for one episode, drawn as the task says; None on an empty table."""
        return self._draw_start(rng)

    def object_place(self, offset: float) -> Array:
        """Where an object's axis meets the table at reset, (2,) [m], by its offset along the grasp axis [m]."""
        return self._object_position(offset) if self._place_asked is None else self._place_asked

    def begin_with(self, item: GraspObject, offset: float, place: Array | None = None) -> None:
        """Let the next episodes begin with one object, whatever the task would draw.

        Args:
            item: the object, instead of the environment's own.
            offset: along the grasp axis [m].
            place: where its axis meets the table, (2,) [m]; None: where the task puts it.
        """
        self.object_choice = ObjectChoice((item,), None, None, None, None, Interval(offset, offset))
        self._place_asked = place

    @property
    def item(self) -> GraspObject | None:
        """The object of this episode; None on an empty table."""
        return self._item

    @property
    def offset(self) -> float:
        """Of the object along the grasp axis at the start of this episode [m]."""
        return self._offset

    def replay_specification(self) -> ReplaySpecification:
        """What simulates an episode of this environment again, without effects."""
        choice, pads = self.object_choice, self.sensors.pads
        return ReplaySpecification(
            model=self.model,
            wiring=self.wiring(),
            period=self.dt,
            pads=pads,
            cell=None if pads is None else self.load_cell,
            item=None if choice is None else choice.first(),
            offset=0.0 if choice is None else choice.offset.low,
            start_qpos=lambda item, offset: self.start_qpos(item, self.object_place(offset)),
        )

    # gymnasium-robotics' hooks --------------------------------------------------------------------------------------

    def _initialize_simulation(self) -> None:
        self.model = scene.build(self._scene)
        mujoco_log.told_once()
        self._check_joints()
        self.data = mujoco.MjData(self.model)
        self.model.vis.global_.offwidth = self.width
        self.model.vis.global_.offheight = self.height
        if self.object_choice is not None:
            check_fits(self.object_choice, scene.opening(self.model))
            self._object_address = int(self.model.joint(names.OBJECT_JOINT).qposadr[0])
        source = self.force_source if self._load_cells else None
        self.sensors = Sensors(self.model, self.joints, self.load_cell, source)
        self.drive = Drive.of(self.model, self.joints, control=self.control, held=self.FINGERS_HELD)
        self.velocity_limit = self.drive.velocity_limit
        self._actuated = np.array(self.model.jnt_qposadr[self.model.actuator_trnid[:, 0]])
        self._ctrl = np.array([self.model.actuator(name).id for name in self.joints])
        self._range = np.stack([self.drive.low, self.drive.high], axis=1)
        self.qpos_address = np.array([self.model.joint(name).qposadr[0] for name in self.joints])
        self._qvel_address = np.array([self.model.joint(name).dofadr[0] for name in self.joints])
        self.initial_time = 0.0
        self.initial_qpos = scene.pose(self.model)
        for name, value in self.START.items():
            self.initial_qpos[self.model.joint(name).qposadr[0]] = value
        self.initial_qvel = np.zeros(self.model.nv)
        self._filter = MovingAverage(self.load_cell.average)
        self._grasp_frame()
        self._noise = NoiseBlocks(1, self.load_cell.noises)
        self._item, self._offset = self._scene.item, 0.0
        self._act_under(self._effects)
        self._settle(self._object_position(0.0))

    def _check_joints(self) -> None:
        known = tuple(self.model.actuator(k).name for k in range(self.model.nu))
        for k, name in enumerate(self.joints):
            if not is_one_of(name, known):
                raise ValueError(
                    f"joints has {quoted(name)}, which {self._scene.robot} does not move: {did_you_mean(name, known)}"
                )
            if name in self.joints[:k]:
                raise ValueError(f"joints has {quoted(name)} twice: name each joint once")

    def contact(self) -> tuple[float, float, int] | None:
        """Stiffness [N/m], damping [N·s/m] and contact points of one pad with the present object; None without one."""
        return contact_of(self._item)

    def _reset_sim(self) -> bool:
        self._runner.restore()  # the next object goes into the nominal model
        start = self._draw_start(self.np_random)
        if start is not None:
            self._offset = start.offset
            if start.item != self._item:
                scene.set_object(self.model, start.item, self.data)
                self._item = start.item
        self._settle(self._middle if start is None else start.place)
        return True

    def start_qpos(self, item: GraspObject | None, place: Array | None) -> Array:
        """Where everything is at the start of an episode, (nq,)."""
        qpos: Array = self.initial_qpos.copy()
        if item is not None and place is not None:
            put_object(qpos, self._object_address, item, place, self._object_orientation)
        return qpos

    def start_act(self, qpos: Array) -> Array:
        """The servos' set points at the start: where their joints are, (..., na)."""
        points: Array = qpos[..., self._actuated]
        return points

    def _settle(self, place: Array) -> None:
        """Put everything at the start of an episode; nothing of the episode before remains."""
        mujoco.mj_resetData(self.model, self.data)
        self.data.qpos[:] = self.start_qpos(self._item, place)
        self.data.act[:] = self.start_act(self.data.qpos)
        self._runner.start(self._period, self.n_substeps, self.contact())
        mujoco.mj_forward(self.model, self.data)
        self._filter.reset()
        self._noise.forget()
        self._tare = self.sensors.tare(self.data.sensordata)
        self._read()

    def _grasp_frame(self) -> None:
        """Middle and axis of the grasp on the table plane, in the pre-grasp pose."""
        frame = grasp_frame(self.model, self.data, self.initial_qpos)
        self._middle, self._towards_left, self._object_orientation = frame.middle, frame.towards_left, frame.orientation

    def _read(self) -> None:
        """Take one reading of every sensor; noise is drawn here and nowhere else."""
        data = self.data
        noise = None if self.sensors.pads is None else self._noise.take((self.np_random,))[0]
        self.state = self.sensors.read(
            data.qpos,
            data.qvel,
            data.sensordata,
            tare=self._tare,
            noise=noise,
            average=self._filter,
            effects=self._measured,
        )

    def render(self) -> Any:
        """One frame: (height, width, 3) uint8 for ``rgb_array``, (height, width) float32 for ``depth_array``.

        Raises:
            gymnasium.error.DependencyNotInstalled: no OpenGL could be started; says what to set.
        """
        viewer = self.mujoco_renderer.viewer
        if viewer is not None:
            viewer.make_context_current()  # another environment may have made its own current, or freed it
        frame = checks.rendered(
            super().render, self.render_mode, lambda: getattr(self.mujoco_renderer, "viewer", None) is not None
        )
        if viewer is None and self.render_mode != "human":
            headless.free_apart(self.mujoco_renderer.viewer)
        return frame

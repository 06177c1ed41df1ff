"""Arguments that every environment takes: how the robot is simulated, commanded, sensed and shown."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from tiago_mj.envs.drive import CONTROLS
from tiago_mj.io.quoting import is_number, is_one_of, quoted
from tiago_mj.models import names, scene
from tiago_mj.models.objects import GraspObject
from tiago_mj.sensing.load_cell import LoadCell
from tiago_mj.sensing.sheet import named_load_cell

#: Longest physics step [s]. Against a 0.1 ms reference a closing grasp's force curve is then within 1.1 % of its peak
#: (rms), and 95 % of its control steps are within 1.4 %; the steps in which contact begins or ends are farther off, as
#: a reading is one physics step old and the force jumps there (benchmarks/time_step.py, results/time_step.json).
MAX_TIMESTEP: Final = 1 / 480
#: The same for ``servo="ideal"``, whose stiffness is bound by the step: it then lags by 4 steps, half a control period.
IDEAL_MAX_TIMESTEP: Final = 1 / 1920
#: Of a side of a rendered frame [pixel]: OpenGL's own bound on most machines.
MOST_PIXELS: Final = 16_384
#: Commanded finger speed [m/s]: the 2021 project's. Its URDF says 0.05, and 0.02 is what the real robot was run at.
FINGER_SPEED: Final = 0.08
RENDER_MODES: Final = ["human", "rgb_array", "depth_array"]


@dataclass(frozen=True, kw_only=True)
class SimulationArguments:
    """What is the same for every robot and task.

    Attributes:
        servo: ``pal`` (a velocity command moves the set point of the position servo that the real robot has: it lags)
            or ``ideal`` (velocities are tracked within 2 ms, as in the 2021 project; four times the physics steps).
            Effort limits hold for both.
        control: ``velocity``: an action in [-1, 1] is a velocity over the joint's limit. ``position``: it is a target
            over the joint's range; the set point moves there no faster than the velocity limit.
        control_hz: rate of the actions [Hz].
        finger_speed: velocity limit of the fingers [m/s].
        sensing: a :class:`LoadCell`, the name of a preset (``ta11``, ``released``, ``newtons``), or the path of a file
            that ``tiago-mj calibrate-sensor`` wrote.
        force_source: what the load cells read: ``contact``, ``touch`` or ``force`` (:mod:`tiago_mj.sensing.sources`).
        effects: what the real robot has and the nominal model lacks: a list, the short form, or the path of a
            ``calibration.yaml`` (docs/effects.md).
        load_cells: read them even where there is no object; with an object they are always read.
        visual: whether the model has the geoms that are only seen. Without them physics is faster (docs/speed.md) and
            nothing can be rendered; nothing else depends on them but the last digits of a contact that just begins.
        render_mode: ``rgb_array``, ``depth_array``, ``human`` or None.
        width, height: of rendered frames [pixel].

    Raises:
        ValueError: an argument is unusable; one line says which and what is possible.
    """

    servo: str = "pal"
    control: str = "velocity"
    control_hz: float = 240.0
    finger_speed: float = FINGER_SPEED
    sensing: str | Path | LoadCell = "ta11"
    force_source: str = "contact"
    effects: Any = None
    load_cells: bool = False
    visual: bool = True
    render_mode: str | None = None
    width: int = 480
    height: int = 480

    def __post_init__(self) -> None:
        if not is_one_of(self.control, CONTROLS):
            raise ValueError(f"control {quoted(self.control)} is unknown: use one of {', '.join(CONTROLS)}")
        if not (is_number(self.control_hz) and 1 <= self.control_hz <= 10_000):
            raise ValueError(f"control_hz is {quoted(self.control_hz)}: give a rate from 1 to 10000 Hz")
        if not (is_number(self.finger_speed) and 0 < self.finger_speed <= 1):
            raise ValueError(f"finger_speed is {quoted(self.finger_speed)}: give a speed above 0, at most 1 m/s")
        self._check_frames()
        for name, flag in (("visual", self.visual), ("load_cells", self.load_cells)):
            if not isinstance(flag, (bool, np.bool_)):
                raise ValueError(f"{name} is {quoted(flag)}: give True or False")

    def _check_frames(self) -> None:
        mode = self.render_mode
        if mode is not None and mode not in RENDER_MODES:
            raise ValueError(f"render_mode {quoted(mode)} is unknown: use one of {RENDER_MODES}")
        if mode is not None and not self.visual:
            raise ValueError(f"visual is False and render_mode {quoted(mode)}: there is nothing to see; leave one out")
        for name, size in (("width", self.width), ("height", self.height)):
            if isinstance(size, bool) or not isinstance(size, (int, np.integer)) or not 1 <= size <= MOST_PIXELS:
                raise ValueError(
                    f"{name} is {quoted(size)}: it is that of rendered frames, give a whole number of pixels from 1 to "
                    f"{MOST_PIXELS}" + (" (an object's width is object_width)" if name == "width" else "")
                )

    @property
    def load_cell(self) -> LoadCell:
        """The load cell that ``sensing`` is or names."""
        return self.sensing if isinstance(self.sensing, LoadCell) else named_load_cell(self.sensing)

    @property
    def substeps(self) -> int:
        """Physics steps in a control period, as few as their longest length allows."""
        longest = IDEAL_MAX_TIMESTEP if self.servo == "ideal" else MAX_TIMESTEP
        return math.ceil(1 / (self.control_hz * longest) - 1e-9)

    def scene(self, robot: str, item: GraspObject | None, goal_radius: float | None) -> scene.SceneConfig:
        """The scene of a robot, an object or None, and the radius of a goal's sphere [m] or None."""
        return scene.SceneConfig(
            robot=robot,
            item=item,
            servo=self.servo,
            timestep=1 / (self.control_hz * self.substeps),
            velocity_limits=dict.fromkeys(names.FINGERS, self.finger_speed),
            goal_radius=goal_radius,
            visual=self.visual,
        )

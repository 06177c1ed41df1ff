"""MuJoCo Playground 0.2 (MJX 3.17): ``config_overrides`` of the times, and a function that patches a compiled model.

Format: ``mujoco_playground.registry.load(name, config_overrides=…)``, whose configurations have ``ctrl_dt`` and
``sim_dt`` [s]; a patch sets fields of ``mujoco.MjModel`` by names, before ``mjx.put_model``. Units are MuJoCo's.
"""

from __future__ import annotations

from collections.abc import Iterable
from types import MappingProxyType
from typing import Any, Final

import mujoco
import numpy as np

from tiago_mj.effects import model_file
from tiago_mj.export.drives import Numbers
from tiago_mj.export.holding import approximate, exact, lacking
from tiago_mj.export.numbers import number
from tiago_mj.export.targets import playground_randomisation
from tiago_mj.export.targets.python_text import literal
from tiago_mj.export.targets.target import Target

_PATCHED: Final = (
    "servo stiffness",
    "servo damping",
    "effort limit",
    "motor constant",
    "dry friction",
    "viscous friction",
    "armature",
    "mass",
    "gravity",
)
HOLDS: Final = MappingProxyType(
    {
        **{quantity: exact("a field of the model, set by the patch") for quantity in _PATCHED},
        "spring": approximate("fields of the model, set by the patch; MJX 3.17 in JAX leaves out what hardens"),
        "play": approximate("a second joint in the body, in the model beside: a patch adds none"),
        "elasticity": approximate("a second joint with a spring, in the model beside: a patch adds none"),
        "delay": lacking("MJX 3.17 keeps no history of controls: delay actions in the environment's step"),
    }
)
#: What a field's rows are of.
_KINDS: Final = {"dof": "joint", "jnt": "joint", "qpos": "joint", "body": "body", "actuator": "actuator"}
TEXT: Final = '''\
"""{robot} with what a diagnosis found, for MuJoCo Playground 0.2. Written by tiago-mj export.

    env = registry.load(NAME, config_overrides=CONFIG_OVERRIDES)
    patch(env.mj_model)
    env._mjx_model = mjx.put_model(env.mj_model, impl=env._config.impl)
"""

import mujoco

CONFIG_OVERRIDES = {{"ctrl_dt": {period}, "sim_dt": {step}}}
#: Fields of the model by name: what differs from the model that was diagnosed.
JOINTS = {joints}
BODIES = {bodies}
ACTUATORS = {actuators}
GRAVITY = {gravity}


def patch(model: mujoco.MjModel) -> mujoco.MjModel:
    """Set the fields in place; what follows from masses and inertias is computed anew."""
    for name, fields in JOINTS.items():
        joint = model.joint(name)
        for field, value in fields.items():
            rows = {{"jnt": joint.id, "dof": joint.dofadr[0], "qpos": joint.qposadr[0]}}
            row = rows[field.partition("_")[0]]
            getattr(model, field)[row] = value
    for rows, find in ((BODIES, model.body), (ACTUATORS, model.actuator)):
        for name, fields in rows.items():
            for field, value in fields.items():
                getattr(model, field)[find(name).id] = value
    if GRAVITY is not None:
        model.opt.gravity[:] = GRAVITY
    mujoco.mj_setConst(model, mujoco.MjData(model))
    return model
'''


def write(numbers: Numbers) -> dict[str, str]:
    """The module's text."""
    robot, period = numbers.robot, numbers.robot.substeps * float(numbers.robot.model.opt.timestep)
    model, wanted = robot.model, numbers.exact
    tilted = not np.array_equal(model.opt.gravity, wanted.opt.gravity)
    text = TEXT.format(
        robot=robot.file.stem,
        period=literal(period),
        step=literal(float(model.opt.timestep)),
        joints=_by_name(model, wanted, (*model_file.OF_JOINTS, *model_file.OF_WHOLE_JOINTS, *model_file.OF_SPRINGS)),
        bodies=_by_name(model, wanted, model_file.OF_BODIES),
        actuators=_by_name(model, wanted, model_file.OF_ACTUATORS),
        gravity=_source(wanted.opt.gravity) if tilted else "None",
    )
    return {"playground_patch.py": text}


def _by_name(model: mujoco.MjModel, wanted: mujoco.MjModel, fields: Iterable[str]) -> str:
    """Rows of fields that differ, by name, as Python source."""
    rows: dict[str, dict[str, str]] = {}
    for field in fields:
        for row in model_file.differing_rows(model, wanted, field):
            rows.setdefault(_name(model, field, row), {})[field] = _source(getattr(wanted, field)[row])
    if not rows:
        return "{}"
    lines = [
        f"    {name!r}: {{{', '.join(f'{field!r}: {value}' for field, value in own.items())}}},\n"
        for name, own in rows.items()
    ]
    return "{\n" + "".join(lines) + "}"


def _name(model: mujoco.MjModel, field: str, row: int) -> str:
    kind = field.partition("_")[0]
    if kind == "qpos":
        row = int(np.searchsorted(model.jnt_qposadr, row, side="right")) - 1
    index = int(model.dof_jntid[row]) if kind == "dof" else row
    return str(getattr(model, _KINDS[kind])(index).name)


def _source(value: Any) -> str:
    """A number, or a list of them."""
    if np.ndim(value):
        return "[" + ", ".join(number(float(one)) for one in value) + "]"
    return number(float(value))


TARGET: Final = Target(
    "playground",
    "0.2",
    HOLDS,
    write,
    "3.17",
    ("command_delay",),
    "its model replayed by mujoco-mjx 3.17, its patch by MuJoCo 3.17",
    playground_randomisation.RANDOMISATION,
)

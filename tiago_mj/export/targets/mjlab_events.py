"""mjlab 1.6: an event that gives every world, at each reset, one simulator of a table of draws.

Format: ``mjlab.managers.event_manager.EventTermCfg`` and ``requires_model_fields``, by which mjlab keeps a field for
each world and computes anew what follows from it; functions of events get the environment and the ids of worlds.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from tiago_mj.export.draws import FILE, Draws, table
from tiago_mj.export.drives import Numbers
from tiago_mj.export.holding import Held, approximate, exact
from tiago_mj.export.targets.target import Randomisation

MODULE: Final = "mjlab_events.py"
_DRAWN: Final = exact("`EVENTS` of mjlab_events.py: drawn together with all others of its row")
HOLDS: Final[Mapping[str, Held]] = MappingProxyType(
    {
        **dict.fromkeys(
            ("servo stiffness", "servo damping", "effort limit", "motor constant", "dry friction", "viscous friction"),
            _DRAWN,
        ),
        **dict.fromkeys(("armature", "mass", "elasticity"), _DRAWN),
        "delay": approximate("`with_delays`: mjlab draws whole physics steps evenly; the correlation is lost"),
    }
)
#: Fields of a degree of freedom, by the drive's number; of bodies, as they are.
OF_JOINTS: Final = {"friction": "dof_frictionloss", "joint_damping": "dof_damping", "armature": "dof_armature"}
OF_BODIES: Final = ("body_mass", "body_inertia", "body_ipos", "body_iquat")
OF_SERVOS: Final = {"position": ("stiffness", "damping"), "velocity": ("damping",), "effort": ()}
TEXT: Final = '''\
"""Simulators of {robot} drawn from the posterior of {source}, for mjlab 1.6. Written by tiago-mj export.

    from mjlab_robot import ACTUATORS
    cfg.events |= EVENTS
    articulation = EntityArticulationInfoCfg(actuators=with_delays(ACTUATORS))

Every reset gives a world one row of {file}: numbers that go together stay together.
"""

import dataclasses
import json
from pathlib import Path

import torch
from mjlab.managers.event_manager import EventTermCfg, RecomputeLevel, requires_model_fields

DRAWS = json.loads((Path(__file__).parent / "{file}").read_text(encoding="utf-8"))
#: Physics steps by which commands are late, least and most, where they differ from draw to draw.
LAGS = {lags}


@requires_model_fields({fields}, recompute=RecomputeLevel.{level})
def simulators(env, env_ids, entity="robot"):
    """Give worlds one row of the table each."""
    if env_ids is None:
        env_ids = torch.arange(env.num_envs, device=env.device)
    rows = torch.randint(DRAWS["count"], (len(env_ids),), device=env.device)
    asset, model = env.scene[entity], env.sim.model
    worlds = env_ids.long()

    def drawn(quantity, name):
        return torch.tensor(DRAWS["columns"][quantity][name], device=env.device, dtype=torch.float32)[rows]

    for field in ("dof_frictionloss", "dof_damping", "dof_armature"):
        for name in DRAWS["columns"].get(field, {{}}):
            address = asset.indexing.joint_v_adr[asset.joint_names.index(name)]
            getattr(model, field)[worlds, address] = drawn(field, name)
    for field in ("body_mass", "body_inertia", "body_ipos", "body_iquat"):
        for name in DRAWS["columns"].get(field, {{}}):
            body = asset.indexing.body_ids[asset.body_names.index(name)]
            getattr(model, field)[worlds, body] = drawn(field, name)
    servos = {{name: servo for one in asset.actuators for name, servo in zip(one.target_names, one.global_ctrl_ids)}}
    for name in DRAWS["columns"].get("stiffness", {{}}):
        stiffness = drawn("stiffness", name)
        model.actuator_gainprm[worlds, servos[name], 0] = stiffness
        model.actuator_biasprm[worlds, servos[name], 1] = -stiffness
    for name in DRAWS["columns"].get("damping", {{}}):
        damping = drawn("damping", name)
        if {velocity}:
            model.actuator_gainprm[worlds, servos[name], 0] = damping
        model.actuator_biasprm[worlds, servos[name], 2] = -damping
    for name in DRAWS["columns"].get("effort", {{}}):
        effort = drawn("effort", name)
        model.actuator_forcerange[worlds, servos[name], 0] = -effort
        model.actuator_forcerange[worlds, servos[name], 1] = effort


def with_delays(actuators):
    """Actuator configurations that draw their delays by themselves, evenly between LAGS and apart from the table."""
    late = {{actuator.target_names_expr[0]: actuator for actuator in actuators}}
    for name, (low, high) in LAGS.items():
        late[name] = dataclasses.replace(late[name], delay_min_lag=low, delay_max_lag=high)
    return tuple(late.values())


EVENTS = {{"simulators": EventTermCfg(mode="reset", func=simulators)}}
'''


def write(draws: Draws, numbers: Numbers) -> dict[str, str]:
    """The module and its table."""
    robot = numbers.robot
    columns = {OF_JOINTS[key]: draws.drives[key] for key in OF_JOINTS if key in draws.drives}
    columns |= {field: draws.fields[field] for field in OF_BODIES if field in draws.fields}
    servo = (*OF_SERVOS[robot.wiring.interface], "effort")
    columns |= {key: draws.drives[key] for key in servo if key in draws.drives}
    fields = [key for key in columns if "_" in key]
    fields += ["actuator_gainprm", "actuator_biasprm"] if {"stiffness", "damping"} & set(columns) else []
    fields += ["actuator_forcerange"] if "effort" in columns else []
    heavy = any(field in OF_BODIES for field in columns)
    level = "set_const" if heavy else "set_const_0" if "dof_armature" in columns else "none"
    text = TEXT.format(
        robot=robot.file.stem,
        source=draws.source,
        file=FILE,
        lags=repr(draws.lags(float(robot.model.opt.timestep))),
        fields=", ".join(repr(field) for field in fields),
        level=level,
        velocity=robot.wiring.interface == "velocity",
    )
    about = "dof_* and body_* as MuJoCo's fields; stiffness, damping and effort at the joints, SI units"
    return {MODULE: text, FILE: table(draws.source, columns, about)}


RANDOMISATION: Final = Randomisation(HOLDS, (MODULE, FILE), write)

"""Isaac Lab 2.3: an event term that gives every environment, at each reset, one simulator of a table of draws.

Format: ``isaaclab.managers.EventTermCfg``, whose functions get the environment and the ids of environments, and the
``write_joint_..._to_sim`` of ``isaaclab.assets.Articulation``; explicit actuators keep their own gains. Isaac Lab
cannot be installed without its simulator: run behind a stand-in only.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from tiago_mj.export.draws import FILE, Draws, table
from tiago_mj.export.drives import Numbers
from tiago_mj.export.holding import Held, approximate, exact
from tiago_mj.export.targets.target import Randomisation

MODULE: Final = "isaaclab_events.py"
_DRAWN: Final = exact("`EventCfg` of isaaclab_events.py: drawn together with all others of its row")
HOLDS: Final[Mapping[str, Held]] = MappingProxyType(
    {
        **dict.fromkeys(
            ("servo stiffness", "servo damping", "effort limit", "motor constant", "dry friction", "viscous friction"),
            _DRAWN,
        ),
        "armature": _DRAWN,
        "elasticity": _DRAWN,
        "velocity limit": approximate("drawn together with the others, of `velocity_limit_sim`, which cuts velocities"),
        "mass": approximate("masses are drawn together with the others; inertias follow by their ratio, centres stay"),
        "delay": approximate(
            "`LAGS`, for `min_delay` and `max_delay`: drawn evenly by the actuator; correlation is lost"
        ),
    }
)
TEXT: Final = '''\
"""Simulators of {robot} drawn from the posterior of {source}, for Isaac Lab 2.3. Written by tiago-mj export.

Every reset gives an environment one row of {file}: numbers that go together stay together. Give EventCfg, or a class
that has its term beside your own, as ``events`` of the environment's configuration.
"""

import json
from pathlib import Path

import torch
from isaaclab.managers import EventTermCfg as EventTerm
from isaaclab.managers import SceneEntityCfg
from isaaclab.utils import configclass

DRAWS = json.loads((Path(__file__).parent / "{file}").read_text(encoding="utf-8"))
#: Physics steps by which commands are late, least and most, where they differ from draw to draw: for min_delay and
#: max_delay of DelayedPDActuatorCfg, which draws them evenly, apart from the table.
LAGS = {lags}


def simulators(env, env_ids, asset_cfg=SceneEntityCfg("robot")):
    """Give environments one row of the table each."""
    asset = env.scene[asset_cfg.name]
    if env_ids is None:
        env_ids = torch.arange(env.scene.num_envs, device=asset.device)
    rows = torch.randint(DRAWS["count"], (len(env_ids),), device=asset.device)

    def drawn(quantity):
        """Names, their ids, and values, (environments, names)."""
        columns = DRAWS["columns"].get(quantity, {{}})
        if not columns:
            return [], [], None
        values = torch.tensor(list(columns.values()), device=asset.device, dtype=torch.float32).T[rows]
        find = asset.find_bodies if quantity == "mass" else asset.find_joints
        return list(columns), find(list(columns), preserve_order=True)[0], values

    for quantity, write in (
        ("armature", asset.write_joint_armature_to_sim),
        ("effort", asset.write_joint_effort_limit_to_sim),
        ("velocity", asset.write_joint_velocity_limit_to_sim),
    ):
        _, ids, values = drawn(quantity)
        if ids:
            write(values, joint_ids=ids, env_ids=env_ids)
    # Gains of implicit actuators are the simulator's; explicit ones have theirs, and the simulator's stay 0.
    for quantity, write in (
        ("stiffness", asset.write_joint_stiffness_to_sim),
        ("damping", asset.write_joint_damping_to_sim),
        ("effort_limit", None),
    ):
        names, ids, values = drawn("effort" if quantity == "effort_limit" else quantity)
        for k, (name, joint) in enumerate(zip(names, ids)):
            for actuator in asset.actuators.values():
                if name in actuator.joint_names:
                    getattr(actuator, quantity)[env_ids, actuator.joint_names.index(name)] = values[:, k]
                    if write is not None and type(actuator).__name__ == "ImplicitActuator":
                        write(values[:, k : k + 1], joint_ids=[joint], env_ids=env_ids)
    _, ids, values = drawn("friction")
    if ids:
        asset.write_joint_friction_coefficient_to_sim(
            values, joint_dynamic_friction_coeff=values, joint_ids=ids, env_ids=env_ids
        )
    _, ids, values = drawn("joint_damping")
    if ids:
        asset.write_joint_viscous_friction_coefficient_to_sim(values, joint_ids=ids, env_ids=env_ids)
    _, ids, values = drawn("mass")
    if ids:
        view, here = asset.root_physx_view, env_ids.cpu()
        masses, inertias = view.get_masses(), view.get_inertias()
        now = masses[here[:, None], ids]
        masses[here[:, None], ids] = values.cpu()
        inertias[here[:, None], ids] *= (values.cpu() / now)[..., None]
        view.set_masses(masses, here)
        view.set_inertias(inertias, here)


@configclass
class EventCfg:
    """The event that draws simulators."""

    simulators = EventTerm(func=simulators, mode="reset")
'''
_KEYS: Final = ("stiffness", "damping", "friction", "joint_damping", "armature", "effort", "velocity")


def write(draws: Draws, numbers: Numbers) -> dict[str, str]:
    """The module and its table."""
    robot = numbers.robot
    columns = {key: draws.drives[key] for key in _KEYS if key in draws.drives}
    if "body_mass" in draws.fields:
        columns["mass"] = draws.fields["body_mass"]
    text = TEXT.format(
        robot=robot.file.stem,
        source=draws.source,
        file=FILE,
        lags=repr(draws.lags(float(robot.model.opt.timestep))),
    )
    about = "numbers at the joints and masses of bodies, SI units, radians on hinges"
    return {MODULE: text, FILE: table(draws.source, columns, about)}


RANDOMISATION: Final = Randomisation(HOLDS, (MODULE, FILE), write)

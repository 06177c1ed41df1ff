"""Cost and accuracy of each choice of the physics: time of a step, and the force curve against a 0.1 ms reference.

    python benchmarks/physics.py [--rounds 20] [--robots gripper_ta11 tiago_ta11]

One choice is changed at a time. Time is that of one `mj_step` in C on one thread: of the open gripper, whose object
stands on the table, and of a held grasp; the choices take turns, and the fastest of the rounds counts. The force curve
is that of benchmarks/time_step.py (close at full speed; touch, let go and touch again; cylinder and box): errors in
units of the reference's peak, rms over the episode and the 95th percentile over its control steps, the worse of the
programs. The reference is the default at a step of 0.1 ms.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any
from unittest import mock

import gymnasium
import mujoco
import numpy as np
from machine import save
from time_step import REFERENCE

import tiago_mj  # noqa: F401
from tiago_mj.envs import arguments as shared
from tiago_mj.models import names, scene

IDS = {"gripper_ta11": "GripperTactile-v0", "tiago_ta11": "TIAGoTactile-v0"}
STATE = mujoco.mjtState.mjSTATE_INTEGRATION
STEPS = 300


@dataclass(frozen=True)
class Choice:
    """One thing that could be otherwise.

    Attributes:
        name: in the table.
        step: longest physics step [s].
        model: changes a compiled model.
        spec: changes the scene before it is compiled.
    """

    name: str
    step: float = shared.MAX_TIMESTEP
    model: Callable[[mujoco.MjModel], None] | None = None
    spec: Callable[[mujoco.MjSpec], None] | None = None


def without(flag: str) -> Callable[[mujoco.MjModel], None]:
    bit = int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{flag}"))

    def change(model: mujoco.MjModel) -> None:
        model.opt.disableflags |= bit

    return change


def option(**values: Any) -> Callable[[mujoco.MjModel], None]:
    def change(model: mujoco.MjModel) -> None:
        for name, value in values.items():
            setattr(model.opt, name, value)

    return change


def bare(spec: mujoco.MjSpec) -> None:
    for geom in [g for g in spec.geoms if g.contype == g.conaffinity == 0]:
        spec.delete(geom)


def plane(spec: mujoco.MjSpec) -> None:
    """The table's top as a plane to the object: no edge."""
    at = [*scene.TABLE_CENTRE[:2], scene.TABLE_TOP]
    spec.worldbody.add_geom(
        name="top", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[1, 1, 1], pos=at, contype=0, conaffinity=0
    )
    spec.add_pair(name="top", geomname1="top", geomname2=names.OBJECT_GEOM, condim=3)
    spec.add_exclude(bodyname1="world", bodyname2=names.OBJECT_BODY)


SOLVER, CONE = mujoco.mjtSolver, mujoco.mjtCone
CHOICES = (
    Choice("default"),
    Choice("time step 1/240 s", step=1 / 240),
    Choice("time step 1/960 s", step=1 / 960),
    Choice("solver CG", model=option(solver=int(SOLVER.mjSOL_CG))),
    Choice("solver PGS", model=option(solver=int(SOLVER.mjSOL_PGS))),
    Choice("at most 1 iteration", model=option(iterations=1)),
    Choice("solver tolerance 1e-4", model=option(tolerance=1e-4)),
    Choice("pyramidal cone", model=option(cone=int(CONE.mjCONE_PYRAMIDAL))),
    Choice("no constraint islands", model=without("ISLAND")),
    Choice("no warm start", model=without("WARMSTART")),
    Choice("integrator Euler", model=option(integrator=int(mujoco.mjtIntegrator.mjINT_EULER))),
    Choice("one contact point a pair", model=without("MULTICCD")),
    Choice("libccd collider", model=without("NATIVECCD")),
    Choice("table top a plane", spec=plane),
    Choice("no visual geoms", spec=bare),
    Choice("no sensors", model=without("SENSOR")),
    Choice("no contacts (floor of the cost)", model=without("CONTACT")),
)
#: Nothing can be measured of their forces.
BLIND = ("no sensors", "no contacts (floor of the cost)")


def make(choice: Choice, robot: str, **arguments: Any) -> Any:
    """The environment of a robot, with one thing otherwise."""

    def build(config: scene.SceneConfig) -> mujoco.MjModel:
        spec, model = scene.build_spec(config)
        if choice.spec is not None:
            choice.spec(spec)
            model = spec.compile()
            assert config.item is not None
            scene.set_object(model, config.item)
        if choice.model is not None:
            choice.model(model)
        return model

    with mock.patch.object(shared, "MAX_TIMESTEP", choice.step), mock.patch.object(scene, "build", build):
        return gymnasium.make(f"tiago_mj/{IDS[robot]}", **arguments).unwrapped


def curve(choice: Choice, robot: str, item: str, program: str) -> np.ndarray:
    """Contact forces (steps, 2) [N] of a second and a quarter of commands at 240 Hz."""
    env = make(choice, robot, object=item, object_offset=0.005 if robot == "gripper_ta11" else 0.0018)
    env.reset(seed=0)
    action, forces = np.zeros(env.action_space.shape), []
    for step in range(300):
        now = step / 240
        wave = -0.5 if now < 0.55 else -0.1 * np.sin(2 * np.pi * 3 * now)
        action[-2:] = -1.0 if program == "close" else wave
        env.step(action)
        forces.append(env.state.force_contact)
    return np.array(forces)


def times(made: dict[str, Any], rounds: int) -> dict[str, dict[str, float]]:
    """Microseconds of a step, and contacts, by choice."""
    found: dict[str, dict[str, float]] = {name: {} for name in made}
    for phase in ("open", "grasp"):
        runs = {}
        for name, env in made.items():
            env.reset(seed=0)
            action = np.zeros(env.action_space.shape)
            if phase == "grasp":
                action[-2:] = -1.0
                for _ in range(150):
                    env.step(action)
            state = np.empty(mujoco.mj_stateSize(env.model, STATE))
            mujoco.mj_getState(env.model, env.data, state, STATE)
            runs[name] = (env.model, mujoco.MjData(env.model), state)
        best = dict.fromkeys(runs, np.inf)
        for _ in range(rounds):
            for name, (model, data, state) in runs.items():
                mujoco.mj_setState(model, data, state, STATE)
                data.ctrl[:] = 0
                begin = time.thread_time()  # of this thread alone: other work on the machine does not count
                mujoco.mj_step(model, data, nstep=STEPS)
                best[name] = min(best[name], (time.thread_time() - begin) / STEPS)
        for name, (_, data, _) in runs.items():
            found[name] |= {f"{phase}_us": best[name] * 1e6, f"{phase}_contacts": int(data.ncon)}
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=20)
    parser.add_argument("--robots", nargs="*", default=list(IDS), choices=list(IDS))
    parser.add_argument("--name", default="physics", help="of the file in results/")
    given = parser.parse_args()
    results: dict[str, list[dict[str, Any]]] = {}
    programs = [(program, item) for program in ("close", "wave") for item in ("cylinder", "box")]
    for robot in given.robots:
        made, refused = {}, {}
        for choice in CHOICES:
            try:
                made[choice.name] = make(choice, robot)
            except ValueError as reason:  # the contact would be unstable
                refused[choice.name] = str(reason)
        spent = times(made, given.rounds)
        fine = Choice("reference", step=REFERENCE)
        references = {p: curve(fine, robot, p[1], p[0]) for p in programs}
        touching = [p for p in programs if references[p].max() > 1.0]  # [N]; TIAGo's wave does not reach the object
        rows = []
        for choice in CHOICES:
            if choice.name in refused:
                rows.append({"choice": choice.name, "refused": refused[choice.name]})
                print(f"{robot:14}{choice.name:32} refused: {refused[choice.name]}")
                continue
            row: dict[str, Any] = {"choice": choice.name, **spent[choice.name]}
            steps = round(1 / 240 / choice.step)
            row["us_of_a_control_step"] = steps * (row["open_us"] + row["grasp_us"]) / 2
            if choice.name not in BLIND:
                row["programs"] = {}
                for program, item in touching:
                    peak = references[program, item].max()
                    error = np.abs(curve(choice, robot, item, program) - references[program, item]) / peak
                    row["programs"][f"{program} {item}"] = {
                        "rms": float(np.sqrt((error**2).mean())),
                        "p95": float(np.percentile(error, 95)),
                    }
                row |= {key: max(of[key] for of in row["programs"].values()) for key in ("rms", "p95")}
            rows.append(row)
            curve_error = f"rms {row['rms']:.2%} p95 {row['p95']:.2%}" if "rms" in row else ""
            print(
                f"{robot:14}{choice.name:32} open {row['open_us']:6.2f} us ({row['open_contacts']})  "
                f"grasp {row['grasp_us']:6.2f} us ({row['grasp_contacts']})  "
                f"control step {row['us_of_a_control_step']:6.1f} us  {curve_error}"
            )
        results[robot] = rows
    print("saved", save(given.name, {"reference": REFERENCE, "robots": results}).name)


if __name__ == "__main__":
    main()

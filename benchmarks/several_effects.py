"""Several large effects at once: arms of three joints that rub, carry a load and have other drives than their model.

Reality is MuJoCo with its own friction, damping, armature, another body and other gains, at a quarter of the model's
step; nothing of the library's effects takes part. One to four kinds of effects are drawn for each arm, with another
number on each joint. What is diagnosed is the commands of its position servos, or motion and efforts alone.

    python -m benchmarks.several_effects --cases 12 --seed 2 --of efforts --out DIR [--save NAME]
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from collections import Counter
from pathlib import Path
from typing import Any, Final

import mujoco
import numpy as np

from benchmarks.machine import save

JOINTS: Final = ("turn", "lift", "roll")
#: Gains of the servos [N·m/rad], [N·m·s/rad].
SERVOS: Final = {"turn": (60.0, 4.0), "lift": (60.0, 4.0), "roll": (15.0, 0.6)}
DRIVES: Final = [f'<position joint="{j}" kp="{p}" kv="{v}" forcerange="-30 30"' for j, (p, v) in SERVOS.items()]
ARM: Final = f"""<mujoco model="arm">
  <option timestep="0.002" integrator="implicitfast"/>
  <default><joint damping="0.1" frictionloss="0.05" armature="0.01"/><geom type="capsule" size="0.02"/></default>
  <worldbody>
    <body name="upper"><joint name="turn" axis="0 0 1"/><geom fromto="0 0 0 0.1 0 0" mass="2"/>
      <body name="middle" pos="0.1 0 0"><joint name="lift" axis="0 1 0"/><geom fromto="0 0 0 0.3 0 0" mass="1.5"/>
        <body name="last" pos="0.3 0 0">
          <joint name="roll" axis="1 0 0"/><geom fromto="0 0 0 0.06 0 0" mass="0.4"/>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator>
    {"".join(f'{drive} name="{j}"/>' for j, drive in zip(JOINTS, DRIVES, strict=True))}
  </actuator>
</mujoco>
"""
#: What is drawn, with a scale for each joint: of dry friction [N·m], damping [N·m·s/rad], armature [kg·m²].
SCALES: Final = {
    "coulomb_friction": (0.5, 0.6, 0.12),
    "viscous_friction": (0.6, 0.8, 0.16),
    "armature": (0.1, 0.1, 0.03),
}
KINDS: Final = (*SCALES, "payload", "torque_constant")
TRIALS, SECONDS, RATE = 6, 3.0, 100
#: Noise of positions [rad], velocities [rad/s] and efforts [N·m].
NOISE: Final = (2e-4, 5e-3, 0.02)


def reality(rng: np.random.Generator) -> tuple[mujoco.MjModel, dict[str, Any], np.ndarray]:
    """An arm, what is true of it, and by what factor its efforts are read too large, (3,)."""
    kinds = rng.choice(KINDS, size=rng.integers(1, 5), replace=False)
    spec, truth = mujoco.MjSpec.from_string(ARM), {}
    if "payload" in kinds:
        load = spec.body("last").add_body(pos=rng.uniform((0.03, -0.05, -0.05), (0.13, 0.05, 0.05)))
        load.explicitinertial, load.mass, load.inertia = True, rng.uniform(0.2, 0.8), np.full(3, 1e-6)
        truth["payload"] = {"all": load.mass}
    model, reads = spec.compile(), np.ones(3)
    model.opt.timestep /= 4
    model.dof_solref[:], model.dof_solimp[:, :2] = (2 * model.opt.timestep, 1), 0.99  # hardly any creep
    fields = (model.dof_frictionloss, model.dof_damping, model.dof_armature)
    for (kind, scale), field in zip(SCALES.items(), fields, strict=True):
        if kind in kinds:
            more = np.array(scale) * np.exp(rng.uniform(-0.8, 0.8, 3))
            field[:] += more
            truth[kind] = dict(zip(JOINTS, more.tolist(), strict=True))
    if "torque_constant" in kinds:
        k, factor = 1, rng.choice([0.7, 0.8, 1.25, 1.4])  # of the joint that carries the arm
        model.actuator_gainprm[k] *= factor
        model.actuator_biasprm[k] *= factor
        truth["torque_constant"], reads[k] = {JOINTS[k]: float(factor)}, 1 / factor
    return model, truth, reads


def record(folder: Path, model: mujoco.MjModel, reads: np.ndarray, rng: np.random.Generator, of: str) -> None:
    """Write model and recordings: sines. Commands are held for a row, every other time with steps beside them; where
    efforts are recorded drives follow the path itself."""
    (folder / "arm.xml").write_text(ARM)
    columns = {"commands": ("command", "position", "velocity"), "efforts": ("effort", "position", "velocity")}[of]
    for trial in range(TRIALS):
        data, rows = mujoco.MjData(model), []
        fast, phase = rng.uniform(1.5, 5.0, (2, 3)), rng.uniform(0, 6, (2, 3))
        size = rng.uniform(0.15, 0.4, (2, 3))
        ticks = round(1 / RATE / model.opt.timestep)
        for k in range(round(SECONDS * RATE) * ticks):
            at = k * model.opt.timestep if of == "efforts" else k // ticks / RATE
            step = 0.25 * (trial % 2) * (int(at / 0.75) % 2) * (of == "commands")
            data.ctrl[:] = (size * (np.sin(fast * at + phase) - np.sin(phase))).sum(0) + step
            if k % ticks == 0:
                mujoco.mj_forward(model, data)
                first = data.ctrl if of == "commands" else data.qfrc_actuator * reads + rng.normal(0, NOISE[2], 3)
                q, v = data.qpos + rng.normal(0, NOISE[0], 3), data.qvel + rng.normal(0, NOISE[1], 3)
                rows.append((at, *first, *q, *v))
            mujoco.mj_step(model, data)
        header = ",".join(["time", *(f"{column}.{joint}" for column in columns for joint in JOINTS)])
        np.savetxt(folder / f"log-{trial}.csv", rows, delimiter=",", header=header, comments="")
        interface = {"interface": "position"} if of == "commands" else {}
        (folder / f"log-{trial}.json").write_text(json.dumps({"robot": "arm.xml", **interface}))


def grade(truth: dict[str, Any], found: dict[str, Any]) -> str:
    """``all``, ``some`` or ``none`` of the kinds are named, ``false``: one that is not there."""
    said = found["verdict"]
    named = {one["name"] for one in said["effects"]} if said["kind"] in ("effect", "ambiguous") else set()
    if named - set(truth):
        return "false"
    return "all" if named == set(truth) else "some" if named else "none"


def main(words: list[str] | None = None) -> int:
    """Command line."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.several_effects")
    parser.add_argument("--cases", type=int, required=True, metavar="N")
    parser.add_argument("--seed", type=int, required=True, metavar="N")
    parser.add_argument("--of", choices=("commands", "efforts"), required=True)
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    parser.add_argument("--save", metavar="NAME", help="results/NAME.json")
    asked, each = parser.parse_args(words), []
    for k in range(asked.cases):
        rng, folder = np.random.default_rng([asked.seed, k]), asked.out / f"{k:03d}"
        model, truth, reads = reality(rng)
        answer = folder / "diagnosis" / "diagnosis.json"
        if not answer.exists():
            folder.mkdir(parents=True, exist_ok=True)
            record(folder, model, reads, rng, asked.of)
            logs = [str(folder / f"log-{trial}.csv") for trial in range(TRIALS)]
            words = ["diagnose", *logs, "--model", str(folder / "arm.xml"), "--out", str(answer.parent), "--jobs", "1"]
            subprocess.run([sys.executable, "-m", "tiago_mj.cli", *words], check=False, capture_output=True)
        found = json.loads(answer.read_text())
        names = sorted({one["name"] for one in found["verdict"]["effects"]})
        each.append(
            {"truth": sorted(truth), "kind": found["verdict"]["kind"], "named": names, "grade": grade(truth, found)}
        )
        each[-1] |= {"closed": found["shrink"]["closed"], "physics_steps": found["physics_steps"]}
        print(json.dumps(each[-1]), flush=True)
    closed = [one["closed"] or 0.0 for one in each]
    results = {"grades": Counter(one["grade"] for one in each), "closed_median": float(np.median(closed)), "each": each}
    print(results["grades"], round(float(np.median(closed)), 3))
    if asked.save:
        command = f"python -m benchmarks.several_effects --cases {asked.cases} --seed {asked.seed} --of {asked.of}"
        print(save(asked.save, results, f"{command} --out DIR"))
    return 0


if __name__ == "__main__":
    sys.exit(main())

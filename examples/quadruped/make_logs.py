"""A log of a quadruped's legs in the air, one of whose knees rubs, and the quadruped's model.

    python examples/quadruped/make_logs.py --out out/quadruped

This takes the place of a real robot that hangs from its trunk and its logger: goals and angles of eight joints at
200 Hz for 24 s, in degrees. In every joint a controller of 20 N·m/rad and 0.5 N·m·s/rad makes torques of the goals; the
model has motors. Every knee has dry friction of 0.15 N·m that the model lacks, and the rear left one has 0.6 N·m.
"""

from __future__ import annotations

import argparse
import csv
from pathlib import Path

import mujoco
import numpy as np

LEGS = {"FL": (0.2, 0.1), "FR": (0.2, -0.1), "RL": (-0.2, 0.1), "RR": (-0.2, -0.1)}
PARTS = ("thigh", "knee")
KP, KV = 20.0, 0.5
FRICTION = {"FL": 0.15, "FR": 0.15, "RL": 0.6, "RR": 0.15}
RATE, SECONDS, STEP = 200, 24.0, 1e-3
#: Of the controllers [s], which hold a torque for so long: of 20 N·m/rad that is 0.0025 N·m·s/rad less damping. At STEP
#: it would be 0.01, a tenth of a joint's own, and a diagnosis would find it.
CONTROL_STEP = 2.5e-4
ENCODER = np.radians(1e-3)


def model(friction: dict[str, float] | None = None) -> str:
    """MJCF with motors; with friction in the knees where it is given."""
    legs = ""
    for leg, (x, y) in LEGS.items():
        rub = 0.0 if friction is None else friction[leg]
        legs += f"""
      <body name="{leg}_thigh" pos="{x} {y} 0">
        <joint name="{leg}_thigh_joint" axis="0 1 0" armature="0.01" damping="0.1"/>
        <geom type="capsule" size="0.02" fromto="0 0 0 0 0 -0.2" mass="1"/>
        <body name="{leg}_knee" pos="0 0 -0.2">
          <joint name="{leg}_knee_joint" axis="0 1 0" armature="0.01" damping="0.1" frictionloss="{rub}"/>
          <geom type="capsule" size="0.015" fromto="0 0 0 0 0 -0.2" mass="0.4"/>
        </body>
      </body>"""
    motors = "".join(f'\n    <motor name="{leg}_{part}" joint="{leg}_{part}_joint"/>' for leg in LEGS for part in PARTS)
    return f"""<mujoco model="quadruped">
  <option timestep="{STEP}" integrator="implicitfast"/>
  <default><geom contype="0" conaffinity="0"/></default>
  <worldbody>
    <body name="trunk" pos="0 0 0.5">
      <freejoint/>
      <geom type="box" size="0.25 0.1 0.05" mass="6"/>{legs}
    </body>
  </worldbody>
  <actuator>{motors}
  </actuator>
</mujoco>
"""


def log(path: Path) -> None:
    """Sways of every joint, each with a period of its own, on the trunk that hangs from a rope."""
    real = mujoco.MjModel.from_xml_string(model(FRICTION).replace("<freejoint/>", ""))
    real.opt.timestep = CONTROL_STEP
    data, rng = mujoco.MjData(real), np.random.default_rng(0)
    joints = [real.joint(j).name for j in range(real.njnt)]
    with path.open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(["t_ms", *(f"{name}.goal" for name in joints), *(f"{name}.angle" for name in joints)])
        for at in np.arange(int(SECONDS * RATE)) / RATE:
            goal = 0.5 * np.sin(2 * np.pi * at / (1.3 + 0.11 * np.arange(real.nq)))
            angle = data.qpos + rng.normal(0, ENCODER, real.nq)
            degrees = np.degrees(np.concatenate([goal, angle]))
            rows.writerow([f"{1000 * at:.3f}", *(f"{value:.5f}" for value in degrees)])
            for _ in range(round(1 / RATE / CONTROL_STEP)):
                data.ctrl[:] = KP * (goal - data.qpos) - KV * data.qvel
                mujoco.mj_step(real, data)


def main() -> None:
    """Write both into a folder."""
    parser = argparse.ArgumentParser(description="A log of legs in the air, and the model of the robot.")
    parser.add_argument("--out", type=Path, required=True, help="folder")
    out = parser.parse_args().out
    (out / "logs").mkdir(parents=True, exist_ok=True)
    (out / "quadruped.xml").write_text(model())
    log(out / "logs" / "sway.csv")
    print(f"wrote {out / 'quadruped.xml'} and {out / 'logs' / 'sway.csv'}")


if __name__ == "__main__":
    main()

"""A leg in the air whose every joint rubs, recorded with the commands of its position servos."""

from __future__ import annotations

import json
from pathlib import Path

import mujoco
import numpy as np

from tiago_mj.recordings.read import read_recordings
from tiago_mj.recordings.recording import Trial

JOINTS = ("hip", "thigh", "calf")
LINK = (
    '<body pos="0 0 {}"><joint name="{}" axis="{}" damping="0.05"/><geom size=".02" fromto="0 0 0 0 0 -.2" mass=".4"/>'
)
LEG = f"""<mujoco><option timestep="0.002"/><default><geom type="capsule"/></default><worldbody>
{LINK.format(1, "hip", "1 0 0")}{LINK.format(-0.2, "thigh", "0 1 0")}{LINK.format(-0.2, "calf", "0 1 0")}
</body></body></body></worldbody><actuator>
{"".join(f'<position name="{name}" joint="{name}" kp="20" kv="0.5" forcerange="-20 20"/>' for name in JOINTS)}
</actuator></mujoco>"""
#: MuJoCo's own dry friction [N·m].
RUBS = (0.2, 0.2, 0.8)
RATE = 100


def recorded(folder: Path) -> list[Trial]:
    """Two trials; the model and the recordings are written into the folder."""
    (folder / "leg.xml").write_text(LEG)
    model = mujoco.MjModel.from_xml_string(LEG)
    model.dof_frictionloss[:] = RUBS
    model.dof_solref[:], model.dof_solimp[:, :2] = (2 * model.opt.timestep, 1), 0.99  # hardly any creep
    rng = np.random.default_rng(4)
    for trial in range(2):
        data, rows = mujoco.MjData(model), []
        fast = rng.uniform(2.0, 5.0, 3)
        for at in np.arange(0, 3, 1 / RATE):
            data.ctrl[:] = 0.6 * np.sin(fast * at)
            rows.append((at, *data.ctrl, *(data.qpos + rng.normal(0, 2e-4, 3))))
            for _ in range(round(1 / RATE / model.opt.timestep)):
                mujoco.mj_step(model, data)
        names = [f"command.{name}" for name in JOINTS] + [f"position.{name}" for name in JOINTS]
        header = ",".join(["time", *names])
        np.savetxt(folder / f"log-{trial}.csv", rows, delimiter=",", header=header, comments="")
        (folder / f"log-{trial}.json").write_text(json.dumps({"robot": "leg.xml", "interface": "position"}))
    return list(read_recordings([folder / "log-0.csv", folder / "log-1.csv"]).trials)

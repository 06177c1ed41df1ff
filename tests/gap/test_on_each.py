"""An effect on every joint, with a magnitude of its own on each."""

from __future__ import annotations

import json
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from tiago_mj.gap.inference import hypotheses
from tiago_mj.gap.inference.fit import Fitter, Point, Start
from tiago_mj.gap.inference.predictor import predictor
from tiago_mj.gap.search import on_each, ranking
from tiago_mj.gap.search.state import State
from tiago_mj.gap.simulation.plant import plant_of
from tiago_mj.gap.simulation.subset import Subset
from tiago_mj.recordings.read import read_recordings

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


@pytest.fixture(scope="module")
def leg(tmp_path_factory):
    """A search whose best explanation is one friction on every joint, of a leg with another one on each."""
    folder = tmp_path_factory.mktemp("leg")
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
    trials = read_recordings([folder / "log-0.csv", folder / "log-1.csv"]).trials
    predict, _ = predictor(plant_of(trials, model=folder / "leg.xml"), trials, threads=1)
    pool = hypotheses.candidates(predict.plant, ["coulomb_friction"])
    none = np.zeros((0, *predict.data.value.shape))
    full = Fitter(predict, Subset((0, 1)), predict.data, np.ones(len(predict.data.channels)), (), none)
    every = next(one for one in pool if one.target is None)
    fits = full.fit_all([Start((), np.zeros(0)), Start((every,), np.array([0.4]))])
    return State(full, full, tuple(fits), np.zeros(0), Point((), np.zeros(0), np.zeros(0)), pool=tuple(pool))


def test_one_friction_for_all_joints_gives_way_to_one_on_each_where_it_leaves_a_gap(leg):
    assert ranking.discrepancy(leg.best) > ranking.INADEQUATE_DISCREPANCY
    spent = replace(leg, full=replace(leg.full, out_of_time=lambda: True))  # its budget
    best = on_each.target(spent, lambda: False).best
    found = {part.target[0]: value for part, value in zip(best.parts, best.values, strict=True)}
    assert [found[name] for name in JOINTS] == pytest.approx(RUBS, rel=0.1)
    assert best.evidence > leg.best.evidence + 100
    assert ranking.size(best) == 1  # what all joints have is one effect


def test_one_friction_that_leaves_no_gap_is_kept(leg, monkeypatch):
    monkeypatch.setattr(ranking, "INADEQUATE_DISCREPANCY", np.inf)
    assert on_each.target(leg, lambda: False) is leg


def test_nothing_is_fitted_once_the_time_is_over(leg):
    assert on_each.target(leg, lambda: True) is leg

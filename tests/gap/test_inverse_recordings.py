"""Recordings for the diagnosis along their motion: several, faulty in a channel, or of no use."""

import json
from collections.abc import Callable
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from made_motions import ARM, diagnosed, named, pendulum, record, robot, trial

from tiago_mj.gap.report import json as report
from tiago_mj.gap.torque.channels import Usable, Wanted, choose
from tiago_mj.recordings.lint import inspect
from tiago_mj.recordings.recording import RecordingError, Trial


def test_a_dead_effort_channel_is_left_out_and_named() -> None:
    recorded = record(robot(), ARM[2:], spread=0.9, seconds=12)
    dead = dict(recorded.efforts) | {"arm_4_joint": np.zeros_like(recorded.time)}
    found = diagnosed(replace(recorded, efforts=dead))
    assert ("dead_channel", "effort.arm_4_joint") in {(f.code, f.channel) for f in found.findings}
    assert "effort.arm_4_joint" not in {place.channel for place in found.where}


def test_a_drive_that_is_switched_off_once_is_not_dead() -> None:
    """A joint that swings freely has no torque, and its channel has shown a signal before."""
    recorded = record(pendulum(), ("swing",), spread=1.2, seconds=30)

    def with_effort(on: np.ndarray) -> Trial:
        return replace(recorded, efforts={"swing": np.where(on, recorded.efforts["swing"], 0.0)})

    once = with_effort(recorded.time < 5)
    now_and_then = with_effort(recorded.time % 6 < 1)  # as much of it, in pieces
    assert "dead_channel" not in {f.code for f in inspect([once])}
    assert choose([once], pendulum(), Wanted(("swing",), inspect([once]))).course.channels == ("swing",)
    for dead in (now_and_then, with_effort(recorded.time < 1), with_effort(recorded.time < 0)):
        assert ("dead_channel", "effort.swing") in {(f.code, f.channel) for f in inspect([dead])}


def test_an_effort_of_the_wrong_sign_is_found_where_it_is() -> None:
    recorded = record(robot(), ARM, spread=0.9, seconds=15)
    flipped = dict(recorded.efforts) | {"arm_2_joint": -recorded.efforts["arm_2_joint"]}
    found = choose([replace(recorded, efforts=flipped)], robot(), Wanted(ARM))
    assert {f.channel for f in found.findings if f.code == "sign"} == {"effort.arm_2_joint"}


def test_an_effort_in_another_unit_is_left_out_and_named() -> None:
    recorded = record(robot(), ARM[1:3], spread=0.9, seconds=12)
    amperes = dict(recorded.efforts) | {"arm_2_joint": recorded.efforts["arm_2_joint"] / 400}
    found = diagnosed(replace(recorded, efforts=amperes))
    assert ("unit_scale", "effort.arm_2_joint") in {(f.code, f.channel) for f in found.findings}


def test_several_short_trials_are_not_cut() -> None:
    model = pendulum()
    model.dof_frictionloss[:] += 0.3
    whole = [record(model, ("swing",), spread=1.2, seconds=4, seed=k) for k in range(7)]
    trials = tuple(replace(one, name=f"t{k}") for k, one in enumerate(whole))
    found = diagnosed(*trials)
    assert sorted(name for part in found.splits.values() for name in part) == [f"t{k}" for k in range(7)]
    assert named(found.best) == {"coulomb_friction"}


def test_the_same_recording_and_seed_give_the_same_answer() -> None:
    model = pendulum()
    model.dof_damping[:] += 0.2
    recorded = record(model, ("swing",), spread=1.2, seconds=12)
    first, second = (json.loads(report.text(diagnosed(recorded))) for _ in range(2))
    first.pop("seconds"), second.pop("seconds")
    assert first == second


@pytest.mark.parametrize(
    ("spoil", "says"),
    [
        (lambda t: replace(t, positions={"swing": np.zeros_like(t.time)}), "no joint moves"),
        (lambda t: replace(t, efforts={"swing": np.zeros_like(t.time)}), "same value"),
        (
            lambda t: trial(t.time[:20], {"swing": t.positions["swing"][:20]}, {"swing": t.efforts["swing"][:20]}),
            "longer",
        ),
        (lambda t: replace(t, efforts={"swing": np.full_like(t.time, np.nan)}), "same value|no stretch"),
    ],
)
def test_a_recording_that_cannot_be_used_ends_in_one_line(spoil: Callable[[Trial], Trial], says: str) -> None:
    recorded = spoil(record(pendulum(), ("swing",), spread=1.2, seconds=10))
    with pytest.raises(RecordingError, match=says) as fault:
        diagnosed(recorded)
    assert "trial.csv" in str(fault.value)
    assert "\n" not in str(fault.value)


WRIST = """
<mujoco>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <body name="arm">
      <joint name="shoulder" axis="0 1 0"/>
      <geom type="capsule" fromto="0 0 0 0.5 0 0" size="0.04" mass="8"/>
      <body name="hand" pos="0.5 0 0">
        <joint name="wrist" axis="1 0 0"/>
        <geom type="box" size="0.02 0.02 0.02" mass="0.2"/>
      </body>
    </body>
  </worldbody>
  <actuator><motor name="shoulder" joint="shoulder"/><motor name="wrist" joint="wrist"/></actuator>
</mujoco>
"""


def test_a_wrist_whose_effort_is_all_friction_is_in_the_right_unit() -> None:
    """The frictionless model needs 1e-4 N·m there; what the shoulder carries shows that these are newton-metres."""
    recorded = record(mujoco.MjModel.from_xml_string(WRIST), ("shoulder", "wrist"), spread=0.9, seconds=15)
    rubs = 3.0 * np.sign(np.gradient(recorded.positions["wrist"]))
    model = mujoco.MjModel.from_xml_string(WRIST)

    def chosen(wrist: np.ndarray) -> Usable:
        trial = replace(recorded, efforts={**recorded.efforts, "wrist": wrist})
        return choose([trial], model, Wanted(("shoulder", "wrist")))

    assert chosen(recorded.efforts["wrist"] + rubs).course.channels == ("shoulder", "wrist")
    ticks = chosen(1000 * (recorded.efforts["wrist"] + rubs))
    assert ticks.course.channels == ("shoulder",)
    assert {(f.code, f.channel) for f in ticks.findings} == {("unit_scale", "effort.wrist")}


def test_efforts_under_each_others_names_are_found_and_left_out() -> None:
    recorded = record(robot(), ARM, spread=0.9, seconds=15)
    one, other = ARM[1:3]
    swapped = {**recorded.efforts, one: recorded.efforts[other], other: recorded.efforts[one]}
    found = choose([replace(recorded, efforts=swapped)], robot(), Wanted(ARM))
    assert {f.channel for f in found.findings if f.code == "swapped_channels"} == {f"effort.{one}", f"effort.{other}"}
    assert set(found.course.channels) == set(ARM) - {one, other}
    assert not choose([recorded], robot(), Wanted(ARM)).findings

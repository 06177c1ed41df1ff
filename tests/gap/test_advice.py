"""What a report says to do now: what to run, what to record, where to look on the robot."""

from __future__ import annotations

import re
import shlex
from types import SimpleNamespace

import numpy as np
import pytest
from made_diagnoses import CASES, COULOMB, LEFT, RIGHT, Read, diagnosis, every_case, replace

from tiago_mj.cli import main
from tiago_mj.effects import EFFECTS, describe
from tiago_mj.effects.declare import STAGES
from tiago_mj.effects.spec import Entry
from tiago_mj.gap.analysis import outcome
from tiago_mj.gap.decision.verdict import most_probable
from tiago_mj.gap.report import advice, html, tables, verdict
from tiago_mj.gap.report.repaired import limits
from tiago_mj.gap.result import Explanation, FitQuality, Named, Repaired, Value
from tiago_mj.gap.simulation.plant import plant_of
from tiago_mj.recordings import motions
from tiago_mj.recordings.recording import Sidecar, Trial

HINGE = """<mujoco><worldbody><body><joint name="elbow" axis="0 1 0"/><geom type="capsule" size=".02"
 fromto="0 0 0 0.3 0 0"/></body></worldbody><actuator><{actuator}/></actuator></mujoco>"""


def trial(path):
    """A hinge that stands still."""
    still = np.zeros(20)
    sidecar = Sidecar(robot=str(path), rate_hz=100.0, interface="position")
    return Trial("a", np.arange(20) / 100, {"m": still}, {"elbow": still}, {}, {}, {}, sidecar, "a.csv")


def steps(given):
    return {step.title: step for step in advice.advice(given)}


def said(given):
    return " ".join(Read(html.render(given)).words.replace("\N{NO-BREAK SPACE}", " ").split())


def model_of(holds=("coulomb_friction",), lacks=()):
    xml = "<mujoco/>" if holds or lacks else ""
    return Repaired(xml, "", holds, lacks, 100.0, "position", 0.002, ("elbow",), ("elbow",))


@every_case
def test_every_verdict_has_something_to_do_and_the_page_says_it(name):
    done = advice.advice(CASES[name])
    assert done
    page = said(CASES[name])
    assert page.index("What to do now") < page.index("How these numbers were made")
    for step in done:
        assert step.title in page
        assert step.said or step.places
        if step.command:
            assert step.command in page


@every_case
def test_every_command_is_one_that_the_program_knows(name, capsys):
    for step in advice.advice(CASES[name]):
        if not step.command.startswith("tiago-mj "):
            continue
        words = shlex.split(step.command)[1:]
        with pytest.raises(SystemExit) as over:
            main([words[0], "--help"])
        assert over.value.code == 0
        known = capsys.readouterr().out
        assert all(word in known for word in words if word.startswith("--"))
        if words[0] == "record" and "--env" in words and CASES[name].next_motion is None:
            assert motions.find(words[words.index("--motion") + 1]) is not None


def test_what_a_rest_looks_like_says_what_to_record():
    given = CASES["unknown_with_a_shape"]
    assert "with the drives on and with them off" in steps(given)["Find out what the rest depends on"].said
    rises = steps(CASES["unknown_that_may_be_several"])
    assert "Record steps with rests" in rises["Find out what the rest depends on"].said
    assert "--motion stop_and_go_25hz.csv" in rises["Record a motion that shows it alone"].command
    # The channel with most of the gap is a force, but no stage of the shape is one of the force sensor.
    assert "known weights" not in rises["Look where the gap is"].said
    assert "Find out what the rest depends on" in steps(CASES["effect_and_an_irregular_rest"])
    assert "Find out what the rest depends on" not in steps(CASES["unknown"])


def test_an_effect_is_used_in_the_simulator_and_looked_for_on_the_robot():
    given = diagnosis(limits={"joint": {RIGHT: 16.0, LEFT: 16.0}})
    use, look = advice.advice(given)
    assert use.command == "tiago-mj train --env tiago_mj/GripperTactile-v0 --effects out/calibration.yaml --out trained"
    assert use.install.endswith("'.[train]'")
    assert use.code.startswith("import gymnasium\nimport tiago_mj")
    assert use.code.endswith('\n\nenv = gymnasium.make("tiago_mj/GripperTactile-v0", effects="out/calibration.yaml")')
    ((what, where),) = look.places
    assert "2.6 N (2.4–2.9) of Coulomb friction" in what
    assert "16 % of the largest force that its drive gives" in what
    assert where.lower() == describe(EFFECTS["coulomb_friction"]).check.lower()


def test_drives_of_several_strengths_have_a_range_of_shares_and_no_limit_has_none():
    on_all = replace(COULOMB, target="all")
    strengths = {"joint": {"a": 10.0, "b": 50.0}}
    told, _ = advice.on_robot(diagnosis(best=(on_all,), limits=strengths), on_all)
    assert "5.3 % to 26 %" in told
    told, _ = advice.on_robot(diagnosis(best=(on_all,)), on_all)
    assert "%" not in told
    lag = Named("force_lag", "all", {"time_constant": Value(0.03, 0.02, 0.04, "s")})
    assert "most" not in advice.on_robot(diagnosis(best=(lag,), limits=strengths), lag)[0]


def test_a_model_of_ones_own_is_watched_where_its_file_holds_something():
    command = "tiago-mj diagnose logs --model 'my arm.xml' --seed 0 --out 'my out'"
    given = diagnosis(robot="my arm.xml", repaired=model_of(), command=command)
    use = steps(given)["Use the repaired simulator"]
    assert use.command == "python -m mujoco.viewer --mjcf='my out/repaired.xml'"
    assert 'apply(mujoco.MjModel.from_xml_path("my arm.xml"), "my out/calibration.yaml")' in use.code
    lacking = replace(given, repaired=model_of((), ("backlash",)))
    use = steps(lacking)["Use the repaired simulator"]
    assert use.command == ""
    assert "No model file can hold backlash" in use.said


def test_what_is_ambiguous_is_recorded_first_and_each_explanation_is_looked_for():
    first, look, use = advice.advice(CASES["ambiguous"])
    assert "--motion free_reversals_slow_25hz.csv" in first.command
    assert "87 %" in first.said
    assert [what.split(" has ")[0].split(" have ")[0] for what, _ in look.places] == [
        "The gripper's right finger",
        "Both fingers of the gripper",
    ]
    assert use.title == "Until then, use the likelier repair"


def test_what_is_unknown_is_looked_for_along_the_signal_chain():
    seen = set()
    for stage in STAGES:
        look, record, *_ = advice.advice(diagnosis("unknown", (), stage=stage))
        assert advice.LOOK[stage].lower() in look.said.lower()
        name = re.search(r"--motion (\S+)", record.command).group(1)
        assert motions.find(name) is not None
        seen.add(look.said)
    assert len(seen) == len(STAGES)
    assert "Compare, one after another" in advice.advice(CASES["nothing_compared"])[0].said


def test_a_stage_has_a_motion_of_the_arm_wherever_the_arm_has_that_stage():
    for stage in STAGES:
        for name in advice.MOTIONS[stage]:
            assert not name or motions.rates(name), name


def test_without_a_gap_the_simulator_is_used_as_it_is_or_with_what_was_given():
    use, untested = advice.advice(CASES["no_gap"])
    assert use.command == "tiago-mj train --env tiago_mj/GripperTactile-v0 --out trained"
    assert "6 effects" in untested.said
    known = replace(CASES["no_gap"], given=(Entry("force_lag", None, {}),))
    assert "--effects out/calibration.yaml" in advice.advice(known)[0].command


def test_limits_are_of_the_joint_behind_its_gear(tmp_path):
    def of(actuator):
        path = tmp_path / "hinge.xml"
        path.write_text(HINGE.format(actuator=actuator))
        return limits(plant_of([trial(path)], model=path))

    ranged = of('position name="m" joint="elbow" kp="10" gear="5" forcerange="-2 2"')
    assert ranged == {"joint": {"elbow": 10.0}, "command": {"m": 2.0}}
    motor = of('motor name="m" joint="elbow" gear="30" ctrllimited="true" ctrlrange="-.5 .5"')
    assert motor == {"joint": {"elbow": 15.0}, "command": {"m": 0.5}}
    assert of('position name="m" joint="elbow" kp="10"') == {"joint": {}, "command": {}}


def test_the_highest_probability_is_explained_where_it_is_reached():
    met = FitQuality(met=-100.0, price=-9.0, misfit=1.0, lasting=1.0)
    most = most_probable(Explanation((COULOMB,), 1.0, 1.0, met))
    assert re.search(r"never above \d\d %", verdict.ceiling(Explanation((COULOMB,), most, 1.0, met)))
    assert verdict.ceiling(Explanation((COULOMB,), 0.8 * most, 1.0, met)) == ""
    why = verdict.why_ceiling()
    assert re.search(r"On \d{2,} simulated cases", why)
    assert verdict.why_ceiling(replays=False) != why, "efforts along a motion were tried on cases of their own"
    sure = Explanation((COULOMB,), most, 1.0, met)
    page = html.render(replace(CASES["effect"], best=sure))
    assert 'href="#why-not-surer"' in page
    assert 'id="why-not-surer"' in page


def test_why_a_row_of_the_same_class_stands_where_it_does_is_said_only_where_there_is_one():
    again = Explanation(
        (Named("stribeck_friction", (RIGHT,), {"static": Value(3.0, 2.0, 4.0, "N")}),),
        0.93,
        1.0,
        FitQuality(1, 1, 1, 1),
    )
    given = replace(CASES["effect"], ranking=(CASES["effect"].ranking[0], again, *CASES["effect"].ranking[1:]))
    assert [row.again for row in tables.ranking(given)][:2] == [False, True]
    assert "The rows of one class are listed together" in said(given)
    assert "The rows of one class are listed together" not in said(CASES["effect"])


def test_efforts_that_were_not_compared_are_no_notice_at_the_top(tmp_path):
    quiet = trial(tmp_path / "hinge.xml")
    logged = replace(quiet, efforts={"elbow": np.zeros(20)})
    (aside,) = outcome.asides([logged])
    assert outcome.asides([quiet]) == ()
    plant = SimpleNamespace(joints=(), wiring=SimpleNamespace(targets=SimpleNamespace(slides=())))
    splits = {"train": ("hinge",), "test": ("hinge",)}
    session = SimpleNamespace(trials=[logged], recorded=1, plant=plant, splits=splits)
    predict = SimpleNamespace(data=SimpleNamespace(late=None))
    told = outcome.notes(session, [], SimpleNamespace(excluded=(), complete=True, predict=predict))
    assert not any("effort" in note for note in told)
    page = said(replace(CASES["effect"], asides=(aside,)))
    assert page.index(aside) > page.index("How these numbers were made")


@pytest.mark.parametrize("name", CASES)
def test_what_to_record_next_is_one_plain_line_of_every_whole_answer(name):
    found = CASES[name]
    said = advice.to_record(found)
    assert bool(said) == found.complete
    assert "\n" not in said
    assert "`" not in said
    if found.complete and found.kind == "ambiguous" and found.next_motion is not None:
        assert said == found.next_motion.file

"""What diverges loses quietly; a nominal model that does is one line with the mend; what was found is not lost."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tiago_mj import cli
from tiago_mj.effects import EFFECTS
from tiago_mj.effects.spec import Entry, read_effects
from tiago_mj.gap import command, report
from tiago_mj.gap.faults import FaultError
from tiago_mj.gap.inference import noise_model
from tiago_mj.gap.inference.predictor import Predictor, predictor
from tiago_mj.gap.pipeline import diagnose
from tiago_mj.gap.search import select
from tiago_mj.gap.simulation import replay, stability
from tiago_mj.gap.simulation.plant import Plant, plant_of
from tiago_mj.recordings.recording import RecordingError, Sidecar, Trial

ARM = """
<mujoco model="arm"><option timestep="0.002"/><worldbody><body name="upper" pos="0 0 1">
<joint name="shoulder" axis="0 1 0" {shoulder}/><geom type="capsule" fromto="0 0 0 .3 0 0" size=".03" mass="1.5"/>
<body name="lower" pos=".3 0 0"><joint name="elbow" axis="0 1 0" damping="0.1"/>
<geom type="capsule" fromto="0 0 0 .25 0 0" size=".025" mass=".8"/></body></body></worldbody>
<actuator><position name="shoulder" joint="shoulder" kp="{kp}" kv="5"/>
<position name="elbow" joint="elbow" kp="40" kv="2"/></actuator></mujoco>
"""
RATE = 100.0
JOINTS = ("shoulder", "elbow")
LIBRARY = ("coulomb_friction", "command_delay", "armature")


def arm(folder: Path, *, kp: float = 80, shoulder: str = 'damping="0.1"', seconds: float = 1.5, logs: int = 3) -> Plant:
    """An arm that sags under its own weight, and its motions."""
    model = folder / "arm.xml"
    model.write_text(ARM.format(kp=kp, shoulder=shoulder))
    return plant_of(trials(model, seconds, logs))


def trials(model: Path, seconds: float, logs: int) -> list[Trial]:
    time = np.arange(round(seconds * RATE)) / RATE
    made = []
    for k in range(logs):
        swing = np.where(time > 0.2, np.sin((1.5 + k) * (time - 0.2)), 0.0)
        commands = {"shoulder": 0.3 + 0.4 * swing, "elbow": -0.4 + 0.5 * swing}
        still = {name: np.full_like(time, values[0]) for name, values in commands.items()}
        sidecar = Sidecar(trial=f"log{k}", robot=str(model), rate_hz=RATE, interface="position")
        made.append(Trial(f"log{k}", time, commands, still, {}, {}, {}, sidecar, f"log{k}.csv"))
    return made


def played(plant: Plant, effects: object, folder: Path) -> list[Trial]:
    """Its motions, as the simulator with effects makes them, from where it rests under the first commands."""
    model = folder / "arm.xml"
    made = trials(model, 1.5, 3)
    held = [with_positions(t, {j: np.full_like(t.time, t.commands[j][0]) for j in JOINTS}) for t in made]
    for trial in held:
        for joint in JOINTS:
            trial.commands[joint][:] = trial.commands[joint][0]
    for _ in range(4):  # six seconds
        signals = replay.simulate(plant_of(held), replay.grid(plant, held), [(k, ()) for k in range(3)])
        ends = [
            {j: np.full_like(t.time, signals.position[k, -1, i]) for i, j in enumerate(JOINTS)}
            for k, t in enumerate(held)
        ]
        held = [with_positions(t, end) for t, end in zip(held, ends, strict=True)]
    rested = [with_positions(t, end) for t, end in zip(trials(model, 1.5, 3), ends, strict=True)]
    plant = plant_of(rested)
    signals = replay.simulate(plant, replay.grid(plant, rested), [(k, read_effects(effects)) for k in range(3)])
    seen = signals.position + np.random.default_rng(0).normal(0, 2e-4, signals.position.shape)
    return [with_positions(t, {j: seen[k, :, i] for i, j in enumerate(JOINTS)}) for k, t in enumerate(rested)]


def with_positions(trial: Trial, positions: dict[str, np.ndarray]) -> Trial:
    commands = {name: values.copy() for name, values in trial.commands.items()}
    return replace(trial, commands=commands, positions=positions)


def test_a_candidate_that_diverges_is_not_finite_and_stops_nobody_beside_it(tmp_path):
    plant = arm(tmp_path)
    on = replay.grid(plant, trials(tmp_path / "arm.xml", 1.5, 3))
    wild = (Entry("servo_damping", None, {"damping": 1e4}),)
    together = replay.simulate(plant, on, [(0, ()), (0, wild), (1, ())])
    assert together.diverged.tolist() == [False, True, False]
    alone = replay.simulate(plant, on, [(0, ()), (1, ())])
    np.testing.assert_array_equal(together.position[[0, 2]], alone.position)


def test_no_inertia_at_all_is_refused_like_a_divergence(tmp_path):
    plant = arm(tmp_path)
    on = replay.grid(plant, trials(tmp_path / "arm.xml", 1.5, 1))
    nothing = (Entry("payload", None, {"mass": -5.0}), Entry("armature", None, {"mass": -5.0}))
    assert replay.simulate(plant, on, [(0, nothing), (0, ())]).diverged.tolist()[1] is False


def test_predictions_are_finite_and_what_diverged_is_hopeless(tmp_path):
    plant = arm(tmp_path)
    given = trials(tmp_path / "arm.xml", 1.5, 3)
    predict, _ = predictor(plant, given)
    wild = (Entry("servo_damping", None, {"damping": 1e4}),)
    out = predict([(0, ()), (0, wild)])
    assert np.isfinite(out).all()
    assert np.abs(out[1] - out[0]).max() > 0.5 * noise_model.DIVERGED_DEVIATIONS * predict.data.noise.min()
    assert predict.tally["diverged"] == 1


@pytest.mark.parametrize(
    ("model", "mend"),
    [
        ({"kp": 4e6}, "timestep"),
        ({"shoulder": 'damping="0.1" range="-0.02 0.02"'}, 'angle="radian"'),
    ],
    ids=["stiff servo", "radians read as degrees"],
)
def test_a_nominal_model_that_diverges_is_one_line_with_the_likely_mend(tmp_path, model, mend):
    plant = arm(tmp_path, **model)
    given = trials(tmp_path / "arm.xml", 1.5, 1)
    on = replay.grid(plant, given)
    if "kp" in model:
        with pytest.raises(RecordingError, match=mend) as told:
            predictor(plant, given)
        assert "log0.csv" in str(told.value)
        assert "\n" not in str(told.value)
    assert mend in stability.likely_mend(plant, on, 0)


def test_a_plain_servo_that_sags_held_its_first_command_before_it(tmp_path):
    """An arm at rest under its command is below it; one that stood at another set point is not."""
    sagging = played(arm(tmp_path), None, tmp_path)
    start = plant_of(sagging).starts["log0"]
    np.testing.assert_allclose(start.set_point, [sagging[0].commands[j][0] for j in JOINTS])
    assert np.abs(start.set_point - start.qpos).max() > 0.02
    elsewhere = trials(tmp_path / "arm.xml", 1.5, 1)[0]
    elsewhere.commands["shoulder"][:] += 1.0
    assert plant_of([elsewhere]).starts["log0"].set_point[0] == pytest.approx(elsewhere.positions["shoulder"][0])


def test_a_plain_servo_takes_its_command_at_once_whatever_speed_its_joint_may_have(tmp_path):
    plant = arm(tmp_path)
    given = trials(tmp_path / "arm.xml", 1.5, 1)
    on = replay.grid(plant, given)
    plant.wiring.targets.velocity[:] = 0.1  # as a URDF's limits, which no actuator has
    limited = replay.simulate(plant, on, [(0, ())])
    plant.wiring.targets.velocity[:] = np.inf
    np.testing.assert_array_equal(limited.position, replay.simulate(plant, on, [(0, ())]).position)


def interrupted(monkeypatch) -> None:
    """Let Ctrl-C end the search once the first effects are fitted to all trials."""

    def failing(*given, **named):
        raise KeyboardInterrupt

    monkeypatch.setattr(select.rounds, "around_the_best", failing)


def test_an_interrupted_command_writes_its_best_verdict_and_says_so(tmp_path, monkeypatch, capsys):
    from tiago_mj.recordings.write import write_trial

    for trial in played(arm(tmp_path), {"coulomb_friction": {"force": 0.6}}, tmp_path):
        write_trial(trial, tmp_path / "logs")
    interrupted(monkeypatch)
    words = ["diagnose", str(tmp_path / "logs"), "--out", str(tmp_path / "out"), "--jobs", "1"]
    without = "--without=" + ",".join(name for name in EFFECTS if name not in LIBRARY)
    assert cli.main([*words, without]) == 130
    written = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    assert written["complete"] is False
    assert written["verdict"]["effects"][0]["name"] == "coulomb_friction"
    assert {"diagnosis.json", "calibration.yaml", "report.html", "repaired.xml"} <= {
        p.name for p in (tmp_path / "out").iterdir()
    }
    assert "interrupted" in capsys.readouterr().out


def test_whether_the_step_is_put_right_is_decided_beside_the_explanation(tmp_path):
    """Recorded in this very simulator, late by a delay that is larger than what the step does."""
    late = played(arm(tmp_path), {"command_delay": {"seconds": 0.03}}, tmp_path)
    found = diagnose(late, names=LIBRARY, threads=1)
    (named,) = found.best.effects
    assert named.name == "command_delay"
    assert named.parameters["seconds"].value == pytest.approx(0.03, abs=5e-4)
    assert found.shrink.after < 2.5  # of the simulator as it is: that of the page, the environment and the model file
    assert not found.remains


def test_the_repaired_signals_of_the_page_are_what_its_calibration_simulates(tmp_path):
    rubbing = played(arm(tmp_path), {"coulomb_friction": {"force": 0.6}}, tmp_path)
    found = diagnose(rubbing, names=LIBRARY, threads=1)
    report.write(found, tmp_path / "out")
    (shown,) = found.overlays
    plant, trial = plant_of(rubbing), [t.name for t in rubbing].index(shown.trial)
    entries = read_effects(tmp_path / "out" / "calibration.yaml")
    signals = replay.simulate(plant, replay.grid(plant, rubbing), [(trial, entries)])
    for j, joint in enumerate(JOINTS):
        np.testing.assert_allclose(
            shown.repaired[f"position.{joint}"], signals.position[0, :, j], rtol=0, atol=1e-7
        )  # the file has six digits
    square = [((shown.measured[c] - shown.repaired[c]) / shown.floor[c]) ** 2 for c in shown.measured]
    whole = found.shrink.with_numbers or found.shrink
    assert whole.after == pytest.approx(np.mean(square), rel=1e-6)  # there is one test trial, the one shown


def test_predictions_as_simulated_share_their_simulations_with_those_put_right(tmp_path):
    plant = arm(tmp_path)
    given = trials(tmp_path / "arm.xml", 1.5, 2)
    predict, _ = predictor(plant, given)
    corrected = Predictor(plant, predict.on, predict.data, off=predict.off)
    corrected.all_trials([()], range(2), keep=True)
    count = corrected.tally["simulations"]
    raw = corrected.as_simulated().all_trials([()], range(2))[0]
    assert corrected.tally["simulations"] == count
    simulated = replay.simulate(plant, predict.on, [(k, ()) for k in range(2)])
    np.testing.assert_array_equal(raw, noise_model.predicted(predict.data, simulated))


def test_a_fault_while_a_motion_is_proposed_does_not_lose_what_the_search_found(tmp_path, monkeypatch):
    import tiago_mj.gap.conclusion as module

    def failing(*given, **named):
        raise ValueError("numbers without sense")

    monkeypatch.setattr(module, "next_motion", failing)
    monkeypatch.setattr(module.promises, "standing", lambda judged, *rest: replace(judged, kind="ambiguous"))
    rubbing = played(arm(tmp_path), {"coulomb_friction": {"force": 0.6}}, tmp_path)
    with pytest.raises(FaultError, match="numbers without sense") as met:
        diagnose(rubbing, names=LIBRARY, threads=1)
    found = met.value.answer
    assert [effect.name for effect in found.best.effects] == ["coulomb_friction"]
    assert not found.complete
    assert any("ValueError" in note for note in found.notes)


def test_the_command_in_the_report_is_the_command_that_was_given():
    given = ["diagnose", "my logs", "more", "--model", "arm.xml", "--effects", "a.yaml", "--effects", "b.yaml"]
    given += ["--map", "map.yaml", "--without", "backlash", "--time-budget", "60.0", "--seed", "3", "--out", "out"]
    arguments = cli.build_parser("diagnose").parse_args(given)
    again = cli.build_parser("diagnose").parse_args(command.words(arguments)[1:])
    said, once_more = ({k: v for k, v in vars(one).items() if k != "run"} for one in (arguments, again))
    assert once_more == said

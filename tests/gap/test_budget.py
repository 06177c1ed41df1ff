"""A search that ends before its end: what it says, how to go on, and that it has an answer wherever it ends."""

from __future__ import annotations

import json
import math
import re
import shlex
import signal
import time
from collections.abc import Callable
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from made_diagnoses import CASES
from made_motions import diagnosed, pendulum, record

from tiago_mj import cli
from tiago_mj.effects import EFFECTS
from tiago_mj.effects.spec import read_effects
from tiago_mj.gap import command, conclusion, pipeline, report
from tiago_mj.gap.faults import FAULT, FaultError
from tiago_mj.gap.pipeline import diagnose
from tiago_mj.gap.report import advice, terminal, verdict
from tiago_mj.gap.report import json as as_json
from tiago_mj.gap.result import Diagnosis, Stopped
from tiago_mj.gap.search import screen, select
from tiago_mj.gap.simulation import replay
from tiago_mj.gap.simulation.plant import plant_of
from tiago_mj.io.deadline import Deadline, OutOfTimeError
from tiago_mj.recordings.recording import RecordingError, Sidecar, Trial
from tiago_mj.recordings.write import write_trial

HINGE = """
<mujoco model="hinge"><option timestep="0.002"/><worldbody><body><joint name="swing" axis="0 0 1" damping="0.1"/>
<geom type="capsule" fromto="0 0 0 .3 0 0" size=".03" mass="1"/></body></worldbody>
<actuator><position name="swing" joint="swing" kp="60" kv="3"/></actuator></mujoco>
"""
LIBRARY = ("coulomb_friction", "command_delay", "armature", "viscous_friction")
WITHOUT = ",".join(name for name in EFFECTS if name not in LIBRARY)
FAR = 90.0


def trial(model: Path, number: int, position: np.ndarray | None = None) -> Trial:
    when = np.arange(120) / 100
    commands = {"swing": np.where(when > 0.2, 0.5 * np.sin((2 + number) * (when - 0.2)), 0.0)}
    side = Sidecar(trial=f"log{number}", robot=str(model), rate_hz=100.0, interface="position")
    positions = {"swing": np.zeros_like(when) if position is None else position}
    return Trial(f"log{number}", when, commands, positions, {}, {}, {}, side, f"log{number}.csv")


@pytest.fixture(scope="module")
def rubbing(tmp_path_factory) -> list[Trial]:
    """Three motions of a hinge that rubs by 0.6 N·m more than its model."""
    model = tmp_path_factory.mktemp("hinge") / "hinge.xml"
    model.write_text(HINGE)
    asked = [trial(model, k) for k in range(3)]
    plant, effects = plant_of(asked), read_effects({"coulomb_friction": {"force": 0.6}})
    made = replay.simulate(plant, replay.grid(plant, asked), [(k, effects) for k in range(3)]).position[..., 0]
    made = made + np.random.default_rng(0).normal(0, 2e-4, made.shape)
    return [trial(model, k, made[k]) for k in range(3)]


@pytest.fixture(scope="module")
def pulled() -> Trial:
    """Efforts along a motion of a pendulum that rubs more than its model."""
    model = pendulum()
    model.dof_frictionloss[:] += 0.3
    return record(model, ("swing",), spread=1.2, seconds=20.0)


class Clock:
    """A clock that goes on a little whenever it is looked at, until it is told that all time is over."""

    def __init__(self, pace: float = 0.0) -> None:
        self.now, self.pace = 0.0, pace

    def __call__(self) -> float:
        self.now += self.pace
        return self.now

    def over(self) -> None:
        self.now = FAR

    def deadline(self) -> Deadline:
        return Deadline(60.0, 0.0, self)


def at(stage: str, end: Callable[[], None], time: int = 1) -> Callable[..., None]:
    """A listener that ends the work when it is told of a stage for so many times."""
    told: list[str] = []

    def tick(name: str, done: float, left: float | None) -> None:
        told.append(name)
        if told.count(stage) == time:
            end()

    return tick


def interrupt() -> None:
    raise KeyboardInterrupt


class Words(HTMLParser):
    """The text of a page, without what is not read."""

    def __init__(self) -> None:
        super().__init__()
        self.text: list[str] = []
        self.hidden = False

    def handle_starttag(self, tag, attributes):
        self.hidden = tag in ("style", "script")

    def handle_endtag(self, tag):
        self.hidden = False

    def handle_data(self, data):
        if not self.hidden:
            self.text.append(data)


def says_nothing_more(found: Diagnosis, folder: Path) -> tuple[str, str]:
    """Check what is the same wherever a search ends; the page's and the terminal's text."""
    assert not found.complete
    assert found.stopped is not None
    given = "tiago-mj diagnose logs --time-budget 3 --seed 0 --out out"
    found = replace(found, command=given)
    paths = report.write(found, folder)
    written = json.loads(paths["diagnosis.json"].read_text())
    assert written["complete"] is False
    assert written["stopped"]["why"] == found.stopped.why
    assert written["verdict"]["probability"] is None
    assert {one["probability"] for one in (*written["ranking"], *written["verdict"]["alternatives"])} <= {None}
    assert written["next_motion"] is None
    assert as_json.load(paths["diagnosis.json"]).stopped == replace(
        found.stopped, seconds=written["stopped"]["seconds"], needs=written["stopped"]["needs"]
    )
    words = Words()
    words.feed(paths["report.html"].read_text())
    page = " ".join(words.text).replace("\u00a0", " ").replace("\u2060", "")
    shown = "\n".join(line for _, line in terminal.lines(found, {}))
    for text in (page, shown):
        assert verdict.headline(found) in text
        assert "probability" not in text.lower()
        assert "No gap" not in text
    assert found.best.effects or "nominal simulator" not in shown
    ran_out = "time budget" in " ".join(found.notes)
    assert ran_out == (found.stopped.why == "budget")
    (step,) = advice.go_on(found)
    assert step.command in shown
    arguments = cli.build_parser("diagnose").parse_args(shlex.split(step.command)[1:])
    assert arguments.recordings == [Path("logs")]
    if found.stopped.why == "budget":
        assert arguments.time_budget >= (found.stopped.needs or 2 * found.stopped.seconds)
        assert f"--time-budget {arguments.time_budget:g}" in step.said
    else:
        assert arguments.time_budget is None
    return page, shown


# Where commands are replayed ------------------------------------------------------------------------------------------


def test_a_budget_that_ends_in_the_first_pass_says_how_many_effects_were_tried(rubbing, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(screen, "BATCH_SIZE", 2)
    clock = Clock()
    tick = at("screening", clock.over, time=4)
    found = diagnose(rubbing, names=LIBRARY, threads=1, deadline=clock.deadline(), tick=tick)
    assert found.kind == "unknown"
    assert not found.best.effects
    assert found.stopped is not None
    assert 0 < found.stopped.tried < found.stopped.effects == len(LIBRARY)
    assert found.not_excited == ()
    assert found.where
    headline = verdict.headline(found)
    assert f"{found.stopped.tried} of 4 effects tried; nothing is named yet." in headline
    assert headline.startswith("Stopped after")
    assert found.stopped.needs is not None
    says_nothing_more(found, tmp_path)


@pytest.mark.parametrize("stage", ["replaying", "fitting the nominal model"])
def test_a_budget_that_ends_before_the_nominal_model_is_fitted_has_an_answer(rubbing, tmp_path, stage) -> None:
    clock = Clock()
    found = diagnose(rubbing, names=LIBRARY, threads=1, deadline=clock.deadline(), tick=at(stage, clock.over))
    assert found.stopped is not None
    assert found.stopped.why == "budget"
    assert found.stopped.tried == 0
    assert bool(found.where) == (stage != "replaying")
    assert "before any effect was tried; nothing is named yet." in verdict.headline(found)
    says_nothing_more(found, tmp_path)


def test_what_leads_when_the_time_is_over_is_said_as_provisional(rubbing, tmp_path, monkeypatch) -> None:
    clock, around = Clock(), select.rounds.around_the_best

    def then_over(*given):
        clock.over()
        return around(*given)

    monkeypatch.setattr(select.rounds, "around_the_best", then_over)
    found = diagnose(rubbing, names=LIBRARY, threads=1, deadline=clock.deadline())
    assert [effect.name for effect in found.best.effects] == ["coulomb_friction"]
    assert math.isnan(found.best.probability)
    headline = verdict.headline(found)
    assert "with all 4 effects tried; what leads so far, provisionally: " in headline
    assert "friction" in headline
    says_nothing_more(found, tmp_path)
    assert "Provisional" in (tmp_path / "calibration.yaml").read_text()


def test_short_time_hurries_the_search_to_what_it_can_fit(rubbing, monkeypatch) -> None:
    """From so long before the end on as the first fits take: it ends by itself, and something is named."""
    monkeypatch.setattr(select, "LANDING", 10**9)
    clock = Clock(pace=1e-6)
    found = diagnose(rubbing, names=LIBRARY, threads=1, deadline=clock.deadline())
    assert clock.now < 1.0
    assert found.stopped is not None
    assert found.stopped.why == "budget"
    assert [effect.name for effect in found.best.effects] == ["coulomb_friction"]


@pytest.mark.parametrize("stage", ["replaying", "fitting the nominal model", "screening", "fitting", "pairs"])
def test_an_interrupt_has_the_same_answer_as_a_budget(rubbing, tmp_path, stage) -> None:
    found = diagnose(rubbing, names=LIBRARY, threads=1, tick=at(stage, interrupt))
    if found.complete:  # pairs are sought where one effect does not explain it all
        assert stage == "pairs"
        return
    assert found.interrupted
    assert found.stopped is not None
    assert found.stopped.why == "interrupted"
    assert verdict.headline(found).startswith("Interrupted after")
    says_nothing_more(found, tmp_path)


def test_a_fault_is_neither(rubbing, tmp_path, monkeypatch) -> None:
    def failing(*given):
        raise ValueError("numbers\nwithout sense")

    monkeypatch.setattr(select.rounds, "around_the_best", failing)
    with pytest.raises(FaultError, match=r"ValueError: numbers\s+without sense") as met:
        diagnose(rubbing, names=LIBRARY, threads=1)
    found = met.value.answer
    assert "ValueError: numbers without sense" in " ".join(found.notes)
    assert not found.interrupted
    assert [effect.name for effect in found.best.effects] == ["coulomb_friction"]
    assert found.stopped is not None
    assert found.stopped.why == "fault"
    assert verdict.headline(found).startswith("Ended by a fault of this program after")
    page, shown = says_nothing_more(found, tmp_path)
    assert "ValueError" in page
    assert "ValueError" in shown
    assert not (tmp_path / FAULT).exists()
    report.write(found, tmp_path, fault=met.value.fault)
    assert "numbers\nwithout sense" in (tmp_path / FAULT).read_text()
    assert "failing" in (tmp_path / FAULT).read_text()
    report.write(found, tmp_path)
    assert not (tmp_path / FAULT).exists()


@pytest.mark.parametrize(
    ("where", "name"), [(conclusion.verdict, "judge"), (conclusion.place, "refined"), (pipeline, "with_model")]
)
def test_a_fault_after_the_search_keeps_what_was_found(rubbing, monkeypatch, where, name) -> None:
    def failing(*given, **named):
        raise KeyError("no such thing")

    monkeypatch.setattr(where, name, failing)
    with pytest.raises(FaultError, match="KeyError") as met:
        diagnose(rubbing, names=LIBRARY, threads=1)
    assert isinstance(met.value.__cause__, KeyError)
    found = met.value.answer
    assert "coulomb_friction" in {effect.name for effect in found.best.effects}
    assert (found.stopped is None) == (where is pipeline)  # by then the whole answer was known
    assert found.findings == ()
    assert found.seconds > 0


def test_a_fault_before_anything_was_found_is_one_as_well(rubbing, monkeypatch) -> None:
    def failing(*given, **named):
        raise ValueError("no such number")

    monkeypatch.setattr(pipeline, "predictor", failing)
    with pytest.raises(FaultError, match="ValueError: no such number") as met:
        diagnose(rubbing, names=LIBRARY, threads=1)
    assert (met.value.answer.kind, met.value.answer.complete) == ("unknown", False)
    assert "nothing is named yet" in verdict.headline(met.value.answer)


def test_recordings_that_cannot_be_used_are_no_fault(rubbing, monkeypatch) -> None:
    def refusing(*given, **named):
        raise RecordingError("log0.csv: mend it")

    monkeypatch.setattr(pipeline, "predictor", refusing)
    with pytest.raises(RecordingError, match=r"log0\.csv"):
        diagnose(rubbing, names=LIBRARY, threads=1)


def test_a_budget_that_is_not_spent_changes_nothing(rubbing) -> None:
    free, bound = (diagnose(rubbing, names=LIBRARY, threads=1, deadline=by) for by in (Deadline(), Clock().deadline()))
    assert free.complete
    assert free.stopped is None
    assert as_json.as_data(replace(free, seconds=0.0)) == as_json.as_data(replace(bound, seconds=0.0))


# Along a motion -------------------------------------------------------------------------------------------------------


def along(pulled: Trial, deadline: Deadline | None = None, **more) -> Diagnosis:
    return diagnosed(pulled, deadline=deadline, **more)


@pytest.mark.parametrize("ending", ["budget", "interrupted"])
def test_a_search_along_a_motion_ends_with_what_leads(pulled, tmp_path, ending) -> None:
    clock = Clock()
    tick = at("all trials", clock.over if ending == "budget" else interrupt)
    found = along(pulled, clock.deadline(), tick=tick)
    assert "coulomb_friction" in {effect.name for effect in found.best.effects}
    assert found.stopped is not None
    assert found.stopped.why == ending
    assert found.stopped.tried == found.stopped.effects > 0
    says_nothing_more(found, tmp_path)


def test_a_search_along_a_motion_that_has_not_begun_names_nothing(pulled, tmp_path) -> None:
    clock = Clock()
    found = along(pulled, clock.deadline(), tick=at("fitting the nominal model", clock.over))
    assert found.kind == "unknown"
    assert not found.best.effects
    assert found.where
    says_nothing_more(found, tmp_path)


@pytest.mark.parametrize("ending", ["budget", "interrupted"])
def test_efforts_that_were_not_compared_yet_have_an_answer_too(pulled, tmp_path, ending) -> None:
    model = tmp_path / "pendulum.xml"
    from made_motions import PENDULUM

    model.write_text(PENDULUM)
    clock = Clock()
    tick = at("comparing torques", clock.over if ending == "budget" else interrupt)
    found = diagnose([pulled], model=model, deadline=clock.deadline(), tick=tick)
    assert found.stopped is not None
    assert found.stopped.why == ending
    assert "nothing is named yet" in verdict.headline(found)
    says_nothing_more(found, tmp_path / "out")


# The command ----------------------------------------------------------------------------------------------------------


@pytest.fixture
def logs(rubbing, tmp_path) -> Path:
    for one in rubbing:
        write_trial(one, tmp_path / "logs")
    return tmp_path


def test_a_tiny_budget_is_answered_at_once(logs, capsys) -> None:
    begun = time.monotonic()
    words = ["diagnose", str(logs / "logs"), "--out", str(logs / "out"), "--time-budget", "0.01", "--jobs", "1"]
    assert cli.main(words) == 0
    took = time.monotonic() - begun
    said = capsys.readouterr().out
    assert re.search(r"^Stopped after \S+ s before any effect was tried; nothing is named yet\.$", said, re.MULTILINE)
    again = next(line for line in said.splitlines() if line.strip().startswith("tiago-mj diagnose"))
    asked = cli.build_parser("diagnose").parse_args(shlex.split(again)[1:])
    assert asked.time_budget >= 1
    assert "robots are not drawn" in said
    assert (logs / "out" / "report.html").exists()
    assert took < 60  # in a process of its own 3 s, once it is loaded: docs/diagnosis.md


def test_a_command_that_is_interrupted_early_writes_that_and_ends_as_interrupted(logs, monkeypatch, capsys) -> None:
    monkeypatch.setattr(command.Told, "__call__", lambda self, *given: interrupt())
    assert cli.main(["diagnose", str(logs / "logs"), "--out", str(logs / "out"), "--jobs", "1"]) == 130
    assert json.loads((logs / "out" / "diagnosis.json").read_text())["stopped"]["why"] == "interrupted"
    assert "Interrupted after" in capsys.readouterr().out


def test_a_fault_is_status_1_with_the_answer_and_the_traceback_in_files(logs, monkeypatch, capsys) -> None:
    def failing(*given):
        raise ValueError("numbers without sense")

    monkeypatch.setattr(select.rounds, "around_the_best", failing)
    words = ["diagnose", str(logs / "logs"), "--out", str(logs / "out"), "--jobs", "1", "--without", WITHOUT]
    assert cli.main(words) == 1
    out = logs / "out"
    assert json.loads((out / "diagnosis.json").read_text())["stopped"]["why"] == "fault"
    assert "ValueError: numbers without sense" in (out / FAULT).read_text()
    (line,) = [line for line in capsys.readouterr().err.splitlines() if "a fault of this program" in line]
    assert "numbers without sense" in line
    assert str(out / FAULT) in line


def test_sigterm_ends_the_work_as_ctrl_c_does() -> None:
    before = signal.signal(signal.SIGTERM, signal.SIG_DFL)  # libraries leave handlers
    try:
        with pytest.raises(KeyboardInterrupt), command.terminated_as_interrupted():
            signal.raise_signal(signal.SIGTERM)
        assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL
    finally:
        signal.signal(signal.SIGTERM, before)


# The parts ------------------------------------------------------------------------------------------------------------


def test_a_deadline_is_over_where_no_more_is_left_than_is_needed() -> None:
    clock = Clock()
    deadline = Deadline(10.0, 0.0, clock)
    clock.now = 4.0
    assert (deadline.spent(), deadline.left()) == (4.0, 6.0)
    assert not deadline.over()
    assert not deadline.over(5.9)
    assert deadline.over(6.0)
    assert deadline.sooner(6.0).over()
    clock.now = 10.0
    with pytest.raises(OutOfTimeError):
        deadline.check()
    assert not Deadline().over(1e9)


def test_a_simulation_ends_where_its_time_does(rubbing) -> None:
    plant = plant_of(rubbing)
    clock = Clock()
    clock.over()
    sims = [(0, read_effects({"coulomb_friction": {"force": 0.6}}))]
    with pytest.raises(OutOfTimeError):
        replay.simulate(plant, replay.grid(plant, rubbing), sims, replay.Run(deadline=clock.deadline()))


def test_a_motion_that_there_is_no_time_to_choose_is_said_to_be_missing() -> None:
    def late():
        raise OutOfTimeError

    motion, said = conclusion._if_time(late)
    assert motion is None
    assert "no time" in said


@pytest.mark.parametrize(("needs", "budget"), [(231.0, 240), (61.5, 62), (4.2, 5), (0.3, 1), (1234.0, 1300)])
def test_a_budget_is_told_in_two_digits_and_is_enough(needs: float, budget: int) -> None:
    assert advice._rounded_up(needs) == budget


def test_the_headline_is_what_is_known() -> None:
    stopped = Stopped("budget", 30.0, 12, 49, 231.0)
    assert verdict.headline(replace(CASES["no_gap"], stopped=stopped)) == (
        "Stopped after 30 s with 12 of 49 effects tried; nothing is named yet."
    )

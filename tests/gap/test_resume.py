"""A diagnosis that was killed, interrupted or stopped goes on to the bits of one that was not."""

from __future__ import annotations

import json
import os
import random
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_diagnoses import CASES
from test_budget import HINGE, Clock, at, interrupt, pulled, rubbing, trial

from tiago_mj import cli
from tiago_mj.effects import EFFECTS
from tiago_mj.gap import report
from tiago_mj.gap.inference.hypotheses import Candidate
from tiago_mj.gap.inference.points import Start
from tiago_mj.gap.pipeline import diagnose
from tiago_mj.gap.report import JOURNAL
from tiago_mj.gap.report import json as as_json
from tiago_mj.gap.result import Diagnosis, Stopped
from tiago_mj.gap.search import rounds
from tiago_mj.io import journal as journals
from tiago_mj.io.journal import Journal, digest, kept, packed, unpacked
from tiago_mj.recordings.recording import Trial
from tiago_mj.recordings.write import write_trial

__all__ = ["pulled", "rubbing"]  # fixtures
LIBRARY = ("coulomb_friction", "viscous_friction")
WITHOUT = ",".join(name for name in EFFECTS if name not in LIBRARY)


def told(found: Diagnosis) -> dict[str, Any]:
    """All of an answer but its seconds."""
    return as_json.as_data(replace(found, seconds=0.0))


def begun(trials: list[Trial], path: Path | None = None, **more: Any) -> Diagnosis:
    return diagnose(trials, names=LIBRARY, threads=1, journal=path, **more)


@pytest.fixture(scope="module")
def whole(rubbing) -> dict[str, Any]:
    return told(begun(rubbing))


def lines(path: Path) -> list[str]:
    return path.read_text().splitlines()


# Whatever ends it -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("stage", ["replaying", "screening", "weighing", "all trials"])
def test_an_interrupted_search_goes_on_to_the_same_answer(rubbing, whole, tmp_path, stage) -> None:
    path = tmp_path / JOURNAL
    first = begun(rubbing, path, tick=at(stage, interrupt))
    assert first.interrupted
    done = lines(path) if path.exists() else []
    assert bool(done) == (stage != "replaying")
    assert told(begun(rubbing, path, resume=True)) == whole
    assert lines(path)[: len(done)] == done


def test_a_whole_journal_spares_the_fits(rubbing, whole, tmp_path, monkeypatch) -> None:
    path = tmp_path / JOURNAL
    assert told(begun(rubbing, path)) == whole
    done = lines(path)
    made: list[object] = []
    monkeypatch.setattr(rounds.Fitter, "_fit", lambda *given: made.append(given))
    assert told(begun(rubbing, path, resume=True)) == whole
    assert not made
    assert lines(path) == done


@pytest.mark.parametrize("stage", ["fitting", "refitting"])
def test_a_stopped_search_goes_on_to_the_same_answer(rubbing, whole, tmp_path, stage) -> None:
    path, clock = tmp_path / JOURNAL, Clock()
    first = begun(rubbing, path, deadline=clock.deadline(), tick=at(stage, clock.over))
    assert first.stopped is not None
    assert first.stopped.why == "budget"
    assert told(begun(rubbing, path, resume=True, deadline=Clock().deadline())) == whole


def test_what_the_clock_cut_short_is_not_kept(rubbing, whole, tmp_path, monkeypatch) -> None:
    """A fit that ends where it is as time is short is no finished one, though it has a result."""
    path, clock = tmp_path / JOURNAL, Clock(pace=1e-6)
    monkeypatch.setattr("tiago_mj.gap.search.select.LANDING", 10**9)
    first = begun(rubbing, path, deadline=clock.deadline())
    assert first.stopped is not None
    assert [effect.name for effect in first.best.effects] == ["coulomb_friction"]
    monkeypatch.undo()
    assert told(begun(rubbing, path, resume=True)) == whole


def test_a_search_along_a_motion_goes_on_too(pulled, tmp_path) -> None:
    path = tmp_path / JOURNAL
    asked: dict[str, Any] = {"names": LIBRARY, "threads": 1, "journal": path, "model": _pendulum(tmp_path)}
    once = told(diagnose([pulled], **asked))
    path.unlink()
    assert diagnose([pulled], **asked, tick=at("all trials", interrupt)).interrupted
    done = len(lines(path))
    assert told(diagnose([pulled], **asked, resume=True)) == once
    assert len(lines(path)) > done > 1


def _pendulum(folder: Path) -> Path:
    from made_motions import PENDULUM

    model = folder / "pendulum.xml"
    model.write_text(PENDULUM)
    return model


def test_any_number_of_threads_goes_on_with_it(rubbing, whole, tmp_path) -> None:
    path = tmp_path / JOURNAL
    begun(rubbing, path, tick=at("refitting", interrupt))
    assert told(diagnose(rubbing, names=LIBRARY, threads=2, journal=path, resume=True)) == whole


def test_a_torn_end_is_dropped(rubbing, whole, tmp_path) -> None:
    path = tmp_path / JOURNAL
    begun(rubbing, path)
    done = path.read_bytes()
    path.write_bytes(done[:-40])
    assert told(begun(rubbing, path, resume=True)) == whole
    assert path.read_bytes() == done


def test_a_damaged_line_ends_what_is_taken_up(rubbing, whole, tmp_path) -> None:
    path = tmp_path / JOURNAL
    begun(rubbing, path)
    done = lines(path)
    path.write_text("\n".join([*done[:3], done[3].replace("1", "2"), *done[4:]]) + "\n")
    assert told(begun(rubbing, path, resume=True)) == whole
    assert lines(path) == done


def test_an_empty_journal_begins_at_the_start(rubbing, whole, tmp_path) -> None:
    path = tmp_path / JOURNAL
    path.write_text("")
    assert told(begun(rubbing, path, resume=True)) == whole


# Of what it is --------------------------------------------------------------------------------------------------------


def test_a_journal_of_other_work_is_refused_in_one_line(rubbing, tmp_path, monkeypatch) -> None:
    path, model = tmp_path / JOURNAL, tmp_path / "hinge.xml"
    begun(rubbing, path, tick=at("refitting", interrupt))
    done = path.read_bytes()
    with pytest.raises(ValueError, match=r"^--resume: .*journal\.jsonl is of another options: ") as met:
        begun(rubbing, path, resume=True, seed=1)
    assert "\n" not in str(met.value)
    with pytest.raises(ValueError, match="is of another recordings: "):
        begun(rubbing[:2], path, resume=True)
    model.write_text(HINGE.replace('mass="1"', 'mass="1.01"'))
    heavier = [replace(one, sidecar=replace(one.sidecar, robot=str(model))) for one in rubbing]
    with pytest.raises(ValueError, match="is of another model: "):
        begun(heavier, path, resume=True)
    monkeypatch.setattr("tiago_mj.__version__", "99.0")
    with pytest.raises(ValueError, match=r"another version \(.*, not 99\.0\)"):
        begun(rubbing, path, resume=True)
    assert path.read_bytes() == done


def test_without_resume_an_old_journal_is_replaced(rubbing, tmp_path) -> None:
    path = tmp_path / JOURNAL
    begun(rubbing, path, tick=at("refitting", interrupt))
    begun(rubbing, path, tick=at("weighing", interrupt), seed=1)
    old, new = tmp_path / "old.jsonl", lines(path)
    begun(rubbing, old, tick=at("weighing", interrupt), seed=1)
    assert new == lines(old)


@pytest.mark.parametrize(("why", "stays"), [("budget", True), ("interrupted", True), ("fault", False), ("", False)])
def test_the_journal_goes_with_the_whole_answer_and_stays_with_a_part(tmp_path, why, stays) -> None:
    path = tmp_path / JOURNAL
    path.write_text("")
    found = CASES["unknown"]
    report.write(replace(found, complete=False, stopped=Stopped(why, 30.0)) if why else found, tmp_path)
    assert path.exists() == stays


def test_recordings_that_cannot_be_used_leave_no_journal(tmp_path) -> None:
    model = tmp_path / "hinge.xml"
    model.write_text(HINGE)
    path = tmp_path / "out" / JOURNAL
    mute = [replace(trial(model, k), positions={}) for k in range(3)]
    with pytest.raises(ValueError, match="no measured column"):
        begun(mute, path)
    assert not path.parent.exists()


# The command ----------------------------------------------------------------------------------------------------------


@pytest.fixture
def words(rubbing, tmp_path) -> Iterator[Callable[[str], list[str]]]:
    for one in rubbing:
        write_trial(one, tmp_path / "logs")

    def of(out: str) -> list[str]:
        return ["diagnose", str(tmp_path / "logs"), "--out", out, "--jobs", "1", "--without", WITHOUT]

    before = Path.cwd()
    os.chdir(tmp_path)
    yield of
    os.chdir(before)


def without_times(file: Path) -> str:
    """The bytes of a diagnosis but for its seconds."""
    return re.sub(r'"seconds": [\d.]+', '"seconds": 0', file.read_text())


def test_the_printed_command_goes_on(words, monkeypatch, capsys) -> None:
    from tiago_mj.gap import command

    said: list[str] = []

    def tell(self: object, stage: str, done: float, left: float | None) -> None:
        said.append(stage)
        if stage == "refitting":
            raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(command.Told, "__call__", tell)
        assert cli.main(words("out")) == 130
    line = next(one.strip() for one in capsys.readouterr().out.splitlines() if one.strip().startswith("tiago-mj diag"))
    assert line.endswith("--out out --resume")
    assert Path("out", JOURNAL).exists()
    assert cli.main(line.split()[1:]) == 0
    assert cli.main(words("other")) == 0
    assert without_times(Path("out/diagnosis.json")) == without_times(Path("other/diagnosis.json"))
    assert not Path("out", JOURNAL).exists()


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_a_killed_diagnosis_goes_on_to_the_same_bits(words) -> None:
    assert cli.main(words("other")) == 0
    whole, rng, more = without_times(Path("other/diagnosis.json")), random.Random(3), 0
    for kill in range(2):
        more = _killed([*words("out"), *(["--resume"] if kill else [])], more + rng.randint(1, 4))
        assert not Path("out/diagnosis.json").exists()
    assert cli.main([*words("out"), "--resume"]) == 0
    assert without_times(Path("out/diagnosis.json")) == whole
    assert sorted(os.listdir("out")) == sorted(os.listdir("other"))


def _killed(arguments: list[str], least: int) -> int:
    """Kill a command once its journal has so many lines; how many it has then."""
    file = Path("out", JOURNAL)
    process = subprocess.Popen([sys.executable, "-m", "tiago_mj.cli", *arguments], stdout=subprocess.DEVNULL)
    while process.poll() is None and (not file.exists() or file.read_bytes().count(b"\n") < least):
        time.sleep(0.01)
    process.send_signal(signal.SIGKILL)
    assert process.wait() == -signal.SIGKILL
    return file.read_bytes().count(b"\n")


def test_resume_is_refused_in_one_line(words, capsys) -> None:
    journal = Path("out", JOURNAL)
    journal.parent.mkdir()
    one = Journal(journal, {"schema": journals.SCHEMA, "version": "0"})
    one.add("key", 1.0)
    one.close()
    assert cli.main([*words("out"), "--resume"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert re.match(r"tiago-mj diagnose: --resume: \S*out/journal\.jsonl is of another version \(0, not ", line)


# The file -------------------------------------------------------------------------------------------------------------


def test_what_is_packed_comes_back_bit_by_bit() -> None:
    rng = np.random.default_rng(0)
    part = Candidate("armature", None, "inertia", (("a", 1.0),), 0.0, 0.0, 1.0, (0.1, 0.2), "kg·m²")
    arrays = (rng.normal(size=(3, 4)), np.asfortranarray(rng.normal(size=(3, 4))), np.zeros((0, 2)), np.array([True]))
    given = [
        Start((part,), np.array([0.1 + 0.2, np.nan, -0.0, np.inf]), None, ((arrays[0], arrays[1]),)),
        (np.float64(1 / 3), np.int64(3), 1 / 3, None, True, "a"),
        {"of": arrays},
    ]
    back = unpacked(json.loads(json.dumps(packed(given))), {"Start": Start, "Candidate": Candidate})
    assert repr(back) == repr(given)
    assert digest(back) == digest(given)
    assert [one.tobytes() for one in back[2]["of"]] == [one.tobytes() for one in arrays]
    assert back[2]["of"][1].flags.fnc
    assert type(back[1][0]) is np.float64
    with pytest.raises(TypeError):
        packed(object())
    with pytest.raises(TypeError):
        digest(object())
    with pytest.raises(KeyError):
        unpacked({"Start": []}, {})


def test_a_digest_tells_values_apart() -> None:
    different = [(1, 2), (1, (2,)), [(1.0, 2)], ("1", 2), np.array([1, 2]), np.array([1.0, 2.0]), {"1": 2}, (1, -2)]
    assert len({digest(one) for one in different}) == len(different)
    assert digest(frozenset({"a", "b"})) == digest(frozenset({"b", "a"}))


def test_two_processes_do_not_share_a_journal(tmp_path) -> None:
    path = tmp_path / JOURNAL
    with kept(path, dict) as first, kept(path, dict) as second:
        first.add("one", 1)
        second.add("two", 2)  # goes on without it
        assert second.path is None
        with pytest.raises(ValueError, match=r"another process writes .*: wait for it"), kept(path, dict, resume=True):
            pass
    with kept(path, dict, resume=True) as third:
        assert third.found == {"one": 1}
        third.add("three", 3)
    with kept(path, dict, resume=True) as fourth:
        assert fourth.found == {"one": 1, "three": 3}


def test_a_full_drive_ends_no_work(tmp_path, monkeypatch) -> None:
    path = tmp_path / JOURNAL
    with kept(path, dict) as journal:
        journal.add("one", 1)

        def full(*given: object) -> int:
            raise OSError(28, "No space left on device")

        with monkeypatch.context() as patched:
            patched.setattr(os, "write", full)
            journal.add("two", 2)
        journal.add("three", 3)
    assert path.read_bytes() == b""

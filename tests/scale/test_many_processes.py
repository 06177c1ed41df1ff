"""Whatever the number of processes, the results are those of one; what goes wrong in another is said in one line."""

import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest
import scale_bench

from tiago_mj import cli
from tiago_mj.effects import EFFECTS
from tiago_mj.gap import diagnose_all
from tiago_mj.io import atomic, extra, mujoco_log
from tiago_mj.rollout import scale


def printed(capsys, *words):
    assert cli.main(words) == 0
    said = capsys.readouterr()
    assert said.err == "", "other processes have nothing to announce"
    return said.out


def refused(capsys, *words):
    assert cli.main(words) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.count("\n") == 1
    return said.err


@pytest.mark.parametrize("jobs", [1, 2, 0])
def test_results_come_in_the_order_of_the_tasks(jobs):
    if jobs != 1:
        pytest.importorskip("joblib", reason="needs the extra 'scale'")
    assert scale.run_all(scale_bench.square, range(20), jobs=jobs) == [k * k for k in range(20)]
    assert scale.run_all(scale_bench.square, [], jobs=jobs) == []


def test_many_jobs_are_many_processes():
    pytest.importorskip("joblib", reason="needs the extra 'scale'")
    found = scale.run_all(scale_bench.process, range(40), jobs=2)
    assert [number for number, _ in found] == list(range(40))
    assert 1 <= len({identity for _, identity in found}) <= 2
    assert scale.run_all(scale_bench.process, [0], jobs=1)[0][1] not in {identity for _, identity in found}


@pytest.mark.parametrize("policy", ["pi", "random"])
def test_a_rollout_in_many_processes_is_the_rollout_in_one(policy, capsys):
    pytest.importorskip("joblib", reason="needs the extra 'scale'")
    words = ("rollout", "--env", "GripperTactile-v0", "--policy", policy, "--episodes", "6", "--json", "--jobs")
    one = printed(capsys, *words, "1")
    assert printed(capsys, *words, "2") == one
    assert len({episode["episode_return"] for episode in json.loads(one)["episodes"]}) == 6


def test_an_episode_depends_on_its_seed_alone(capsys):
    words = ("rollout", "--env", "GripperTactile-v0", "--policy", "random", "--json")
    three = json.loads(printed(capsys, *words, "--episodes", "3"))["episodes"]
    last = json.loads(printed(capsys, *words, "--seed", "2"))["episodes"]
    assert last == three[2:]


@pytest.mark.slow
def test_a_folder_is_diagnosed_among_others_as_alone_and_none_hinders_another(tmp_path, capsys):
    pytest.importorskip("joblib", reason="needs the extra 'scale'")
    pytest.importorskip("pyarrow", reason="needs the extra 'gap'")
    folder, empty, out = (tmp_path / name for name in ("gain", "empty", "out"))
    words = ("record", "--env", "GripperTactile-v0", "--policy", "pi", "--episodes", "2", "--out", str(folder))
    assert cli.main([*words, "--effects", '{"force_gain": {"factor": 1.4}}']) == 0
    empty.mkdir()
    few = ("--without", ",".join(name for name in EFFECTS if name != "force_gain"))  # as it takes less time
    assert cli.main(["diagnose", str(folder), "--out", str(tmp_path / "alone"), *few]) == 0
    capsys.readouterr()
    assert cli.main(["diagnose-all", str(folder), str(empty), "--out", str(out), *few, "--jobs", "2"]) == 2
    table = capsys.readouterr().out
    alone, among = (json.loads((path / "diagnosis.json").read_text()) for path in (tmp_path / "alone", out / "gain"))
    del alone["seconds"], among["seconds"]
    assert among == alone
    summary = json.loads((out / diagnose_all.SUMMARY).read_text())
    assert summary["gain"] == {
        "status": 0,
        "complaint": "",
        "verdict": alone["verdict"],
        "closed": alone["shrink"]["closed"],
        "complete": True,
    }
    assert summary["empty"]["status"] == 2
    assert "holds no recording" in summary["empty"]["complaint"]
    lines = table.splitlines()
    assert lines[1].split()[:3] == ["gain", "effect", "force_gain"]
    assert "holds no recording" in lines[2]


def test_a_search_that_ended_early_is_not_told_as_a_verdict():
    verdict = {"kind": "unknown", "effects": [], "probability": None}
    found = {
        name: {"status": 0, "complaint": "", "verdict": verdict, "closed": None, "complete": complete}
        for name, complete in (("whole", True), ("budget", False))
    }
    _, whole, early = diagnose_all.table(found).splitlines()
    assert whole.split()[:2] == ["whole", "unknown"]
    assert early.split()[:3] == ["budget", "stopped", "early"]


def test_what_was_finished_before_a_stop_is_not_diagnosed_again_unless_its_recordings_changed(
    tmp_path, capsys, monkeypatch
):
    made = []

    def diagnosed(task):
        made.append(Path(task.out).name)
        if stops and made[-1] == "b":
            raise KeyboardInterrupt
        with atomic.replacing_set(Path(task.out)) as new:
            (new / "diagnosis.json").write_text("{}")
        return diagnose_all.Outcome(2 if made[-1] == "c" else 0, "no use")

    monkeypatch.setattr(diagnose_all, "_diagnosed", diagnosed)
    folders = [tmp_path / name for name in "abc"]
    for folder in folders:
        folder.mkdir()
        (folder / "x.csv").write_text("1")
    words = ["diagnose-all", *map(str, folders), "--out", str(tmp_path / "out"), "--jobs", "1", "--json"]
    for change, again in (("", ["a", "b", "b", "c"]), ("2", ["a", "b", "a", "b", "c"])):
        stops = True
        assert cli.main(words) == 130
        assert (tmp_path / "out").exists() == bool(change), "nothing appears before all is done"
        (folders[0] / "x.csv").write_text(f"1{change}")
        stops = False
        assert cli.main(words) == 2
        assert made == again
        made.clear()
        assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["a", "b", "diagnoses.json"]
        assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "b", "c", "out"]


@pytest.mark.parametrize("gone", [False, True], ids=["a file", "the folder"])
def test_a_run_that_is_stopped_while_it_clears_up_is_made_again(gone, tmp_path, monkeypatch):
    def diagnosed(task):
        with atomic.replacing_set(Path(task.out)) as new:
            (new / "diagnosis.json").write_text("{}")
            (new / "report.html").write_text("whole")
        return diagnose_all.Outcome(0)

    def stopped(path, **options):
        if Path(path).name.endswith(".unfinished"):
            (Path(path) / "a" / "report.html").unlink()
            if gone:
                remove(Path(path) / "a")
            raise KeyboardInterrupt
        remove(path, **options)

    monkeypatch.setattr(diagnose_all, "_diagnosed", diagnosed)
    remove = shutil.rmtree
    (tmp_path / "a").mkdir()
    words = ["diagnose-all", str(tmp_path / "a"), "--out", str(tmp_path / "out"), "--jobs", "1", "--json"]
    monkeypatch.setattr(diagnose_all.shutil, "rmtree", stopped)
    assert cli.main(words) == 130
    monkeypatch.setattr(diagnose_all.shutil, "rmtree", remove)
    assert cli.main(words) == 0
    assert sorted(path.name for path in (tmp_path / "out" / "a").iterdir()) == ["diagnosis.json", "report.html"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "out"]


def test_a_fault_of_one_folder_leaves_its_traceback_and_the_others(tmp_path, capsys, monkeypatch):
    def command(words):
        if Path(words[1]).name == "a":
            raise RuntimeError("numbers without sense")
        with atomic.replacing_set(Path(words[3])) as new:
            answer = {"verdict": {"kind": "no_gap"}, "shrink": {"closed": None}, "complete": True}
            (new / "diagnosis.json").write_text(json.dumps(answer))
        return 0

    monkeypatch.setattr(diagnose_all.cli, "main", command)
    for name in "ab":
        (tmp_path / name).mkdir()
    words = ["diagnose-all", str(tmp_path / "a"), str(tmp_path / "b"), "--out", str(tmp_path / "out"), "--jobs", "1"]
    arguments = cli.build_parser("diagnose-all").parse_args([*words, "--json"])
    assert diagnose_all.run(arguments) == 1
    assert json.loads(capsys.readouterr().out)["a"]["complaint"] == "RuntimeError: numbers without sense"
    assert sorted(path.name for path in (tmp_path / "out").rglob("*.*")) == [
        "diagnoses.json",
        "diagnosis.json",
        "fault.txt",
    ]
    assert "RuntimeError: numbers without sense" in (tmp_path / "out" / "a" / "fault.txt").read_text()


def test_a_drive_that_is_full_ends_all_and_leaves_the_old_diagnoses(tmp_path, capsys, monkeypatch):
    made = []

    def diagnosed(task):
        made.append(Path(task.out).name)
        if full and made[-1] == "b":
            return diagnose_all.Outcome(2, f"out: {cli.FULL}: make room on it, or name another place")
        with atomic.replacing_set(Path(task.out)) as new:
            (new / "diagnosis.json").write_text(json.dumps(len(made)))
        return diagnose_all.Outcome(0)

    monkeypatch.setattr(diagnose_all, "_diagnosed", diagnosed)
    for name in "ab":
        (tmp_path / name).mkdir()
        (tmp_path / name / "x.csv").write_text("1")
    words = ["diagnose-all", *(str(tmp_path / name) for name in "ab"), "--out", str(tmp_path / "out"), "--jobs", "1"]

    def written():
        return {str(path): path.read_text() for path in (tmp_path / "out").rglob("*.json")}

    full = False
    assert cli.main([*words, "--json"]) == 0
    before = written()
    full = True
    assert cli.main([*words, "--json", "--seed", "1"]) == 2
    assert cli.FULL in capsys.readouterr().err
    assert written() == before
    full = False
    assert cli.main([*words, "--json", "--seed", "1"]) == 0
    assert made == ["a", "b", "a", "b", "b"], "what was finished is kept"
    assert written() != before


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc")
def test_a_worker_ends_with_the_process_that_started_it(tmp_path):
    pytest.importorskip("joblib", reason="needs the extra 'scale'")
    script = (
        "import sys, scale_bench as b; from tiago_mj.rollout import scale; "
        "scale.run_all(b.wait, [sys.argv[1]] * 2, jobs=2)"
    )
    env = {**os.environ, "PYTHONPATH": os.pathsep.join([str(Path(__file__).parent), *sys.path])}
    process = subprocess.Popen(
        [sys.executable, "-c", script, str(tmp_path), str(tmp_path)], env=env, stderr=subprocess.DEVNULL
    )
    until = time.monotonic() + 60
    while not list(tmp_path.iterdir()):
        assert time.monotonic() < until
        time.sleep(0.1)
    process.kill()
    process.wait()
    workers = [int(path.name) for path in tmp_path.iterdir()]
    while any(Path(f"/proc/{worker}").exists() for worker in workers):
        assert time.monotonic() < until, "a worker goes on without anybody who waits for it"
        time.sleep(0.1)


def test_warnings_of_other_processes_are_counted_here_and_written_nowhere(tmp_path, monkeypatch, capfd):
    pytest.importorskip("joblib", reason="needs the extra 'scale'")
    monkeypatch.chdir(tmp_path)
    with mujoco_log.counted() as kinds:
        assert scale.run_all(scale_bench.shake, [1, 2, 3], jobs=2) == [1, 2, 3]
    assert sum(kinds.values()) == 6
    assert len(mujoco_log.sentences(kinds)) == 1
    assert list(tmp_path.iterdir()) == []
    assert capfd.readouterr().err == ""


def test_a_fault_in_another_process_is_the_fault_itself():
    pytest.importorskip("joblib", reason="needs the extra 'scale'")
    with pytest.raises(ValueError, match="task -1 is negative"):
        scale.run_all(scale_bench.square, [1, -1, 2], jobs=2)


def test_a_process_that_dies_is_told_and_no_result_is_made_up():
    pytest.importorskip("joblib", reason="needs the extra 'scale'")
    with pytest.raises(OSError, match="ended in the middle of its task"):
        scale.run_all(scale_bench.die, range(6), jobs=2)
    assert scale.run_all(scale_bench.square, range(6), jobs=2) == [0, 1, 4, 9, 16, 25], "the next run has new processes"


def test_an_effect_of_ones_own_is_not_left_out_in_silence():
    task = diagnose_all.Task(("diagnose",), "out", "kept", (*EFFECTS, "return_spring_of_mine"))
    with pytest.raises(ValueError, match=r"return_spring_of_mine .* use --jobs 1"):
        diagnose_all.diagnose(task)


ROLLOUT = ("rollout", "--env", "GripperTactile-v0", "--policy", "pi", "--episodes", "2")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ((*ROLLOUT, "--jobs", "-1"), "--jobs is -1: give 0 or more"),
        ((*ROLLOUT, "--jobs", "2", "--film", "a.png"), "leave out --jobs"),
        (("diagnose-all", "x/a", "y/a", "--out", "out"), "2 of the folders are called 'a'"),
        (("diagnose-all", "x", "--out", "out", "--jobs", "-1"), "--jobs is -1: give 0 or more"),
        (("diagnose-all", "x", "--out", "out", "--threads", "-1"), "--threads is -1: give 0 or more"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, tuple) else "",
)
def test_bad_input_gets_one_line_that_says_how_to_mend_it(words, said, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert said in refused(capsys, *words)
    assert list(tmp_path.iterdir()) == []


def test_an_unknown_backend_is_refused():
    with pytest.raises(ValueError, match="use one of local, ray"):
        scale.run_all(scale_bench.square, [1, 2], backend="slurm")


@pytest.mark.parametrize(("words", "missing"), [(("--jobs", "2"), "joblib"), (("--backend", "ray"), "ray")])
def test_without_the_extra_one_line_says_how_to_install_it(words, missing, capsys, monkeypatch):
    if missing == "ray":
        pytest.importorskip("joblib", reason="needs the extra 'scale'")
    monkeypatch.setitem(sys.modules, missing, None)
    said = refused(capsys, *ROLLOUT, *words)
    assert missing in said
    assert extra.install("scale") in said

"""A real Ray cluster of two nodes on this machine, one of which is killed in the middle."""

import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections import Counter
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest
import scale_bench
from small_training import hyperparameters

ray = pytest.importorskip("ray", reason="needs the extra 'scale'")
pytest.importorskip("joblib", reason="needs the extra 'scale'")

from tiago_mj import cli  # noqa: E402
from tiago_mj.io import held  # noqa: E402
from tiago_mj.rollout import scale  # noqa: E402

#: The head notices after about 5 s instead of 15 s that a node is gone.
SOON = {"health_check_period_ms": 1000, "health_check_failure_threshold": 5}
MEMORY = 80 * 2**20  # about the least that Ray takes
TASKS = 24
ROLLOUT = ("rollout", "--env", "GripperTactile-v0", "--policy", "pi", "--episodes", "6", "--json")
#: Seconds that the locks of the killed seeds are held on: longer than for a process that is about to end.
LEASE = 2 * held.PATIENCE
#: Seeds that are small, but long enough to be killed between two of some ten checkpoints.
SEEDS, STEPS, EVERY = 5, 2400, 200
SMALL = hyperparameters("GripperTactileSteady-v0")


@pytest.fixture(scope="module")
def nodes():
    """A cluster of two nodes of two processors; what is written to the environment is for its processes."""
    from ray.cluster_utils import Cluster

    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("RAY_USAGE_STATS_ENABLED", "0")
        patch.setenv("PYTHONPATH", os.pathsep.join([os.path.dirname(__file__), os.environ.get("PYTHONPATH", "")]))
        head = {"num_cpus": 2, "object_store_memory": MEMORY, "include_dashboard": False, "_system_config": SOON}
        started = Cluster(initialize_head=True, head_node_args=head)
        started.other = None
        yield started
        started.shutdown()


@pytest.fixture
def cluster(nodes, monkeypatch):
    """Both nodes at work: what a test has killed is started again."""
    if nodes.other is None:
        nodes.other = nodes.add_node(num_cpus=2, object_store_memory=MEMORY)
        nodes.wait_for_nodes()
    monkeypatch.setenv(scale.ADDRESS, nodes.address)
    return nodes


def began(folder):
    """Task, node and process of every beginning."""
    return [tuple(mark.name.split("-")) for mark in folder.iterdir()]


@pytest.mark.slow
def test_a_rollout_and_a_fault_are_on_a_cluster_what_they_are_here(cluster, capsys):
    assert cli.main([*ROLLOUT, "--backend", "ray", "--jobs", "2"]) == 0
    there = json.loads(capsys.readouterr().out)
    assert cli.main(ROLLOUT) == 0
    assert json.loads(capsys.readouterr().out) == there
    with pytest.raises(ValueError, match="task -1 is negative"):
        scale.run_all(scale_bench.square, [1, -1, 2], jobs=2, backend="ray")
    assert cli.main([*ROLLOUT, "--backend", "ray", "--jobs", "9"]) == 2
    assert "the Ray cluster has 4 processors" in capsys.readouterr().err


def test_files_have_the_names_on_a_cluster_that_they_have_here(cluster, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert scale.run_all(scale_bench.place, range(4), jobs=2, backend="ray") == [str(tmp_path)] * 4


def test_no_process_is_started_for_nothing(cluster, monkeypatch):
    started = []

    def parallel(joblib, function, tasks, jobs, *_):
        started.append(jobs)

    monkeypatch.setattr(scale, "_parallel", parallel)
    for tasks, jobs in (([1, 2, 3], 0), ([1], 0), (range(20), 0), (range(20), 2)):
        scale.run_all(scale_bench.square, tasks, jobs=jobs, backend="ray")
    assert started == [3, 2, 4, 2]


@pytest.mark.slow
def test_every_result_arrives_once_though_a_node_is_killed_in_the_middle(cluster, tmp_path, capfd):
    tasks = [scale_bench.Slow(number, str(tmp_path), 0.3) for number in range(TASKS)]
    killed = []

    def kill_when_it_works():
        while not (there := [process for _, node, process in began(tmp_path) if node == cluster.other.node_id]):
            time.sleep(0.02)
        killed.append(len(began(tmp_path)))
        for process in set(there):  # they would outlive their node by a second
            os.kill(int(process), signal.SIGKILL)
        node, cluster.other = cluster.other, None
        cluster.remove_node(node, allow_graceful=False)

    killer = threading.Thread(target=kill_when_it_works, daemon=True)
    killer.start()
    found = scale.run_all(scale_bench.slow_square, tasks, jobs=0, backend="ray")
    killer.join(timeout=30)
    assert killed, "the node was to be killed before the end"
    assert killed[0] < TASKS, "tasks must be left when it is"
    assert [(number, square) for number, square, _ in found] == [(k, k * k) for k in range(TASKS)]
    last = Counter(node for *_, node in found)
    assert last[cluster.head_node.node_id] > TASKS / 2, "the node that is left does the work"
    again = [number for number, count in Counter(number for number, *_ in began(tmp_path)).items() if count > 1]
    assert again, "what the killed node had begun was begun again"
    assert not ray.is_initialized(), "the connection is left"


def parent(process):
    """Number of the process that started another one; 0: that is over."""
    try:
        return int(Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[1])
    except OSError:
        return 0


def said(folder):
    """What a seed said last of its steps, and its process."""
    try:
        facts = json.loads((folder / "progress.json").read_text())
    except FileNotFoundError:
        return 0, None
    return facts["steps"], facts["process"]


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc")
def test_seeds_go_on_from_their_checkpoints_on_another_node_when_theirs_is_killed(cluster, tmp_path):
    pytest.importorskip("stable_baselines3", reason="needs the extra 'train'")
    from tiago_mj.learn.agent_file import load_agent

    small = tmp_path / "small.yml"
    small.write_text(SMALL)
    words = [
        sys.executable, "-m", "tiago_mj.cli", "train", "--env", "GripperTactileSteady-v0", "--hyperparameters",
        str(small), "--seeds", str(SEEDS), "--steps", str(STEPS), "--env-option", "max_episode_steps=40",
        "--evaluate-every", "800", "--evaluation-episodes", "2", "--checkpoint-every", str(EVERY), "--quiet", "--json",
    ]  # fmt: skip
    out, whole = tmp_path / "killed", tmp_path / "whole"
    folders = [out / f"seed-{seed}" for seed in range(SEEDS)]
    raylet = cluster.other.all_processes["raylet"][0].process.pid
    running = subprocess.Popen(
        [*words, "--out", str(out), "--backend", "ray"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    try:
        until = time.monotonic() + 240
        began, lost = set(), {}
        while len(began) < 4 or not lost or not all((folder / "checkpoint.zip").exists() for folder in lost):
            assert running.poll() is None, running.communicate()
            assert time.monotonic() < until, "no seed of the other node came to a checkpoint"
            time.sleep(0.05)
            processes = {folder: process for folder in folders if (process := said(folder)[1]) is not None}
            began = set(processes.values())
            lost = {folder: process for folder, process in processes.items() if parent(process) == raylet}
        for process in lost.values():  # a machine without power: nothing of it goes on
            os.kill(process, signal.SIGKILL)
        assert not any((folder / "model.zip").exists() for folder in lost), "they must not have been over"
        with ExitStack() as server:  # on a shared folder the machine's locks outlive it
            for folder in lost:
                server.enter_context(held.alone(folder, "training"))
            node, cluster.other = cluster.other, None
            cluster.remove_node(node, allow_graceful=False)
            time.sleep(LEASE)
            assert running.poll() is None, running.communicate()
        again = {}
        while len(again) < len(lost):
            assert running.poll() is None, running.communicate()
            time.sleep(0.05)
            for folder, before in lost.items():
                steps, process = said(folder)
                if process != before:
                    again.setdefault(folder, steps)
        assert all(EVERY < steps < STEPS for steps in again.values()), "from a checkpoint, not from the beginning"
        result, complaint = running.communicate(timeout=300)
    finally:
        running.kill()
    assert running.returncode == 0, complaint
    seeds = json.loads(result)["seeds"]
    assert [seed["seed"] for seed in seeds] == list(range(SEEDS))
    assert [seed["steps"] for seed in seeds] == [STEPS] * SEEDS
    assert cli.main([*words[3:], "--out", str(whole)]) == 0
    for folder in folders:
        same = whole / folder.name
        for name in ("episodes.csv", "evaluations.csv"):
            assert (folder / name).read_text() == (same / name).read_text()
        for name in ("best.npz", "evaluated.npz", "last.npz"):
            ours, theirs = (load_agent(path / name).arrays() for path in (folder, same))
            assert ours.keys() == theirs.keys()
            for key, value in theirs.items():
                np.testing.assert_array_equal(ours[key], value, err_msg=f"{folder.name} {name}: {key}")


@pytest.mark.parametrize("address", ["closed port", "nonsense"])
def test_a_cluster_that_does_not_answer_gets_one_line_and_no_wait(address, capsys, monkeypatch):
    if address == "closed port":
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            address = f"127.0.0.1:{free.getsockname()[1]}"
    monkeypatch.setenv(scale.ADDRESS, address)
    begun = time.monotonic()
    assert cli.main([*ROLLOUT, "--backend", "ray"]) == 2
    assert time.monotonic() - begun < 2 * scale.PATIENCE
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert address in said
    assert "ray start --head" in said
    assert scale.ADDRESS in said

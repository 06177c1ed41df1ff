"""The reality in which small robots of nobody in particular are recorded: what the diagnosis is given to judge."""

from __future__ import annotations

import ast
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from benchmarks.user_robots import __main__ as main
from benchmarks.user_robots import case, record, truths, written
from benchmarks.user_robots.models import USER_ROBOTS, UserRobot
from tiago_mj.gap.simulation import replay
from tiago_mj.gap.simulation.plant import Plant, plant_of
from tiago_mj.recordings import lint
from tiago_mj.recordings.read import read_recordings
from tiago_mj.recordings.recording import Finding, Trial

SMALL = {"logs": 2, "seconds": 2.5, "rate": 100.0}
PLAYED = [name for name, one in USER_ROBOTS.items() if one.interface != "effort"]


def recorded(
    robot: UserRobot, kind: str, folder: Path, *, seed: int = 0, spread: float = record.JITTER
) -> tuple[Plant, Sequence[Trial], tuple[Finding, ...], record.Reality, record.Plan]:
    path = robot.write(folder)
    reality, plan = record.make(robot, kind, seed, path, spread=spread, asked=SMALL)
    written.write(reality, plan, seed, folder / kind, f"../{path.name}")
    read = read_recordings([folder / kind])
    plant = plant_of(read.trials)
    return plant, read.trials, (*read.findings, *lint.inspect_all(read.trials, plant)), reality, plan


@pytest.mark.parametrize("name", USER_ROBOTS)
def test_recordings_of_every_truth_are_accepted_without_complaint(name: str, tmp_path: Path) -> None:
    """Of every robot; a step of an encoder is said, and is true."""
    for kind in truths.TRUTHS:
        _, trials, findings, reality, _ = recorded(USER_ROBOTS[name], kind, tmp_path)
        lint.refuse(trials, findings)
        assert {finding.code for finding in findings} <= {"quantum"}, findings
        assert len(trials) == SMALL["logs"]
        assert set(trials[0].commands) == set(reality.actuators)
        moved = [np.ptp(np.concatenate([t.positions[j] for t in trials])) for j in reality.joints]
        assert min(moved) > 0.01, "every joint moves"
        if kind in ("friction", "payload"):
            assert reality.truth.facts["shows"] > record.CLEAR[0] / 2
            assert reality.truth.value is not None
            assert reality.truth.value > 0


@pytest.mark.parametrize("name", PLAYED)
def test_without_effect_and_jitter_the_users_model_replays_what_was_recorded(name: str, tmp_path: Path) -> None:
    plant, trials, _, reality, plan = recorded(USER_ROBOTS[name], "none", tmp_path, spread=0.0)
    on = replay.grid(plant, trials)
    measured = np.stack([np.stack([trial.positions[j] for j in plant.joints], axis=1) for trial in trials])

    def error(plant: Plant) -> np.ndarray:
        return (
            replay.simulate(plant, on, [(k, ()) for k in range(len(trials))], replay.Run(threads=1)).position - measured
        )

    # At the model's own step of up to 5 ms all is a little early or late: 3 % of a joint's way, where it is fastest.
    assert np.all(np.abs(error(plant)).max(axis=(0, 1)) < 0.03 * np.ptp(measured, axis=(0, 1)))
    plant.model.opt.timestep, plant.model.opt.integrator = record.STEP, mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    fine = error(replace(plant, max_timestep=record.STEP))
    noise = record.noise_of(reality, plan) + 0.4 * np.pi / 2**plan.bits
    assert np.all(np.sqrt((fine**2).mean(axis=(0, 1))) < 2.5 * noise), (
        "at reality's step, encoders are all that differs"
    )


def test_torques_of_motors_are_the_nominal_models_along_the_motion(tmp_path: Path) -> None:
    """Without effect and jitter: inverse dynamics of what was measured gives what was commanded."""
    robot = USER_ROBOTS["pendulum"]
    path = robot.write(tmp_path)
    reality, plan = record.make(robot, "none", 0, path, spread=0.0, asked=SMALL)
    log = record.session(reality, plan, 0, range(1))[0]
    data, wanted = mujoco.MjData(reality.nominal), []
    change = np.gradient(log.velocity, axis=0) * plan.rate
    for k in range(len(log.time)):
        data.qpos[:], data.qvel[:], data.qacc[:] = log.position[k], log.velocity[k], change[k]
        mujoco.mj_inverse(reality.nominal, data)
        wanted.append(data.qfrc_inverse.copy())
    late = 0.5 * (log.command[1:] + log.command[:-1])  # a command is held from its row to the next
    assert np.sqrt(np.mean((late - wanted[1:]) ** 2)) < 0.05 * np.ptp(log.command)


def test_bristles_hold_what_is_below_the_friction_and_carry_it_when_slipping() -> None:
    mass, step, friction = 0.5, record.STEP, 2.0
    held, slipping = truths.Bristles(friction, mass, step), truths.Bristles(friction, mass, step)
    where = speed = 0.0
    for _ in range(8000):  # 4 s under half the friction
        speed += step * (1.0 + held(speed)) / mass
        where += step * speed
    assert 0 < where < 1.5 * held.travel
    assert abs(speed) < 1e-9
    for _ in range(400):
        force = slipping(0.3)
    assert force == pytest.approx(-friction)


def test_a_late_command_is_late_by_the_delay_to_a_physics_step() -> None:
    late, parts = 45, 20
    in_force = [truths.queued(k // parts, k % parts, parts, late) for k in range(200)]
    assert in_force == [(k - late) // parts for k in range(200)]
    assert in_force.index(0) == late


def test_reality_imports_nothing_of_the_diagnosis() -> None:
    folder = Path(record.__file__).parent
    for name in ("models.py", "motions.py", "record.py", "truths.py", "written.py"):
        for node in ast.walk(ast.parse((folder / name).read_text())):
            found = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            found += [f"{node.module}"] if isinstance(node, ast.ImportFrom) else []
            assert not [module for module in found if module.startswith("tiago_mj.gap") or module == "tiago_mj"]


def answer(kind: str, *names: str, others: Sequence[str] = ()) -> dict:
    value = {"value": 1.0, "low": 0.9, "high": 1.1, "unit": "-"}
    parameters = {"force": value, "seconds": value, "mass": value}
    effects = [{"name": name, "target": "elbow", "parameters": parameters} for name in names]
    alternatives = [{"effects": [{"name": name, "target": "elbow"}], "probability": 0.4} for name in others]
    verdict = {"kind": kind, "effects": effects, "probability": 0.9, "alternatives": alternatives}
    return {"verdict": verdict, "complete": True, "shrink": {"closed": None}, "seconds": 1.0}


@pytest.mark.parametrize(
    ("truth", "found", "right", "false_names"),
    [
        ("friction", answer("effect", "stribeck_friction"), True, []),
        ("friction", answer("effect", "coulomb_friction", "backlash"), False, ["backlash"]),
        ("friction", answer("ambiguous", "backlash", others=["backlash", "coulomb_friction"]), True, ["backlash"]),
        ("friction", answer("unknown", "coulomb_friction"), False, []),
        ("none", answer("no_gap"), True, []),
        ("none", answer("unknown"), False, []),
        ("none", answer("effect", "armature"), False, ["armature"]),
        ("none", answer("effect", "encoder_quantization"), True, []),
        ("none", answer("effect", "armature", "encoder_quantization"), False, ["armature"]),
        ("friction", answer("effect", "coulomb_friction", "encoder_quantization"), True, []),
        ("friction", answer("effect", "encoder_quantization"), False, []),
        ("delay", None, False, []),
    ],
)
def test_an_answer_is_right_by_its_class(truth, found, right, false_names) -> None:
    effect, parameter = truths.CALLED.get(truth, (None, None))
    label = {"kind": truth, "effect": effect, "parameter": parameter, "target": None, "value": 1.0}
    said = case.judged(case.Case("two_joint", truth, 0), label, found)
    assert (said["right"], said["false_names"]) == (right, false_names)
    assert said.get("within", True), "where it is named, 1.0 lies in 0.9 to 1.1"


def test_a_payload_on_a_level_gripper_may_be_called_armature() -> None:
    label = {"kind": "payload", "effect": "payload", "parameter": "mass", "target": None, "value": 0.3}
    for model, right in (("gripper", True), ("lift", False)):
        assert case.judged(case.Case(model, "payload", 0), label, answer("effect", "armature"))["right"] is right


def test_what_a_command_leaves_and_prints_is_seen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A diagnosis that ends in an error is wrong, counts as a crash, and is not made again."""
    monkeypatch.setattr(case, "recorded", lambda asked, work: (work.mkdir(parents=True), {"kind": "none"})[1])
    folder = tmp_path / "lift-none-0"
    row = case.run(case.Case("lift", "none", 0), folder, budget=5.0, threads=1)
    assert (row["exit_status"], row["crashed"], row["right"], row["files_left"]) == (2, True, False, {})
    assert row["lines"] == 1
    assert "recordings" in row["last_line"]
    (folder / "result.json").write_text('{"right": true}')
    assert case.run(case.Case("lift", "none", 0), folder, budget=5.0, threads=1) == {"right": True}


def test_the_sum_counts_false_names_only_where_nothing_is_to_be_named() -> None:
    rows = []
    for kind, found in (("none", answer("effect", "armature")), ("none", answer("no_gap")), ("delay", None)):
        effect, parameter = truths.CALLED.get(kind, (None, None))
        label = {"kind": kind, "effect": effect, "parameter": parameter, "target": None, "value": None}
        said = {"exit_status": 0, "seconds": 1.0, "lines": 20, "crashed": False, "files_left": {}, "last_line": ""}
        rows.append(
            {
                "model": "lift",
                "truth": label,
                "seed": 0,
                **case.judged(case.Case("lift", kind, 0), label, found),
                **said,
            }
        )
    told = main.summary(rows)
    assert told["right_by_truth"] == {"none": [1, 2], "delay": [0, 1]}
    assert told["false_names_without_effect"] == [1, 2]
    assert len(main.table(rows).splitlines()) == 4

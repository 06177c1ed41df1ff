"""Sensors with a memory act between rows, whose signals are simulated in parts of rows for them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from tiago_mj.effects.spec import Entry
from tiago_mj.gap.inference import noise_model
from tiago_mj.gap.inference.predictor import Predictor, predictor
from tiago_mj.gap.simulation import replay
from tiago_mj.gap.simulation.plant import Plant, plant_of
from tiago_mj.gap.simulation.replay import Signals
from tiago_mj.recordings.record.environment import Plan, record
from tiago_mj.recordings.recording import Sidecar, Trial
from tiago_mj.rollout.policies import make_policy
from tiago_mj.sensing.load_cell import LoadCell

FIELDS = tuple(Signals.__dataclass_fields__)
RATE = 25.0
HINGE = """
<mujoco model="pendulum"><option timestep="0.002" integrator="implicitfast"/><worldbody><body>
<joint name="hinge" axis="0 1 0" damping=".05" range="-2 2" limited="true"/>
<geom type="capsule" size=".01" fromto="0 0 0 0 0 -.2" mass=".5"/></body></worldbody>
<actuator><position name="hinge" joint="hinge" kp="20" kv="0.6" forcerange="-4 4"/></actuator></mujoco>
"""
PHYSICS = (
    (),
    (Entry("viscous_friction", None, {"damping": 0.3}), Entry("command_delay", None, {"seconds": 0.011})),
    (Entry("encoder_bias", None, {"offset": 1e-3}),),
    (Entry("stribeck_friction", None, {"static": 0.2, "velocity": 0.01}),),
    (Entry("clock_skew", None, {"rate": 0.01}),),
)
LATE = Entry("clock_offset", None, {"seconds": 0.3 / RATE})
FILTERED = Entry("velocity_filter", None, {"time_constant": 0.06})


def hinge(folder: Path, time: NDArray[np.float64], *names: str) -> list[Trial]:
    model = folder / "pendulum.xml"
    model.write_text(HINGE)
    sidecar = Sidecar(trial="swing", robot=str(model), rate_hz=RATE, interface="position")
    still = {"hinge": np.zeros_like(time)}
    command = {"hinge": 0.4 * np.sin(2 * np.pi * 1.5 * time)}
    return [Trial(name, time, command, still, still, {}, {}, sidecar, f"{name}.csv") for name in names or ("swing",)]


def even(rows: int = 40) -> NDArray[np.float64]:
    return np.arange(rows) / RATE


def uneven(rows: int = 40) -> NDArray[np.float64]:
    return np.concatenate([[0.0], np.cumsum(np.random.default_rng(3).uniform(0.03, 0.05, rows - 1))])


def grasp(sensing: LoadCell | None = None) -> list[Trial]:
    arguments = {"control_hz": RATE, **({"sensing": sensing} if sensing else {})}
    plan = Plan("tiago_mj/GripperTactile-v0", arguments, None, None, "pi")
    return list(record(plan, lambda env: make_policy("pi", env, seed=0, trust=False), episodes=1, seed=0))


def same(one: Signals, other: Signals) -> None:
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)


def sines(plant: Plant, trials: list[Trial], parts: int, frequency: float) -> tuple[NDArray[np.float64], Signals]:
    """Every signal a sine of the true time, in parts of rows; and that time."""
    time = trials[0].time
    ends = np.arange((len(time) - 1) * parts + 1) / parts
    fine = np.interp(ends, np.arange(len(time)), time)
    wave = np.sin(2 * np.pi * frequency * fine)[None, :, None]
    none = np.zeros((1, len(fine), len(plant.sensors)))
    return time, Signals(wave, wave, wave, none, none)


def lagged(time: NDArray[np.float64], frequency: float, seconds: float) -> NDArray[np.float64]:
    """A first-order lag of a sine from rest at 0, by the formula."""
    w = 2 * np.pi * frequency
    lasting = (np.sin(w * time) - w * seconds * np.cos(w * time)) / (1 + (w * seconds) ** 2)
    return lasting + w * seconds / (1 + (w * seconds) ** 2) * np.exp(-time / seconds)


def test_rows_are_cut_into_whole_physics_steps_of_two_milliseconds_or_so(tmp_path: Path) -> None:
    plant = plant_of(hinge(tmp_path, even()))
    parts = {rate: replay.parts_of(replace(plant, period=1 / rate)) for rate in (25.0, 50.0, 100.0, 200.0, 240.0)}
    assert parts == {25.0: 20, 50.0: 10, 100.0: 5, 200.0: 3, 240.0: 3}
    assert replay.parts_of(replace(plant, max_timestep=0.04 / 19)) == 19  # a prime number of steps
    assert replay.parts_of(replace(plant, max_timestep=0.04)) == 1


@pytest.mark.parametrize("time", [even(), uneven()], ids=["even", "uneven"])
def test_what_is_simulated_in_parts_has_the_rows_to_the_last_bit(tmp_path: Path, time: NDArray[np.float64]) -> None:
    trials = hinge(tmp_path, time)
    plant = plant_of(trials)
    on, sims = replay.grid(plant, trials), [(0, effects) for effects in PHYSICS]
    rows, parts = (replay.simulate(plant, on, sims, replay.Run(threads=1, parts=n)) for n in (1, 10))
    assert parts.position.shape[1] == (len(time) - 1) * 10 + 1
    same(parts.thinned(10), rows)
    inside = parts.position[0, 10:21, 0]
    assert (np.diff(inside) != 0).all()


def test_parts_of_a_grasp_have_the_rows_to_the_last_bit_with_a_driver_that_averages() -> None:
    trials = grasp(LoadCell(average=4))
    plant = plant_of(trials)
    assert plant.cell is not None
    assert plant.cell.average == 4
    on, count = replay.grid(plant, trials), replay.parts_of(plant)
    assert count > 1
    sims = [(0, ()), (0, (Entry("backlash", None, {"width": 0.001}),))]
    rows, parts = (replay.simulate(plant, on, sims, replay.Run(threads=1, parts=n)) for n in (1, count))
    assert np.ptp(rows.reading[0]) > 0.1
    same(parts.thinned(count), rows)


def test_a_simulation_that_diverges_in_parts_has_the_same_rows(tmp_path: Path) -> None:
    trials = hinge(tmp_path, even())
    (tmp_path / "pendulum.xml").write_text(HINGE.replace("implicitfast", "Euler").replace('forcerange="-4 4"', ""))
    plant = plant_of(trials)
    wild = (Entry("servo_damping", None, {"damping": 50.0}),)
    on, sims = replay.grid(plant, trials), [(0, ()), (0, wild)]
    rows, parts = (replay.simulate(plant, on, sims, replay.Run(threads=1, parts=n)) for n in (1, 10))
    assert rows.diverged.tolist() == parts.diverged.tolist() == [False, True]
    same(parts.thinned(10), rows)


def test_effects_without_a_memory_do_the_same_in_parts_to_the_last_bit() -> None:
    """The draws of what is missed, too: a load cell is sampled at rows."""
    trials = grasp(LoadCell(average=3))
    plant = plant_of(trials)
    on, count = replay.grid(plant, trials), replay.parts_of(plant)
    true = replay.simulate(plant, on, [(0, ())], replay.Run(parts=count))
    static = (
        Entry("force_gain", None, {"factor": 1.2}),
        Entry("force_quantization", None, {"step": 0.05}),
        Entry("encoder_quantization", None, {"step": 1e-3}),
        Entry("force_dropout", None, {"probability": 0.3}),
    )
    rows, parts = (replay.measure(plant, on, true.thinned(count // n), [(0, static)], parts=n) for n in (1, count))
    same(parts, rows)


@pytest.mark.parametrize("time", [even(), uneven()], ids=["even", "uneven"])
def test_a_filter_follows_a_curve_between_rows(tmp_path: Path, time: NDArray[np.float64]) -> None:
    trials = hinge(tmp_path, time)
    plant, frequency = plant_of(trials), 2.0
    on, off = replay.grid(plant, trials), {}
    for parts in (1, 10):
        at, true = sines(plant, trials, parts, frequency)
        measured = replay.measure(plant, on, true, [(0, (FILTERED,))], parts=parts).velocity[0, :, 0]
        off[parts] = np.abs(measured - lagged(at, frequency, 0.06)).max()
    assert off[10] < 3.3e-4  # (2π 2 Hz 5 ms)² / 12
    assert off[1] > 5e-3


@pytest.mark.parametrize("time", [even(), uneven()], ids=["even", "uneven"])
def test_a_clock_that_is_late_by_a_fraction_of_a_row_shifts_a_curve(tmp_path: Path, time: NDArray[np.float64]) -> None:
    trials = hinge(tmp_path, time)
    plant, frequency = plant_of(trials), 2.0
    on, off = replay.grid(plant, trials), {}
    for parts in (1, 10):
        at, true = sines(plant, trials, parts, frequency)
        measured = replay.measure(plant, on, true, [(0, (LATE,))], parts=parts).position[0, :, 0]
        before = np.sin(2 * np.pi * frequency * np.maximum(at - 0.3 / RATE, 0.0))
        off[parts] = np.abs(measured - before)[2:].max()
    assert off[10] < (1e-3 if on.uniform else 2e-2)  # a delay line counts periods of the last length
    assert off[1] > 2e-2


def test_predictions_with_a_filter_are_measured_in_parts_and_those_as_simulated_at_rows(tmp_path: Path) -> None:
    trials = hinge(tmp_path, even(), "one", "two")
    plant = plant_of(trials)
    predict, nominal = predictor(plant, trials, threads=1)
    assert nominal.position.shape[1] == 40
    assert predict.off is not None
    assert predict.off.position.shape[1] == 781
    sims = [(k, effects) for k in range(2) for effects in ((), (FILTERED,), (LATE, *PHYSICS[1]))]
    bare = [(k, [e for e in es if not replay.sensor_only(e)]) for k, es in sims]
    fine = replay.simulate(plant, predict.on, bare, replay.Run(parts=20))
    expected = replay.measure(plant, predict.on, fine, sims, parts=20)
    np.testing.assert_array_equal(
        replace(predict, corrected=False)(sims), noise_model.predicted(predict.data, expected)
    )
    corrected = Signals(*(getattr(fine, f) - np.repeat(getattr(predict.off, f), 3, axis=0) for f in FIELDS))
    np.testing.assert_array_equal(
        replace(predict, corrected=True)(sims),
        noise_model.predicted(predict.data, replay.measure(plant, predict.on, corrected, sims, parts=20)),
    )
    at_rows = replay.simulate(plant, predict.on, sims)
    np.testing.assert_allclose(
        predict.as_simulated()(sims), noise_model.predicted(predict.data, at_rows), rtol=0, atol=1e-12
    )
    assert np.abs(expected.velocity - at_rows.velocity).max() > 0.02


def test_what_is_kept_at_rows_is_simulated_once_more_for_a_sensor_with_a_memory(tmp_path: Path) -> None:
    trials = hinge(tmp_path, even(), "one", "two")
    plant = plant_of(trials)
    on, data = replay.grid(plant, trials), noise_model.collect(plant, trials)
    predict = Predictor(plant, on, data, threads=1)
    base = predict.all_trials([()], range(2), keep=True)
    for effects, count in (((), 2), ((FILTERED,), 4), ((LATE,), 4), ((), 4)):
        after = predict.all_trials([effects], range(2))
        assert predict.tally["simulations"] == count
    np.testing.assert_array_equal(after, base)


def test_parts_that_cannot_be_are_refused(tmp_path: Path) -> None:
    trials = hinge(tmp_path, even())
    plant = plant_of(trials)
    with pytest.raises(ValueError, match="20 physics steps of a row in 3 parts"):
        replay.simulate(plant, replay.grid(plant, trials), [(0, ())], replay.Run(parts=3))
    with pytest.raises(ValueError, match="then measure"):
        replay.simulate(plant, replay.grid(plant, trials), [(0, (LATE,))], replay.Run(parts=20))

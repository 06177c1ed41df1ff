"""Motions of the menu, simulated before a robot plays them: what would be recorded, and whether it is safe."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.effects import EFFECTS
from tiago_mj.effects.declare import is_random
from tiago_mj.effects.spec import Entry
from tiago_mj.gap.inference import noise_model, step_tolerance
from tiago_mj.gap.inference.noise_model import Data
from tiago_mj.gap.inference.predictor import Predictor
from tiago_mj.gap.simulation import replay
from tiago_mj.gap.simulation.plant import Plant, Start
from tiago_mj.gap.simulation.replay import Grid, Run
from tiago_mj.models import names
from tiago_mj.recordings import motions
from tiago_mj.recordings.motions.menu import OPEN, items
from tiago_mj.recordings.motions.play import Motion, read_motion
from tiago_mj.recordings.recording import Trial

Array = NDArray[np.float64]
Effects = tuple[Entry, ...]

#: Longest motion that is considered [s].
LONGEST: Final = 6.5
#: Fingers that begin farther than this from where the menu's motions begin are opened first [m].
ELSEWHERE: Final = 1e-3
#: A motion is not safe if the servos would press harder than this share of their limits.
PRESS: Final = 0.85


@dataclass(frozen=True)
class Rehearsal:
    """Motions side by side, each a trial of the plant.

    Attributes:
        files, motions: of the menu, K.
        plant, on: how they are simulated.
        data: how far their recordings could be trusted; of the values only which there are counts.
        nominal: channels without any effect, (K, T, C).
        predicted: under every explanation, (nexplanations, K, T, C).
        harmless: whether no servo that the motion moves comes near its limit, whichever explanation is true, (K,).
        how: simulations are run.
    """

    files: tuple[str, ...]
    motions: tuple[Motion, ...]
    plant: Plant
    on: Grid
    data: Data
    nominal: Array
    predicted: Array
    harmless: NDArray[np.bool_]
    how: Run

    def predict(self, explanations: Sequence[Effects]) -> Array:
        """Channels under other explanations, (nexplanations, K, T, C)."""
        how = self.how
        predictor = Predictor(self.plant, self.on, self.data, how.threads, how.seed, deadline=how.deadline)
        return predictor.all_trials(explanations, range(len(self.files)))

    def only(self, which: Iterable[int]) -> Rehearsal:
        """Some of the motions."""
        index, on = list(which), self.on
        return replace(
            self,
            files=tuple(self.files[k] for k in index),
            motions=tuple(self.motions[k] for k in index),
            on=replace(
                on,
                trials=tuple(on.trials[k] for k in index),
                rows=on.rows[index],
                period=on.period[index],
                commands=on.commands[index],
            ),
            data=noise_model.select_trials(self.data, index),
            nominal=self.nominal[index],
            predicted=self.predicted[:, index],
            harmless=self.harmless[index],
        )


def rehearse(plant: Plant, like: Trial, data: Data, explanations: Sequence[Effects], how: Run) -> Rehearsal | None:
    """Play what the menu has for the plant; None if it has nothing.

    Args:
        plant: the nominal simulator.
        like: a recording: its object and start are those of the motions; the fingers begin open.
        data: channels and noise of the recordings.
        explanations: what may be true.
        how: simulations are run; its seed is of the noise, too, that recordings would have.

    Raises:
        OutOfTimeError: the deadline is over.
    """
    listed = _applicable(plant)
    if not listed:
        return None
    count = len(listed)
    start = _opened(plant, plant.starts[like.name])
    plant = replace(plant, starts={file: start for file, _ in listed})
    on = replay.grid(plant, [_trial(plant, like, file, motion) for file, motion in listed])
    # What is measured, and when; the values do not matter yet.
    blank = np.zeros((count, on.commands.shape[1] + 1, len(data.channels)))
    rows = noise_model.collect(plant, [_recorded(t, data, blank[k]) for k, t in enumerate(on.trials)])
    sims = [(k, effects) for effects in ((), *explanations) for k in range(count)]
    true = replay.simulate(plant, on, sims, how)
    predicted = noise_model.predicted(rows, true).reshape(len(explanations) + 1, *blank.shape)
    rng = np.random.default_rng(how.seed)
    noisy = predicted[0] + data.noise * rng.standard_normal(blank.shape)
    if data.late is not None:
        noisy += np.gradient(predicted[0], plant.period, axis=1) * data.late * rng.standard_normal(blank.shape)
    rows = noise_model.collect(plant, [_recorded(t, data, noisy[k]) for k, t in enumerate(on.trials)])
    played = tuple(motion for _, motion in listed)
    harmless = _harmless(plant, played, true.effort.reshape(len(explanations) + 1, *blank.shape[:2], -1))
    files = tuple(file for file, _ in listed)
    found = Rehearsal(files, played, plant, on, rows, predicted[0], predicted[1:], harmless, how)
    drawn = [k for k, effects in enumerate(explanations) if any(is_random(EFFECTS[entry.name]) for entry in effects)]
    if drawn:  # a mean over several draws tells more than one
        found.predicted[drawn] = found.predict([explanations[k] for k in drawn])
    return found


def with_numerics(rehearsal: Rehearsal) -> Rehearsal:
    """With a tolerance of what the nominal simulator itself gets wrong by its physics step."""
    fine = replace(rehearsal.plant, max_timestep=rehearsal.plant.max_timestep / step_tolerance.STEP_REFINEMENT)
    each: list[tuple[int, Effects]] = [(k, ()) for k in range(len(rehearsal.files))]
    finer = replay.simulate(fine, rehearsal.on, each, rehearsal.how)
    rows = step_tolerance.with_step_tolerance(
        rehearsal.data, rehearsal.nominal, noise_model.predicted(rehearsal.data, finer)
    )
    return replace(rehearsal, data=rows)


def _applicable(plant: Plant) -> list[tuple[str, Motion]]:
    """Motions of the menu for the plant's joints and interface, at the rate nearest to its own."""
    rate = min(motions.RATES, key=lambda r: abs(np.log(r * plant.period)))
    out = []
    for item in items():
        if item.interface != plant.wiring.interface or item.seconds > LONGEST:
            continue
        if set(item.shapes) <= set(plant.actuators):
            file = motions.file_name(item.name, rate)
            out.append((file, read_motion(motions.FOLDER / file)))
    return out


def _opened(plant: Plant, start: Start) -> Start:
    """A start with the fingers where the menu's motions begin, unless they are there anyway."""
    qpos, set_point = start.qpos.copy(), start.set_point.copy()
    for k, name in enumerate(plant.actuators):
        if name in names.FINGERS and abs(set_point[k] - OPEN) > ELSEWHERE:
            qpos[plant.wiring.qpos[plant.wiring.targets.actuated[k]]] = set_point[k] = OPEN
    return replace(start, qpos=qpos, set_point=set_point)


def _trial(plant: Plant, like: Trial, file: str, motion: Motion) -> Trial:
    rate = 1 / plant.period
    steps = motion.steps(rate)
    commands = {name: np.append(values, np.nan) for name, values in motion.at(rate).items()}
    return replace(like, name=file, time=np.arange(steps + 1, dtype=np.float64) * plant.period, commands=commands)


def _recorded(trial: Trial, data: Data, values: Array) -> Trial:
    """A trial with measurements, (T, C), as long as it is."""
    kinds: dict[str, dict[str, Array]] = {"position": {}, "velocity": {}, "force": {}}
    for c, channel in enumerate(data.channels):
        kind, _, name = channel.partition(".")
        kinds[kind][name] = values[: len(trial.time), c]
    return replace(trial, positions=kinds["position"], velocities=kinds["velocity"], forces=kinds["force"])


def _harmless(plant: Plant, played: Sequence[Motion], effort: Array) -> NDArray[np.bool_]:
    """(K,), of efforts of all joints, (nexplanations, K, T, njoints)."""
    servos = np.array(plant.wiring.actuators)
    limited = plant.model.actuator_forcelimited[servos] > 0
    limit = np.where(limited, plant.model.actuator_forcerange[servos, 1], np.inf)
    most = np.abs(effort[..., list(plant.wiring.targets.actuated)]).max(axis=(0, 2))
    moved = np.array([[name in motion.commands for name in plant.actuators] for motion in played])
    return np.asarray(~(moved & (most > PRESS * limit)).any(axis=1))

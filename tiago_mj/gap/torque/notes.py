"""Sentences that a reader of a diagnosis along a measured motion should know."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from tiago_mj.gap.torque.measured import Measured
from tiago_mj.recordings.recording import Trial, sampled


def of_method(trials: Sequence[Trial], measured: Measured) -> tuple[str, ...]:
    """What was compared, and how."""
    return (
        *measured.usable.notes,
        _method(measured),
        *_stated(measured),
        *_late(trials),
        *_commands(trials),
        "At rest dry friction takes any value within its bounds, so rows at rest are neither fitted nor counted in "
        "before and after.",
        "A torque constant and the gain of the effort reading are one and the same here.",
    )


def _stated(measured: Measured) -> Iterator[str]:
    """How well the recordings say that numbers of the model are known."""
    for (effect, target), deviation in measured.session.plant.known.items():
        yield (
            f"{effect}{f' of {target}' if target else ''} is known to {deviation:.2g}, as the recordings say: it is "
            "adjusted within that, whatever is named."
        )


def _commands(trials: Sequence[Trial]) -> Iterator[str]:
    if any(trial.commands for trial in trials):
        yield (
            "The commands are torques. Nothing pulls a joint back to the recorded motion, so a replay of them would "
            "add up their errors: they are compared with the torques that the model needs along the measured motion. "
            "Delays and lags of the drive and play between motor and joint cannot be seen that way."
        )
        return
    yield (
        "Nothing is known of the commands, so delays, lags, limits and gains of the servo and play between motor "
        "and joint cannot be seen."
    )


def _method(measured: Measured) -> str:
    data, course = measured.predict.data, measured.course
    known = [f"{noise:.2g} ({name})" for noise, name in zip(data.sigma.min(axis=(0, 1)), course.channels, strict=True)]
    return (
        f"Positions and efforts were low-passed at {course.cutoff:.2g} Hz without phase shift; below that efforts are "
        f"known to {_list(known, 'and')}: by their noise, by that of the positions, and by what is probably "
        "left beside a model with every effect and free functions of position, speed and time."
    )


def _late(trials: Sequence[Trial]) -> Iterator[str]:
    """Velocities that trail the derivative of the positions."""
    lags = []
    for trial in trials:
        for joint in trial.velocities:
            if joint not in trial.positions:
                continue
            time, velocity = sampled(trial, f"velocity.{joint}")
            when, position = sampled(trial, f"position.{joint}")
            if len(time) < 100 or np.ptp(velocity) == 0 or np.ptp(position) == 0:
                continue
            derived = np.interp(time, when, np.gradient(position, when))
            step = float(np.median(np.diff(time)))
            shifts = range(int(0.5 / step) if step > 0 else 0)
            n = len(time) - len(shifts)
            if n < 100 or not len(shifts):
                continue
            match = [float(np.corrcoef(velocity[k : k + n], derived[:n])[0, 1]) for k in shifts]
            lags.append(step * int(np.argmax(match)))
    if lags and max(lags) > 0.02:
        yield (
            f"The recorded velocities trail the derivative of the positions by {min(lags):.2f} to {max(lags):.2f} s, "
            "as a filter would make them; they are not used."
        )


def _list(items: Sequence[str], word: str) -> str:
    return items[0] if len(items) == 1 else f"{', '.join(items[:-1])} {word} {items[-1]}" if items else ""

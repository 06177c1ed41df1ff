"""Sentences that a reader of a diagnosis along a measured motion should know."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from tiago_mj.gap.torque.channels import Usable
from tiago_mj.gap.torque.judge import Verdict
from tiago_mj.gap.torque.search import Scored, Search
from tiago_mj.recordings import travel
from tiago_mj.recordings.recording import Trial, sampled


def sentences(trials: Sequence[Trial], usable: Usable, search: Search, verdict: Verdict) -> tuple[str, ...]:
    """All of them, the weightiest first."""
    return (
        *verdict.said,
        *_together(search, verdict),
        *_unnamed(search, verdict),
        *_given(search, verdict),
        *of_method(trials, usable, search),
        "Probabilities follow from BIC over effective samples by the calibration of replayed recordings; no bank of "
        "simulated recordings without commands stands behind them.",
    )


def of_method(trials: Sequence[Trial], usable: Usable, search: Search) -> tuple[str, ...]:
    """Those that do not depend on what was found."""
    return (
        *usable.notes,
        *_method(search),
        *_unequal(trials, search),
        *_late(trials),
        *_commands(trials),
        "At rest dry friction takes any value within its bounds, so rows at rest are neither fitted nor counted in "
        "before and after.",
        "A torque constant and the gain of the effort reading are one and the same here.",
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


def _together(search: Search, verdict: Verdict) -> Iterator[str]:
    """What all equally good explanations share, and wherein they differ."""
    if not verdict.alternatives:
        return
    sets = [set(search.names(one)) for one in verdict.alternatives]
    shared = sorted(set.intersection(*sets))
    if shared:
        yield f"Every explanation that the data allow holds {_list(shared, 'and')}."
    own = []
    for one, names in zip(verdict.alternatives, sets, strict=True):
        own.append(_list([_where(search, one, name) for name in sorted(names - set(shared))], "with"))
    yield f"This motion cannot tell apart: {'; '.join(o or 'neither' for o in own)}."


def _where(search: Search, scored: Scored, name: str) -> str:
    targets = [search.evidence.terms[k].target for k in scored.terms if search.evidence.terms[k].effect == name]
    return f"{name} ({', '.join(targets)})"


def _unnamed(search: Search, verdict: Verdict) -> Iterator[str]:
    if verdict.unsupported:
        yield (
            f"A function of position or time that no effect has explains more than "
            f"{_list(verdict.unsupported, 'and')}: the name is not supported."
        )
    if verdict.remains.any():
        left = [name for name, remains in zip(search.evidence.course.channels, verdict.remains, strict=True) if remains]
        yield f"Above the noise something remains on {_list(left, 'and')}."


def _given(search: Search, verdict: Verdict) -> Iterator[str]:
    e = search.evidence
    for k, size in e.given.items():
        term, value = e.terms[k], verdict.best.strengths.get(k, 0.0)
        yield (
            f"The recordings say that {term.effect} of {term.target} is known to ±{size:.2g}: it is fitted along with "
            f"every explanation, here to {term.parameter} {term.identity + value:.3g}, and is no gap."
        )


def _method(search: Search) -> Iterator[str]:
    e = search.evidence
    course, blocks = e.course, e.blocks
    noise = _list([f"{n:.2g} ({c})" for n, c in zip(e.floor.noise, course.channels, strict=True)], "and")
    yield (
        f"Positions and efforts were low-passed at {course.cutoff:.2g} Hz without phase shift; the efforts' noise "
        f"below that is {noise}."
    )
    if blocks.cut:
        yield (
            f"The recording was cut into {len(blocks.names)} blocks of about {blocks.length:.2g} s with gaps of "
            f"{blocks.gap:.2g} s; the residual's correlation times are "
            f"{_list([f'{t:.2g} s' for t in e.floor.correlation], 'and')}."
        )
    if not blocks.test:
        yield "There are too few blocks to keep one aside: how much of the gap closes is not known."


def _unequal(trials: Sequence[Trial], search: Search) -> tuple[str, ...]:
    """Of whole trials: joints that went less far in those that were fitted."""
    blocks = search.evidence.blocks
    splits = {part: [blocks.names[b] for b in getattr(blocks, part)] for part in ("train", "validation", "test")}
    return travel.notes(trials, splits)


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

"""Exchanged columns: right and left, or two joints, under each other's name."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations
from typing import Final

import numpy as np

from tiago_mj.models import names
from tiago_mj.recordings.lint.consistency import DIFFERENT, ENOUGH, SAME, follows
from tiago_mj.recordings.lint.motion import CLEAR, Travel, commanded, integrated, lags, measured
from tiago_mj.recordings.lint.numbers import correlation, noise, rms
from tiago_mj.recordings.recording import Finding, Trial, sampled

#: Unexplained variance by the other finger's channel over that by the finger's own that shows an exchange.
EXCHANGED: Final = 0.3
#: Cosine of a joint's motion and the other's command, and of their differences backwards, that show an exchange where
#: the two move much alike.
CROSSED: Final = 0.7
#: Cosine below which two joints' difference runs backwards beyond doubt, and how far it must then rise above the floor.
BACKWARDS, RISES = -0.95, 2.0


def check(trials: Sequence[Trial]) -> Iterator[tuple[Finding, frozenset[str]]]:
    """Findings on exchanged columns, each with its joints."""
    joints = tuple(dict.fromkeys(joint for trial in trials for joint in trial.positions))
    for one, other in combinations(joints, 2):
        both = [trial for trial in trials if one in trial.positions and other in trial.positions]
        velocity = [trial for trial in both if _velocities_exchanged(trial, one, other)]
        command = _commands_exchanged(both, one, other)
        kind = ("position" if velocity else "command") if command else "velocity"
        if velocity and not command and _more_exchanged(velocity, one, other) == "position":
            kind = "position"
        for trial in both if command else velocity:
            either = kind == "command" and not {one, other} <= set(trial.velocities)
            finding = Finding(
                "swapped_channels",
                trial.source,
                f"{kind}.{one}",
                f"the columns {'position or command' if either else kind} of '{one}' and '{other}' are exchanged: each "
                "follows the other joint; rename them, or map them (--map)",
                refuses=True,
            )
            yield finding, frozenset({one, other})
    for finding in _forces_exchanged(trials):
        yield finding, frozenset()


def _velocities_exchanged(trial: Trial, one: str, other: str) -> bool:
    position = [measured(trial, joint) for joint in (one, other)]
    velocity = [integrated(trial, joint) for joint in (one, other)]
    if any(travel is None or len(travel.windows) < ENOUGH for travel in [*position, *velocity]):
        return False
    p, v = [t for t in position if t is not None], [t for t in velocity if t is not None]
    difference = [t[0].windows - t[1].windows for t in (p, v)]
    floors = [np.hypot(t[0].floor, t[1].floor) for t in (p, v)]
    cosine = correlation(difference[0], difference[1])
    clear = RISES if cosine < BACKWARDS else CLEAR
    if any(rms(d) <= clear * floor for d, floor in zip(difference, floors, strict=True)):
        return False
    return cosine < -SAME and all(correlation(p[k].windows, v[1 - k].windows) > SAME for k in (0, 1))


def _more_exchanged(trials: Sequence[Trial], one: str, other: str) -> str:
    """Whether positions or velocities of an exchanged pair contradict the commands' difference more."""
    against = {}
    for kind, read in (("position", measured), ("velocity", integrated)):
        cosines = []
        for trial in trials:
            sent = [commanded(trial, joint, trial.sidecar.interface) for joint in (one, other)]
            gone = [read(trial, joint) for joint in (one, other)]
            if sent[0] and sent[1] and gone[0] and gone[1]:
                cosines.append(correlation(sent[0].windows - sent[1].windows, gone[0].windows - gone[1].windows))
        against[kind] = float(np.mean(cosines)) if cosines else 0.0
    return min(against, key=lambda kind: against[kind])


def _commands_exchanged(trials: Sequence[Trial], one: str, other: str) -> bool:
    having = [
        (trial, a, b)
        for trial in trials
        if {one, other} <= set(trial.commands)
        and (a := measured(trial, one)) is not None
        and (b := measured(trial, other)) is not None
        and a.moved
        and b.moved
    ]
    if sum(len(a.windows) for _, a, _ in having) < ENOUGH:
        return False
    first, second = [(t, a) for t, a, _ in having], [(t, b) for t, _, b in having]
    own = [follows(one, first, None).max(initial=-1), follows(other, second, None).max(initial=-1)]
    crossed = [follows(other, first, None).max(initial=-1), follows(one, second, None).max(initial=-1)]
    if max(own) < DIFFERENT:
        return bool(min(crossed) > SAME)
    return min(crossed) > max(max(own), CROSSED) and _differ_backwards(having, one, other)


def _differ_backwards(having: Sequence[tuple[Trial, Travel, Travel]], one: str, other: str) -> bool:
    """Whether the difference of two joints is opposite to that of their commands, at every lag."""
    clear = [(t, a, b) for t, a, b in having if rms(a.windows - b.windows) > CLEAR * float(np.hypot(a.floor, b.floor))]
    gone = [a.windows - b.windows for _, a, b in clear]
    cosines = []
    for lag in lags():
        sent = [
            tuple(commanded(trial, joint, trial.sidecar.interface, lag) for joint in (one, other))
            for trial, _, _ in clear
        ]
        wanted = [a.windows - b.windows for a, b in sent if a is not None and b is not None]
        if not wanted or len(wanted) < len(gone):
            return False
        cosines.append(correlation(np.concatenate(wanted), np.concatenate(gone)))
    return bool(cosines) and min(cosines) < -CROSSED and max(cosines) < DIFFERENT


def _forces_exchanged(trials: Sequence[Trial]) -> Iterator[Finding]:
    """Share of each sensor's force that effort and speed (drag) of either finger explain."""
    usable = []
    for trial in trials:
        fingers = [next((j for j in trial.efforts if side in j and j in trial.velocities), "") for side in names.SIDES]
        if all(fingers) and set(names.SIDES) <= set(trial.forces):
            usable.append((trial, fingers))
    if not usable:
        return
    unexplained = np.empty((2, 2))
    for s, side in enumerate(names.SIDES):
        force = np.concatenate([sampled(trial, f"force.{side}")[1] for trial, _ in usable])
        if np.ptp(force) <= 4 * CLEAR * noise(force):
            return
        for f in range(2):
            columns = [
                np.concatenate(
                    [
                        np.interp(sampled(trial, f"force.{side}")[0], *sampled(trial, f"{kind}.{fingers[f]}"))
                        for trial, fingers in usable
                    ]
                )
                for kind in ("effort", "velocity")
            ]
            basis = np.stack([np.ones_like(force), *columns], axis=1)
            rest = force - basis @ np.linalg.lstsq(basis, force, rcond=None)[0]
            unexplained[s, f] = float(np.var(rest) / np.var(force))
    own, crossed = np.diag(unexplained), np.diag(unexplained[:, ::-1])
    if (crossed < EXCHANGED * own).all() and (crossed < 1 - SAME).all():
        for trial, _ in usable:
            yield Finding(
                "swapped_channels",
                trial.source,
                "force.right",
                "the columns force of 'right' and 'left' are exchanged: each follows the other finger's effort; rename "
                "them, or map them (--map)",
                refuses=True,
            )

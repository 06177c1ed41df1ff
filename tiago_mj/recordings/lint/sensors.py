"""Faults of single sensors: dead, stuck, quantized, saturated, without sign."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.recordings.lint.motion import CLEAR, commanded, integrated, measured
from tiago_mj.recordings.lint.numbers import noise, quantum, rms, runs
from tiago_mj.recordings.nominal_priors import grids
from tiago_mj.recordings.recording import Array, Finding, Trial, names, sampled

#: Share of the samples of a moving joint in which a dead effort channel reads exactly its most frequent value.
DEAD_SHARE: Final = 0.75
#: And that value, relative to the largest: a servo at its limit reads one value, too.
NOTHING: Final = 0.05
#: Steps of a grid that a reading may lack without being dead.
MAX_MISSING_STEPS: Final = 3.0
#: Commanded net displacement [m, rad] that a working joint shows, whatever its dead band, play or quantum.
UNMISTAKABLE: Final = 0.01
#: Identical samples in a row that are looked at; an analogue reading repeats by chance once or twice.
RUN: Final = 10
#: A channel is analogue if this share of its samples differs from the one before.
ANALOGUE: Final = 0.9
#: A drive that is switched off for a while gives a signal in this share of the samples at least.
SIGNAL: Final = 0.1
#: A plateau holds at least this share of the samples, and is so many times longer than the longest run elsewhere.
PLATEAU_SHARE, PLATEAU_RATIO = 0.02, 3.0
#: A joint goes both ways if either way is this share of its travel.
BOTH_WAYS: Final = 0.15


def check(trials: Sequence[Trial]) -> Iterator[Finding]:
    """Findings on single channels. A quantization step is estimated over all recordings."""
    stated = grids(trials)
    for name in names(tuple(trials)):
        having = [trial for trial in trials if name in _all(trial)]
        pooled = np.concatenate([sampled(trial, name)[1] for trial in having])
        step = quantum(pooled)
        coarse = float(np.diff(np.unique(pooled)).min(initial=np.inf))
        if name in stated:
            coarse = stated[name] if np.isinf(coarse) else max(coarse, stated[name])
        hides = step is not None and noise(pooled) < step  # readings at rest repeat, and are between two lines
        unsigned = _is_unsigned(name, having)
        for trial in having:
            found = list(_dead(trial, name, having, coarse))
            if not found:
                if not (hides and name.startswith("force.")):
                    found = [*_stuck(trial, name), *_saturated(trial, name)]
                if unsigned:
                    found.append(_unsigned(trial, name))
            if step is not None:
                found.append(
                    Finding(
                        "quantum", trial.source, name, f"it comes in steps of {step:.4g}: smaller changes are not seen"
                    )
                )
            yield from found


def _all(trial: Trial) -> tuple[str, ...]:
    return names((trial,))


def _dead(trial: Trial, name: str, having: Sequence[Trial], coarse: float) -> Iterator[Finding]:
    """Finding on a channel that is constant although others show that it must change.

    Args:
        trial: that is looked at.
        name: of the channel.
        having: all trials with it.
        coarse: step of its grid, as stated, or the smallest difference between any two of its readings; infinite where
            it has but one.
    """
    kind, _, joint = name.partition(".")
    values = sampled(trial, name)[1]
    if len(values) < RUN:
        return
    constant = bool((values == values[0]).all())
    because = ""
    if kind == "force":
        if constant and (why := _must_have_read(trial, name, having, coarse)):
            because = f"it reads {values[0]:.4g} throughout, {why}"
    elif constant and kind == "position" and _moves(trial, joint, ("velocity", "command"), coarse):
        because = f"it reads {values[0]:.4g} throughout, while the joint is commanded or said to move"
    elif constant and kind == "velocity" and not _slower(trial, joint, coarse):
        if _moves(trial, joint, ("position", "command")):
            because = f"it reads {values[0]:.4g} throughout, while the joint moves or is commanded to"
    elif (
        kind == "effort"
        and not _commanded_effort(trial, joint)
        and _moves(trial, joint, ("position", "velocity", *(("command",) if constant else ())))
    ):
        value, share = _most_frequent(trial, joint)
        largest = float(np.abs(values).max())
        grid = not constant and largest <= MAX_MISSING_STEPS * coarse  # what little it read was a step or two
        if constant or (share > DEAD_SHARE and abs(value) <= NOTHING * largest and not grid):
            because = f"it reads {value + 0.0:.4g} in {share:.0%} of the samples in which the joint moves"
    if because:
        said = because + ": left out of use; check the sensor and its cable"
        yield Finding("dead_channel", trial.source, name, said, discredits=True)


def _must_have_read(trial: Trial, name: str, having: Sequence[Trial], coarse: float) -> str:
    """Why a load cell that reads one value must be dead; "" where a coarse quantization, or lack of contact, explains
    it."""
    alive = False
    for other in having:
        values = sampled(other, name)[1]
        start, _ = runs(values)
        if other is not trial and len(values) >= RUN and len(start) > ANALOGUE * len(values):
            return "without any noise, which it has elsewhere"
        alive = alive or bool(np.ptp(values))
    if alive:
        return ""
    step = coarse if np.isfinite(coarse) else 0.0
    for cell in trial.forces:
        if f"force.{cell}" == name:
            continue
        values = sampled(trial, f"force.{cell}")[1]
        if len(values) < RUN:
            continue
        floor = max(noise(values), float(np.diff(np.unique(values)).min(initial=0.0)))
        if float(np.ptp(values)) > max(MAX_MISSING_STEPS * step, 4 * CLEAR * floor):
            return f"while force.{cell} is pressed"
    return ""


def _slower(trial: Trial, joint: str, coarse: float) -> bool:
    """Whether a joint, by its position, is slower than the quantization step of its velocity."""
    if not np.isfinite(coarse) or joint not in trial.positions:
        return False
    time, position = sampled(trial, f"position.{joint}")
    return float(np.percentile(np.abs(np.gradient(position, time)), 95)) < coarse


def _commanded_effort(trial: Trial, joint: str) -> bool:
    """Whether efforts are what is commanded: a torque that is switched off reads 0 while the joint swings."""
    return trial.sidecar.interface == "effort" and joint in trial.commands


def _moves(trial: Trial, joint: str, by: tuple[str, ...], coarse: float = np.inf) -> bool:
    """Whether a joint moves, by other channels; farther than two steps of the one in question, where they are known."""
    travels = {
        "position": lambda: measured(trial, joint),
        "velocity": lambda: integrated(trial, joint),
        "command": lambda: commanded(trial, joint, trial.sidecar.interface),
    }
    for kind in by:
        travel = travels[kind]()
        if travel is None or not travel.moved:
            continue
        gone = np.append(0.0, np.cumsum(travel.windows[::2]))
        if np.isfinite(coarse) and float(np.ptp(gone)) < 2 * coarse:
            continue
        if kind != "command" or abs(gone[-1]) > UNMISTAKABLE:
            return True
    return False


def switched_off(effort: Array) -> NDArray[np.bool_]:
    """Rows in which a drive is off, (n,): its torque is 0 in one stretch, and a signal before and after it.

    A joint that swings freely has no torque, which is evidence as good as any. What reads 0 now and then, or always, is
    dead.
    """
    start, length = runs(effort)
    zero = np.flatnonzero((effort[start] == 0.0) & (length >= RUN))
    off = np.zeros(len(effort), dtype=bool)
    if len(zero) == 1:
        first, rows = int(start[zero[0]]), int(length[zero[0]])
        others = len(effort) - rows
        if others >= SIGNAL * len(effort) and len(start) - 1 > ANALOGUE * others:
            off[first : first + rows] = True
    return off


def _most_frequent(trial: Trial, joint: str) -> tuple[float, float]:
    """Most frequent effort, and its share of the samples, while the joint moves fast and its drive is on."""
    time, effort = sampled(trial, f"effort.{joint}")
    on = ~switched_off(effort)
    if joint in trial.velocities:
        when, speed = sampled(trial, f"velocity.{joint}")
    else:
        when, position = sampled(trial, f"position.{joint}")
        speed = np.gradient(position, when)
    fast = np.abs(np.interp(time, when, speed))
    moving = effort[on & (fast > 0.25 * np.percentile(fast, 95))]
    if len(moving) < RUN:
        return 0.0, 0.0
    value, count = np.unique(moving, return_counts=True)
    return float(value[np.argmax(count)]), float(count.max() / len(moving))


def _stuck(trial: Trial, name: str) -> Iterator[Finding]:
    kind, _, joint = name.partition(".")
    time, values = sampled(trial, name)
    start, length = runs(values)
    long = np.flatnonzero(length >= RUN)
    if not len(long) or len(start) < 2:
        return
    others = len(values) - int(length[long].sum())
    analogue = others >= RUN and (len(start) - len(long)) / others > ANALOGUE
    for k in long:
        first, last = int(start[k]), int(start[k] + length[k] - 1)
        value = float(values[first])
        if kind == "effort" and not analogue:
            wrong = False
        elif kind == "force":
            ends = (0.0, values.min(), values.max())
            wrong = analogue and not np.isclose(value, ends, rtol=1e-9, atol=1e-12).any()  # there it saturates
        else:
            wrong = _elsewhere(trial, kind, joint, value, float(time[first]), float(time[last]))
        if wrong:
            yield Finding(
                "stuck",
                trial.source,
                name,
                f"it stays at {value:.6g} from {time[first]:.4g} to {time[last]:.4g} s, while "
                f"{'its noise should show' if kind == 'force' else 'the joint moves'}: left out of use here",
                discredits=True,
            )
            return


def _elsewhere(trial: Trial, kind: str, joint: str, value: float, begin: float, end: float) -> bool:
    """Whether another channel of the joint shows that this one should have changed between two times."""
    if kind == "velocity":
        if joint not in trial.positions:
            return False
        when, position = sampled(trial, f"position.{joint}")
        speeds = np.unique(sampled(trial, f"velocity.{joint}")[1])
        lost = float(np.diff(speeds).min(initial=np.inf)) * (end - begin)  # what rounding of the velocity hides
        floor = max(noise(position), quantum(position) or 0.0, 1e-9)
        went = float(np.diff(np.interp([begin, end], when, position))[0])
        p, v = measured(trial, joint), integrated(trial, joint)
        unit = rms(p.windows) / rms(v.windows) if p and v and p.moved and v.moved else 1.0  # the two may differ in it
        return abs(went - unit * value * (end - begin)) > max(2 * CLEAR * floor, 0.1 * float(np.ptp(position))) + lost
    if kind == "position" and joint in trial.velocities:
        when, speed = sampled(trial, f"velocity.{joint}")
        gone = np.append(0.0, np.cumsum((speed[1:] + speed[:-1]) / 2 * np.diff(when)))
        missed = abs(float(np.diff(np.interp([begin, end], when, gone))[0]))
        position = sampled(trial, f"position.{joint}")[1]
        step = max(noise(position), float(np.diff(np.unique(position)).min(initial=np.inf)))
        lost = (quantum(speed) or 0.0) * (end - begin)
        return missed > max(2 * CLEAR * step + lost, 0.1 * float(np.ptp(gone)))
    if kind == "effort" and joint in trial.positions and value != 0.0:
        when, position = sampled(trial, f"position.{joint}")
        inside = position[(when >= begin) & (when <= end)]
        effort = sampled(trial, f"effort.{joint}")[1]
        if value in (effort.min(), effort.max()) or quantum(effort) is not None or len(inside) < 2:
            return False
        return float(np.ptp(inside)) > max(2 * CLEAR * noise(position), 0.1 * float(np.ptp(position)))
    return False


def _saturated(trial: Trial, name: str) -> Iterator[Finding]:
    kind, _, joint = name.partition(".")
    if kind not in ("effort", "force"):
        return
    values = sampled(trial, name)[1]
    start, length = runs(values)
    limit = ((trial.sidecar.servo or {}).get("effort_limit") or {}).get(joint)
    for extreme in (values.max(), values.min()):
        at = values[start] == extreme
        at[0] = False  # what stands there from the first row on need not have been limited
        elsewhere = length[values[start] != extreme]
        if extreme == 0.0 or not at.any() or not len(elsewhere) or (kind == "force" and extreme < 0):
            continue
        longest = int(length[at].max())
        if limit is not None and np.isclose(abs(extreme), limit, rtol=1e-6):
            continue  # the servo's own limit, which the nominal model has
        if (values == extreme).mean() >= PLATEAU_SHARE and longest >= max(5, PLATEAU_RATIO * int(elsewhere.max())):
            yield Finding(
                "saturation",
                trial.source,
                name,
                f"it never passes {extreme:.6g} and stays there for {longest} samples: a limit of sensor or servo",
            )


def _is_unsigned(name: str, having: Sequence[Trial]) -> bool:
    """Whether a channel shows no sign although the joint goes both ways, in trials without a drive that is off."""
    kind, _, joint = name.partition(".")
    if kind not in ("velocity", "effort"):
        return False
    trials = [trial for trial in having if kind == "velocity" or not switched_off(sampled(trial, name)[1]).any()]
    pooled = np.concatenate([np.empty(0), *(sampled(trial, name)[1] for trial in trials)])
    if len(pooled) < RUN or not np.ptp(pooled):
        return False
    size = np.abs(pooled)
    if not ((pooled >= 0).all() or (pooled <= 0).all()) or np.percentile(size, 5) > 0.05 * np.percentile(size, 95):
        return False
    forth = back = 0.0
    for trial in trials:
        travel = measured(trial, joint)
        if travel is not None and travel.moved:
            forth += float(travel.windows[travel.windows > 0].sum())
            back -= float(travel.windows[travel.windows < 0].sum())
    return min(forth, back) > BOTH_WAYS * (forth + back) > 0


def _unsigned(trial: Trial, name: str) -> Finding:
    return Finding(
        "unsigned",
        trial.source,
        name,
        "it never changes its sign although the joint goes both ways, so it is a magnitude: left out of use; record it "
        "with its sign",
        discredits=True,
    )

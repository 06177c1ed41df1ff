"""What the best explanation leaves: the channel with the largest residual, the stage of the signal chain, the shape.

The stage follows from which channels carry the residual. Where the change of a position's residual is the integral of
the velocity's, the joint moved differently, or the encoder behind both is off; where only one of the two has it, that
sensor is off; where only the forces have it, the force sensor is off (or a contact that moves the joint by less than
its noise). A different motion may have any cause upstream in the chain, which the residual's shape narrows down.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.gap.analysis import locate, residual_shape
from tiago_mj.gap.analysis.regressors import Trajectory
from tiago_mj.gap.analysis.remainder import own_numbers
from tiago_mj.gap.analysis.residual_shape import Share
from tiago_mj.gap.decision.verdict import Judged
from tiago_mj.gap.inference import noise_model
from tiago_mj.gap.inference.noise_model import Data
from tiago_mj.gap.result import Place, ResidualShape
from tiago_mj.gap.search.state import Ranked
from tiago_mj.gap.simulation import phases
from tiago_mj.gap.simulation.plant import Plant
from tiago_mj.gap.simulation.replay import Grid, Signals
from tiago_mj.gap.simulation.session import Session
from tiago_mj.io.deadline import OutOfTimeError

Array = NDArray[np.float64]

#: Position and velocity are compared over this time [s], and at least so many rows.
OVER: Final = 0.1
ROWS: Final = 2
#: A change counts that is so many times what noise makes of it (mean squares).
LOUD: Final = 3.0
#: They agree where at least this share of the larger one's mean square is in both.
AGREE: Final = 0.5
#: Of position and velocity of one motion the position is told of, unless the velocity's shape explains so much more.
CLEARER: Final = 0.1
#: Forces alone have the residual where the motion has at most this share of it.
LITTLE: Final = 0.1
#: One reading alone has it where the other has at most this share of it.
ALONE: Final = 0.1
#: Stages that have such a residual of a motion, by its shape: of each there are effects that look so. What is
#: irregular may sit anywhere.
STAGES: Final[Mapping[str, tuple[str, ...]]] = {
    "offset": ("transmission", "body", "joint_sensor"),
    "drift": ("timing", "actuator", "joint_sensor"),
    "speed": ("timing", "command", "actuator", "transmission"),
    "acceleration": ("timing", "command", "transmission", "body"),
    "position": ("actuator", "transmission", "body", "joint_sensor"),
    "periodic": ("actuator", "transmission", "joint_sensor"),
    "direction": ("command", "transmission"),
    "place": ("transmission",),
    "reversal": ("command", "actuator", "transmission"),
    "jump": ("command", "actuator"),
    "touch": ("actuator", "transmission", "contact", "joint_sensor"),
    "force": ("actuator", "transmission", "contact", "joint_sensor"),
    "onset": ("actuator", "transmission", "contact"),
    "release": ("actuator", "transmission", "contact"),
    "frequency": ("actuator", "transmission", "body"),
}
#: The same by what has it, whatever its shape.
OF_READINGS: Final[Mapping[str, tuple[str, ...]]] = {
    "position": ("joint_sensor",),
    "velocity": ("joint_sensor",),
    "force": ("force_sensor",),
    "apart": ("timing", "joint_sensor"),
}


def by_the_best(
    session: Session, data: Data, ranked: Ranked, judged: Judged, nominal: Signals
) -> tuple[ResidualShape | None, str]:
    """Residual of the best explanation with its fitted nominal numbers, where that is a gap; or a sentence where there
    was no time.

    Args:
        session: the recordings.
        data: of all trials.
        ranked: explanations.
        judged: which of them stands.
        nominal: the nominal replay, one row a trial.
    """
    if judged.kind == "no_gap" or not (judged.remains or judged.kind == "unknown") or not ranked.complete:
        return None, ""
    best = ranked.fits[judged.rivals[0]]
    known = (*best.effects(), *own_numbers(session.plant, best))
    try:
        predicted = ranked.predict.all_trials([known], range(len(session.trials)))[0]
    except OutOfTimeError:
        return None, "The time budget left no time to say what the rest looks like."
    trials = [k for k in range(len(session.trials)) if k not in ranked.excluded]
    return unexplained(Replayed(session.plant, ranked.predict.on, nominal, trials), data, predicted), ""


def stage(shape: ResidualShape | None, where: tuple[Place, ...]) -> str | None:
    """Stage of the signal chain where no effect is named: from the residual, or else from the gap of the nominal
    model."""
    return locate.stage(where) if shape is None else shape.stage


@dataclass(frozen=True)
class Replayed:
    """Recordings as the nominal model replays them.

    Attributes:
        plant, on: what was replayed.
        nominal: of all trials, one row a trial.
        trials: indices of those that are looked at.
    """

    plant: Plant
    on: Grid
    nominal: Signals
    trials: list[int]


def unexplained(replayed: Replayed, data: Data, predicted: Array) -> ResidualShape | None:
    """Carrier, stages and shape of the residual in the channel with the largest one.

    Args:
        replayed: by the nominal model.
        data: measured, in all trials.
        predicted: with the best explanation, (ntrials, T, C).

    Returns:
        None where nothing was measured in them.
    """
    plant, nominal, index = replayed.plant, replayed.nominal, replayed.trials
    selected, predictions = noise_model.select_trials(data, index), predicted[index]
    residual = selected.value - predictions
    loud = loudness(selected, residual)
    if not len(loud) or not np.nanmax(loud, initial=0.0) > 0:
        return None
    worst = int(np.nanargmax(loud))
    said = carrier(selected, residual, worst, plant.period)

    def shares_of(channel: int) -> list[Share]:
        trajectory = _trajectory(replayed, selected, predictions, channel)
        return residual_shape.shares(residual[:, :, channel], trajectory, selected.sigma[:, :, channel])

    if said == "motion":
        worst, found = _clearer(selected, worst, shares_of)
    else:
        found = shares_of(worst)
    shape = residual_shape.named(found, len(index))
    second = next((one for one in found if one.shape != shape.shape and one.share > 0), None)
    return ResidualShape(
        channel=selected.channels[worst],
        stages=stages(said, shape.shape),
        carrier=said,
        name=shape.shape,
        share=min(shape.share, 1.0),
        runner_up=None if second is None else second.shape,
        runner_up_share=None if second is None else min(second.share, 1.0),
        at=None if shape.at is None else float(shape.at),
        unit=_unit(plant, selected, nominal, worst, shape.shape),
    )


def _clearer(data: Data, worst: int, shares_of: Callable[[int], list[Share]]) -> tuple[int, list[Share]]:
    """Of a joint's position and velocity, one of which has the largest residual, the channel with the clearer shape,
    and its shares."""
    name = data.channels[worst].partition(".")[2]
    position, velocity = (data.channels.index(f"{kind}.{name}") for kind in ("position", "velocity"))
    found = {channel: shares_of(channel) for channel in (position, velocity)}
    most = {channel: rows[0].share if rows else 0.0 for channel, rows in found.items()}
    chosen = velocity if most[velocity] > most[position] + CLEARER else position
    return chosen, found[chosen]


def loudness(data: Data, residual: Array) -> Array:
    """Mean square of the residuals, (ntrials, T, C), in units of noise and tolerance by channel, (C,); 0 where not
    measured."""
    seen = np.isfinite(residual)
    squares = np.where(seen, residual / data.sigma, 0.0) ** 2
    mean: Array = squares.sum(axis=(0, 1)) / np.maximum(seen.sum(axis=(0, 1)), 1)
    return mean


def carrier(data: Data, residual: Array, worst: int, period: float) -> str:
    """What carries the residual, one of :data:`tiago_mj.gap.result.CARRIERS`.

    Args:
        data: measured.
        residual: measured less predicted, (ntrials, T, C).
        worst: index of the channel that leaves most.
        period: of the rows [s].
    """
    kind, _, name = data.channels[worst].partition(".")
    if kind == "force":
        excess = np.maximum(loudness(data, residual) - 1, 0.0)
        motion = sum(float(e) for e, k in zip(excess, data.kinds, strict=True) if k != "force")
        return "force" if motion <= LITTLE * float(excess.sum()) else "both"
    both = [f"{one}.{name}" for one in ("position", "velocity")]
    if not set(both) <= set(data.channels):
        return "unclear"
    p, v = (data.channels.index(one) for one in both)
    return agreement(residual[:, :, p], residual[:, :, v], float(data.noise[p]), float(data.noise[v]), period)


def agreement(position: Array, velocity: Array, noise: float, speed_noise: float, period: float) -> str:
    """Whether the residuals of a joint's position and velocity are those of one motion: position the integral of
    velocity.

    Args:
        position, velocity: residuals, (ntrials, T) each [m, rad; per s]; NaN where nothing was measured.
        noise, speed_noise: one standard deviation of each one's noise.
        period: of the rows [s].

    Returns:
        ``motion`` where they do, ``position`` or ``velocity`` where that alone has it, ``apart`` where both have it and
        do not agree; else ``unclear``: both stand still, or one is too noisy to tell.
    """
    rows = max(round(OVER / period), ROWS)
    change = position[:, rows:] - position[:, :-rows]
    middle = (velocity[:, 1:] + velocity[:, :-1]) / 2
    summed = np.cumsum(np.pad(np.nan_to_num(middle), ((0, 0), (1, 0))), axis=1) * period
    integral = summed[:, rows:] - summed[:, :-rows]
    gaps = np.cumsum(np.pad(~np.isfinite(middle), ((0, 0), (1, 0))), axis=1)
    known = np.isfinite(change) & (gaps[:, rows:] == gaps[:, :-rows])
    if not known.any():
        return "unclear"
    by_noise = 2 * noise**2, rows * (period * speed_noise) ** 2
    moved, flowed = (float(np.mean(one[known] ** 2)) for one in (change, integral))
    apart = float(np.mean((change - integral)[known] ** 2)) - sum(by_noise)
    loud = moved > LOUD * by_noise[0], flowed > LOUD * by_noise[1]
    larger = max(moved - by_noise[0], flowed - by_noise[1])
    if not any(loud) or larger < LOUD * min(by_noise):
        return "unclear"
    if 1 - apart / larger >= AGREE:
        return "motion"
    if apart < LOUD * sum(by_noise):  # one is too noisy to tell
        return "unclear"
    if min(moved - by_noise[0], flowed - by_noise[1]) > ALONE * larger:
        return "apart"
    return "position" if moved - by_noise[0] > flowed - by_noise[1] else "velocity"


def stages(carried: str, shape: str) -> tuple[str, ...]:
    """Stages of the signal chain that can cause such a residual; empty: any.

    Args:
        carried: one of :data:`tiago_mj.gap.result.CARRIERS`.
        shape: one of :data:`tiago_mj.gap.result.SHAPES`.
    """
    if carried in OF_READINGS:
        return OF_READINGS[carried]
    found = STAGES.get(shape, ())
    return (*found, "force_sensor") if carried == "both" and found else found


def _trajectory(replayed: Replayed, data: Data, predicted: Array, channel: int) -> Trajectory:
    """Predicted motion and contact, and commands, belonging to a channel.

    Args:
        replayed: by the nominal model.
        data: of the trials that are looked at.
        predicted: of these, (ntrials, T, C).
        channel: index.
    """
    plant, on, nominal, trials = replayed.plant, replayed.on, replayed.nominal, replayed.trials
    length = predicted.shape[1]
    joint = _joint(plant, data, nominal, channel)
    name = plant.joints[joint]
    position, velocity = (_known(one[trials][:, :length, joint]) for one in (nominal.position, nominal.velocity))
    if f"position.{name}" in data.channels:
        position = predicted[:, :, data.channels.index(f"position.{name}")]
        velocity = np.gradient(position, axis=1) / plant.period
    if f"velocity.{name}" in data.channels:
        velocity = predicted[:, :, data.channels.index(f"velocity.{name}")]
    newtons = _known(nominal.newtons[trials][:, :length])
    touching = np.asarray(newtons > phases.CONTACT_NEWTONS)
    if data.kinds[channel] == "force":
        pad = int(data.part[channel])
        touched, force = touching[:, :, pad], predicted[:, :, channel]
    else:
        touched, force = np.asarray(touching.any(axis=2)), newtons.sum(axis=2)
    command = np.zeros_like(position)
    actuated = list(plant.wiring.targets.actuated)
    if joint in actuated:
        sent = _known(on.commands[trials][:, :, actuated.index(joint)])
        command = np.pad(sent, ((0, 0), (0, max(length - sent.shape[1], 0))), mode="edge")[:, :length]
    return Trajectory(position, velocity, command, touched, np.where(touched, force, 0.0), plant.period)


def _joint(plant: Plant, data: Data, nominal: Signals, channel: int) -> int:
    """Index of the joint of a channel; for a load cell the joint named after it, or else the fastest."""
    part = int(data.part[channel])
    if data.kinds[channel] != "force":
        return part
    named = [j for j, joint in enumerate(plant.joints) if f"_{plant.sensors[part]}_" in f"_{joint}_"]
    return named[0] if named else int(np.nan_to_num(np.abs(nominal.velocity)).max(axis=(0, 1)).argmax())


def _unit(plant: Plant, data: Data, nominal: Signals, channel: int, shape: str) -> str:
    """Unit of the frequency or period of a residual's shape; empty where it has neither."""
    if shape == "periodic":
        return "m" if plant.wiring.targets.slides[_joint(plant, data, nominal, channel)] else "rad"
    return "Hz" if shape == "frequency" else ""


def _known(values: Array) -> Array:
    """Values with NaN replaced by 0."""
    return np.asarray(np.nan_to_num(values))

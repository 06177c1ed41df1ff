"""Gains of servos as recordings, a command line or the model itself state them: known effects and their uncertainty."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import mujoco

from tiago_mj.effects import Effect, Entry
from tiago_mj.effects.actuator import ServoDamping, ServoStiffness
from tiago_mj.effects.now import Wiring
from tiago_mj.models import gains
from tiago_mj.models.gains import Gain, Gains
from tiago_mj.models.stated import text
from tiago_mj.recordings.recording import RecordingError, Trial


@dataclass(frozen=True)
class ServoGains:
    """What stated gains mean of a model.

    Attributes:
        given: effects that turn the model's gains into the stated ones.
        known: prior standard deviations of the gains, by (effect, actuator): of the logarithm of the stiffness'
            factor, and of the damping in its unit.
    """

    given: tuple[Entry, ...]
    known: Mapping[tuple[str, str | None], float]


def servo_gains(model: mujoco.MjModel, wiring: Wiring, trials: Sequence[Trial]) -> ServoGains:
    """Gains of the commanded position servos.

    Args:
        model: nominal.
        wiring: of the model.
        trials: of one robot; ``gains`` of their sidecars count more than the model's own text.

    Raises:
        RecordingError: what is said is no gain, of no position servo, or differs between trials; one line.
    """
    stated, of_model = _stated(trials), _of_model(model)
    servos = [k for k in range(len(wiring.targets.command)) if wiring.servo[k]]
    names = [wiring.targets.command[k] for k in servos]
    for who, _ in stated:
        if who is not None and who not in names:
            listed = ", ".join(names) or "none"
            raise RecordingError(f"{trials[0].source}: gains of {who}, which is no position servo: there are {listed}")
    given: list[Entry] = []
    known: dict[tuple[str, str | None], float] = {}
    for k, name in zip(servos, names, strict=True):
        stiffness = float(-model.actuator_biasprm[wiring.actuators[k], 1])
        damping = float(-model.actuator_biasprm[wiring.actuators[k], 2])
        kp, kv = (_gain(stated, of_model, name, gain) for gain in gains.GAINS)
        if kp.value is not None and kp.value != stiffness:
            if not kp.value:
                raise RecordingError(f"{trials[0].source}: kp of {name} is 0: a servo without stiffness holds nothing")
            given.append(_entry(ServoStiffness, name, kp.value / stiffness))
        if kv.value is not None and kv.value != damping:
            given.append(_entry(ServoDamping, name, kv.value - damping))
        if kp.known_to is not None:
            known[ServoStiffness.name, name] = kp.known_to
        size = damping if kv.value is None else kv.value
        if kv.known_to is not None and size:
            known[ServoDamping.name, name] = kv.known_to * size
    return ServoGains(tuple(given), known)


def _entry(declared: type[Effect], actuator: str, value: float) -> Entry:
    return Entry(declared.name, (actuator,), {next(iter(declared.parameters)): value})


def _gain(stated: Gains, of_model: Gains, actuator: str, name: str) -> Gain:
    """What counts: what is stated, of which the model's own text has the uncertainty where only it says one."""
    said, own = gains.of(stated, actuator, name), gains.of(of_model, actuator, name)
    if said is not None:
        return said
    return Gain(None, None if own is None else own.known_to)


def _stated(trials: Sequence[Trial]) -> Gains:
    said = trials[0].sidecar.raw.get("gains")
    for trial in trials:
        if trial.sidecar.raw.get("gains") != said:
            raise RecordingError(
                f"{trial.source}: gains in the sidecar are not those of {trials[0].source}: mend one of them, or "
                "diagnose them apart"
            )
    try:
        return {} if said is None else gains.parsed(said)
    except ValueError as fault:
        raise RecordingError(f"{trials[0].source}: {fault}") from None


def _of_model(model: mujoco.MjModel) -> Gains:
    """What a converted model says of its gains; nothing where its text is another's."""
    said = text(model, gains.TEXT)
    try:
        return {} if said is None else gains.parsed(said)
    except ValueError:
        return {}

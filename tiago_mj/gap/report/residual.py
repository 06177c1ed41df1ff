"""What is left looks like, in plain words, and what tells more of it."""

from __future__ import annotations

from typing import Final

from tiago_mj.gap.report import tables, words
from tiago_mj.gap.result import Diagnosis, ResidualShape

#: What a residual does that has a shape.
DOES: Final = {
    "offset": "is a constant offset",
    "drift": "drifts with time, within a trial or from one to the next",
    "speed": "rises with speed",
    "acceleration": "rises with acceleration",
    "position": "depends on the joint's position",
    "periodic": "repeats with the joint's position{at}",
    "direction": "depends on the direction of motion",
    "place": "depends on the joint's position and the direction of motion together",
    "reversal": "comes after reversals and fades",
    "jump": "comes after jumps of the set point and fades",
    "touch": "is there in contact and not without",
    "force": "rises with the contact force",
    "onset": "comes after contact begins and fades or grows from there",
    "release": "comes after contact ends and fades",
    "frequency": "swings at one frequency{at}",
}
#: The same as what it depends on.
ON: Final = {
    "offset": "a constant offset",
    "drift": "time",
    "speed": "speed",
    "acceleration": "acceleration",
    "position": "the joint's position",
    "periodic": "a periodic function of the joint's position",
    "direction": "the direction of motion",
    "place": "position and direction of motion together",
    "reversal": "reversals",
    "jump": "jumps of the set point",
    "touch": "contact",
    "force": "the contact force",
    "onset": "the beginning of contact",
    "release": "the end of contact",
    "frequency": "one frequency",
}
#: A share that is told; a smaller one would read 0 %.
SOMETHING: Final = 0.005
IRREGULAR: Final = (
    "has none of the shapes that are looked for (offset, drift, speed, acceleration, position, direction, reversals, "
    "jumps of the set point, contact, one frequency)"
)
#: What carries it.
CARRIED: Final = {
    "motion": "Position and velocity readings agree on it: the joint moves differently, or one encoder is off from "
    "which both come",
    "position": "The velocity reading hardly has it: the position reading is off, not the motion",
    "velocity": "The position reading hardly has it: the velocity reading is off, not the motion",
    "apart": "Position and velocity readings both have it, but not as one motion would: a reading or its time stamps "
    "are off, or it changes faster than the recordings are sampled",
    "force": "The motion hardly has it: the force reading is off, or a force that hardly moves the joint",
    "both": "Motion and force readings both have it",
    "unclear": "These recordings do not show whether the motion is off or its reading",
}
#: What tells more of a shape.
NEXT: Final = {
    "offset": (
        "Read the sensor at rest at places, or under weights, that you know: the offset of a reading is the same "
        "everywhere. Then turn the robot or the load around: a constant force changes sides, and a reading's offset "
        "stays."
    ),
    "drift": (
        "Record the same motion cold, warm, and again after a pause of some minutes: what comes of heat is smaller "
        "after the pause. What grows within every trial alike may be a clock that runs at another rate."
    ),
    "speed": (
        "Delays, lags, viscous friction and a servo's damping all rise with speed. Record steps with rests between "
        "them, of several sizes: after a delay all of the step comes later, with a lag or damping it begins in time "
        "and is slower. Switch the drive off and move the joint by hand: friction is still there."
    ),
    "acceleration": (
        "Record one motion slowly and fast, without and with a mass that you know: inertia that the model lacks grows "
        "with acceleration alone, and the known mass tells its scale."
    ),
    "position": (
        "Record slow strokes over the whole range in both directions: a spring, a cable or gravity pulls the same way "
        "at one place whichever way the joint moves, friction at that place turns round with the motion. An encoder's "
        "error shows against places that you can measure. Play looks like this, too, where gravity takes it up."
    ),
    "periodic": (
        "Record slow strokes over the whole range in both directions, and compare the period with the teeth of gears, "
        "the poles of the motor and the lines of the encoder."
    ),
    "direction": (
        "Record even strokes in both directions at several speeds, with rests: dry friction keeps its size at any "
        "speed, viscous friction grows with it. Play, and a dead band of the commands, show as a width of motion that "
        "does not depend on the force."
    ),
    "place": (
        "Record slow strokes over the whole range in both directions, and move the unpowered joint by hand: friction "
        "of one stretch of the way is felt there, and turns round with the motion."
    ),
    "reversal": (
        "Record small, slow strokes with reversals, some with a rest at the turn: play takes the same way each time, "
        "static friction the same force, and grows with the rest if it ages."
    ),
    "jump": (
        "Record steps of several sizes with rests between them: after a delay all steps come late by the same time, a "
        "limit of speed or force lasts the longer the larger the step is, and a lag fades in the same time for all."
    ),
    "touch": (
        "Record slow squeezes of one object whose size you have measured, and the same motion without it: what is "
        "there in contact alone is not of the joint."
    ),
    "force": (
        "Record slow squeezes to several forces, and put known weights on the load cell: an error of the cell is there "
        "under the weights, too, one of pad or object is not."
    ),
    "onset": (
        "Record touches at several speeds, each with a long hold: an impact grows with the speed and is over soon, "
        "creep goes on while nothing moves."
    ),
    "release": (
        "Record releases, slow and fast, after short and long holds: what clings grows with the hold, a delay of the "
        "reading does not."
    ),
    "frequency": (
        "Record at rest with the drives on and with them off, and once at another rate: hum on the lines is there at "
        "rest, a resonance only after motion, and a faster oscillation that the rate folds down moves to another "
        "frequency."
    ),
    "irregular": (
        "Record one motion several times without a change: what comes again each time follows from the motion, the "
        "rest is chance, such as lost commands, an object that slips, or noise of another size."
    ),
}
#: A runner-up is told that explains so much, and hardly told from the first if it explains as much up to this.
TOLD: Final = 0.1
CLOSE: Final = 0.1


def sentences(diagnosis: Diagnosis) -> str:
    """What is left looks like, and where in the chain it sits; empty where that is not known."""
    shape = diagnosis.residual_shape
    if shape is None:
        return ""
    return " ".join((_looks(shape), _sits(shape)))


def stages(diagnosis: Diagnosis) -> tuple[str, ...]:
    """Of the signal chain, those that are told: one, or of what is unknown those that what is left may come from."""
    if diagnosis.stage is not None:
        return (diagnosis.stage,)
    if diagnosis.residual_shape is None or diagnosis.kind != "unknown":
        return ()
    return diagnosis.residual_shape.stages


def next_record(diagnosis: Diagnosis) -> str:
    """What to record that tells more of it; empty where no shape is known."""
    return "" if diagnosis.residual_shape is None else NEXT.get(diagnosis.residual_shape.name, "")


def _looks(shape: ResidualShape) -> str:
    left = f"What is left of {words.channel(shape.channel)}"
    if shape.name not in DOES:
        best = f", {ON[shape.runner_up]}," if shape.runner_up in ON else ""
        most = f"the best of them{best} explains {words.percent(shape.share)} of it"
        return f"{left} {IRREGULAR}: {most if shape.share >= SOMETHING else 'none of them explains any of it'}."
    said = f"{left} {DOES[shape.name].format(at=_at(shape))}: that explains {words.percent(shape.share)} of it"
    if shape.runner_up is None or shape.runner_up_share is None or shape.runner_up_share < TOLD:
        return f"{said}."
    other, much = ON.get(shape.runner_up, shape.runner_up), words.percent(shape.runner_up_share)
    if shape.runner_up_share > shape.share - CLOSE:
        return f"{said}, which these recordings can hardly distinguish from {other} ({much})."
    return f"{said}, {other} {much}."


def _at(shape: ResidualShape) -> str:
    """Its frequency or period."""
    if shape.at is None:
        return ""
    return f", {'every ' if shape.name == 'periodic' else ''}{words.quantity(shape.at, shape.unit)}"


def _sits(shape: ResidualShape) -> str:
    carried = CARRIED.get(shape.carrier, CARRIED["unclear"])
    if not shape.stages:
        return f"{carried}. Its stage in the signal chain stays open."
    names = words.listed([tables.STAGE_NAMES.get(stage, stage) for stage in shape.stages], "or")
    if shape.stage is not None:
        return f"{carried}. That points to the stage “{names}”."
    return f"{carried}. Such a residual may come from the stages {names}."

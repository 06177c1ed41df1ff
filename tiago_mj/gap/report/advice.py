"""What to do now, by verdict: what to run, what to record, where to look on the robot."""

from __future__ import annotations

import math
import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from tiago_mj.effects import EFFECTS, describe
from tiago_mj.effects.declare import STAGES
from tiago_mj.gap.report import commands, residual, verdict, words
from tiago_mj.gap.report.consistency import repairs
from tiago_mj.gap.result import Diagnosis, Explanation, Named, Place
from tiago_mj.io import extra
from tiago_mj.io.progress import seconds
from tiago_mj.models import names

#: Motion of the menu that shows most of what a stage of the signal chain may have, of fingers and of the arm.
MOTIONS: Final = {
    "timing": ("steps_free", "arm_wrist"),
    "command": ("stop_and_go", "arm_wrist"),
    "actuator": ("chirp_free", "arm_multisine"),
    "transmission": ("free_reversals_slow", "arm_reversals_slow"),
    "contact": ("squeeze_slow", ""),
    "body": ("shift", "arm_lift"),
    "joint_sensor": ("free_sweep", "arm_multisine"),
    "force_sensor": ("ramp_slow", ""),
}
#: Stage whose motion shows a shape of what is left, where that is clearer than the stage that is told.
BY_SHAPE: Final = {
    **dict.fromkeys(("speed", "jump"), "command"),
    **dict.fromkeys(("position", "periodic"), "joint_sensor"),
    **dict.fromkeys(("direction", "place", "reversal"), "transmission"),
    **dict.fromkeys(("touch", "onset", "release"), "contact"),
    "acceleration": "actuator",
    "force": "force_sensor",
}
#: Where no stage is told.
ANY: Final = ("multisine_free", "arm_multisine")
#: The same for a robot of one's own, which has no menu, in words.
BY_HAND: Final = {
    "timing": "fast steps with rests between them",
    "command": "fast steps with rests between them",
    "actuator": "a swing that grows faster from slow to as fast as is safe",
    "transmission": "slow and even strokes to and fro, with reversals",
    "contact": "slow squeezes of one object",
    "body": "slow strokes through poses in which gravity pulls differently, with and without the tool",
    "joint_sensor": "one slow stroke over the whole range, with rests at places that you can measure",
    "force_sensor": "a grip that rises slowly, holds and falls again",
}
ANY_BY_HAND: Final = "one joint at a time: slow strokes, then fast ones, with rests between them"
#: What to look at where the cause is unknown and only the stage of the signal chain is told.
LOOK: Final = {
    "timing": "compare the clocks that stamp commands and measurements, and look for rows that came late.",
    "command": "compare what was sent with what the driver received: delays, filters, limits, lost messages.",
    "actuator": "compare the driver's gains, limits and supply with the model's.",
    "transmission": "move the unpowered joint by hand: does it rub, stick, give or have play?",
    "contact": "look at pads and object, measure the object, and see whether it slips or tips.",
    "body": "weigh what the robot carries, and put a spirit level on its base.",
    "joint_sensor": "move the joint by a known amount and compare it with what is read.",
    "force_sensor": "put known weights on the load cell and compare them with what is read.",
}
ALONG: Final = (
    "Compare, one after another, what was sent, what the driver received, what the joint did and what was logged."
)
#: The same where not even the stage is told, by kind of the channel that holds most of the gap.
BY_CHANNEL: Final = {"force": "force_sensor", "effort": "transmission"}
#: Units of a magnitude that a joint's limit can be compared with.
FORCES: Final = ("N", "N·m")
#: What training needs.
EXTRA: Final = "for which the extra `train` is needed"
#: Explanations whose places on the robot are told.
TOLD: Final = 3


@dataclass(frozen=True)
class Step:
    """One thing to do.

    Attributes:
        title: in a few words.
        said: sentences, code in backticks.
        install: what ``command`` needs first, run once in the clone; empty: nothing.
        command: to be run in a shell; empty: none.
        code: Python that does the same or the rest; empty: none.
        places: (what is there, where to look) on the robot.
        link: (target, text) of where more is; None: nowhere.
    """

    title: str
    said: str = ""
    install: str = ""
    command: str = ""
    code: str = ""
    places: tuple[tuple[str, str], ...] = ()
    link: tuple[str, str] | None = None


def advice(diagnosis: Diagnosis) -> tuple[Step, ...]:
    """What to do now, the first thing first."""
    kind = diagnosis.kind
    if not diagnosis.complete:
        return (*go_on(diagnosis), *_look(diagnosis, (diagnosis.best,), "Look at what leads so far"))
    if kind == "no_gap":
        repair = _simulate(diagnosis, "Use") if repairs(diagnosis.shrink) else ()
        return (*(repair or (_use_as_it_is(diagnosis),)), *_not_excited(diagnosis))
    if kind == "ambiguous":
        choices = diagnosis.alternatives or (diagnosis.best,)
        title = "Look on the robot, which may decide it sooner"
        return (_record_next(diagnosis), *_look(diagnosis, choices, title), *_simulate(diagnosis, "Until then, use"))
    if kind == "unknown" or not diagnosis.best.effects:
        known = _look(diagnosis, (diagnosis.best,), "Look at what is known already")
        return (_look_by_stage(diagnosis), *_by_shape(diagnosis), _record_more(diagnosis), *known, _declare())
    look = _look(diagnosis, (diagnosis.best,), "Look on the robot, if you would rather mend it")
    if repairs(diagnosis.shrink) is False:  # what predicts no better is nothing to train in
        return (*look, *_by_shape(diagnosis), _record_more(diagnosis))
    return (*_simulate(diagnosis, "Use"), *look, *_by_shape(diagnosis))


def to_record(diagnosis: Diagnosis) -> str:
    """What to record after this answer, in a line; empty where a whole answer has to come first."""
    kind = diagnosis.kind
    if not diagnosis.complete:
        return ""
    if kind == "no_gap":
        return "motions faster, firmer or longer than these, if those matter to you: a gap may show in them alone"
    if kind == "ambiguous":
        return diagnosis.next_motion.file if diagnosis.next_motion else next(filter(None, _alone(diagnosis)))
    if kind == "unknown" or repairs(diagnosis.shrink) is False:
        return next(filter(None, _alone(diagnosis)))
    return "the same motions once it is mended, when the effect should be gone; or others, to see that the repair holds"


def go_on(diagnosis: Diagnosis) -> tuple[Step, ...]:
    """How to have the whole answer where a search did not come to its end; empty where it did."""
    stopped = diagnosis.stopped
    if stopped is None:
        return ()
    if stopped.why == "fault":
        said = "The same command ends the same way. Please report it with the sentence on the fault."
        return (Step("Report the fault", said, command=commands.again(diagnosis)),)
    if stopped.needs is None:
        budget = _rounded_up(2 * stopped.seconds)
        known = "How long the whole search takes is not known yet"
    else:
        budget = _rounded_up(stopped.needs)
        known = f"The whole search takes at most about {seconds(budget)} at the speed of this one"
    kept = "What is done is kept, and with `--resume` the search goes on from there:"
    if stopped.why == "interrupted":
        return (Step("Let the search come to its end", f"{known}. {kept}", command=commands.go_on(diagnosis, None)),)
    said = f"{known}: give `--time-budget {budget}`, or none. {kept}"
    return (Step("Give the search more time", said, command=commands.go_on(diagnosis, budget)),)


def _rounded_up(amount: float) -> int:
    """To two digits, as far as they count seconds."""
    amount = max(amount, 1.0)
    unit = 10 ** max(math.floor(math.log10(amount)) - 1, 0)
    return unit * math.ceil(amount / unit)


def on_robot(diagnosis: Diagnosis, effect: Named) -> tuple[str, str]:
    """What an effect is on the robot, with its share of what the joint can give where that is known, and where to look
    for it."""
    declared = EFFECTS.get(effect.name)
    check = describe(declared).check if declared else ""
    share = _share(diagnosis, effect)
    return words.begin(words.clause(effect)) + (f": {share}." if share else "."), words.begin(check)


def _share(diagnosis: Diagnosis, effect: Named) -> str:
    """A force as a share of the limits of its joints; empty where it is none, or the model has no limit."""
    first = next(iter(effect.parameters.values()), None)
    if first is None or first.unit not in FORCES or not math.isfinite(first.value):
        return ""
    declared = EFFECTS.get(effect.name)
    limits = [
        limit
        for name, limit in diagnosis.limits.get(declared.targets if declared else "", {}).items()
        if effect.targets is None or name in effect.targets
        if math.isfinite(limit) and limit > 0
    ]
    if not limits:
        return ""
    what = "force" if first.unit == "N" else "torque"
    low, high = (words.percent(abs(first.value) / limit) for limit in (max(limits), min(limits)))
    if low == high:
        return f"{low} of the largest {what} that {'each drive' if len(limits) > 1 else 'its drive'} gives in the model"
    return f"{low} to {high} of the largest {what} that the drives give in the model"


def _look(diagnosis: Diagnosis, explanations: Sequence[Explanation], title: str) -> tuple[Step, ...]:
    effects = {(effect.name, effect.target): effect for one in explanations[:TOLD] for effect in one.effects}
    places = tuple(on_robot(diagnosis, effect) for effect in effects.values())
    if not places:
        return ()
    mended = (
        "Once it is mended, record the same motions again: the effect should be gone."
        if diagnosis.kind == "effect"
        else ""
    )
    return (Step(title, mended, places=places),)


def _simulate(diagnosis: Diagnosis, use: str) -> tuple[Step, ...]:
    if not diagnosis.repair:
        return ()
    sure = diagnosis.kind in ("effect", "no_gap")
    which = "the repaired simulator" if sure else f"the {verdict.first(diagnosis)} repair"
    model = diagnosis.repaired
    if model is None and commands.is_model(diagnosis):
        return ()
    calibration = commands.beside(diagnosis, "calibration.yaml")
    if model is None:
        return (
            Step(
                f"{use} {which}",
                f"Make it in Python, or train in it, {EXTRA}{commands.where_to(diagnosis)}:",
                install=extra.in_clone("train"),
                command=commands.train(diagnosis, calibration),
                code=commands.make(diagnosis),
            ),
        )
    whole = commands.apply_to_model(diagnosis)
    if not (model.xml and (model.holds or model.numbers)):  # a file that is as before repairs nothing
        return (Step(f"{use} {which}", verdict.on_model(diagnosis), code=whole),)
    watch = f"python -m mujoco.viewer --mjcf={shlex.quote(commands.beside(diagnosis, 'repaired.xml'))}"
    return (Step(f"{use} {which}", verdict.on_model(diagnosis), command=watch, code=whole),)


def _use_as_it_is(diagnosis: Diagnosis) -> Step:
    said = "For motions like the recorded ones the simulator may be used as it is"
    if commands.is_model(diagnosis):
        return Step("Use the simulator as it is", f"{said}: nothing in the model needs to be changed.")
    given = commands.beside(diagnosis, "calibration.yaml") if diagnosis.given else ""
    if given:
        said = "For motions like the recorded ones the simulator may be used with the effects that were given"
    said = f"{said}, for training, say, {EXTRA}{commands.where_to(diagnosis) if given else ''}:"
    command = commands.train(diagnosis, given)
    return Step("Use the simulator as it is", said, install=extra.in_clone("train"), command=command)


def _not_excited(diagnosis: Diagnosis) -> tuple[Step, ...]:
    count = len(diagnosis.not_excited)
    if not count:
        return ()
    effects = "1 effect" if count == 1 else f"{count} effects"
    said = f"These motions could not have shown {effects}. Before faster, firmer or longer motions, record those, too."
    return (Step("Know what was not tested", said, link=("#not-excited", "which they are")),)


def _record_next(diagnosis: Diagnosis) -> Step:
    motion = diagnosis.next_motion
    again = "Diagnose old and new recordings together."
    if motion is None:
        other = _motion(diagnosis, _stage_of(diagnosis))
        said = "No motion of the menu was found that would decide."
        if commands.is_model(diagnosis) or not other:
            said = f"A motion that shows more: {BY_HAND.get(_stage_of(diagnosis), ANY_BY_HAND)}."
            return Step("Record another motion", f"{said} {again}")
        return Step(
            "Record another motion", f"{said} This one shows more: {again}", command=commands.record(diagnosis, other)
        )
    pairs = words.listed([f"{words.title(a)} from {words.title(b)}" for a, b in motion.resolves])
    tells = f" distinguishes {pairs} best:" if pairs else " is the best:"
    chance = words.percent(motion.expected_probability)
    said = (
        f"Of the safe motions `{motion.file}`{tells} one recording of it decides with a chance of {chance}. Record it "
        f"on the real robot about three times, as `docs/motions.md` says. {again} Of a simulated robot this records it:"
    )
    return Step("Record this motion next", said, command=commands.record(diagnosis, motion.file))


def _record_more(diagnosis: Diagnosis) -> Step:
    after = "One cause at a time is easier to see. Diagnose old and new recordings together."
    name, by_hand = _alone(diagnosis)
    if not name:
        return Step("Record a motion that shows it alone", f"{words.begin(by_hand)}. {after}")
    said = f"`{name}` is a safe motion for that (`docs/motions.md`). {after} Of a simulated robot this records it:"
    return Step("Record a motion that shows it alone", said, command=commands.record(diagnosis, name))


def _alone(diagnosis: Diagnosis) -> tuple[str, str]:
    """A motion of the menu that shows what is left by itself, empty for a robot of one's own; and in words."""
    shape = diagnosis.residual_shape
    stage = BY_SHAPE.get("" if shape is None else shape.name, _stage_of(diagnosis))
    return "" if commands.is_model(diagnosis) else _motion(diagnosis, stage), BY_HAND.get(stage, ANY_BY_HAND)


def _look_by_stage(diagnosis: Diagnosis) -> Step:
    stage = _stage_of(diagnosis)
    place = verdict.main_place(diagnosis.remains_where or diagnosis.where)
    where = f"Most of it lies in {place}. " if place else ""
    look = words.begin(LOOK[stage]) if stage in LOOK else ALONG
    link = ("#signals", "the signals") if diagnosis.overlays else None
    return Step("Look where the gap is", f"{where}{look}", link=link)


def _by_shape(diagnosis: Diagnosis) -> tuple[Step, ...]:
    """What tells more of what is left, by its shape."""
    said = residual.next_record(diagnosis)
    return (Step("Find out what the rest depends on", said),) if said else ()


def _declare() -> Step:
    said = (
        "A cause that the library lacks takes 15 lines (`docs/tutorials/add-an-effect.md`). The next diagnosis tries "
        "it with the others."
    )
    return Step("Have a suspicion? Declare it as an effect", said)


def _stage_of(diagnosis: Diagnosis) -> str:
    """The stage that is told, else the likeliest by the channel with most of the gap, unless it is none of those that
    are told; empty: none."""
    if diagnosis.stage in STAGES:
        return str(diagnosis.stage)
    kind = _loudest(diagnosis.remains_where or diagnosis.where).partition(".")[0]
    found, told = BY_CHANNEL.get(kind, ""), residual.stages(diagnosis)
    return found if not told or found in told else ""


def _loudest(places: Sequence[Place]) -> str:
    by: dict[str, float] = {}
    for place in places:
        by[place.channel] = by.get(place.channel, 0.0) + place.share
    return max(by, key=lambda name: by[name], default="")


def _motion(diagnosis: Diagnosis, stage: str) -> str:
    """A motion of the menu for a robot of the library; empty where it has none."""
    fingers = any(place.channel.endswith((*names.FINGERS, *names.SIDES)) for place in diagnosis.where)
    loudest = _loudest(diagnosis.remains_where or diagnosis.where)
    arm = loudest.partition(".")[2].startswith(("arm_", "torso_"))
    if not fingers and not arm:
        return ""
    return MOTIONS.get(stage, ANY)[1 if arm else 0]

"""The search on each of a robot's like parts by itself: legs on a base that is held move each other by nothing.

Torques of one leg do not depend on the other legs' motion, masses or friction where no joint that moves is between
them. What is found of each is then put together, with what only the whole robot can have, and fitted to all of it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from tiago_mj.effects import EFFECTS
from tiago_mj.gap.inference import hypotheses
from tiago_mj.gap.inference.fit import Start
from tiago_mj.gap.inference.hypotheses import Candidate
from tiago_mj.gap.inference.noise_model import Data
from tiago_mj.gap.search import agreement, beginning, ranking, rounds, select, sharpen
from tiago_mj.gap.search.beside_readings import with_readings
from tiago_mj.gap.search.state import Question, Ranked, State, Tick
from tiago_mj.gap.torque.predictor import EffortPredictor
from tiago_mj.gap.torque.strips import Course
from tiago_mj.gap.torque.torques import Torques
from tiago_mj.io.deadline import Deadline
from tiago_mj.recordings.like import alike

Array = NDArray[np.float64]

#: Effects that are of one joint each.
OF_JOINTS: Final = ("joint", "command")


def apart(model: mujoco.MjModel, parts: Mapping[str, Mapping[str, str]]) -> bool:
    """Whether no joint of one part carries a joint of another one.

    Args:
        model: nominal.
        parts: joints by part.
    """
    of = {model.joint(name).id: part for part, mine in parts.items() for name in mine.values()}
    for joint, part in of.items():
        body = int(model.jnt_bodyid[joint])
        while body:
            body = int(model.body_parentid[body])
            first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
            above = range(first, first + count) if count else ()
            if any(of.get(other, part) != part for other in above):
                return False
    return True


def searched(asked: Question, said: Sequence[str], deadline: Deadline, landing: float, tick: Tick) -> Ranked | None:
    """Explanations of a robot whose parts were searched one by one; None where they cannot be taken apart.

    Args:
        asked: of the whole robot, whose efforts are compared along its motion.
        said: what the names of the parts begin with.
        deadline, landing, tick: as of :func:`tiago_mj.gap.search.select.select`.
    """
    predict = asked.predict
    if not isinstance(predict, EffortPredictor):
        return None
    targets = predict.plant.wiring.targets
    parts = alike(targets.joint, said)
    if not apart(predict.plant.model, parts):
        return None
    found: dict[str, Ranked] = {}
    for part, joints in parts.items():
        question = _of_part(asked, predict, tuple(joints.values()))
        found[part] = select.select(question, deadline=deadline, landing=landing, tick=tick)
    return _together(asked, found, parts, lambda: deadline.over(landing))


def _of_part(asked: Question, predict: EffortPredictor, joints: tuple[str, ...]) -> Question:
    """The question of some joints alone."""
    fewer = of_joints(predict, joints)
    targets = fewer.plant.wiring.targets
    mine = {*targets.joint, *targets.command}
    pool = [
        c
        for c in asked.pool
        if EFFECTS[c.effect].targets in OF_JOINTS and not EFFECTS[c.effect].common and set(c.target or ()) <= mine
    ]
    columns = [k for k, name in enumerate(predict.data.channels) if name.partition(".")[2] in joints]
    return replace(
        asked,
        predict=fewer,
        data=_channels(asked.data, columns, fewer.torques[0].course),
        assumed=None if asked.assumed is None else _channels(asked.assumed, columns, fewer.torques[0].course),
        pool=pool,
        terms=hypotheses.terms(fewer.plant),
        base=fewer.all_trials([()], asked.trials)[0],
    )


def of_joints(predict: EffortPredictor, joints: Sequence[str]) -> EffortPredictor:
    """The same efforts of some joints, along their own motion; the others stay where the model has them."""
    plant = predict.plant

    def fewer(one: Torques) -> Torques:
        return Torques(plant.model, _course(one.course, joints), plant.given, predict.deadline)

    torques = tuple(fewer(one) for one in predict.torques)
    columns = [k for k, name in enumerate(predict.data.channels) if name.partition(".")[2] in joints]
    kept = [k for k, name in enumerate(predict.torques[0].course.joints) if name in joints]
    largest = tuple(plant.largest_effort[k] for k in kept) if plant.largest_effort else ()
    return replace(
        predict,
        plant=replace(plant, wiring=torques[0].wiring, largest_effort=largest),
        data=_channels(predict.data, columns, torques[0].course),
        torques=torques,
        whole=None if predict.whole is None else fewer(predict.whole),
        tally=Counter(),
        _known={},
    )


def _course(course: Course, joints: Sequence[str]) -> Course:
    kept = [k for k, name in enumerate(course.joints) if name in joints]
    read = [k for k, name in enumerate(course.channels) if name in joints]
    strips = tuple(
        replace(
            strip,
            position=strip.position[:, kept],
            velocity=strip.velocity[:, kept],
            acceleration=strip.acceleration[:, kept],
            effort=strip.effort[:, read],
            noise=strip.noise[read],
        )
        for strip in course.strips
    )
    return replace(
        course,
        joints=tuple(course.joints[k] for k in kept),
        channels=tuple(course.channels[k] for k in read),
        strips=strips,
        rest_speed=course.rest_speed[kept],
        noise=course.noise[kept],
    )


def _channels(data: Data, columns: Sequence[int], course: Course) -> Data:
    """Some channels of what was measured."""
    kept = list(columns)

    def some(one: Array | None) -> Array | None:
        return None if one is None else one[..., kept]

    pairs = (None if two is None else (two[0][..., kept], two[1][..., kept]) for two in (data.stepless, data.assumed))
    stepless, assumed = pairs
    return replace(
        data,
        channels=tuple(data.channels[k] for k in kept),
        part=np.array(course.columns, dtype=int),
        value=data.value[..., kept],
        noise=data.noise[kept],
        sigma=data.sigma[..., kept],
        common=data.common[..., kept],
        step=some(data.step),
        least=some(data.least),
        stepless=stepless,
        assumed=assumed,
    )


def _together(
    asked: Question, found: Mapping[str, Ranked], parts: Mapping[str, Mapping[str, str]], over: Callable[[], bool]
) -> Ranked:
    """The best explanations of the parts as one of the whole robot, with and without what only the whole can have."""
    full, shared = beginning.fitter(asked, over)
    excluded = tuple(sorted({trial for one in found.values() for trial in one.excluded}))
    kept = [k for k, trial in enumerate(full.trials) if trial not in excluded]
    first = full = full.part(kept or range(len(full.trials)))
    state = beginning.with_nominal(full, asked.first_trials)
    targets = asked.predict.plant.wiring.targets
    mine: list[Candidate] = []
    values: list[float] = []
    for part, one in found.items():
        best = one.fits[0]
        for candidate, value in zip(best.parts, best.values, strict=True):
            every = alike(targets.names(EFFECTS[candidate.effect].targets), list(parts))[part]
            mine.append(candidate if candidate.target else replace(candidate, target=tuple(every.values())))
            values.append(float(value))
    if mine:
        state = state.with_fits(state.full.fit_all([Start(tuple(mine), np.array(values))]))
        state = _reduced(sharpen.sharpened(state))
    state = state if over() else _of_the_whole(state, asked)
    shown = ranking.reportable(ranking.unique_by_labels(state.fits), replays=False)
    shown = sharpen.misfits_by(first, state.full, agreement.with_agreement(state.full, shown))
    searches = list(found.values())
    unseen = [name for name in searches[0].not_excited if all(name in one.not_excited for one in searches)]
    complete, ended = all(one.complete for one in searches), [one.ended for one in searches if one.ended is not None]
    return Ranked(
        tuple(with_readings(fit, asked.known, shared) for fit in shown),
        tuple(unseen),
        len(asked.known),
        len({candidate.effect for candidate in asked.pool}),
        complete,
        state.full.weight,
        state.full.predict,
        excluded,
        ended[0] if ended else None,
    )


def _reduced(state: State) -> State:
    """With the best explanation without magnitudes that are close to none."""
    best = state.best
    least = ranking.least_deviations(replays=False)
    needed = [k for k in range(len(best.parts)) if ranking.differs_from_identity(best, k, least)]
    fewer = rounds.reduced_to(best, needed)
    return state if fewer is None else state.with_fits(state.full.fit_all([fewer]))


def _of_the_whole(state: State, asked: Question) -> State:
    """With effects that no part has alone, such as of a clock or of gravity, beside the best explanation."""
    best = state.best
    whole = [c for c in asked.pool if EFFECTS[c.effect].targets not in OF_JOINTS or EFFECTS[c.effect].common]
    begin = [
        Start((*best.parts, c), np.append(best.values, value), best.nuisance)
        for c in whole
        if c.target is None and c.effect not in {part.effect for part in best.parts}
        for value in c.grid[:: max(len(c.grid) - 1, 1)]
    ]
    return state.with_fits(state.full.fit_all(begin)) if begin else state

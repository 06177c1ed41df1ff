"""Work of a diagnosis that an earlier run has finished, taken from its journal.

A diagnosis is one deterministic loop. The same command goes through it again, and what costs time (fits, scans,
decoding) is looked up by a digest of what it depends on: its arguments, how simulations are corrected, and how many
were asked for before, which says where in the loop it is. What a unit of work counts and warns of is kept with its
result, so that whatever follows finds everything as if the work had been done.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any, Final, TypeVar

from tiago_mj.gap.inference.hypotheses import Candidate
from tiago_mj.gap.inference.points import Fitted, Start
from tiago_mj.gap.inference.predictor import REPEATED, Predictor
from tiago_mj.io import mujoco_log
from tiago_mj.io.journal import digest, packed, unpacked

T = TypeVar("T")

#: Dataclasses that results are made of.
CLASSES: Final = {one.__name__: one for one in (Candidate, Fitted, Start)}


def remembered(
    predict: Predictor, work: Callable[[], T], depends_on: Sequence[Any], out_of_time: Callable[[], bool]
) -> T:
    """The result of a unit of work, from the predictor's journal or else computed.

    Nothing is kept of what the clock may have cut short, and of what makes the predictor remember physics, since later
    simulations depend on that.

    Args:
        predict: simulations that the work makes.
        work: computes the result.
        depends_on: what tells it from other work, the name of it first.
        out_of_time: whether the search is over; once it is, it stays so.
    """
    journal = predict.journal
    if journal.path is None:
        return work()
    on, before = predict.on.delivered, Counter(predict.tally)
    how = (type(predict).__name__, predict.plant.joints, predict.plant.given, predict.corrected, predict.between)
    key = digest((*how, on, sorted(before.items()), tuple(depends_on)))
    unit = journal.found.get(key)
    if unit is None:
        kept, asked = predict.samples_kept, len(predict.made.asked)
        with mujoco_log.counted() as warned:
            found = packed(work())
        counts = {name: count - before[name] for name, count in predict.tally.items()}
        simulations = predict.made.asked[asked:]
        unit = {"counts": counts, "warned": dict(warned), "result": found, "simulations": simulations}
        if predict.samples_kept == kept and not out_of_time():
            journal.add(key, unit)
    else:
        predict.tally.update(unit["counts"])
        predict.made.replay([(name, size) for name, size in unit["simulations"]])
        counts = Counter(unit["counts"])
        predict.simulated(counts["physics_steps"] - counts[REPEATED["physics_steps"]])
    mujoco_log.tell(unit["warned"])
    result: T = unpacked(unit["result"], CLASSES)
    return result

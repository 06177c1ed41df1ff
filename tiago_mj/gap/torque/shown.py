"""Which candidates a comparison of efforts along a motion can show."""

from __future__ import annotations

import math
from collections.abc import Sequence

from tiago_mj.effects import EFFECTS, Effect, Entry
from tiago_mj.effects.declare import overrides
from tiago_mj.effects.spec import arrays
from tiago_mj.gap.inference.hypotheses import Candidate
from tiago_mj.gap.torque.torques import STAGES, Torques, invertible
from tiago_mj.recordings.recording import RecordingError, Trial


def shown(pool: Sequence[Candidate], torques: Sequence[Torques]) -> tuple[Candidate, ...]:
    """Candidates that change what a motion needs, or what is read of it, on joints whose efforts are compared.

    What acts on one joint's motor is seen at that joint alone; masses and wrong positions are seen at others, too.

    Args:
        pool: candidates of the plant.
        torques: along the motions of all trials.
    """
    found = []
    for candidate in pool:
        declared = EFFECTS[candidate.effect]
        if not _may_show(declared) or not _can_be_undone(declared, candidate, torques):
            continue
        anywhere = candidate.target is None or declared.stage in ("body", "joint_sensor")
        if anywhere or set(candidate.target or ()) <= _compared(declared, torques[0]):
            found.append(candidate)
    return tuple(found)


def may_show(effect: str) -> bool:
    """Whether an effect of that name may show in efforts along a motion, on some robot."""
    return _may_show(EFFECTS[effect])


def check_given(trials: Sequence[Trial], given: Sequence[Entry]) -> None:
    """Refuse what is said of the log of efforts itself: along a motion it is the log that has to be put right.

    Raises:
        RecordingError: one line.
    """
    for entry in given:
        if _on_the_log(EFFECTS[entry.name]):
            raise RecordingError(
                f"{trials[0].source}: {entry.name} cannot be given where efforts are explained along a motion: put "
                "the log right (--map with scale, or the time of its rows), and take it out of --effects"
            )


def _on_the_log(declared: type[Effect]) -> bool:
    return bool(declared.delays_readings) or overrides(declared, "measure_effort")


def _may_show(declared: type[Effect]) -> bool:
    """Whether an effect has a strength that a motion can be searched for; limits and play need a command."""
    strengths = [p for p in declared.parameters.values() if p.identity is not None]
    if not declared.nameable:
        return False
    if len(strengths) != 1 or not math.isfinite(strengths[0].identity or 0.0):
        return False
    return _on_the_log(declared) or (declared.stage in STAGES and declared.targets not in ("sensor", "clock"))


def _compared(declared: type[Effect], torques: Torques) -> set[str]:
    """Targets of an effect at the joints whose efforts are compared."""
    course, targets = torques.course, torques.wiring.targets
    if declared.targets != "command":
        return set(course.channels)
    return {
        name for name, j in zip(targets.command, targets.actuated, strict=True) if course.joints[j] in course.channels
    }


def _can_be_undone(declared: type[Effect], candidate: Candidate, torques: Sequence[Torques]) -> bool:
    """Whether true positions follow from readings that have the effect, where it changes these."""
    if not overrides(declared, "measure_position") or _on_the_log(declared):
        return True
    entry = candidate.entry(candidate.grid[-1])
    for one in torques:
        effect = arrays(declared, [[entry]], one.wiring.targets)
        if not invertible(effect, one.course.stack("position"), one.along):
            return False
    return True

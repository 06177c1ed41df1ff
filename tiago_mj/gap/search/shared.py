"""Candidates that like parts share: one magnitude on the same joint of every part, such as on all knees."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

from tiago_mj.effects import EFFECTS
from tiago_mj.effects.targets import Targets
from tiago_mj.gap.detectors.readings import MEASURES
from tiago_mj.gap.inference.hypotheses import Candidate
from tiago_mj.recordings.like import alike, prefixes
from tiago_mj.recordings.like import tied as is_tied
from tiago_mj.recordings.recording import Trial

#: Targets that a part has several of.
KINDS = ("joint", "command")


def of_like_parts(
    pool: Sequence[Candidate], targets: Targets, trials: Sequence[Trial], *, replays: bool
) -> tuple[Candidate, ...]:
    """The pool with what like parts share, where the recordings say that some are alike.

    Args:
        pool: candidates, on all targets or on one.
        targets: of the robot.
        trials: whose sidecars say which parts are alike, and whether they are tied.
        replays: whether commands are replayed; of efforts along a motion each part is searched by itself.

    Raises:
        RecordingError: they are no like parts; one line.
    """
    said = prefixes(trials)
    if is_tied(trials):
        return tied(pool, targets, said)
    return with_shared(pool, targets, said) if said and replays else tuple(pool)


def tied(pool: Sequence[Candidate], targets: Targets, said: Sequence[str]) -> tuple[Candidate, ...]:
    """The pool with one candidate for all parts in the place of one for each.

    Args:
        pool: candidates, on all targets or on one.
        targets: of the robot.
        said: what the names of the parts begin with.

    Raises:
        RecordingError: they are no like parts; one line.
    """
    shared = _by_place(pool, targets, said)
    gone = {id(one) for mine in shared for one in mine}
    return (*(one for one in pool if id(one) not in gone), *_new(shared, targets))


def with_shared(pool: Sequence[Candidate], targets: Targets, said: Sequence[str]) -> tuple[Candidate, ...]:
    """The pool, and beside each part's candidates one for all parts; arguments as of :func:`tied`."""
    return (*pool, *_new(_by_place(pool, targets, said), targets))


def _by_place(pool: Iterable[Candidate], targets: Targets, said: Sequence[str]) -> list[list[Candidate]]:
    """Candidates of single joints of like parts, together with those of the same place of the other parts."""
    place: dict[tuple[str, str], str] = {}
    for kind in KINDS:
        if targets.names(kind):
            by_part = alike(targets.names(kind), said).values()
            place |= {(kind, name): where for mine in by_part for where, name in mine.items()}
    found: dict[tuple[object, ...], list[Candidate]] = {}
    for one in pool:
        if EFFECTS[one.effect].shows_as in MEASURES:  # the readings of each joint say by themselves what it has
            continue
        kind = EFFECTS[one.effect].targets
        where = place.get((kind, one.target[0])) if one.target is not None and len(one.target) == 1 else None
        if where is not None:
            found.setdefault((one.effect, one.parameter, one.fixed, kind, where), []).append(one)
    return [mine for mine in found.values() if len(mine) > 1]


def _new(shared: Iterable[Sequence[Candidate]], targets: Targets) -> list[Candidate]:
    """One candidate for those of each place, but where it would be that on all targets, which is in the pool."""
    return [_together(mine) for mine in shared if len(mine) < len(targets.names(EFFECTS[mine[0].effect].targets))]


def _together(mine: Sequence[Candidate]) -> Candidate:
    """One candidate on the targets of several, within what is possible on each of them."""
    low, high = max(one.low for one in mine), min(one.high for one in mine)
    grid = tuple(value for value in mine[0].grid if low <= value <= high) or mine[0].grid
    return replace(
        mine[0],
        target=tuple(name for one in mine for name in one.target or ()),
        low=low,
        high=high,
        grid=grid,
        tolerance=max(one.tolerance for one in mine),
        removes=all(one.removes for one in mine),
    )

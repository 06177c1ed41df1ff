"""Which effects a motion with efforts excites, joint by joint, and which of them it cannot tell apart.

Without commands (or where efforts are commanded) torques are compared along the measured motion, by inverse dynamics.
An effect's signature is the torque per unit of its strength, in units of what the efforts resolve, less what the
model's own uncertain numbers could make as well, as of :mod:`tiago_mj.experiment_design.excitation`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from tiago_mj.effects import EFFECTS
from tiago_mj.experiment_design.excitation import CLEAR, Excited, Preflight
from tiago_mj.gap.simulation.along_a_motion import efforts_along
from tiago_mj.gap.simulation.plant import Plant
from tiago_mj.gap.torque.band import clearest
from tiago_mj.gap.torque.diagnose import check_given
from tiago_mj.gap.torque.evidence import Evidence
from tiago_mj.gap.torque.terms import Term, possible
from tiago_mj.recordings.nominal_priors import known_to
from tiago_mj.recordings.recording import Finding, RecordingError, Trial

Array = NDArray[np.float64]

#: What cannot be told apart is asked of signatures that are this many times as long as a clear one.
FIRM: Final = 2.0


def preflight_along(plant: Plant, trials: Sequence[Trial], findings: Sequence[Finding], seed: int = 0) -> Preflight:
    """Excitation of every effect on every joint by a measured motion, as changes of torque from inverse dynamics.

    Args:
        plant: the nominal simulator, with what is known already.
        trials: recordings with positions and efforts.
        findings: of the lint: channels that it discredits are left out.
        seed: of the blocks that the recordings are cut into.

    Raises:
        RecordingError: nothing moves, no effort can be used, or it is too short; one line.
    """
    trials, joints = efforts_along(plant, trials)
    check_given(trials, plant.given)
    if not any(np.nanmax(p, initial=-np.inf) > np.nanmin(p, initial=np.inf) for t in trials for p in _positions(t)):
        raise RecordingError(f"{trials[0].source}: no joint moves: torque along a motion needs a motion")
    usable, evidence = clearest(trials, plant.model, joints, findings, seed, known_to(trials), given=plant.given)
    if len(evidence.blocks.names) < 2 or not evidence.terms:
        files = ", ".join(dict.fromkeys(trial.source for trial in trials))
        raise RecordingError(f"{files}: the motion is too short to tell anything by its efforts: record longer")
    resolved = _Resolved(evidence)
    found: dict[tuple[str, str], Excited] = {}
    signatures: dict[tuple[str, str], Array] = {}
    for k, term in enumerate(evidence.terms):
        one, signature = _excited(term, resolved.signature(evidence.column(k)))
        if term.key not in found or one.distance > found[term.key].distance:  # of several shapes the clearest
            found[term.key], signatures[term.key] = one, signature
    dull = [
        Excited(name, _strength(name), "", None, 0.0)
        for name in possible(usable.torques)
        if name not in {effect for effect, _ in found}
    ]
    seen = {key: signatures[key] for key, one in found.items() if one.visible}
    return Preflight(
        plant.name,
        len(trials),
        (*found.values(), *dull),
        _alike(seen, {key: _named(one) for key, one in found.items()}),
        notes=(
            "Efforts are compared along the measured motion, as nothing else was commanded: effects on commands, "
            "servos, timing and load cells are not looked at.",
            *usable.notes,
        ),
    )


def _positions(trial: Trial) -> list[Array]:
    return [values[np.isfinite(values)] for values in trial.positions.values()]


class _Resolved:
    """Effect signatures in units of the resolution of the efforts, orthogonal to the uncertain numbers of the model."""

    def __init__(self, evidence: Evidence) -> None:
        floor = evidence.floor
        each = np.minimum(1 / (evidence.course.rate * floor.correlation), 1.0)  # independent samples a row
        self._weight = np.where(evidence.moving, np.sqrt(each) / floor.spread, 0.0)
        uncertain = [self._white(column) for column in evidence.tolerance_columns]
        uncertain += [size * self._white(evidence.column(k)) for k, size in evidence.given.items()]
        self._columns = np.stack(uncertain, axis=1)
        self._factor = linalg.cho_factor(np.eye(len(uncertain)) + self._columns.T @ self._columns)

    def signature(self, column: Array) -> Array:
        """Signature of a change of effort, (T, c): its component orthogonal to the nuisances, whose norm is its
        distance."""
        white = self._white(column)
        left = white - self._columns @ linalg.cho_solve(self._factor, self._columns.T @ white)
        length = float(np.sqrt(max(white @ left, 0.0)))
        size = float(np.linalg.norm(left))
        return left * (length / size) if size > 0 else left

    def _white(self, column: Array) -> Array:
        return (column * self._weight).ravel()


def _excited(term: Term, unit: Array) -> tuple[Excited, Array]:
    """Excitation of one term, and its signature at its default magnitude, or at twice the smallest clear one."""
    per_unit = float(np.linalg.norm(unit))
    nearest = CLEAR / per_unit if per_unit > 0 else np.inf
    sides = [side for side in (np.sign(term.magnitude), -np.sign(term.magnitude)) if side]
    smallest = next((s * nearest for s in sides if term.low <= s * nearest <= term.high), None)
    size = max(abs(term.magnitude), FIRM * nearest) if np.isfinite(nearest) else 0.0
    return (
        Excited(
            term.effect,
            term.parameter,
            term.unit,
            None if smallest is None else term.identity + float(smallest),
            abs(term.magnitude) * per_unit,
            target=None if term.joint is None else term.target,
        ),
        size * unit,
    )


def _named(one: Excited) -> str:
    return one.effect if one.target is None else f"{one.effect} on {one.target}"


def _strength(effect: str) -> str:
    """Name of the parameter that is an effect's magnitude."""
    return next(p.name for p in EFFECTS[effect].parameters.values() if p.identity is not None)


def _alike(
    seen: Mapping[tuple[str, str], Array], on_target: Mapping[tuple[str, str], str]
) -> tuple[tuple[str, ...], ...]:
    """Groups of effects on a joint that cannot be distinguished: the difference of their signatures is not clear."""
    groups: list[set[tuple[str, str]]] = []
    for a, b in combinations(seen, 2):
        x, y = seen[a], seen[b]
        longest = max(np.linalg.norm(x), np.linalg.norm(y))
        size = max(float(np.linalg.norm(x) * np.linalg.norm(y)), 1e-12)
        if longest * np.sqrt(max(1 - (float(x @ y) / size) ** 2, 0.0)) < CLEAR:
            touching = [g for g in groups if a in g or b in g]
            groups = [g for g in groups if g not in touching] + [{a, b}.union(*touching)]
    return tuple(tuple(on_target[key] for key in seen if key in g) for g in groups)

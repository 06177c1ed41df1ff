"""The result of a search as parts of a diagnosis: explanations, effects with intervals, curves and notes."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.effects import EFFECTS
from tiago_mj.effects.spec import Entry
from tiago_mj.gap.analysis.recorded import Recorded
from tiago_mj.gap.analysis.remainder import own_numbers
from tiago_mj.gap.decision import verdict
from tiago_mj.gap.detectors.readings import Tone
from tiago_mj.gap.inference.fit import Fitted
from tiago_mj.gap.inference.hypotheses import Candidate
from tiago_mj.gap.inference.noise_model import Data
from tiago_mj.gap.parts import target_of
from tiago_mj.gap.result import Explanation, Joint, Named, Overlay, Value
from tiago_mj.gap.search.state import Ranked
from tiago_mj.gap.simulation.plant import Plant
from tiago_mj.gap.simulation.session import Session
from tiago_mj.io.deadline import OutOfTimeError
from tiago_mj.io.quantities import NINETY
from tiago_mj.recordings import travel
from tiago_mj.recordings.recording import Trial

Array = NDArray[np.float64]

#: Ends a note of what makes the verdict ``unknown``, whatever explains the rest.
STRANGE: Final = "no effect of the library does that"


# Explanations ---------------------------------------------------------------------------------------------------------


def left_open(plant: Plant, ranked: Ranked) -> dict[int, tuple[Entry, ...]]:
    """Nominal parameters that the recordings leave uncertain, as effects with each explanation's fitted values, by its
    index; empty where there are none.

    They are part of the simulation before and after, as they are neither a gap nor an effect.
    """
    stated = {name for name, _ in plant.known}
    if not stated:
        return {}
    return {
        k: tuple(entry for entry in own_numbers(plant, fit) if entry.name in stated)
        for k, fit in enumerate(ranked.fits)
    }


def nominal(ranked: Ranked) -> int:
    """Index of the explanation without effects, apart from those measured on the readings."""
    return next(k for k, fit in enumerate(ranked.fits) if len(fit.parts) == ranked.known)


def stage(best: Fitted) -> str:
    """Stage of the signal chain of the first effect of an explanation."""
    return EFFECTS[best.parts[0].effect].stage


def explanations(plant: Plant, ranked: Ranked, probability: Array, gains: Array) -> list[Explanation]:
    """The fits as explanations of a diagnosis, in the same order.

    Args:
        plant: the nominal simulator.
        ranked: the fits.
        probability: of each, (n,).
        gains: drop of the validation trials' mean squared residual under each, (n,).
    """
    return [
        Explanation(
            tuple(named(plant, fit, part) for part in range(len(fit.parts))),
            float(p),
            float(gain),
            verdict.option(fit, ranked).evidence,
            joint=joint(fit),
        )
        for fit, p, gain in zip(ranked.fits, probability, gains, strict=True)
    ]


def named(plant: Plant, fit: Fitted, k: int) -> Named:
    """The ``k``-th effect of a fit with its values and 90 % intervals, which end at the value without effect."""
    part = fit.parts[k]
    declared = EFFECTS[part.effect]
    value, sd = float(fit.values[k]), float(fit.told[k])
    fitted, known = _deviations(part, value, sd)
    targets = plant.wiring.targets
    side = targets.side(declared.targets, targets.first(declared.targets, part.target))
    reach, (least, most) = NINETY * float(np.hypot(fitted, known)), _bounds(part, value)
    low, high = max(value - reach, least), min(value + reach, most)
    parameters: dict[str, Value] = {part.parameter: Value(value, low, high, part.unit, sd, known)}
    for name, fixed in part.fixed:
        if name in declared.forms:
            if fixed != declared.forms[name].values[0]:
                parameters[name] = Value(fixed, None, None, "-")
            continue
        if name in declared.details:
            detail, unit = declared.details[name], declared.details[name].unit[side]
            if name not in fit.spreads:  # proposed, and the search ended before it was fitted
                parameters[name] = Value(fixed, None, None, unit)
                continue
            off = NINETY * verdict.calibration().widens * fit.spreads[name]
            ends = max(fixed - off, detail.bounds[0]), min(fixed + off, detail.bounds[1])
            parameters[name] = Value(fixed, *ends, unit, fit.spreads[name])
            continue
        unit = declared.parameters[name].unit[side]
        parameters[name] = Value(fixed, None, None, unit)
        if k < len(fit.second_deviations) and name in fit.second_deviations[k]:
            lowest, highest = declared.parameters[name].bounds[side]
            share = fit.second_deviations[k][name]
            times = math.exp(NINETY * verdict.calibration().widens * share)
            ends = max(fixed / times, lowest), min(fixed * times, highest)
            parameters[name] = Value(fixed, *ends, unit, fixed * share)
    return Named(part.effect, target_of(part.target), parameters)


def joint(fit: Fitted) -> Joint | None:
    """Posterior of a fit's magnitudes, as wide as the intervals of :func:`named` and with their bounds."""
    if not fit.parts or fit.correlation is None:
        return None
    values = fit.values.tolist()
    fitted, known = np.transpose(list(map(_deviations, fit.parts, values, fit.told.tolist())))
    covariance = fit.correlation[0] * np.outer(fitted, fitted) + np.diag(np.square(known))
    rows = tuple(tuple(row) for row in covariance.tolist())
    return Joint((False,) * len(values), rows, *zip(*map(_bounds, fit.parts, values), strict=True))


def _deviations(part: Candidate, value: float, deviation: float) -> tuple[float, float]:
    """Standard deviations of a magnitude: of its fit, widened as fits are, and of what no recording tells of it."""
    if part.spread is not None:  # it was measured on the readings, not fitted
        return deviation, 0.0
    return deviation * verdict.calibration().widens, part.known_to(value)


def _bounds(part: Candidate, value: float) -> tuple[float, float]:
    """Within which a magnitude is: on its side of the value without effect."""
    low = max(part.low, part.identity) if value > part.identity else part.low
    return low, min(part.high, part.identity) if value < part.identity else part.high


# Pictures and notes ---------------------------------------------------------------------------------------------------


def overlay(recorded: Recorded, base: Array, repaired: Array, k: int) -> Overlay:
    """Curves of the ``k``-th trial: measured, and predicted without and with the explanation."""
    plant, data, trial = recorded.plant, recorded.data, recorded.session.trials[k]
    rows = len(trial.time)
    units: Mapping[str, Callable[[int], str]] = {
        "position": lambda j: "m" if plant.wiring.targets.slides[j] else "rad",
        "velocity": lambda j: "m/s" if plant.wiring.targets.slides[j] else "rad/s",
        "force": lambda j: "sensor units",
        "effort": lambda j: "N" if plant.wiring.targets.slides[j] else "N·m",
    }

    def signals(values: Array) -> dict[str, Array]:
        return {name: values[k, :rows, c] for c, name in enumerate(data.channels)}

    return Overlay(
        trial=trial.name,
        time=trial.time,
        phases=recorded.phase[k, :rows],
        measured=signals(data.value),
        nominal=signals(base),
        repaired=signals(repaired),
        units={name: units[name.partition(".")[0]](int(j)) for name, j in zip(data.channels, data.part, strict=True)},
        floor={name: float(noise) for name, noise in zip(data.channels, data.floor, strict=True)},
    )


def notes(session: Session, tones: Sequence[Tone], ranked: Ranked) -> tuple[str, ...]:
    """Notes for the reader of a diagnosis, one sentence each.

    Args:
        session: trials that were compared.
        tones: that load cells hum.
        ranked: what the search found, and how it ended.
    """
    trials, cut_from, plant = session.trials, session.recorded, session.plant
    slides = [name for name, slides in zip(plant.joints, plant.wiring.targets.slides, strict=True) if slides]
    said = []
    if len(trials) > cut_from:
        what = "The recording was" if cut_from == 1 else f"The {cut_from} recordings, few or long, were"
        said.append(
            f"{what} cut into {len(trials)} trials: at rests, or where there are too few of them into parts with gaps "
            "between them."
        )
    said += travel.notes(trials, session.splits, slides)
    if not session.splits["test"]:
        said.append("There is no test trial, so no share of the gap can be said to be closed: record more than one.")
    said += [
        f"{tone.channel} swings at about {tone.frequency:.3g} Hz (or faster, seen at this rate) by "
        f"±{tone.amplitude:.2g} even where nothing is touched: mains hum, or a vibration; {STRANGE}."
        for tone in tones
    ]
    said += [
        f"In {trials[k].name} the motion departs from the simulator's, unlike in the other trials: something slipped, "
        "tipped or got stuck there. The answer is based on the others."
        for k in ranked.excluded
    ]
    said += late_readings(ranked.predict.data)
    if not ranked.complete:
        said.append(early_end(ranked.ended))
    return tuple(said)


def late_readings(data: Data) -> list[str]:
    """A sentence on readings that are earlier or later than their stamps."""
    if data.late is None or not data.late.any():
        return []
    late = {name: 1e3 * float(one) for name, one in zip(data.channels, data.late, strict=True) if one}
    least, most = f"{min(late.values()):.2g}", f"{max(late.values()):.2g}"
    return [
        f"{', '.join(late)}: read earlier or later than {'its' if len(late) == 1 else 'their'} stamps say, "
        f"by {most if least == most else f'{least} to {most}'} ms (root mean square), so that a fast motion is read "
        "less exactly: that counts as noise."
    ]


def early_end(ended: BaseException | None) -> str:
    """A sentence on what ended a search early; None where the time was over."""
    if isinstance(ended, KeyboardInterrupt):
        return "The search was interrupted: this is the best answer so far."
    if ended is not None and not isinstance(ended, OutOfTimeError):
        fault = f"{type(ended).__name__}: {' '.join(str(ended).split())[:200]}"
        return f"A fault of this program ended the search ({fault}): this is the best answer so far."
    return "The time budget ran out: this is the best answer so far."


def asides(trials: Sequence[Trial]) -> tuple[str, ...]:
    """Sentences on how the numbers were computed that do not affect the answer."""
    if not any(trial.efforts for trial in trials):
        return ()
    return ("Measured efforts are not compared where commands can be replayed: servos report them in many ways.",)

"""Do the library's effects do what reality's do? Each is replayed at its true parameters.

    python -m benchmarks.effect_forms [EFFECT ...] [--rates 25,240]

Reality has the simulator's own numbers here, and the object stands where it is said to: with the right form nothing is
left but noise, a mean square of 1. What is left beyond it no magnitude can mend, and a diagnosis takes it for a second
effect. Run over all effects it writes ``benchmarks/results/effect_forms.json``.
"""

from __future__ import annotations

import argparse
import itertools
import tempfile
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks.blind import cases, recordings
from benchmarks.blind.cases import Case, EffectChoice
from benchmarks.blind.dictionary import ABOVE, BELOW, CONSTANT, FACTOR, FLAT, GRIPPER, KINDS, available
from benchmarks.machine import save
from tiago_mj.effects import EFFECTS
from tiago_mj.effects.spec import Entry
from tiago_mj.gap.inference import likelihood
from tiago_mj.gap.inference.predictor import RANDOM_EFFECTS, Predictor, predictor
from tiago_mj.gap.simulation.plant import plant_of
from tiago_mj.recordings.read import read_recordings

NAME: Final = "effect_forms"
#: How far up its range a magnitude is taken.
UP: Final = 0.65
#: What two draws of chance have in common is no form.
BY_CHANCE: Final = (*RANDOM_EFFECTS, "force_noise")
INTERFACES: Final = ("velocity", "position")
#: Length of a recording [s] by the rate [Hz].
SECONDS: Final = {25.0: 6.0, 240.0: 2.3}


def magnitudes(name: str) -> dict[str, float]:
    """Clearly visible parameters of an effect."""
    out = {}
    for parameter, (how, low, high) in KINDS[name].ranges[GRIPPER].items():
        size = low + UP * (high - low) if how == FLAT else low * (high / low) ** UP
        out[parameter] = float(1 - size if how == BELOW else 1 + size if how in (ABOVE, FACTOR) else size)
    return out


def left(predict: Predictor, effects: tuple[Entry, ...]) -> dict[str, Any]:
    """What a prediction of all trials leaves in the worst channel: mean square sample by sample, and over blocks."""
    data = predict.data
    predicted = predict.all_trials([effects], range(len(data.value)))[0]
    known = np.maximum(np.isfinite(data.value).sum(axis=(0, 1)), 1)
    misfit = (likelihood.scaled(data, likelihood.residual(data, predicted)) ** 2).sum(axis=(0, 1)) / known
    lasting = np.nan_to_num(likelihood.lasting(data, data.value - predicted))
    return {"misfit": round(float(misfit.max()), 2), "lasting": round(float(lasting.max()), 2)}


def compared(name: str, rate: float, interface: str) -> dict[str, Any]:
    """An effect of reality, with and without the library's; of its forms the one that leaves least."""
    parameters = magnitudes(name)
    case = Case(
        seed=5, interface=interface, effects=(EffectChoice(name, "all", parameters),), spread=0.0, placement=0.0,
        rate=rate, seconds=SECONDS.get(rate, 3.0), trials=4, offset=0.005,
    )  # fmt: skip
    with tempfile.TemporaryDirectory() as scratch:
        recordings.write(cases.simulate(case), Path(scratch))
        trials = read_recordings([Path(scratch)]).trials
    predict, _ = predictor(plant_of(trials), trials, threads=1)
    forms, whole = EFFECTS[name].forms, {**parameters, **CONSTANT.get(name, {})}
    with_it = [
        {**left(predict, (Entry(name, None, {**whole, **dict(zip(forms, values, strict=True))}),)),
         "form": dict(zip(forms, values, strict=True))}
        for values in itertools.product(*(form.values for form in forms.values()))
    ]  # fmt: skip
    best = min(with_it, key=lambda one: max(one["lasting"], one["misfit"]))
    about = {"effect": name, "parameters": parameters, "rate": rate, "interface": interface}
    return {**about, "without": left(predict, ()), "with": best}


def main() -> None:
    """Compare, print, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    effects = [name for name in available(GRIPPER) if name not in BY_CHANCE]
    parser.add_argument("effects", nargs="*", metavar="EFFECT", help="all that the gripper can have by default")
    parser.add_argument("--rates", default="25,240")
    arguments = parser.parse_args()
    unknown = sorted(set(arguments.effects) - set(effects))
    if unknown:
        parser.error(f"{', '.join(unknown)}: use some of {', '.join(effects)}")
    rows = []
    for name in arguments.effects or effects:
        for rate, interface in itertools.product(map(float, arguments.rates.split(",")), INTERFACES):
            row = compared(name, rate, interface)
            before, after = row["without"], row["with"]
            print(
                f"{name:24}{rate:4.0f} Hz {interface:9} lasting {before['lasting']:9.2f} -> {after['lasting']:7.2f}, "
                f"sample by sample {before['misfit']:9.2f} -> {after['misfit']:7.2f}  {after['form'] or ''}",
                flush=True,
            )
            rows.append(row)
    if not arguments.effects:
        save(NAME, {"rows": rows}, f"python -m benchmarks.effect_forms --rates {arguments.rates}")


if __name__ == "__main__":
    main()

"""Accuracy of the stage told by the shape of a residual, on recordings of the blind check with one effect each.

    python -m benchmarks.residual_stages

One case of every effect of the generator, in the library or not, for the hinge and for the gripper. What is looked at
is what the nominal model leaves, whose numbers are 3 to 5 % off: no effect is searched for. Beside it stands the stage
of the phase and band of motion with most of the gap (:func:`tiago_mj.gap.analysis.locate.stage`), which is always a
single one.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks.blind import cases, recordings, robots
from benchmarks.blind.cases import FAST_RATE, RATE, Case
from benchmarks.blind.dictionary import GRIPPER, KINDS, PLAIN
from benchmarks.machine import save
from tiago_mj.effects import EFFECTS
from tiago_mj.gap.analysis import locate, unexplained
from tiago_mj.gap.inference.predictor import predictor
from tiago_mj.gap.simulation import phases
from tiago_mj.gap.simulation.session import session
from tiago_mj.recordings.read import read_recordings

#: Stages of the generator's effects that the library has not.
OUTSIDE: Final = {
    "thermal_fade": "actuator",
    "cable_tug": "transmission",
    "place_friction": "transmission",
    "stiffening_spring": "transmission",
    "mains_hum": "force_sensor",
    "mount_resonance": "body",
    "supply_sag": "actuator",
    "sticky_pads": "force_sensor",
    "soft_saturation": "force_sensor",
    "late_stamps": "timing",
}
#: Residuals that count: mean square of the worst channel, in units of noise and tolerance.
LOUD: Final = 5.0
TRIALS: Final = 6
SECONDS: Final = {FAST_RATE: 2.0, RATE: 6.0}
SEED: Final = 5


def drawn(setting: str, name: str, seed: Sequence[int]) -> Case:
    """A case with one effect."""
    rng = np.random.default_rng(seed)
    rate = (RATE, FAST_RATE)[int(rng.integers(2))]
    interface = "position" if setting == PLAIN or rng.random() < 0.5 else "velocity"
    return Case(
        seed=int(rng.integers(1e6)),
        setting=setting,
        interface=interface,
        effects=(cases.choose(setting, name, rng),),
        rate=rate,
        seconds=SECONDS[rate],
        trials=TRIALS,
    )


def row(case: Case, folder: Path) -> dict[str, Any]:
    """What the nominal model leaves of a case, and which stages are told."""
    model = folder / robots.PLAIN_FILE if case.setting == PLAIN else None
    if model is not None:
        model.write_text(robots.PLAIN)
    recordings.write(cases.simulate(case, folder), folder)
    opened = session(read_recordings([folder]).trials, model=model)
    everything = range(len(opened.trials))
    predict, nominal = predictor(opened.plant, opened.trials, threads=1)
    base = predict.all_trials([()], everything)[0]
    phase = phases.phases(opened.plant, predict.on, nominal)[:, : base.shape[1]]
    shape = unexplained.unexplained(opened.plant, predict.on, predict.data, base, nominal, everything)
    (effect,) = case.effects
    return {
        "setting": case.setting,
        "rate_hz": case.rate,
        "interface": case.interface,
        "effect": effect.name,
        "stage": OUTSIDE.get(effect.name) or EFFECTS[effect.name].stage,
        "loud": round(float(np.nanmax(unexplained.loudness(predict.data, predict.data.value - base))), 2),
        "shape": None if shape is None else shape.name,
        "share": None if shape is None else round(shape.share, 3),
        "carrier": None if shape is None else shape.carrier,
        "told": [] if shape is None else list(shape.stages),
        "by_place": locate.stage(locate.locate(predict.data, base, phase, opened.plant.period)),
    }


def main() -> None:
    rows = []
    for setting in (PLAIN, GRIPPER):
        for k, (name, kind) in enumerate(KINDS.items()):
            if setting not in kind.ranges:
                continue
            with tempfile.TemporaryDirectory() as folder:
                rows.append(row(drawn(setting, name, (77, SEED, k)), Path(folder)))
            print(" ".join(str(value) for value in rows[-1].values()), flush=True)
    loud = [one for one in rows if one["loud"] > LOUD]
    told = [one for one in loud if one["told"]]
    alone = [one for one in told if len(one["told"]) == 1]
    counts = {
        "cases": len(rows),
        "loud": len(loud),
        "told": len(told),
        "stages_told_mean": round(float(np.mean([len(one["told"]) for one in told])), 2),
        "right": sum(one["stage"] in one["told"] for one in told),
        "single": len(alone),
        "single_right": sum(one["told"] == [one["stage"]] for one in alone),
        "by_place_right": sum(one["by_place"] == one["stage"] for one in loud),
    }
    print(counts)
    print("wrote", save("residual_stages", {**counts, "rows": rows}, "python -m benchmarks.residual_stages"))


if __name__ == "__main__":
    main()

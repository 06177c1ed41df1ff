"""One decoder with three models of what becomes of a command, at the true nominal numbers: does it tell the family?

Beside the simulation with the true nominal numbers, and the case's other effects at their true magnitudes, what is left
of the joints' motion is explained by set points that are lost by chance (all ways together, by Viterbi's algorithm over
the last few), that are held within a dead band, or that lie on a grid. All three share one linear answer of the joint
to a set point that is off, and one likelihood (:mod:`tiago_mj.gap.search.lost_commands`). A dead band of positions is
also decoded as ways, in which a command passes the likelier the farther it is from what is held (negative widths
in the results). The family that costs least, with a price for its number, is the decoder's; a gain below
:data:`WORTH` is none.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.experiments import results
from benchmarks.experiments.held import held_ways
from benchmarks.experiments.kept_cases import COMMANDS, Kept
from benchmarks.experiments.opened import Opened, judge, open_case, true_nuisance, true_parts
from tiago_mj.effects.spec import Entry
from tiago_mj.gap.detectors import set_points
from tiago_mj.gap.inference.predictor import Effects
from tiago_mj.gap.search import lost_commands
from tiago_mj.gap.simulation.replay import only_commands

Array = NDArray[np.float64]

FAMILIES: Final = ("dropped_commands", "command_deadband", "command_quantization")
BAND: Final = "command_deadband"
#: Widths at which the ways of a dead band are decoded.
WIDTHS: Final = 14
WORTH: Final = lost_commands.MIN_GAIN_NATS
#: What a magnitude costs that was chosen among those that were looked at [nats].
PRICE: Final = float(np.log(set_points.DENSE_MAGNITUDES))


def decoded(kept: Kept) -> dict[str, Any]:
    """Cost of every family beside the truth's other numbers."""
    opened = open_case(kept)
    if opened.seen is None:
        return {"true": [e.name for e in kept.case.effects], "family": None, "why": "no set points to be read"}
    by = judge(opened, opened.predict, np.ones(len(opened.data.channels)), opened.trials)
    parts, values = true_parts(opened)
    rest = [k for k, part in enumerate(parts) if part.effect not in FAMILIES]
    nuisance = true_nuisance(opened, by)
    beside: list[Effects] = [
        by.effects([parts[k] for k in rest], values[rest], nuisance, row) for row in range(len(by.trials))
    ]
    cost = costs(opened, beside)
    none = cost.pop("none")
    told: dict[str, Any] = {}
    for name, table in cost.items():
        told[name] = _least(table, none)
    family = min(told, key=lambda name: told[name]["cost"])
    gain = float(none.sum()) - told[family]["cost"]
    true = next(e for e in kept.case.effects if e.name in FAMILIES)
    return {
        "setting": f"{kept.case.setting} {kept.case.interface} {kept.case.rate:g} Hz",
        "true": [e.name for e in kept.case.effects],
        "parameters": dict(true.parameters),
        "target": true.target,
        "none": round(float(none.sum()), 1),
        "families": told,
        "family": family if gain > WORTH else None,
        "gain": round(gain, 1),
        "right": gain > WORTH and family == true.name,
    }


def _least(table: dict[float, Array], none: Array) -> dict[str, Any]:
    """The best magnitude of a family, of all servos alike or of one: its cost, with none elsewhere."""
    found = []
    count = len(none)
    for value, each in table.items():
        for servos in [range(count), *([k] for k in range(count) if count > 1)]:
            rest = [k for k in range(count) if k not in servos]
            found.append((float(each[list(servos)].sum() + none[rest].sum()) + PRICE, value, list(servos)))
    cost, value, servos = min(found, key=lambda one: one[0])
    return {"cost": round(cost, 1), "value": float(f"{value:.4g}"), "all": len(servos) == count, "servos": servos}


def costs(opened: Opened, beside: Sequence[Effects]) -> dict[str, Any]:
    """Cost of every magnitude of every family by servo, (nservos,), and of none [nats]."""
    predict, plant, seen = opened.predict, opened.plant, opened.seen
    assert seen is not None
    on, data, trials = predict.on, opened.data, opened.trials
    base = predict([(t, effects) for t, effects in zip(trials, beside, strict=True)])
    delivered = (
        np.random.default_rng(lost_commands.SEED).random(on.commands.shape) > lost_commands.TRAINING_SHARE
    ).astype(float)
    losing = Entry(lost_commands.EFFECT, None, {"probability": lost_commands.TRAINING_SHARE})
    wanted = [(t, (*effects, losing)) for t, effects in zip(trials, beside, strict=True)]
    learned = predict.with_delivered(delivered)(wanted) - base
    deviation = np.sqrt(np.maximum(data.sigma**2 - data.common**2, data.noise**2))[trials]
    joints = plant.wiring.targets.actuated
    none = np.zeros(len(joints))
    tables: dict[str, dict[float, Array]] = {name: {} for name in FAMILIES}
    offsets = {name: _offsets(opened, name) for name in FAMILIES[1:]}
    for a, joint in enumerate(joints):
        names = (f"position.{plant.joints[joint]}", f"velocity.{plant.joints[joint]}")
        mine = [c for c, name in enumerate(data.channels) if name in names]
        value = data.value[trials][:, 1:, mine]
        known = np.isfinite(value) & np.isfinite(seen.deviation[trials][:, 1:, a, None])
        precision = np.where(known, 1 / deviation[:, 1:, mine] ** 2, 0.0)
        residual = np.where(known, value - base[:, 1:, mine], 0.0)
        velocity = plant.wiring.interface == "velocity"
        servo = lost_commands._ServoCommands(
            on.commands[trials, :, a], on.period[trials], seen.start[trials, a], velocity
        )
        share = min(float(seen.share[a]), 0.99)
        rows = int(
            np.clip(
                np.ceil(-lost_commands.RESPONSE_TIME_CONSTANTS / np.log1p(-share)) + lost_commands.RESPONSE_ROWS[0],
                *lost_commands.RESPONSE_ROWS,
            )
        )
        usual = share * (1 - share) ** np.arange(rows)
        first_order = {"position": usual, "velocity": np.diff(usual, prepend=0.0) / plant.period}
        prior = [np.asarray(first_order[data.kinds[c]]) for c in mine]
        answers = lost_commands._impulse_responses(
            servo.set_point_offsets(delivered[trials, :, a]), learned[:, 1:, mine], known, prior
        )
        none[a] = lost_commands._cost_without_losses(
            residual, precision, rows, lost_commands.DECODING_SAMPLE_WEIGHT
        ).sum()
        took = lost_commands._viterbi(servo, answers, residual, precision, lost_commands.DECODING_SAMPLE_WEIGHT)
        for k, probability in enumerate(lost_commands.SHARES):
            tables[FAMILIES[0]].setdefault(probability, np.zeros(len(joints)))[a] = took.cost[k].sum()
        if not velocity:  # a dead band of what a velocity adds up to has no such ways
            for width in offsets[BAND][0][:: max(len(offsets[BAND][0]) // WIDTHS, 1)]:
                ways = held_ways(servo, answers, residual, precision, float(width))
                tables[BAND][-float(width)] = tables[BAND].get(-float(width), np.zeros(len(joints)))
                tables[BAND][-float(width)][a] = ways
        for name, (values, off) in offsets.items():
            for value_, one in zip(values, off, strict=True):
                change = _answered(one[trials, :, a], answers)
                said = lost_commands._cost_without_losses(
                    np.where(known, residual - change, 0.0), precision, rows, lost_commands.DECODING_SAMPLE_WEIGHT
                ).sum()
                tables[name].setdefault(float(value_), np.zeros(len(joints)))[a] = said
    return {"none": none, **tables}


def _answered(offsets: Array, answers: Array) -> Array:
    """What set points that are off make of the channels, (ntrials, T - 1, C)."""
    rows = answers.shape[1]
    padded = np.pad(offsets, ((0, 0), (rows - 1, 0)))
    before = np.lib.stride_tricks.sliding_window_view(padded, rows, axis=1)[:, :, ::-1]
    return np.asarray(before @ answers.T)


def _offsets(opened: Opened, name: str) -> tuple[Array, Array]:
    """Magnitudes, and how far set points are off by each, (nvalues, ntrials, T - 1, nservos)."""
    plant, on, seen = opened.plant, opened.predict.on, opened.seen
    assert seen is not None
    wide = opened.candidates(name, None)[0]
    values = set_points._dense(wide, float(np.nanmax(np.abs(seen.requested))))
    values = np.unique(np.concatenate([values[:: max(len(values) // 120, 1)], _true(opened, name)]))
    out = np.zeros((len(values), *seen.requested.shape))
    for t in range(len(seen.requested)):
        chain = only_commands(plant, [(wide.entry(float(v)),) for v in values])
        shape = (len(values), seen.requested.shape[2])
        chain.now.set_point = np.broadcast_to(seen.start[t], shape).copy()
        for effect in chain.effects:
            effect.start(chain.now)
        for k in range(seen.requested.shape[1]):
            chain.now.dt = np.full(len(values), on.period[t, k])
            target = np.broadcast_to(seen.requested[t, k], shape)
            out[:, t, k] = chain.set_point(target) - target
    return values, out


def _true(opened: Opened, name: str) -> Array:
    """The true magnitude, which may lie between those of the grid, and its surroundings."""
    true = [next(iter(e.parameters.values())) for e in opened.kept.case.effects if e.name == name]
    return np.array([v * s for v in true for s in (0.98, 0.99, 1.0, 1.01, 1.02)])


if __name__ == "__main__":
    results.run("decoder", __doc__, COMMANDS, decoded)

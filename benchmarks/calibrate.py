"""Calibrate the verdict: fit its parameters to finished runs of the blind check, and write them down.

    python -m benchmarks.calibrate RUN... [--unseen RUN...] --out tiago_mj/gap/decision/verdict.json

A diagnosis stores the evidence for every explanation; the verdict is a function of it and of a few numbers
(:func:`tiago_mj.gap.decision.verdict.decide`), so that it can be judged again without simulating anything. Each number
is fitted to its own criterion, and regularised towards the value that it had before there were any runs: with few cases
it stays there.

* ``temperature``: the log loss of the true explanation, up to its classes.
* ``stands``: as few effects as possible are missed while at most 3 % of the cases without a gap get a name.
* ``fails``: as few unknown effects as possible pass while at most 5 % of what the library explains is rightly named and
  still called unknown.
* ``remains``: as few gaps as possible are kept quiet while at most 5 % of the right verdicts say that one is left.
* ``rival``: sets as small as possible while at least 98 % hold the truth, of those whose truth was looked at.
* ``further``: as the temperature, but of runs that the method had not seen when it answered them, where there are any:
  what it was developed on has the forms that it knows.
* ``doubt``: the log loss of whether the best explanation is right, of the same runs: on what a method was developed on
  it is wrong less often.
  With ``--along-a-motion`` it is fitted to runs of efforts, and that of replays stays.
* ``widens``: 90 % of the intervals of rightly named effects hold the true magnitude, of the same runs.

Not a part of ``benchmarks.blind``, which knows nothing of the diagnosis's code. The runs' seeds are written down, too;
a run of one of them is no evaluation afterwards.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, astuple, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from benchmarks.blind import score
from benchmarks.blind.score import Judged
from benchmarks.verdicts_again import Case, again, read
from tiago_mj.effects import EFFECTS
from tiago_mj.gap.decision import verdict
from tiago_mj.gap.decision.verdict import SCHEMA, Calibration, Doubt, probabilities
from tiago_mj.gap.inference.hypotheses import form_deviation
from tiago_mj.gap.result import FitQuality
from tiago_mj.io import atomic

Array = NDArray[np.float64]
Verdicts = Sequence[Judged]

#: Chosen by hand; what few cases do not move much. What is rightly explained leaves 0.1 to 1.6, so that what leaves 3
#: ``fails``; ``widens`` is what holds 36 of the first 40 magnitudes since two samples count as one.
BY_HAND: Final = Calibration(temperature=1.0, stands=0.333, rival=0.05, fails=3.0, remains=2.0, widens=2.0, further=1.0)
#: Of an answer that is right, if the evidence says so.
CERTAIN: Final = Doubt(nothing=-50.0, named=-50.0)
#: Drawn towards: five in a hundred are wrong, whatever is left; so far away is a deviation [log odds].
DOUBT: Final = Doubt()
DOUBT_SPREAD: Final = 1.0
#: Where a number may lie.
RANGE: Final[Mapping[str, tuple[float, float]]] = {
    "temperature": (1.0, 100.0),  # below 1 recordings would tell more than they do
    "stands": (0.001, 1.0),
    "fails": (1.5, 200.0),
    "remains": (1.0, 100.0),
    "rival": (0.001, 0.5),
    "widens": (0.5, 50.0),
    "further": (1.0, 20.0),
}
#: Steps that are tried of each.
GRID: Final = 60
#: How far a number may be expected from where it was put by hand [log]; a case counts 1, a nat of log loss, too.
SPREAD: Final = 0.5
#: Counts jump where a threshold passes a case; a case is taken to lie anywhere within this [log].
SMOOTH: Final = 0.15
#: A case above a limit, by more than chance does with so many cases, counts as many that are missed.
ABOVE: Final = 10.0
#: Even a sure answer is wrong so often, whatever the evidence: the log loss of one case is limited.
MIN_ERROR_RATE: Final = 0.01
#: Half a 90 % interval [deviations], and the share that is to hold the truth.
NINETY, HOLDS = 1.6449, 0.9
FALSE_NAMES, FALSE_FLAGS, FALSE_REMAINS, OUT_OF_SET = 0.03, 0.05, 0.05, 0.02
#: They depend on each other.
ROUNDS: Final = 3


def log_loss(cases: Sequence[Case], by: Calibration) -> float:
    """Sum of −log of the true explanation's probability [nats], of cases whose truth was looked at."""
    total = 0.0
    for one in cases:
        if one.explainable and one.looked_at:
            single = probabilities(one.options, by, measured_on_readings=one.betrayed)
            right = sum(p for p, option in zip(single, one.options, strict=True) if option.classes in one.truths)
            total -= float(np.log((1 - MIN_ERROR_RATE) * right + MIN_ERROR_RATE))
    return total


# What each number is for: cases that are missed, with those above a limit ---------------------------------------------


def _above(count: float, share: float, of: int) -> float:
    """What it costs that more cases than a share are wrong, beyond one standard deviation of that many draws."""
    return ABOVE * max(0.0, count - share * of - float(np.sqrt(share * (1 - share) * of)))


def _stands(said: Verdicts) -> float:
    none = [j for j in said if j.kind == "none"]
    false = sum(j.verdict in ("effect", "ambiguous") and bool(j.best) for j in none)
    there = [j for j in said if j.kind in ("one", "two") and j.detectable]
    return sum(j.verdict == "no_gap" for j in there) + _above(false, FALSE_NAMES, len(none))


def _fails(said: Verdicts) -> float:
    ours = [j for j in said if j.explainable]
    false = sum(
        j.verdict == "unknown" and score.classes(j.answer["verdict"]["effects"]) == j.truth for j in ours if j.answer
    )
    outside = [j for j in said if j.kind in ("outside", "left_out") and j.detectable]
    missed = sum(not score.right(j) for j in outside)
    return missed + _above(false, FALSE_FLAGS, len(ours))


def _remains(said: Verdicts) -> float:
    right = [j for j in said if j.explainable and j.detectable and j.best == j.truth]
    false = sum(_left(j) for j in right)
    partly = [j for j in said if j.verdict in ("effect", "ambiguous") and _short(j)]
    return sum(not _left(j) for j in partly) + _above(false, FALSE_REMAINS, len(right))


def _left(j: Judged) -> bool:
    return bool(j.answer and j.answer["verdict"]["remains"]["flag"])


def _short(j: Judged) -> bool:
    """Whether the best explanation leaves a gap: an effect that it lacks shows."""
    if not j.detectable:
        return False
    return j.kind == "outside" or (j.kind == "two" and j.best is not None and set(j.best) < set(j.truth))


def _rival(cases: Sequence[Case], said: Verdicts) -> float:
    ours = [j for one, j in zip(cases, said, strict=True) if _single(one) and j.verdict != "unknown"]
    out = sum(j.truth not in j.set for j in ours)
    return sum(len(j.set) - 1 for j in ours) + _above(out, OUT_OF_SET, len(ours))


def _doubt(cases: Sequence[Case], by: Calibration) -> Doubt:
    """What makes answers wrong that the evidence is sure of: by the log loss of what is stated."""
    said = [again(one, replace(by, doubt=CERTAIN)) for one in cases]
    rows = [
        (len(j.answer["verdict"]["effects"]), FitQuality(**j.answer["verdict"]["evidence"]), *row)
        for j in said
        if j.answer is not None and (row := score.stated(j)) is not None
    ]
    start = np.array(astuple(DOUBT))

    def loss(numbers: Array) -> float:
        sure = np.array([1 - verdict.wrong(count, evidence, Doubt(*numbers)) for count, evidence, _, _ in rows])
        stated, right = np.array([row[2:] for row in rows]).reshape(-1, 2).T
        as_it_was = np.where(right > 0, sure * stated, 1 - sure * stated)
        return float(
            ((numbers - start) ** 2).sum() / (2 * DOUBT_SPREAD**2)
            - np.log(np.maximum(as_it_was, MIN_ERROR_RATE**2)).sum()
        )

    found = minimize(loss, start, method="L-BFGS-B", bounds=[(None, None)] * 2 + [(0.0, None)] * 3)
    return Doubt(*(float(f"{number:.3g}") for number in found.x))


def _single(one: Case) -> bool:
    return bool(one.label["kind"] == "one" and one.label["oracle"]["detectable"] and one.looked_at)


def misses(cases: Sequence[Case]) -> Array:
    """How much wider intervals would have to be to hold the magnitudes of single effects that were rightly named."""
    out = []
    for one in cases:
        named = one.answer["verdict"].get("effects", [])
        true = one.label["effects"]
        if one.betrayed or not _single(one) or len(named) != 1 or named[0]["name"] != true[0]["name"]:
            continue
        for parameter, drawn in true[0]["parameters"].items():
            said = named[0].get("parameters", {}).get(parameter, {})
            if said.get("deviation") and (true[0]["name"], parameter) not in score.UNSCORED:
                value = float(one.label.get("effective", {}).get(parameter, drawn))
                known = said.get("known_to")
                if known is None:  # answered before that was told
                    identity = EFFECTS[true[0]["name"]].parameters[parameter].identity
                    known = form_deviation(true[0]["name"], np.inf if identity is None else identity, said["value"])
                error = (said["value"] - value) / NINETY
                out.append(np.sqrt(max(error**2 - known**2, 0.0)) / said["deviation"])
    return np.array(out)


def _widens(errors: Array, widens: float) -> float:
    """How far the share of intervals that hold the truth is from what it should be [nats]."""
    held = float(np.mean(errors <= widens)) if len(errors) else HOLDS
    return len(errors) * (held - HOLDS) ** 2 / (2 * HOLDS * (1 - HOLDS))


def fit(cases: Sequence[Case], start: Calibration = BY_HAND, unseen: Sequence[Case] = ()) -> Calibration:
    """All numbers, to three digits; ``further``, ``widens`` and ``doubt`` of unseen cases, if there are any."""
    errors = misses(unseen or cases)
    by = replace(
        start,
        temperature=_best("temperature", start, start, lambda c: log_loss(cases, c)),
        widens=_best("widens", start, start, lambda c: _widens(errors, c.widens)),
    )
    by = replace(by, further=_best("further", by, start, lambda c: log_loss(unseen or cases, c)))
    costs: dict[str, Callable[[Verdicts], float]] = {
        "fails": _fails,
        "remains": _remains,
        "stands": _stands,
        "rival": lambda said: _rival(cases, said),
    }
    for _ in range(ROUNDS):
        before = by
        for name, cost in costs.items():
            value = _best(name, by, start, lambda c, cost=cost: cost([again(one, c) for one in cases]))  # type: ignore
            by = replace(by, **{name: value})  # type: ignore[arg-type]
        by = replace(by, remains=min(by.remains, by.fails))  # what fails leaves a gap
        if by == before:
            break
    return replace(by, doubt=_doubt(unseen or cases, by))


def _best(name: str, by: Calibration, start: Calibration, cost: Callable[[Calibration], float]) -> float:
    """The number of least cost, with what it costs to leave where it was put by hand."""
    low, high, origin = (float(np.log(x)) for x in (*RANGE[name], getattr(start, name)))
    step = (high - low) / GRID
    at = origin + step * np.arange(np.ceil((low - origin) / step), np.floor((high - origin) / step) + 1)
    costs = np.array([cost(replace(by, **{name: float(np.exp(x))})) for x in at])  # type: ignore[arg-type]
    kernel = np.exp(-(((at[:, None] - at[None, :]) / SMOOTH) ** 2) / 2)
    smooth = (kernel / kernel.sum(axis=1, keepdims=True)) @ costs
    away = (at - origin) / SPREAD
    found = float(np.exp(at[np.argmin(smooth + away**2 / 2)]))
    return float(f"{found:.3g}")


def carried(cases: Sequence[Case], unseen: Sequence[Case] = ()) -> dict[str, int]:
    """How many cases each number rests on."""
    shown = [one for one in cases if one.label["oracle"]["detectable"]]
    none = [one for one in cases if one.label["kind"] == "none"]
    return {
        "temperature": sum(one.explainable and one.looked_at for one in cases),
        "stands": len(none) + sum(one.label["kind"] in ("one", "two") for one in shown),
        "rival": sum(_single(one) for one in cases),
        "fails": sum(one.explainable for one in cases) + sum(not one.explainable for one in shown),
        "remains": sum(one.label["kind"] in ("one", "two", "outside") for one in shown),
        "widens": len(misses(unseen or cases)),
        "further": sum(one.explainable and one.looked_at for one in unseen or cases),
        "doubt": sum(score.stated(again(one, BY_HAND)) is not None for one in unseen or cases),
    }


SHOWN: Final = (
    "top1", "in_set", "set_size", "pairs", "false_names", "unknown_flagged", "left_out", "false_flags", "undetectable",
    "ece",
)  # fmt: skip


def table(cases: Sequence[Case], old: Calibration, new: Calibration, unseen: Sequence[Case] = ()) -> str:
    """Numbers and scores of the cases, before and after."""
    lines = [f"{'':16}{'before':>9}{'after':>9}  cases"]
    for name, count in carried(cases, unseen).items():
        if name != "doubt":
            lines.append(f"{name:16}{getattr(old, name):9.3g}{getattr(new, name):9.3g}{count:7}")
    for name in Doubt.__dataclass_fields__:
        lines.append(f"{name:16}{getattr(old.doubt, name):9.3g}{getattr(new.doubt, name):9.3g}")
    errors = misses(unseen or cases)
    if len(errors):
        held = [float(np.mean(errors <= by.widens)) for by in (old, new)]
        lines.append(f"{'intervals hold':16}{held[0]:9.3f}{held[1]:9.3f}{len(errors):7}")
    lines.append(f"{'log loss':16}{log_loss(cases, old):9.3g}{log_loss(cases, new):9.3g}")
    scores = [score.score([again(one, by) for one in cases]) for by in (old, new)]
    for name in SHOWN:
        if scores[0][name]["n"]:
            a, b = (s[name]["value"] for s in scores)
            lines.append(f"{name:16}{a:9.3f}{'-' if b is None else f'{b:.3f}':>9}{scores[0][name]['n']:7}")
    tested = [s["ece"].get("spiegelhalter_p", float("nan")) for s in scores]
    lines.append(f"{'p of calibrated':16}{tested[0]:9.3f}{tested[1]:9.3f}")
    return "\n".join(lines)


def written(
    new: Calibration, cases: Sequence[Case], runs: Sequence[Mapping[str, Any]], unseen: Sequence[Case] = ()
) -> dict[str, Any]:
    """What ``verdict.json`` holds."""
    return {
        "schema": SCHEMA,
        **asdict(new),
        "calibration": {
            "command": "python -m benchmarks.calibrate RUN... [--unseen RUN...] "
            "--out tiago_mj/gap/decision/verdict.json",
            "seeds": sorted({run["seed"] for run in runs}),
            "cases": len(cases),
            "carried_by": carried(cases, unseen),
            "runs": [dict(run) for run in runs],
            "version": max(run["version"] for run in runs),
        },
    }


def _along_a_motion(cases: Sequence[Case], runs: Sequence[Mapping[str, Any]], out: Path | None) -> int:
    """Show, and write beside the other numbers, how often answers are wrong where efforts were compared."""
    old = verdict.calibration(replays=False)
    new = replace(old, doubt=_doubt(cases, old))
    print(table(cases, old, new))
    if out is not None:
        data = json.loads(out.read_text())
        data.setdefault("along_a_motion", {})["doubt"] = asdict(new.doubt)
        told = data["calibration"]
        told["along_a_motion"] = {"doubt": carried(cases)["doubt"]}
        told["seeds"] = sorted({*told["seeds"], *(run["seed"] for run in runs)})
        atomic.write_text(out, json.dumps(data, indent=2) + "\n")
        print(f"Written: {out}")
    return 0


def main(words: Sequence[str] | None = None) -> int:
    """Command line."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.calibrate", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("runs", nargs="+", type=Path, metavar="RUN", help="folders of finished runs, or kept ones")
    parser.add_argument(
        "--unseen",
        nargs="+",
        type=Path,
        default=[],
        metavar="RUN",
        help="runs not seen before: for further, widens, doubt",
    )
    parser.add_argument("--out", type=Path, metavar="FILE", help="where to write; without it, only the table is shown")
    parser.add_argument(
        "--along-a-motion", action="store_true", help="runs of --efforts: their own doubt, written into that of FILE"
    )
    arguments = parser.parse_args(words)
    cases: list[Case] = []
    unseen: list[Case] = []
    runs = []
    try:
        for into, roots in ((cases, arguments.runs), (unseen, arguments.unseen)):
            for root in roots:
                more, run = read(root)
                into += more
                runs.append(run)
        if not cases:
            raise ValueError("no case has stored evidence: diagnose the runs again with this version")
        if len({run["version"] for run in runs}) > 1:
            raise ValueError("the runs are of several versions of the cases: make them again with this one")
    except ValueError as error:
        print(f"calibrate: {error}", file=sys.stderr)
        return 2
    if arguments.along_a_motion:
        return _along_a_motion(cases, runs, arguments.out)
    new = fit(cases, unseen=unseen)
    print(table(cases, verdict.calibration(), new, unseen))
    if arguments.out is not None:
        atomic.write_text(arguments.out, json.dumps(written(new, cases, runs, unseen), indent=2) + "\n")
        print(f"Written: {arguments.out}")
    return 0


if __name__ == "__main__":
    sys.exit(main())

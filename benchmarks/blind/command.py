"""The whole check, as ``python -m benchmarks.blind`` runs it."""

from __future__ import annotations

import argparse
import json
import shlex
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import tiago_mj
from benchmarks.blind import baselines, cases, efforts, next_motion, plan, run, score
from benchmarks.blind.cases import Case
from benchmarks.blind.dictionary import LIBRARY
from benchmarks.blind.page import WORDS, number, page
from benchmarks.blind.store import Store
from tiago_mj.io import atomic, held

#: The numbers of the diagnosis's verdict, and what they were fitted to.
VERDICT: Final = Path(tiago_mj.__file__).parent / "gap" / "decision" / "verdict.json"
#: Least trials of a case: one each to fit, to choose and to report with.
LEAST_TRIALS: Final = 3
#: Shortest trial [s].
LEAST_SECONDS: Final = 1.0


def blind(arguments: argparse.Namespace, say: Any = print) -> int:
    """Generate, seal, diagnose, unseal, score; goes on where it stopped.

    Args:
        arguments: of ``python -m benchmarks.blind``.
        say: told what is done.

    Raises:
        ValueError: an option is unusable, or the folder holds another run.
    """
    if arguments.cases < 1:
        raise ValueError(f"--cases is {arguments.cases}: give 1 or more")
    only, settings = _listed(arguments.kinds, plan.SHARES), _listed(arguments.settings, plan.SETTINGS)
    root = arguments.out.resolve()
    with held.alone(root / ".sealed", "at this run"):
        return _blind(arguments, Store(root), only, settings, say)


def _blind(arguments: argparse.Namespace, store: Store, only: Any, settings: Any, say: Any) -> int:
    """The same, when no other process works in the folder."""
    planned = _of_efforts(arguments, store, only) if arguments.efforts else _planned(arguments, store, only, settings)
    run.generate(planned, store, workers=max(arguments.workers, 1), say=say)
    digest = store.seal(len(planned))
    say(f"labels sealed: SHA-256 {digest}")
    if arguments.generate_only:
        return 0
    extra = tuple(shlex.split(arguments.diagnose_with or ""))
    diagnoser = run.Diagnoser(jobs=max(arguments.jobs, 0), budget=arguments.time_budget, extra=extra)
    run.diagnose(planned, store, diagnoser, say=say, at_once=max(arguments.at_once, 1))
    labels = store.unseal(len(planned))

    def follow(k: int) -> None:
        outcome = next_motion.follow(planned[k], k, labels[f"{k:03d}"], store, diagnoser)
        if outcome is not None:
            say(f"case {k:03d}: the recommended motion {'resolves' if outcome['resolved'] else 'does not resolve'} it")

    if not arguments.no_next_motion:
        run.side_by_side(follow, range(len(planned)), arguments.at_once)
    write_scores(store, planned, labels, digest, command(arguments), say, seed=arguments.seed)
    return 0


def _planned(arguments: argparse.Namespace, store: Store, only: Any, settings: Any) -> list[Case]:
    """The cases of a run whose recordings hold commands; the folder is theirs from now on."""
    for name in ("effects", "off_centre"):
        if getattr(arguments, name):
            raise ValueError(f"--{name.replace('_', '-')} is asked of cases with --efforts only: leave it out")
    rates, trials = _rates(arguments.rates), _trials(arguments.trials)
    seconds = _seconds(arguments.seconds)
    store.begin(run.facts(arguments.cases, arguments.seed, only, settings, rates, trials, seconds))
    return plan.plan(
        arguments.cases,
        arguments.seed,
        only=only,
        settings=settings,
        rates=rates,
        trials=trials,
        seconds=seconds,
    )


def _of_efforts(arguments: argparse.Namespace, store: Store, only: Any) -> list[Case]:
    """The cases of a run whose recordings hold efforts instead; the folder is theirs from now on."""
    for name in ("settings", "rates", "trials", "seconds"):
        if getattr(arguments, name):
            raise ValueError(f"--{name} is not asked of cases with efforts: leave it out")
    drawn = {"cases": arguments.cases, "seed": arguments.seed, "kinds": list(only)}
    asked, off_centre = _listed(arguments.effects, LIBRARY), arguments.off_centre or 0.0
    if not 0 <= off_centre <= 0.2:
        raise ValueError(f"--off-centre is {off_centre:g}: give a share of the links' reach from 0 to 0.2")
    more = {"effects": list(asked), "off_centre": off_centre}
    drawn |= {name: value for name, value in more.items() if value}
    store.begin({**drawn, "efforts": True, "version": efforts.VERSION})
    planned = efforts.cases(arguments.cases, arguments.seed, only, asked)
    return [replace(case, off_centre=off_centre) for case in planned]


def write_scores(
    store: Store,
    planned: list[Case],
    labels: dict[str, Any],
    digest: str,
    words: str,
    say: Any = print,
    *,
    seed: int | None = None,
) -> dict[str, Any]:
    """Score and write ``scores.json`` and ``index.html``; with a word of caution where the seed served to calibrate."""
    judged = [score.Judged(labels[f"{k:03d}"], store.answer(k)) for k in range(len(planned))]
    followed = [store.followed(k) for k in range(len(planned))]
    motions = [bool(one["resolved"]) for one in followed if one is not None]
    scores = score.score(judged, motions)
    scores["baselines"] = baselines.scores(judged, store)
    scores["by_class"] = score.by_class(judged)
    scores["command"], scores["seal"] = words, digest
    if seed in calibration_seeds():
        scores["caution"] = f"The verdict was calibrated on seed {seed}, among others: these scores are no evaluation."
        say(scores["caution"])
    with atomic.replacing_set(store.root) as new:
        atomic.write_text(new / "scores.json", json.dumps(scores, indent=1, allow_nan=False) + "\n")
        atomic.write_text(new / "index.html", page(judged, scores, digest, words))
    for name, meaning in WORDS.items():
        entry = scores[name]
        if entry["n"]:
            say(f"{number(name, entry['value']):>8}  {meaning} (n = {entry['n']})")
    say(f"Written: {store.root / 'index.html'}")
    return scores


def calibration_seeds(path: Path = VERDICT) -> list[int]:
    """Seeds of the runs that the diagnosis's verdict was calibrated on."""
    if not path.exists():
        return []
    return list(json.loads(path.read_text()).get("calibration", {}).get("seeds", []))


def command(arguments: argparse.Namespace) -> str:
    """The command line that makes the same run elsewhere."""
    words = ["python", "-m", "benchmarks.blind", "--cases", str(arguments.cases), "--seed", str(arguments.seed)]
    for name in ("kinds", "settings", "rates", "trials", "seconds", "effects", "off_centre"):
        if getattr(arguments, name):
            words += [f"--{name.replace('_', '-')}", str(getattr(arguments, name))]
    return shlex.join([*words, *(["--efforts"] if arguments.efforts else []), "--out", "DIR"])


def _rates(given: str | None) -> tuple[float, ...]:
    known = {f"{rate:g}": rate for rate in plan.RATES}
    return tuple(known[word] for word in _listed(given, known))


def _trials(given: int | None) -> int:
    if given is None:
        return cases.TRIALS
    if given < LEAST_TRIALS:
        raise ValueError(f"--trials is {given}: give {LEAST_TRIALS} or more, to fit, to choose and to report with")
    return given


def _seconds(given: float | None) -> float | None:
    if given is not None and not given >= LEAST_SECONDS:
        raise ValueError(f"--seconds is {given}: give {LEAST_SECONDS} or more, to close, to touch and to press in")
    return given


def _listed(given: str | None, known: Any) -> tuple[str, ...]:
    names = tuple(name.strip() for name in (given or "").split(",") if name.strip())
    unknown = [name for name in names if name not in known]
    if unknown:
        raise ValueError(f"{unknown[0]!r} is unknown: use some of {', '.join(known)}")
    return names

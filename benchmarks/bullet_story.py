"""The gripper in PyBullet, diagnosed; what the diagnosis says is checked by changing it in PyBullet.

    python -m benchmarks.bullet_story --out DIR [--seed 61] [--trials 6] [--seconds 1.5] [--jobs 0]

A telling is a session recorded in one variant of :mod:`benchmarks.blind.bullet` and diagnosed by ``tiago-mj diagnose``
in a process of its own. :data:`TOLD` are told first. Then whatever a verdict names is undone in PyBullet by the value
that the verdict gives (:func:`undone`) and told again, with the same motions and noise: if it was the cause, the gap
goes.

Before that, a grasp is closed and held still with more and more iterations of Bullet's solver, and once in the nominal
simulator, whose commands are the same (:func:`held`).

Every telling lies in ``DIR/NAME/{recordings,diagnosis}`` and is not told twice, so the command goes on where it was
stopped; it writes ``benchmarks/results/bullet_story.json``.
"""

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks.blind import bullet, motions, recordings, robots
from benchmarks.machine import machine, save
from tiago_mj.gap.simulation import replay
from tiago_mj.gap.simulation.plant import plant_of
from tiago_mj.io import atomic
from tiago_mj.recordings.read import read_recordings

RESULT: Final = "bullet_story"
#: Explanations of a ranking that are kept.
RANKED: Final = 6


@dataclass(frozen=True)
class Telling:
    """A session to record and to diagnose.

    Attributes:
        name: of the folder.
        variant: of PyBullet.
        servo: of the nominal simulator: ``ideal`` (as in 2021) or ``pal`` (the real gripper's).
        follows: telling whose answer it checks.
    """

    name: str
    variant: bullet.Variant
    servo: str = "ideal"
    follows: str | None = None


RELEASED: Final = bullet.Variant()
#: Iterations with which Bullet's solver holds a grasp; with its default of 50 the fingers give way.
ENOUGH: Final = 500
#: The effort limit of the URDF and of the nominal simulator [N].
LIMIT: Final = 16.0
CONVERGED: Final = replace(RELEASED, iterations=ENOUGH)
TOLD: Final = (
    Telling("limited-summed", replace(CONVERGED, force=LIMIT, aggregate="sum")),
    Telling("released", RELEASED),
    Telling("released-pal", RELEASED, servo="pal"),
    Telling("converged", CONVERGED, follows="released"),
)

#: How an effect that a verdict names is taken out of PyBullet: its option, and the option's value without it.
UNDO: Final[dict[str, tuple[str, Callable[[float, dict[str, float]], float]]]] = {
    "contact_stiffness": ("stiffness", lambda now, p: now / p["factor"]),
    "contact_damping": ("damping", lambda now, p: now / p["factor"]),
    "contact_friction": ("friction", lambda now, p: now / p["factor"]),
    "object_mass": ("mass", lambda now, p: now / p["factor"]),
    "object_size": ("radius", lambda now, p: now - p["radius"]),
    "object_offset": ("moved", lambda now, p: now - p["distance"]),
}


#: Iterations with which a grasp is held, and for how long; how fast and how far it was closed [s, m/s, m].
HELD: Final = (20, 50, 100, 200, 500, 5000)
HOLD: Final = 3.0
CLOSING: Final = 0.02
PRESS: Final = 4e-4
#: Rows of it that are kept: every so many.
EVERY: Final = 12


def press_and_hold() -> motions.Program:
    """Close until both pads touch, a little farther, and stand still."""
    t, _, force = yield np.zeros(2)
    while not (force > motions.TOUCH).all():
        t, _, force = yield np.full(2, -CLOSING)
    end = t + PRESS / CLOSING
    while t < end:
        t, _, force = yield np.full(2, -CLOSING)
    while True:
        yield np.zeros(2)


def held(seed: int) -> dict[str, Any]:
    """Mean force of both pads [N] while Bullet holds still, by iterations; and what MuJoCo makes of the same."""
    out: dict[str, Any] = {}
    for iterations in HELD:
        variant = replace(RELEASED, aggregate="sum", iterations=iterations)
        made = bullet.simulate(variant, seed=seed, trials=1, seconds=HOLD, programs=[press_and_hold()])
        still = int(np.flatnonzero(made.recorded.commands[0, :-1, 0])[-1]) + 1
        out[str(iterations)] = _after(made.recorded.force[0], still)
        if iterations == ENOUGH:
            with tempfile.TemporaryDirectory() as folder:
                recordings.write(made, Path(folder))
                trials = read_recordings([Path(folder)]).trials
                plant = plant_of(trials)
                reading = replay.simulate(plant, replay.grid(plant, trials), [(0, ())], replay.Run(threads=1)).reading[
                    0
                ]
            out["nominal"] = _after(reading, still)
    return out


def _after(reading: Any, still: int) -> dict[str, Any]:
    newtons = reading[still:].mean(axis=1) / robots.UNITS_PER_NEWTON
    below = np.flatnonzero(newtons < newtons[0] / 2)
    second = round(1 / bullet.STEP)
    return {
        "newtons": [round(float(value), 2) for value in newtons[::EVERY]],
        "interval": EVERY * bullet.STEP,
        "share_after_1s": round(float(newtons[second - 3 : second + 4].mean() / newtons[0]), 3),
        "half_after": round(float(below[0]) * bullet.STEP, 3) if len(below) else None,
    }


def undone(variant: bullet.Variant, effects: Sequence[dict[str, Any]]) -> bullet.Variant | None:
    """The variant without those effects of a verdict that PyBullet has an option for; None if there are none.

    What it has none for stays: that must be named again.
    """
    changed = variant
    for effect in effects:
        if effect["name"] in UNDO:
            option, without = UNDO[effect["name"]]
            values = {key: p["value"] for key, p in effect["parameters"].items()}
            value: Any = without(getattr(changed, option), values)
            changed = replace(changed, **{option: value})
    return changed if changed != variant else None


@dataclass(frozen=True)
class Session:
    """What all tellings share."""

    out: Path
    seed: int
    trials: int
    seconds: float
    jobs: int

    def tell(self, telling: Telling) -> dict[str, Any]:
        """Record and diagnose, unless that is done; what was found.

        Raises:
            RuntimeError: the diagnosis failed.
        """
        folder = self.out / telling.name
        told = folder / "telling.json"
        asked = {"variant": asdict(telling.variant), "servo": telling.servo, **asdict(self), "out": ".", "jobs": 0}
        made = bullet.simulate(
            telling.variant, seed=self.seed, trials=self.trials, seconds=self.seconds, servo=telling.servo
        )
        if told.exists():
            kept = json.loads(told.read_text())
            if kept["asked"] != asked:
                raise ValueError(f"{folder} holds another telling: name another --out")
            return {"truth": made.truth, **kept["found"]}
        shutil.rmtree(folder, ignore_errors=True)  # left by a run that was cut off
        recordings.write(made, folder / "recordings")
        words = [sys.executable, "-m", "tiago_mj.cli", "diagnose", str(folder / "recordings")]
        words += ["--out", str(folder / "diagnosis"), "--seed", "0", "--jobs", str(self.jobs)]
        done = subprocess.run(words, capture_output=True, text=True, check=False)
        if done.returncode:
            raise RuntimeError(f"{telling.name}: the diagnosis ended with {done.returncode}: {done.stderr.strip()}")
        said = json.loads((folder / "diagnosis" / "diagnosis.json").read_text())
        found = {"commit": machine()["commit"], **summary(said)}
        atomic.write_text(told, json.dumps({"asked": asked, "found": found}, indent=1) + "\n")
        return {"truth": made.truth, **found}


def summary(said: dict[str, Any]) -> dict[str, Any]:
    """What of a diagnosis is kept."""
    verdict, ranking = said["verdict"], said["ranking"]
    kept = ranking[:RANKED] + [one for one in ranking[RANKED:] if not one["effects"]]
    return {
        "verdict": {key: verdict[key] for key in ("kind", "effects", "probability", "alternatives", "remains")},
        "shrink": {key: said["shrink"][key] for key in ("before", "after", "floor", "closed", "low", "high")},
        "per_channel": said["shrink"]["per_channel"],
        "where": said["where"][:4],
        "ranking": kept,
        "lint": [one["code"] for one in said["lint"]],
        "seconds": said["seconds"],
    }


def main() -> None:
    """Tell all, and write the result."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="folder of recordings and diagnoses; goes on there")
    parser.add_argument("--seed", type=int, default=61)
    parser.add_argument("--trials", type=int, default=6)
    parser.add_argument("--seconds", type=float, default=1.5, help="of a trial")
    parser.add_argument("--jobs", type=int, default=0, help="threads of a diagnosis; 0: all processors")
    given = parser.parse_args()
    session = Session(given.out, given.seed, given.trials, given.seconds, given.jobs)
    grasp = held(given.seed)
    print({name: (one["newtons"][0], one["share_after_1s"]) for name, one in grasp.items()}, flush=True)
    rows = []
    waiting = list(TOLD)
    while waiting:
        telling = waiting.pop(0)
        found = session.tell(telling)
        verdict, shrink = found["verdict"], found["shrink"]
        named = ", ".join(
            f"{e['name']} { ({k: p['value'] for k, p in e['parameters'].items()}) }" for e in verdict["effects"]
        )
        print(
            f"{telling.name}: {verdict['kind']} {named or 'nothing'}; gap {shrink['before']:.3g}, "
            f"{shrink['after']:.3g} with it; {found['truth']}; {found['seconds']:.0f} s",
            flush=True,
        )
        rows.append({**asdict(telling), **found})
        without = undone(telling.variant, verdict["effects"]) if telling.follows is None else None
        if without is not None:
            waiting.insert(0, Telling(f"{telling.name}-undone", without, telling.servo, telling.name))
        facts = {
            "seed": given.seed,
            "trials": given.trials,
            "seconds": given.seconds,
            "diagnosis_seed": 0,
            "complete": not waiting,
            "held": grasp,
            "tellings": rows,
        }
        command = f"python -m benchmarks.bullet_story --out DIR --seed {given.seed} --trials {given.trials} "
        save(RESULT, facts, command + f"--seconds {given.seconds:g}")


if __name__ == "__main__":
    main()

"""Accuracy of the progress line of ``tiago-mj diagnose``: whether its share falls, and whether the time left is
true.

    pip install 'tiago-mj[gap]'
    python benchmarks/progress_honesty.py show
    python benchmarks/progress_honesty.py prior

``show``: ten diagnoses, each as the command makes it. What the line would say is read off four times a second, and
compared with what then came: falls of the share, and the ratio of the time left that was told to the true one, the
larger over the smaller, from the first quarter of the time on. The last twentieth is left out, where seconds are a
large ratio. On a machine that others use, too, its speed may change under way, which no estimate can know: so the ratio
is also told in seconds of the process's own, for which the time left that was told is taken at the speed so far.

``prior``: what diagnoses of other cases still had to do at each stage, in simulations of all fitted trials: median and
spread, from which :data:`tiago_mj.gap.ahead.TYPICAL` is made.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import threading
import time
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import mujoco
import numpy as np
import pandas as pd
from machine import save
from numpy.typing import NDArray

from benchmarks.blind import cases, plan, recordings, robots
from benchmarks.blind.dictionary import ARM, GRIPPER, PLAIN
from tests.gap import made_motions
from tiago_mj.gap import ahead, command, pipeline
from tiago_mj.io import atomic
from tiago_mj.io.progress import Progress
from tiago_mj.models.files import model_file

Array = NDArray[np.float64]

#: Seeds of the plan of the cases that are shown, and of those that the prior is of.
SHOWN: Final = 71
PRIOR: Final = 35
#: Trials of a case and seconds of each: shorter than the blind check's, so that ten diagnoses take minutes.
TRIALS, SECONDS, ARM_SECONDS = 5, 1.25, 2.0
#: Seconds between two looks at the line.
LOOK: Final = 0.25
#: Shares of the time between which the time left is judged.
FROM, UNTIL = 0.25, 0.95


@dataclass(frozen=True)
class Asked:
    """A diagnosis: its name, and what writes its recordings into a folder and gives further words of the command."""

    name: str
    make: Callable[[Path], list[str]]


class Watched(Progress):
    """Progress that shows nothing and remembers what it would have shown."""

    last: Watched

    def __init__(self, name: str = "", **kwargs: Any) -> None:
        super().__init__(name, **{**kwargs, "quiet": True})
        self.rows: list[tuple[float, float, float | None, float | None]] = []
        self._watching = threading.Event()
        Watched.last = self

    def __enter__(self) -> Watched:
        super().__enter__()
        self._look()
        self._watcher = threading.Thread(target=self._watch, daemon=True)
        self._watcher.start()
        return self

    def __exit__(self, *fault: Any) -> None:
        self._watching.set()
        self._watcher.join()
        self._look()
        super().__exit__(*fault)

    def _watch(self) -> None:
        while not self._watching.wait(LOOK):
            self._look()

    def _look(self) -> None:
        self.rows.append((time.monotonic(), time.process_time(), *self.now()))


def forward(kind: str, setting: str, seed: int, number: int = 0) -> Asked:
    """A case of the blind check, of commands that are replayed: the ``number``-th of a kind and setting."""

    def make(folder: Path) -> list[str]:
        rates = () if setting == ARM else (240.0,)
        seconds = ARM_SECONDS if setting == ARM else SECONDS
        found = plan.plan(
            number + 1, seed, only=[kind], settings=[setting], rates=rates, trials=TRIALS, seconds=seconds
        )
        with atomic.replacing_set(folder) as new:
            if setting == PLAIN:
                atomic.write_text(new / robots.PLAIN_FILE, robots.PLAIN)
            recordings.write(cases.simulate(found[number], new), new)
        return ["--model", str(folder / robots.PLAIN_FILE)] if setting == PLAIN else []

    return Asked(f"{setting}, {kind}" + (f" {number + 1}" if number else ""), make)


def along(
    name: str, model: Callable[[], mujoco.MjModel], file: Callable[[Path], Path], change: str, seed: int
) -> Asked:
    """Efforts along a motion of made joints, with dry friction or a payload that the model lacks."""

    def make(folder: Path) -> list[str]:
        real = model()
        joints = made_motions.ARM if real.njnt > 1 else ("swing",)
        if change == "friction":
            real.dof_frictionloss[[int(real.joint(j).dofadr[0]) for j in joints]] += 2.0 if real.njnt > 1 else 0.1
        if change == "payload":
            real.body_mass[real.nbody - 1] += 0.5
        made = made_motions.record(real, joints, spread=0.6, seed=seed)
        folder.mkdir()
        columns = {f"position.{name}": one for name, one in made.positions.items()}
        columns |= {f"effort.{name}": one for name, one in made.efforts.items()}
        pd.DataFrame({"time": made.time, **columns}).to_csv(folder / "motion.csv", index=False)
        return ["--model", str(file(folder))]

    return Asked(name, make)


def _pendulum(folder: Path) -> Path:
    path = folder.with_suffix(".xml")
    atomic.write_text(path, made_motions.PENDULUM)
    return path


def shown() -> list[Asked]:
    """The ten."""
    return [
        *(forward(kind, GRIPPER, SHOWN) for kind in ("one", "two", "none", "outside")),
        *(forward(kind, PLAIN, SHOWN) for kind in ("one", "two", "none")),
        forward("one", ARM, SHOWN),
        along("efforts of a pendulum, payload", made_motions.pendulum, _pendulum, "payload", SHOWN),
        along("efforts of an arm, friction", made_motions.robot, lambda _: model_file("robots/tiago_ta11.xml"),
              "friction", SHOWN),
    ]  # fmt: skip


def diagnose(asked: Asked, root: Path) -> list[tuple[float, float, float | None, float | None]]:
    """Record and diagnose a case with the command; what its line said: (time, process time, share, time left)."""
    folder = root / asked.name.replace(" ", "_").replace(",", "")
    words = asked.make(folder)
    parser = argparse.ArgumentParser()
    command.add_arguments(parser)
    arguments = parser.parse_args([str(folder), *words, "--jobs", "1", "--out", f"{folder}_answer", "--json"])
    command.Progress = Watched  # type: ignore[misc]
    command._pictures = lambda *_: None  # type: ignore[assignment]  # the line is over before they are drawn
    with open(os.devnull, "w") as nowhere:
        out, sys.stdout = sys.stdout, nowhere
        try:
            status = command.run(arguments)
        finally:
            sys.stdout = out
    if status:
        raise RuntimeError(f"{asked.name}: exit status {status}")
    return Watched.last.rows


def judged(rows: Sequence[tuple[float, float, float | None, float | None]]) -> dict[str, Any]:
    """How honest a line was."""
    time_, process = (np.array([row[k] for row in rows], dtype=float) for k in (0, 1))
    share, left = (np.array([np.nan if row[k] is None else row[k] for row in rows], dtype=float) for k in (2, 3))
    past, whole = time_ - time_[0], time_[-1] - time_[0]
    speed = (process - process[0]) / np.maximum(past, 1e-9)
    known = share[np.isfinite(share)]
    out: dict[str, Any] = {
        "seconds": round(float(whole), 1),
        "process_seconds": round(float(process[-1] - process[0]), 1),
        "falls": int((np.diff(known) < 0).sum()),
        "share_at_the_end": round(float(known[-1]), 2) if len(known) else None,
    }
    truths = {"time": (past, left), "process": (process - process[0], left * speed)}
    for name, (clock, told) in truths.items():
        late = (clock > FROM * clock[-1]) & (clock < UNTIL * clock[-1])
        true, said = clock[-1] - clock[late], told[late]
        ratio = np.where(np.isfinite(said), said / true, np.inf)
        off = np.maximum(ratio, 1.0 / np.maximum(ratio, 1e-9))
        out[name] = {
            "worst_ratio": _rounded(off.max()),
            "median_ratio": _rounded(np.median(off)),
            "within_two": round(float((off <= 2.0).mean()), 3),
            "unknown": round(float((~np.isfinite(said)).mean()), 3),
        }
    return out


def _rounded(value: float) -> float | None:
    return round(float(value), 2) if np.isfinite(value) else None


def show(root: Path) -> dict[str, Any]:
    """The ten, each with a line of a table."""
    out: dict[str, Any] = {}
    for asked in shown():
        rows = diagnose(asked, root)
        row = judged(rows)
        row["load"] = round(os.getloadavg()[0], 1)
        thinned = rows[:: max(len(rows) // 60, 1)]
        row["line"] = [
            [round(t - rows[0][0], 1), round(p - rows[0][1], 1), *(None if v is None else round(v, 3) for v in said)]
            for t, p, *said in thinned
        ]
        out[asked.name] = row
        print(f"{asked.name:32}", {key: value for key, value in row.items() if key != "line"}, flush=True)
    return out


class Stages(ahead.Ahead):
    """What is ahead, remembering what was done when each stage began."""

    last: Stages

    def __init__(self, listener: ahead.Listener) -> None:
        super().__init__(listener)
        self.begun: list[tuple[str, float]] = []
        Stages.last = self

    def __call__(self, stage: str, total: int = 0, done: int = 0, *, gap: bool | None = None) -> None:
        if stage != self._stage or gap is not None:
            self.begun.append((ahead.key(stage, gap), self._done))
        super().__call__(stage, total, done, gap=gap)

    def rest(self) -> list[tuple[str, float]]:
        """What was left when each stage began, in units."""
        return [(stage, (self._done - done) / self._unit) for stage, done in self.begun if self._unit > 0]


def prior(root: Path, each: int, settings: Sequence[str]) -> dict[str, Any]:
    """Median and spread of what was left at each stage."""
    pipeline.Ahead = Stages  # type: ignore[misc]
    left: dict[str, list[float]] = defaultdict(list)
    for setting in settings:
        for kind in ("one", "none", "two", "outside"):
            for number in range(each):
                diagnose(forward(kind, setting, PRIOR, number), root)
                for stage, rest in Stages.last.rest():
                    left[stage].append(rest)
                print(setting, kind, [(stage, round(rest)) for stage, rest in Stages.last.rest()], flush=True)
    return {
        stage: {"n": len(some), "median": float(np.median(some)), "spread": float(np.log(np.maximum(some, 1)).std())}
        for stage, some in left.items()
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("part", choices=("show", "prior"))
    parser.add_argument("--each", type=int, default=2, help="cases of a kind and setting that the prior is of")
    parser.add_argument("--settings", nargs="+", default=[PLAIN, GRIPPER], help="settings that the prior is of")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        if arguments.part == "show":
            print("saved", save("progress_honesty", show(Path(folder))).name)
        else:
            print("saved", save("progress_prior", prior(Path(folder), arguments.each, arguments.settings)).name)


if __name__ == "__main__":
    main()

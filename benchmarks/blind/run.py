"""A run of the blind check: generate cases from a seed, seal their labels, diagnose each in a process of its own,
score."""

from __future__ import annotations

import ctypes
import errno
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.blind import cases, labels, oracle, recordings, robots
from benchmarks.blind.cases import Case
from benchmarks.blind.store import Store
from tiago_mj.cli import FULL
from tiago_mj.io import atomic

#: Of drives: what they say where nothing can be written any more.
UNWRITTEN = (FULL, *(os.strerror(number).lower() for number in (errno.ENOSPC, errno.EDQUOT, errno.EROFS)))
#: PR_SET_PDEATHSIG of linux/prctl.h.
_END_WITH_PARENT = 1


@dataclass(frozen=True)
class Diagnoser:
    """How a case is diagnosed.

    Attributes:
        jobs: threads of one diagnosis; 0: all.
        budget: seconds for one, or None.
        extra: further arguments of the command.
    """

    jobs: int = 0
    budget: float | None = None
    extra: tuple[str, ...] = ()

    def command(self, case: Case, given: Path, out: Path) -> list[str]:
        """The command line: recordings, and what a user would say of them."""
        words = [sys.executable, "-m", "tiago_mj.cli", "diagnose", str(given), "--out", str(out)]
        words += ["--seed", "0", "--jobs", str(self.jobs)]
        if case.setting in robots.MODELS:
            words += ["--model", str(given / robots.MODELS[case.setting][0])]
        if case.without:
            words += ["--without", ",".join(case.without)]
        if self.budget is not None:
            words += ["--time-budget", f"{self.budget:g}"]
        return [*words, *self.extra]


def make(case: Case, number: int, root: Path) -> float:
    """Record a case and seal its label.

    Returns:
        Seconds that it took.
    """
    begun = time.monotonic()
    store = Store(root)
    with atomic.replacing_set(store.recordings(number)) as folder:
        robots.put_model(case.setting, folder)
        made = cases.simulate(case, folder)
        recordings.write(made, folder)
        label = {**labels.label(made), "oracle": oracle.judge(made, folder)}
    store.keep_label(number, label)
    return time.monotonic() - begun


def generate(
    planned: Sequence[Case], store: Store, *, workers: int, say: Callable[[str], None], limit: int | None = None
) -> None:
    """Record what is not recorded yet."""
    todo = [k for k in range(len(planned)) if not store.label_file(k).exists()][:limit]
    if not todo:
        return
    say(f"recording {len(todo)} cases")
    if workers <= 1:
        for k in todo:
            make(planned[k], k, store.root)
        return
    with ProcessPoolExecutor(workers) as pool:
        list(pool.map(make, [planned[k] for k in todo], todo, [store.root] * len(todo)))


def diagnose(
    planned: Sequence[Case],
    store: Store,
    diagnoser: Diagnoser,
    *,
    say: Callable[[str], None],
    call: Callable[[list[str]], tuple[int, str]] | None = None,
    at_once: int = 1,
) -> None:
    """Diagnose what is not diagnosed yet, one process a case; refuses before the labels are sealed.

    Args:
        planned, store, diagnoser: of the run.
        say: told what is done.
        at_once: diagnoses that run side by side.
        call: runs a command and gives its exit status and what it said on standard error.

    Raises:
        ValueError: the seal is missing or broken.
    """
    store.seal(len(planned))

    def one(k: int) -> None:
        begun = time.monotonic()
        partial = store.case(k) / ".diagnosis"
        shutil.rmtree(partial, ignore_errors=True)
        status, words = (call or call_command)(diagnoser.command(planned[k], store.recordings(k), partial))
        if status == 0 and (partial / "diagnosis.json").exists():
            partial.replace(store.diagnosis(k))
            outcome = str((store.answer(k) or {}).get("verdict", {}).get("kind"))
        else:
            shutil.rmtree(partial, ignore_errors=True)
            last = words.strip().splitlines()[-1] if words.strip() else ""
            if any(reason in last.lower() for reason in UNWRITTEN):  # no answer of the diagnosis: it is asked again
                raise OSError(f"case {k:03d} cannot be written: {last}")
            atomic.write_text(store.failure(k), f"exit status {status}\n{words}")
            outcome = f"failed with exit status {status}: {last}"
        say(f"case {k:03d} of {len(planned)}: {outcome}, {time.monotonic() - begun:.0f} s")

    side_by_side(one, [k for k in range(len(planned)) if not store.answered(k)], at_once)


def side_by_side(one: Callable[[int], None], todo: Sequence[int], at_once: int) -> None:
    """Call a function for each case, some at once: what it waits for are processes of its own."""
    if at_once <= 1:
        for k in todo:
            one(k)
        return
    with ThreadPoolExecutor(at_once) as pool:
        waiting = [pool.submit(one, k) for k in todo]
        try:
            for outcome in as_completed(waiting):
                outcome.result()
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise


def call_command(command: list[str]) -> tuple[int, str]:
    """Run a command in a process of its own: exit status, and what it said on standard error."""
    done = subprocess.run(command, capture_output=True, text=True, check=False, preexec_fn=_ended_with_this_one())
    return done.returncode, done.stderr


def _ended_with_this_one() -> Callable[[], None] | None:
    """On Linux: has the kernel end a process when this one is gone, so that none goes on writing into the run."""
    if sys.platform != "linux":
        return None
    libc = ctypes.CDLL(None)
    return lambda: libc.prctl(_END_WITH_PARENT, signal.SIGKILL)


def facts(
    count: int,
    seed: int,
    only: Sequence[str],
    settings: Sequence[str],
    rates: Sequence[float] = (),
    trials: int = cases.TRIALS,
    seconds: float | None = None,
) -> dict[str, Any]:
    """What decides a run's recordings."""
    drawn = {"cases": count, "seed": seed, "kinds": list(only), "settings": list(settings)}
    return {**drawn, "rates": list(rates), "trials": trials, "seconds": seconds, "version": cases.VERSION}

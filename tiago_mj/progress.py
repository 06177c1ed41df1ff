"""How far a long command is: its stage, the share done, the time left, on standard error.

On a terminal one line lives as long as the work does (rich, where it is installed); elsewhere, in a log, a plain line
comes every few seconds, also while a stage does not advance. What is over at once says nothing.

    with Progress("diagnose", quiet=arguments.json) as progress:
        progress.stage("screening", total=60)
        progress.advance(3)
"""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from types import TracebackType
from typing import Any, Final, TextIO

#: Seconds until the first line of a log, and between two: a little less than the five that nobody waits in silence.
FIRST: Final = 2.0
EVERY: Final = 4.5
#: Seconds between two pictures of the line on a terminal.
LOOK: Final = 0.25
#: A stage shorter than this [s] is not shown on a terminal, where it would be gone before anybody has read it.
SETTLED: Final = 0.6
#: A stage so young [s] has no speed yet, from which to tell the time left.
YOUNG: Final = 1.0


class Progress:
    """What is done and how long it takes yet. Any thread may call its methods."""

    def __init__(
        self,
        name: str = "",
        *,
        quiet: bool = False,
        weights: Mapping[str, float] | None = None,
        budget: float | None = None,
        every: float = EVERY,
        console: Any = None,
        stream: TextIO | None = None,
    ) -> None:
        """Prepare it; nothing is shown before the context is entered.

        Args:
            name: what the lines begin with, such as ``"diagnose"``.
            quiet: show nothing, as a command does that prints JSON.
            weights: stages in their order, and how long each takes next to the others; share and time left are then
                those of the whole, otherwise those of the stage. A stage that is left out counts as done.
            budget: seconds after which the work ends in any case.
            every: seconds between two lines of a log.
            console: a ``rich.console.Console`` to show the line on; one of ``stream`` if None.
            stream: where lines are written; standard error as it is now if None.
        """
        self._name, self._quiet, self._every, self._budget = name, quiet, every, budget
        self._weights = dict(weights or {})
        self._stream = stream or sys.stderr
        self._console = None if quiet else console or _terminal(self._stream)
        self._lock = threading.Lock()
        self._over = threading.Event()
        self._shower: threading.Thread | None = None
        self._stage, self._note, self._done = "", "", 0
        self._total: int | None = None
        self._share_before = 0.0
        self._shown: tuple[str, str] | None = None
        self._began = self._stage_began = time.monotonic()

    def __enter__(self) -> Progress:
        self._began = self._stage_began = time.monotonic()
        if not self._quiet:
            show = self._live if self._console is not None else self._lines
            self._shower = threading.Thread(target=show, name="progress", daemon=True)
            self._shower.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, fault: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._over.set()
        if self._shower is not None:
            self._shower.join()

    def stage(self, name: str, total: int | None = None, *, done: int = 0) -> None:
        """Begin a stage of so many steps (None: not known); the one before counts as done.

        ``done`` of its steps were done by an earlier run, and tell nothing of the speed of this one.
        """
        with self._lock:
            self._stage, self._total, self._done, self._note = name, total, done, ""
            self._share_before = self._share() or 0.0 if done else 0.0
            self._stage_began = time.monotonic()

    def advance(self, steps: int = 1) -> None:
        """So many more steps of the stage are done.

        Raises:
            RuntimeError: no stage has begun.
        """
        with self._lock:
            self._check_begun()
            self._done += steps

    def at(self, done: int, note: str = "") -> None:
        """So many steps of the stage are done in all; ``note`` is told beside it.

        Raises:
            RuntimeError: no stage has begun.
        """
        with self._lock:
            self._check_begun()
            self._done, self._note = done, note

    def said(self) -> str:
        """The line as it is now: ``diagnose: screening 34 of 154, 22 %, about 25 s left``."""
        with self._lock:
            now = time.monotonic()
            told = [self._stage or "beginning"]
            if self._total:
                told[0] += f" {min(self._done, self._total)} of {self._total}"
            share = self._share()
            left = self._left(share, now)
            if share is not None:
                told.append(f"{100 * share:.0f} %")
            told.append(f"{seconds(now - self._began)} so far" if left is None else f"about {seconds(left)} left")
            if self._note:
                told.append(self._note)
            return (f"{self._name}: " if self._name else "") + ", ".join(told)

    def settled(self) -> str:
        """The line for a screen that is drawn again and again: as before, while a new stage is too young to be read."""
        line = self.said()
        with self._lock:
            young = time.monotonic() - self._stage_began < SETTLED
            if self._shown and young and self._stage != self._shown[0]:
                return self._shown[1]
            self._shown = (self._stage, line)
        return line

    def _check_begun(self) -> None:
        if not self._stage:
            raise RuntimeError("progress before its first stage: call stage(name, total) first")

    def _share(self) -> float | None:
        """Share done, of the whole where stages have weights, else of the stage; None: not known."""
        within = min(self._done / self._total, 1.0) if self._total else None
        if self._stage not in self._weights:
            return None if self._weights else within
        order = list(self._weights)
        before = sum(self._weights[name] for name in order[: order.index(self._stage)])
        return (before + (within or 0.0) * self._weights[self._stage]) / sum(self._weights.values())

    def _left(self, share: float | None, now: float) -> float | None:
        """Seconds left, at the speed until now; None: not known."""
        past = now - (self._began if self._weights else self._stage_began)
        new = (share or 0.0) - self._share_before
        left = past * (1.0 - (share or 0.0)) / new if new > 0.0 and past >= YOUNG else None
        if self._budget is not None:
            rest = max(self._budget - (now - self._began), 0.0)
            left = rest if left is None else min(left, rest)
        return left

    def _lines(self) -> None:
        wait = min(FIRST, self._every)
        while not self._over.wait(wait):
            try:
                print(self.said(), file=self._stream, flush=True)
            except (OSError, ValueError):  # nobody reads any more, which is no reason to stop the work
                return
            wait = self._every

    def _live(self) -> None:
        from rich.live import Live
        from rich.spinner import Spinner
        from rich.text import Text

        spinner = Spinner("dots")
        # What the work prints on standard output stays there: it may be a file.
        with Live(spinner, console=self._console, auto_refresh=False, transient=True, redirect_stdout=False) as live:
            while not self._over.wait(LOOK):
                spinner.update(text=Text(self.settled()))
                live.refresh()


@contextmanager
def told(name: str, stage: str, total: int | None = None, *, quiet: bool = False) -> Iterator[Progress]:
    """Progress of work that is one stage."""
    with Progress(name, quiet=quiet) as progress:
        progress.stage(stage, total)
        yield progress


def seconds(amount: float) -> str:
    """A time as people say it: ``25 s``, ``3 min 20 s``, ``40 min``, ``2.5 h``."""
    if amount < 90:
        return f"{amount:.0f} s"
    if amount < 600:
        return f"{amount // 60:.0f} min {amount % 60:02.0f} s" if amount % 60 < 59.5 else f"{amount / 60:.0f} min"
    return f"{amount / 60:.0f} min" if amount < 5400 else f"{amount / 3600:.1f} h"


def _terminal(stream: TextIO) -> Any:
    """A console that can show a line that changes; None where there is none."""
    if not stream.isatty():
        return None
    try:
        from rich.console import Console
    except ModuleNotFoundError:
        return None
    console = Console(file=stream)
    return console if console.is_interactive else None

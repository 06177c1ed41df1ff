"""How far a long command is: its stage, the share done, the time left, on standard error.

On a terminal one line lives as long as the work does (rich, where it is installed); elsewhere, in a log, a plain line
comes every few seconds, and ever more rarely while there is nothing new to say. What is over at once says nothing.

    with Progress("diagnose", quiet=arguments.json) as progress:
        progress.stage("screening", total=60)
        progress.advance(3)
"""

from __future__ import annotations

import math
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import TracebackType
from typing import Any, Final, TextIO

#: Seconds until the first line of a log, and between two: a little less than the five that nobody waits in silence.
FIRST: Final = 2.0
EVERY: Final = 4.5
#: Seconds between two lines at most while there is nothing to say but that time has passed: the wait doubles up to it.
LONGEST: Final = 27.0
#: Share of work whose amount is an expectation, at most: it is over when it is over.
ALMOST: Final = 0.99
#: Seconds between two pictures of the line on a terminal.
LOOK: Final = 0.25
#: A stage shorter than this [s] is not shown on a terminal, where it would be gone before anybody has read it.
SETTLED: Final = 0.6
#: A stage so young [s] has no speed yet, from which to tell the time left.
YOUNG: Final = 1.0


class Estimate:
    """Share done and time left of work whose total becomes known only during the work."""

    def __init__(self) -> None:
        self.share = 0.0
        self._began: tuple[float, float] | None = None
        self._at = (0.0, 0.0)
        self._left: float | None = None

    def worked(self, done: float, left: float | None, now: float) -> None:
        """So much is done in all at an instant [s], so much expected to be left, in the same unit (None: unknown)."""
        if self._began is None:
            self._began = self._at = (now, done)
        new = max(done - self._at[1], 0.0)
        if left is not None and new > 0.0:
            self.share = min(self.share + (1.0 - self.share) * (new / (new + max(left, 0.0))), 1.0)
        self._at, self._left = (now, max(done, self._at[1])), left

    def seconds_left(self, now: float) -> float | None:
        """Seconds left, at the average speed until the last report; None: not known."""
        if self._began is None or self._left is None:
            return None
        took, did = self._at[0] - self._began[0], self._at[1] - self._began[1]
        if took < YOUNG or did <= 0.0:
            return None
        left = max(self._left, 0.0) * took / did
        if not math.isfinite(left):  # so little was done that it tells no speed
            return None
        return left / (1.0 + max(now - self._at[0], 0.0) / left) if left > 0.0 else 0.0


class Progress:
    """Progress display of a command. Its methods may be called from any thread."""

    def __init__(
        self,
        name: str = "",
        *,
        quiet: bool = False,
        budget: float | None = None,
        every: float = EVERY,
        console: Any = None,
        stream: TextIO | None = None,
    ) -> None:
        """Prepare it; nothing is shown before the context is entered.

        Args:
            name: what the lines begin with, such as ``"diagnose"``.
            quiet: show nothing, as a command does that prints JSON.
            budget: seconds after which the work ends in any case.
            every: seconds between two lines of a log.
            console: a ``rich.console.Console`` to show the line on; one of ``stream`` if None.
            stream: where lines are written; standard error as it is now if None.
        """
        self._name, self._quiet, self._every, self._budget = name, quiet, every, budget
        self._whole: Estimate | None = None
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

    def stage(self, name: str, total: int | None = None, *, done: int = 0, part: bool = False) -> None:
        """Begin a stage of so many steps (None: not known); the one before counts as done.

        ``done`` of its steps were done by an earlier run, and tell nothing of the speed of this one. ``part``: it is
        part of what :meth:`worked` tells of, whose share and time left go on.
        """
        with self._lock:
            self._whole = self._whole if part else None
            self._stage, self._total, self._done, self._note = name, total, done, ""
            self._share_before = self._share() or 0.0 if done else 0.0
            self._stage_began = time.monotonic()

    def advance(self, steps: int = 1) -> None:
        """Add steps to those done in the stage.

        Raises:
            RuntimeError: no stage has begun.
        """
        with self._lock:
            self._check_begun()
            self._done += steps

    def at(self, done: int, note: str = "") -> None:
        """Set the number of steps done in the stage; ``note`` is shown beside it.

        Raises:
            RuntimeError: no stage has begun.
        """
        with self._lock:
            self._check_begun()
            self._done, self._note = done, note

    def worked(self, done: float, left: float | None) -> None:
        """So much is done of all stages together, and so much expected to be left, in the same unit; None: not known.

        Share and time left are then those of the whole, for as long as stages are parts of it.

        Raises:
            RuntimeError: no stage has begun.
        """
        with self._lock:
            self._check_begun()
            self._whole = self._whole or Estimate()
            self._whole.worked(done, left, time.monotonic())

    def now(self) -> tuple[float | None, float | None]:
        """Share done, of the whole command if known (:meth:`worked`), else of the stage; and the seconds left."""
        with self._lock:
            share = self._share()
            return share, self._left(share, time.monotonic())

    def said(self) -> str:
        """The present line: ``diagnose: screening 34 of 154, 22 %, about 25 s left``."""
        with self._lock:
            now = time.monotonic()
            told = [self._stage or "beginning"]
            if self._total:
                told[0] += f" {min(self._done, self._total)} of {self._total}"
            share = self._share()
            left = self._left(share, now)
            if share is not None:
                told.append(_percent(share))
            told.append(f"{seconds(now - self._began)} so far" if left is None else f"about {seconds(left)} left")
            if self._note:
                told.append(self._note)
            return (f"{self._name}: " if self._name else "") + ", ".join(told)

    def settled(self) -> str:
        """The line for a screen that is redrawn often: unchanged while a new stage is too young to be read."""
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
        """Share done, of the whole where it is known, else of the stage; None: not known."""
        if self._whole is not None:
            return min(self._whole.share, ALMOST) if self._whole.share else None
        return min(self._done / self._total, 1.0) if self._total else None

    def _left(self, share: float | None, now: float) -> float | None:
        """Seconds left, at the speed until now; None: not known."""
        if self._whole is not None:
            left = self._whole.seconds_left(now)
        else:
            past, new = now - self._stage_began, (share or 0.0) - self._share_before
            left = past * (1.0 - (share or 0.0)) / new if new > 0.0 and past >= YOUNG else None
        if self._budget is not None:
            rest = max(self._budget - (now - self._began), 0.0)
            left = rest if left is None else min(left, rest)
        return left

    def _lines(self) -> None:
        wait, silent, patience = min(FIRST, self._every), 0.0, self._every
        before: set[tuple[str, str, str]] = set()  # a stage that comes again with the same share is no news
        last = ""
        while not self._over.wait(wait):
            silent, wait = silent + wait, self._every
            told = self._news()
            if told in before and silent < patience:
                continue
            patience = 2.0 * (patience if told in before else self._every)
            patience = min(patience, max(LONGEST, self._every))
            before.add(told)
            silent, line = 0.0, self.said()
            same, last = line == last, line
            if same:  # that the work goes on is all there is to say
                line = f"{line}, {seconds(time.monotonic() - self._began)} so far"
            try:
                print(line, file=self._stream, flush=True)
            except (OSError, ValueError):  # nobody reads any more, which is no reason to stop the work
                return

    def _news(self) -> tuple[str, str, str]:
        """What of the line is no mere time: stage, note, and the share, or else the steps."""
        with self._lock:
            share = self._share()
            return self._stage, self._note, str(self._done) if share is None else _percent(share)

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
    """Progress of work with a single stage."""
    with Progress(name, quiet=quiet) as progress:
        progress.stage(stage, total)
        yield progress


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %"


def seconds(amount: float) -> str:
    """A duration in words: ``25 s``, ``3 min 20 s``, ``40 min``, ``2.5 h``."""
    if amount < 90:
        return f"{amount:.0f} s"
    if amount < 600:
        return f"{amount // 60:.0f} min {amount % 60:02.0f} s" if amount % 60 < 59.5 else f"{amount / 60:.0f} min"
    return f"{amount / 60:.0f} min" if amount < 5400 else f"{amount / 3600:.1f} h"


def _terminal(stream: TextIO) -> Any:
    """A console that can redraw a line; None where there is none."""
    if not stream.isatty():
        return None
    try:
        from rich.console import Console
    except ModuleNotFoundError:
        return None
    console = Console(file=stream)
    return console if console.is_interactive else None

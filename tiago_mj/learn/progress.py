"""How far a training of several seeds is: each seed reports to a small file, which whoever started it shows."""

from __future__ import annotations

import json
import sys
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

from tiago_mj import atomic

FILE: Final = "progress.json"
#: Seconds between looks, on a terminal and elsewhere.
LOOK, LINE = 0.5, 60.0


def report(folder: Path, facts: Mapping[str, Any]) -> None:
    """Say how far a seed is."""
    atomic.write_text(folder / FILE, json.dumps(dict(facts)))


def look(folder: Path) -> dict[str, Any]:
    """What a seed said last; nothing where it has not said anything."""
    try:
        facts: dict[str, Any] = json.loads((folder / FILE).read_text())
        return facts
    except (OSError, ValueError):
        return {}


@contextmanager
def shown(folders: Sequence[Path], total: int, *, quiet: bool) -> Iterator[None]:
    """Show progress on stderr while the block runs: a bar a seed on a terminal, elsewhere a line a minute.

    Args:
        folders: of the seeds.
        total: environment steps of each.
        quiet: show nothing.
    """
    if quiet:
        yield
        return
    over = threading.Event()
    show = _bars if sys.stderr.isatty() and _has_rich() else _lines
    shower = threading.Thread(target=show, args=(folders, total, over), daemon=True)
    shower.start()
    try:
        yield
    finally:
        over.set()
        shower.join()


def _has_rich() -> bool:
    try:
        import rich.progress  # noqa: F401
    except ModuleNotFoundError:
        return False
    return True


def _bars(folders: Sequence[Path], total: int, over: threading.Event) -> None:
    from rich import progress
    from rich.console import Console

    columns = (
        progress.TextColumn("{task.description}"),
        progress.BarColumn(),
        progress.MofNCompleteColumn(),
        progress.TimeRemainingColumn(),
        progress.TextColumn("{task.fields[said]}"),
    )
    with progress.Progress(*columns, console=Console(stderr=True)) as bars:
        rows = [bars.add_task(folder.name, total=total, said="") for folder in folders]
        while True:
            last = over.wait(LOOK)
            for row, folder in zip(rows, folders, strict=True):
                facts = look(folder)
                bars.update(row, completed=min(facts.get("steps", 0), total), said=_said(facts))
            if last:
                return


def _lines(folders: Sequence[Path], total: int, over: threading.Event) -> None:
    begun, last = time.monotonic(), False
    while not last:
        last = over.wait(LINE)
        if not last:
            told = ", ".join(f"{folder.name} {_share(look(folder), total)}" for folder in folders)
            print(f"{time.monotonic() - begun:.0f} s: {told}", file=sys.stderr, flush=True)


def _share(facts: Mapping[str, Any], total: int) -> str:
    return f"{100 * facts.get('steps', 0) / total:.0f} % {_said(facts)}".strip()


def _said(facts: Mapping[str, Any]) -> str:
    mean, rate = facts.get("mean_return"), facts.get("success_rate")
    if mean is None:
        return ""
    return f"return {mean:.1f}" + (f", success {rate:.2f}" if rate is not None else "")

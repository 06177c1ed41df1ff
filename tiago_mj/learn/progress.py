"""Progress of a training of several seeds: each seed writes a small file, which the parent process displays."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

from pydantic import Field

from tiago_mj.io import atomic
from tiago_mj.io.loading import load_json
from tiago_mj.io.progress import EVERY, Progress
from tiago_mj.io.schema import Open, checked

FILE: Final = "progress.json"
#: Seconds between looks at what the seeds say.
LOOK: Final = 0.5


def report(folder: Path, facts: Mapping[str, Any]) -> None:
    """Write the progress of a seed."""
    atomic.write_text(folder / FILE, json.dumps(dict(facts)))


class _Facts(Open):
    steps: int = Field(default=0, ge=0)
    mean_return: float | None = None
    success_rate: float | None = None


def look(folder: Path) -> dict[str, Any]:
    """Last reported progress of a seed; empty where its file is missing or unreadable."""
    try:
        return checked(_Facts, load_json(folder / FILE, FILE)).model_dump()
    except ValueError:
        return {}


def steps(folder: Path) -> int:
    """Environment steps that a seed has reported."""
    return int(look(folder).get("steps", 0))


@contextmanager
def shown(folders: Sequence[Path], total: int, *, quiet: bool, every: float = EVERY) -> Iterator[None]:
    """Show progress on stderr while the block runs: how far all seeds are, and what each one's episodes return.

    Args:
        folders: of the seeds.
        total: environment steps of each.
        quiet: show nothing.
        every: seconds between two lines of a log.
    """
    over = threading.Event()
    with Progress("train", quiet=quiet, every=every) as progress:
        # What was trained before this run counts as done, and says nothing of the speed.
        begun = sum(min(steps(folder), total) for folder in folders)
        progress.stage("steps", total * len(folders), done=begun)
        watcher = threading.Thread(target=_watch, args=(progress, folders, total, over), daemon=True)
        watcher.start()
        try:
            yield
        finally:
            over.set()
            watcher.join()


def _watch(progress: Progress, folders: Sequence[Path], total: int, over: threading.Event) -> None:
    """Display what the seeds report."""
    last = False
    while not last:
        facts = [look(folder) for folder in folders]
        told = (f"{folder.name} {_share(one, total)}" for folder, one in zip(folders, facts, strict=True))
        progress.at(sum(min(one.get("steps", 0), total) for one in facts), ", ".join(told))
        last = over.wait(LOOK)


def _share(facts: Mapping[str, Any], total: int) -> str:
    return f"{100 * facts.get('steps', 0) / total:.0f} % {_said(facts)}".strip()


def _said(facts: Mapping[str, Any]) -> str:
    mean, rate = facts.get("mean_return"), facts.get("success_rate")
    if mean is None:
        return ""
    return f"return {mean:.1f}" + (f", success {rate:.2f}" if rate is not None else "")

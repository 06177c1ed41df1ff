"""Processor, cores and versions that a benchmark ran on, and the file that its figures are written to."""

from __future__ import annotations

import json
import os
import platform
import subprocess
import sys
from pathlib import Path
from typing import Any

import mujoco

from tiago_mj import __version__

RESULTS = Path(__file__).parent / "results"


def machine() -> dict[str, Any]:
    """Processor, cores, system, versions and commit: what a figure needs beside it. No name, path or kernel of it."""
    processor = platform.processor() or platform.machine()
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.exists():
        lines = (line for line in cpuinfo.read_text().splitlines() if line.startswith("model name"))
        processor = next(lines, processor).split(":")[-1].strip()
    return {
        "processor": processor,
        "cores": len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count(),
        "system": platform.system(),
        "python": platform.python_version(),
        "mujoco": mujoco.__version__,
        "tiago_mj": __version__,
        "commit": _git("rev-parse", "--short", "HEAD") + ("+changes" if _git("status", "--porcelain", "-uno") else ""),
    }


def save(name: str, results: Any, command: str | None = None) -> Path:
    """Write ``results/NAME.json`` with the machine and the command that makes it."""
    RESULTS.mkdir(exist_ok=True)
    path = RESULTS / f"{name}.json"
    made_by = command or f"python benchmarks/{Path(sys.argv[0]).name} {' '.join(sys.argv[1:])}".strip()
    path.write_text(json.dumps({"command": made_by, "machine": machine(), "results": results}, indent=1) + "\n")
    return path


def _git(*words: str) -> str:
    done = subprocess.run(["git", *words], cwd=Path(__file__).parent, capture_output=True, text=True, check=False)
    return done.stdout.strip()

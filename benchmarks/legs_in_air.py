"""Twelve joints of a Unitree Go2 in the air, diagnosed with its four like legs apart.

    python benchmarks/legs_in_air.py --data DIR --out RUN

DIR holds ``go2/in_air.csv`` and ``go2/go2.xml`` (docs/real-data.md says where they are from): goals and angles, 23.5 s
at 200 Hz, with the gains of the collection's configuration. Writes ``results/legs_in_air.json``: the verdict, what the
like legs share, and how long it took, by the clock and of the processors.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import time
from pathlib import Path

from machine import save

GAINS, LEGS = "20,1.5", "FL,FR,RL,RR"


def main() -> None:
    """Diagnose, and keep the answer."""
    parser = argparse.ArgumentParser(description="Twelve joints of a Go2 in the air.")
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--out", type=Path, required=True)
    asked = parser.parse_args()
    folder = asked.data / "go2"
    words = ["diagnose", str(folder / "in_air.csv"), "--model", str(folder / "go2.xml"), "--fix-base"]
    words += ["--gains", GAINS, "--like", LEGS, "--jobs", "2", "--out", str(asked.out)]
    begun = time.monotonic()
    subprocess.run([sys.executable, "-m", "tiago_mj.cli", *words], check=True)
    wall, used = time.monotonic() - begun, resource.getrusage(resource.RUSAGE_CHILDREN)
    found = json.loads((asked.out / "diagnosis.json").read_text())
    kept = ("headline", "verdict", "like", "numbers", "shrink", "complete", "physics_steps", "notes")
    results = {
        **{key: found[key] for key in kept},
        "seconds": round(wall, 1),
        "processor_seconds": round(used.ru_utime + used.ru_stime, 1),
        "load_after": [round(value, 1) for value in os.getloadavg()],
        "options": words[4:-2],
    }
    print(save("legs_in_air", results, "python benchmarks/legs_in_air.py --data DIR --out RUN"))


if __name__ == "__main__":
    main()

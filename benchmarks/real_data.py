"""The diagnoses of docs/real-data.md, made again from the public recordings, and a table of what they say.

    python benchmarks/real_data.py --data DIR --out RUNS [--only xl330,arm,ta11,so101] [--jobs 1]

DIR holds the recordings as they were published: ``force_vs_displacement.csv``, ``tiago_arm``, ``xl330_pendulum``,
``xl330_pendulum_high_gain`` and ``so101`` (docs/real-data.md says where each is from). Each is imported and diagnosed
with the command line, as the page has it; a diagnosis that lies in RUNS already is not made again. Writes
``results/real_data.json``, a page at a time: what was not asked for keeps the figures that it had.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from machine import RESULTS, machine, save

#: What is left out of the library where the published values of the XL-330 are compared with.
OTHER_FRICTION: Final = (
    "load_dependent_friction,stribeck_friction,asymmetric_friction,motor_cogging,clock_offset,gravity_tilt,payload"
)
SERIES: Final = ("A-wood", "A-pringles", "A-glue", "A-sponge", "B-wood", "B-sponge")
JOINTS: Final = ("Rotation", "Pitch", "Elbow", "Wrist_Pitch", "Wrist_Roll", "Jaw")


@dataclass(frozen=True)
class Asked:
    """One diagnosis.

    Attributes:
        name: of the diagnosis.
        recordings: patterns below the folder of imported recordings.
        options: further words of ``tiago-mj diagnose``.
    """

    name: str
    recordings: tuple[str, ...]
    options: tuple[str, ...] = ()


@dataclass(frozen=True)
class Page:
    """One section of the page.

    Attributes:
        imports: words of ``tiago-mj import`` before ``--out``, and the folder that it writes; ``DIR/`` is the data's.
        diagnoses: what is asked of it.
    """

    imports: tuple[tuple[tuple[str, ...], str], ...]
    diagnoses: tuple[Asked, ...]


PAGES: Final[Mapping[str, Page]] = {
    "xl330": Page(
        (
            (("xl330", "DIR/xl330_pendulum"), "xl330"),
            (("xl330", "DIR/xl330_pendulum_high_gain"), "xl330_high"),
        ),
        (
            Asked("gains 100 and 200", ("xl330",)),
            Asked("the same, constant friction only", ("xl330",), ("--without", OTHER_FRICTION)),
            Asked("gain 400", ("xl330_high/*-kp400.parquet",)),
            Asked("gain 800", ("xl330_high/*-kp800.parquet",)),
            Asked("gains 400 and 800", ("xl330_high",)),
        ),
    ),
    "arm": Page(((("tiago-arm", "DIR/tiago_arm"), "arm"),), (Asked("arm", ("arm",)),)),
    "ta11": Page(
        (
            (("ta11-curve", "DIR/force_vs_displacement.csv"), "ta11"),
            (("ta11-curve", "DIR/force_vs_displacement.csv", "--slope", "165"), "half"),
        ),
        (
            *(Asked(series, (f"ta11/{series}",)) for series in SERIES),
            *(Asked(f"{series}, half the slope", (f"half/{series}",)) for series in SERIES[:2]),
        ),
    ),
    "so101": Page(
        ((("so101", "DIR/so101", "--apart"), "joints"),),
        tuple(
            Asked(f"{joint}, {half}", (f"joints/{joint}/multisine-*[{of}].parquet",
                                       f"joints/{joint}/friction_gravity-*[{of}].parquet"))
            for joint in JOINTS
            for half, of in (("odd", "13579"), ("even", "02468"))
        ),
    ),
}  # fmt: skip


def summary(found: Mapping[str, Any]) -> dict[str, Any]:
    """Of a ``diagnosis.json`` what the page's tables have."""
    verdict, shrink = found["verdict"], found["shrink"]
    return {
        "verdict": verdict["kind"],
        "probability": verdict["probability"],
        "remains": verdict["remains"]["flag"],
        "named": [_effect(one) for one in verdict["effects"]],
        "ranking": [
            {"effects": [one["name"] for one in row["effects"]], "probability": row["probability"]}
            for row in found["ranking"][:4]
        ],
        **{key: shrink[key] for key in ("before", "after", "closed", "low", "high")},
        "seconds": found["seconds"],
        "physics_steps": found["physics_steps"],
    }


def _effect(one: Mapping[str, Any]) -> dict[str, Any]:
    numbers = {name: {k: told[k] for k in ("value", "low", "high", "unit")} for name, told in one["parameters"].items()}
    return {"name": one["name"], "target": one["target"], "parameters": numbers}


def line(name: str, row: Mapping[str, Any]) -> str:
    """One diagnosis as a line of a table."""
    named = "; ".join(
        f"{one['name']} of {one['target']} "
        + ", ".join(
            f"{t['value']:.3g} {t['unit']} ({t['low']:.3g} to {t['high']:.3g})" for t in one["parameters"].values()
        )
        for one in row["named"]
    )
    closed = "–"
    if row["closed"] is not None:
        closed = "{:.0f} % ({:.0f}–{:.0f})".format(*(100 * row[key] for key in ("closed", "low", "high")))
    cells = (
        name,
        f"`{row['verdict']}`" + ("" if row["probability"] is None else f", {100 * row['probability']:.0f} %"),
        named or "–",
        ", ".join("–" if row[key] is None else f"{row[key]:.3g}" for key in ("before", "after")),
        closed,
        f"{row['seconds']:.0f}",
    )
    return f"| {' | '.join(cells)} |"


def _call(words: Sequence[str]) -> None:
    done = subprocess.run([sys.executable, "-m", "tiago_mj.cli", *words], capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"tiago-mj {' '.join(words)}: {done.stderr.strip()}")


def made(page: Page, data: Path, out: Path, jobs: int) -> dict[str, Any]:
    """Import and diagnose what is not there yet; a row for each diagnosis."""
    for words, name in page.imports:
        if not (out / name).exists():
            _call(["import", *(w.replace("DIR", str(data), 1) if w.startswith("DIR/") else w for w in words),
                   "--out", str(out / name)])  # fmt: skip

    def diagnosed(asked: Asked) -> dict[str, Any]:
        folder = out / "diagnoses" / asked.name.replace(" ", "-").replace(",", "")
        if not (folder / "diagnosis.json").exists():
            paths = [str(path) for pattern in asked.recordings for path in sorted(out.glob(pattern))]
            if not paths:
                raise SystemExit(f"{asked.name}: nothing matches {', '.join(asked.recordings)} in {out}")
            begun = time.monotonic()
            _call(["diagnose", *paths, *asked.options, "--jobs", "1", "--out", str(folder)])
            print(f"{asked.name}: {time.monotonic() - begun:.0f} s", file=sys.stderr, flush=True)
        return summary(json.loads((folder / "diagnosis.json").read_text()))

    with ThreadPoolExecutor(jobs) as pool:
        return dict(zip((asked.name for asked in page.diagnoses), pool.map(diagnosed, page.diagnoses), strict=True))


def main() -> None:
    """Make, print, save."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--data", type=Path, required=True, help="folder of the published recordings")
    parser.add_argument("--out", type=Path, required=True, help="folder for imported recordings and diagnoses")
    parser.add_argument("--only", default=",".join(PAGES), help=f"some of {','.join(PAGES)}")
    parser.add_argument("--jobs", type=int, default=1, help="diagnoses at once")
    asked = parser.parse_args()
    chosen = [name.strip() for name in asked.only.split(",")]
    if unknown := [name for name in chosen if name not in PAGES]:
        parser.error(f"{unknown[0]!r} is unknown: use some of {', '.join(PAGES)}")
    path = RESULTS / "real_data.json"
    results = json.loads(path.read_text())["results"] if path.exists() else {}
    for name in chosen:
        rows = made(PAGES[name], asked.data, asked.out, asked.jobs)
        results[name] = {"machine": machine(), "rows": rows}
        print(f"\n{name}\n\n| | verdict | named (90 %) | gap before, after | closed | s |\n|---|---|---|---|---|---|")
        print("\n".join(line(*row) for row in rows.items()), flush=True)
        save("real_data", results, f"python benchmarks/real_data.py --data DIR --out RUNS --only {','.join(PAGES)}")


if __name__ == "__main__":
    main()

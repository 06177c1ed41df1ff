"""Write the measured speeds into docs/speed.md.

    python benchmarks/speed_tables.py

Every table stands between two comments that name its results file and is made of nothing else; a table whose file is
missing stays as it is. Figures that are older than the last two releases are named at the end: measure them again.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from machine import RESULTS

ROOT = Path(__file__).parents[1]
PAGES = (ROOT / "docs" / "speed.md",)
CHANGELOG = ROOT / "CHANGELOG.md"
#: Of figures that were measured before their version was recorded.
FIRST_VERSION = "0.1.0"


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def made_on(found: dict[str, Any]) -> str:
    machine = found["machine"]
    return (
        f"`{found['command']}` on {machine['cores']} cores of an {machine['processor']}, Python {machine['python']}, "
        f"mujoco {machine['mujoco']}, commit {machine['commit']}."
    )


def steps(found: dict[str, Any]) -> str:
    rows = []
    for name, row in found["results"].items():
        for load in ("random", "grasp"):
            f = row["loads"][load]
            rows.append(
                [
                    f"`{name}`",
                    load,
                    f"{f['scalar_steps_per_second']:,.0f} ({f['scalar_share']:.0%})",
                    f"{f['vector_steps_per_second']:,.0f} ({f['vector_share_of_limit']:.0%})",
                    f"{f['reset_ms']:.2f} ms",
                    f"{row['scalar_mb']:.0f} MB",
                    f"{row['mb_per_simulation'] * 1e3:.0f} kB",
                ]
            )
    first = next(iter(found["results"].values()))
    scalar = "scalar [steps/s] (of MuJoCo alone)"
    vector = f"vector, {first['num_envs']} simulations [steps/s] (of the limit)"
    return table(("environment", "load", scalar, vector, "reset", "memory, scalar", "more a simulation"), rows)


def scaling(found: dict[str, Any]) -> str:
    parts = []
    for name, row in found["results"].items():
        threads = sorted({r["threads"] for r in row["rows"]})
        cells = {(r["threads"], r["num_envs"]): r for r in row["rows"]}
        rows = []
        for count in sorted({r["num_envs"] for r in row["rows"]}):
            texts = []
            for t in threads:
                cell = cells.get((t, count))
                texts.append(f"{cell['steps_per_second']:,.0f} ({cell['share_of_limit']:.0%})" if cell else "")
            rows.append([str(count), *texts])
        alone = row["mujoco_alone_steps_per_second"]
        parts.append(
            f"`{name}`; MuJoCo alone on one thread: {alone:,.0f} control steps/s.\n\n"
            + table(["simulations", *(f"{t} thread{'s' * (t > 1)}" for t in threads)], rows)
        )
    return "\n\n".join(parts)


def peers(found: dict[str, Any]) -> str:
    rows = []
    for label, row in found["results"]["rows"].items():
        ratio = f"{row['times']:.1f} × {row['beside']}" if row["times"] else ""
        reset = f"{row['reset_ms']:.2f} ms" if "reset_ms" in row else ""
        faster = f" ({row['reset_times_faster']:.0f} × faster)" if row["reset_times_faster"] else ""
        many = f"{row['num_envs']}" if row["num_envs"] > 1 else ""
        rate = f"{row['steps_per_second']:,.0f}"
        rows.append([label, many, rate, f"{row['times_real_time']:,.0f}", ratio, reset + faster])
    return table(("contender", "at once", "steps/s", "× real time", "ratio", "reset"), rows)


def warp(found: dict[str, Any]) -> str:
    results = found["results"]
    rows = []
    for label, key in (("MuJoCo Warp", "agreement"), ("the CPU, rounded to single precision", "cpu_rounded")):
        f = results[key]
        forces = [f"{f[name]:.2%}" for name in ("force_rms", "force_p95", "held_force_worst")]
        rows.append([label, *forces, f"{f['finger_worst_metres'] * 1e6:.0f} µm", f"{f['diverged']:.0f}"])
    head = (
        "against the CPU",
        "force rms",
        "force, 95 % of the steps",
        "held force, worst",
        "fingers, worst",
        "diverged",
    )
    return (
        f"{results['worlds']} grippers on one {results['device']} (mujoco-warp {results['mujoco_warp']}, "
        f"{results['memory_mb']:.0f} MB): {results['steps_per_second']:,.0f} control steps/s, "
        f"{results['times_one_thread']:.0f} times MuJoCo alone on one CPU thread.\n\n" + table(head, rows)
    )


#: Mark in a page: file of the results, and what makes a table of them.
TABLES: dict[str, tuple[str, Callable[[dict[str, Any]], str]]] = {
    "steps_per_second": ("steps_per_second", steps),
    "scaling": ("scaling", scaling),
    "peers": ("peers", peers),
    "warp": ("warp", warp),
}


def releases_since(found: dict[str, Any], changelog: str) -> list[str]:
    """Releases of the package after the version that a result was measured with, by the headings of a changelog."""
    measured = _numbers(found["machine"].get("tiago_mj", FIRST_VERSION))
    released = re.findall(r"^## \[?v?(\d+\.\d+\.\d+)\b", changelog, re.M)
    return [version for version in released if _numbers(version) > measured]


def _numbers(version: str) -> tuple[int, ...]:
    return tuple(int(number) for number in version.split("."))


def outdated(changelog: str) -> list[str]:
    """What is to be measured again: results of the tables that are older than the code by more than a release."""
    named = []
    for results in sorted({results for results, _ in TABLES.values()}):
        path = RESULTS / f"{results}.json"
        if path.exists() and len(since := releases_since(json.loads(path.read_text()), changelog)) > 1:
            named.append(f"{path.name}: {' and '.join(since)} came after it")
    return named


def remade(text: str) -> str:
    """A page with its tables made of the results."""
    for name, (results, make) in TABLES.items():
        path = RESULTS / f"{results}.json"
        mark = f"<!-- speed: {name} -->"
        if mark not in text or not path.exists():
            continue
        found = json.loads(path.read_text())
        body = f"{mark}\n{make(found)}\n\n{made_on(found)}\n<!-- speed: end -->"
        text = re.sub(re.escape(mark) + r".*?<!-- speed: end -->", lambda _, b=body: b, text, flags=re.S)
    return text


def main() -> None:
    for page in PAGES:
        page.write_text(remade(page.read_text(encoding="utf-8")), encoding="utf-8")
        print(page.name)
    for words in outdated(CHANGELOG.read_text(encoding="utf-8") if CHANGELOG.exists() else ""):
        print(f"outdated: {words}")


if __name__ == "__main__":
    main()

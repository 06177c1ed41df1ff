"""``python -m benchmarks.real``: what the cases are, where their recordings are from, and scores of answers."""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from benchmarks.machine import RESULTS, save
from benchmarks.real import baselines, kept, run, score, submit
from benchmarks.real.cases import CASES, SOURCES, absent, wrong
from benchmarks.real.declare import Case, seal

#: Folder of the recordings where no option gives one.
FOLDER: Final = "TIAGO_MJ_REALDATA"


def _chosen(words: str) -> list[Case]:
    names = list(CASES) if words == "all" else [word.strip() for word in words.split(",") if word.strip()]
    unknown = [name for name in names if name not in CASES]
    if unknown:
        raise ValueError(f"case {unknown[0]!r} is unknown: python -m benchmarks.real cases lists them")
    return [CASES[name] for name in names]


def _data(given: Path | None) -> Path:
    if given is None:
        if FOLDER not in os.environ:
            raise ValueError(f"no folder of recordings: give --data, or set {FOLDER}")
        given = Path(os.environ[FOLDER])
    if not given.is_dir():
        raise ValueError(f"{given}: no such folder: give the one that holds the recordings (fetch-list)")
    return given


def _cases(asked: argparse.Namespace) -> int:
    if asked.json:
        print(json.dumps({case.name: case.label() for case in CASES.values()}, indent=1))
        return 0
    for case in CASES.values():
        print(f"{case.name:32}{case.robot:17}{case.kind:18}{case.recording:10}{case.withheld}")
    robots = {case.robot for case in CASES.values()}
    print(f"{len(CASES)} cases of {len(robots)} robots; declarations {seal(list(CASES.values()))[:16]}")
    return 0


def _fetch_list(asked: argparse.Namespace) -> int:
    listed = [
        {
            "source": source.name,
            "licence": source.licence,
            "url": source.url(file),
            "place": file.place,
            "sha256": file.sha256,
        }
        for source in SOURCES.values()
        for file in source.files
    ]
    if asked.json:
        print(json.dumps(listed, indent=1))
        return 0
    for row in listed:
        print(f"{row['sha256']}  {row['place']}\n    {row['url']}")
    for source in SOURCES.values():
        print(f"{source.name}: {source.repository} at {source.commit}; {source.licence}")
    return 0


def _check(asked: argparse.Namespace) -> int:
    data, faults, total = _data(asked.data), 0, 0
    for source in SOURCES.values():
        for file in source.files:
            total += 1
            if said := wrong(data, file):
                faults += 1
                print(f"{file.place} {said}")
    able = sum(not absent(case, data) for case in CASES.values())
    print(f"{total - faults} of {total} files are as published; {able} of {len(CASES)} cases can be made")
    return 1 if faults else 0


def _convert(asked: argparse.Namespace) -> int:
    data = _data(asked.data)
    for case in _chosen(asked.case):
        folder = asked.out if asked.case == case.name else asked.out / case.name
        print(f"{case.name}: {run.convert(case, data, folder)}")
    return 0


def _run(asked: argparse.Namespace) -> int:
    data, cases = _data(asked.data), _chosen(asked.cases)
    print(f"declarations {run.begin(asked.out)}", flush=True)
    for case in cases:
        if missing := absent(case, data):
            print(f"{case.name}: left out, {missing[0].place} is not there", flush=True)
            continue
        told = run.diagnose(case, data, asked.out, jobs=asked.jobs, budget=asked.time_budget, told=asked.told)
        named = ", ".join((told["answer"] or {}).get("names", [])) or "-"
        kind = (told["answer"] or {}).get("kind", "failed")
        print(f"{case.name}: {kind}: {named}; {told['seconds']:.0f} s", flush=True)
    path = asked.out / "answers.json"
    path.write_text(submit.text(run.answers(asked.out, cases)))
    print(f"python -m benchmarks.real submit {path} scores them")
    return 0


def _baseline(asked: argparse.Namespace) -> int:
    data = _data(asked.data)
    found = baselines.answers(asked.method, _chosen(asked.cases), data, asked.out, lambda said: print(said, flush=True))
    if asked.save:
        path = RESULTS / f"{kept.BASELINES}.json"
        results = {**(kept.baselines() if path.exists() else {}), asked.method: found}
        whole = {method: results[method] for method in baselines.METHODS if method in results}
        print("wrote", save(kept.BASELINES, whole, "python -m benchmarks.real baseline METHOD OUT --data DIR --save"))
    return 0


def _table(asked: argparse.Namespace) -> int:
    del asked
    print(kept.table())
    return 0


def _submit(asked: argparse.Namespace) -> int:
    judged = submit.score(submit.read(asked.file))
    summary = score.summary(list(CASES.values()), judged)
    result = {
        "declarations": seal(list(CASES.values())),
        "summary": summary,
        "cases": {name: vars(one) for name, one in judged.items()},
    }
    if asked.save:
        print("wrote", save(f"real_{asked.save}", result, f"python -m benchmarks.real submit FILE --save {asked.save}"))
    if asked.json:
        print(json.dumps(result, indent=1))
        return 0
    for name, one in judged.items():
        why = "; ".join(
            f"{word} {', '.join(what)}"
            for word, what in (("missed", one.missed), ("false", one.false), ("value off", one.off))
            if what
        )
        print(f"{name:32}{one.grade:8}{why}")
    print("\n" + table(summary))
    return 0


def table(summary: Mapping[str, Any]) -> str:
    """Counts by kind, recording and robot, and by class of the causes."""
    rows = [f"{'':22}{'cases':>6}" + "".join(f"{grade:>8}" for grade in score.GRADES)]

    def row(name: str, counts: Mapping[str, Any]) -> str:
        return f"{name:22}{counts['cases']:6d}" + "".join(f"{counts[grade]:8d}" for grade in score.GRADES)

    for group in ("kind", "recording", "robot"):
        rows += [row(name, counts) for name, counts in summary[group].items()]
    rows += [row("all", summary["all"]), "", f"{'class of the cause':22}{'asked':>6}{'named':>8}{'value':>8}"]
    rows += [
        f"{name:22}{counts['causes']:6d}{counts['named']:8d}{counts['value_right']:8d}"
        for name, counts in summary["class"].items()
    ]
    return "\n".join(rows)


def main(words: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.real", description="Real recordings whose truth is known; docs/real-data.md."
    )
    verbs = parser.add_subparsers(dest="verb", required=True)

    def verb(name: str, what: str, does: Any) -> argparse.ArgumentParser:
        one = verbs.add_parser(name, help=what, description=what)
        one.set_defaults(does=does)
        return one

    for name, what, does in (
        ("cases", "list the cases", _cases),
        ("fetch-list", "what to download from where, with checksums", _fetch_list),
    ):
        verb(name, what, does).add_argument("--json", action="store_true", help="as data")
    data: dict[str, Any] = {"type": Path, "metavar": "DIR", "help": f"folder of the recordings; default: ${FOLDER}"}
    verb("check", "whether the fetched files are the published ones", _check).add_argument("--data", **data)
    one = verb("convert", "write recordings and nominal model of a case", _convert)
    one.add_argument("case", metavar="CASE", help="a case, some with commas between, or all")
    one.add_argument("out", type=Path, metavar="OUT", help="folder; of several cases, one folder each")
    one.add_argument("--data", **data)
    one = verb("run", "diagnose cases with this package; goes on where it stopped", _run)
    one.add_argument("out", type=Path, metavar="OUT", help="folder of the run")
    one.add_argument("--data", **data)
    one.add_argument("--cases", default="all", help="all, or some with commas between")
    one.add_argument("--jobs", type=int, default=1, help="of a diagnosis")
    one.add_argument("--time-budget", type=float, metavar="S", help="of one diagnosis; default: none")
    one.add_argument(
        "--told", action="store_true", help="with no effects in the library but those that the case declares"
    )
    one = verb("baseline", "a simple method on the cases that it can answer; goes on where it stopped", _baseline)
    one.add_argument("method", choices=tuple(baselines.METHODS))
    one.add_argument("out", type=Path, metavar="OUT", help="folder of the baselines")
    one.add_argument("--data", **data)
    one.add_argument("--cases", default="all", help="all, or some with commas between")
    one.add_argument("--save", action="store_true", help="keep the answers in benchmarks/results, too")
    verb("table", "what is kept of the diagnosis and the baselines, scored", _table)
    one = verb("submit", "score anybody's answers", _submit)
    one.add_argument("file", type=Path, metavar="FILE", help="JSON: {case: {kind, names, values}}")
    one.add_argument("--json", action="store_true", help="as data")
    one.add_argument("--save", metavar="NAME", help="write benchmarks/results/real_NAME.json, too")
    asked = parser.parse_args(words)
    try:
        return int(asked.does(asked))
    except ValueError as fault:
        print(fault, file=sys.stderr)
        return 2


if __name__ == "__main__":
    raise SystemExit(main())

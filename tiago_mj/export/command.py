"""``tiago-mj export DIAGNOSIS --to TARGET --out FOLDER``: the arguments and the run."""

from __future__ import annotations

import argparse
import difflib
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from tiago_mj.export import found as finding
from tiago_mj.export import holding, mjcf, replay, versions
from tiago_mj.export.draws import draws_of
from tiago_mj.export.drives import numbers_of
from tiago_mj.export.holding import held
from tiago_mj.export.targets import gymnasium_simulators
from tiago_mj.export.targets.registry import TARGETS
from tiago_mj.export.targets.target import Target
from tiago_mj.export.versions import VERSIONS
from tiago_mj.io import atomic
from tiago_mj.io.numbers_option import with_numbers
from tiago_mj.io.quoting import did_you_mean
from tiago_mj.randomisation import diagnosis as reading
from tiago_mj.randomisation.posterior import Posterior

#: Folder of a robot's own files, beside the text of a target.
MODEL: Final = "model"
CHANGES: Final = "changes.diff"
TABLE: Final = "export.md"


@dataclass(frozen=True)
class Row:
    """One effect in the target.

    Attributes:
        effect: its name.
        where: its targets.
        grade: ``exact``, ``approximate`` or ``not``.
        how: in which form, or why not.
    """

    effect: str
    where: str
    grade: str
    how: str


def run(arguments: argparse.Namespace) -> int:
    """Write the files and print what they hold."""
    if arguments.table:
        every = {name: target.holds for name, target in TARGETS.items()}
        effects = holding.library()
        if arguments.json:
            said = {e: {name: vars(holding.held(holds, e)) for name, holds in every.items()} for e in effects}
            print(json.dumps(said, indent=1, ensure_ascii=False))
        else:
            print(holding.table(every, effects), end="")
        return 0
    if arguments.diagnosis is None or arguments.out is None:
        raise ValueError("give DIAGNOSIS and --out FOLDER, or --table")
    report = export(arguments)
    print(json.dumps(report, indent=1, ensure_ascii=False) if arguments.json else _text(report))
    return 0


def export(arguments: argparse.Namespace) -> dict[str, Any]:
    """Write the files; what was written, as data.

    Raises:
        ValueError: the diagnosis, the target or the model cannot be used; one line.
    """
    if arguments.to not in TARGETS:
        raise ValueError(f"target {arguments.to!r} is unknown: {did_you_mean(arguments.to, tuple(TARGETS))}")
    if arguments.mujoco is not None and arguments.mujoco not in VERSIONS:
        raise ValueError(f"--mujoco {arguments.mujoco} is unknown: use one of {', '.join(VERSIONS)}")
    target, found = TARGETS[arguments.to], finding.read(arguments.diagnosis, numbers=with_numbers(arguments))
    if arguments.mujoco is not None and target.mujoco is None:
        raise ValueError(f"--mujoco is for targets with a model: {target.name} has none")
    posterior = reading.read(_folder(arguments.diagnosis)) if arguments.randomisation else None
    drawn_files = () if target.randomisation is None else target.randomisation.files
    if target.name == "gymnasium":
        rows = [_row(target.holds, entry.name, entry.target) for entry in found.entries]
        texts = {} if posterior is None else gymnasium_simulators.write(posterior)
        with atomic.replacing_set(arguments.out, parts=(finding.CALIBRATION, *drawn_files, TABLE)) as folder:
            finding.copy(found, folder / finding.CALIBRATION, numbers=with_numbers(arguments))
            for name, text in texts.items():
                (folder / name).write_text(text, encoding="utf-8")
            return _finished(folder, arguments, [*rows, *_drawn(target, posterior)], None, ())
    robot = finding.resolve(found, finding.model_path(found, arguments.model), arguments.rate)
    numbers = numbers_of(robot)
    texts = dict(target.write(numbers))
    if posterior is not None and target.randomisation is not None and target.randomisation.write is not None:
        texts |= target.randomisation.write(draws_of(robot, posterior), numbers)
    rows = [_row(target.holds, entry.name, entry.target) for entry in robot.entries]
    with atomic.replacing_set(arguments.out, parts=(*texts, *drawn_files, MODEL, CHANGES, TABLE)) as folder:
        for name, text in texts.items():
            (folder / name).write_text(text, encoding="utf-8")
        drawn = _drawn(target, posterior)
        if target.mujoco is None:
            return _finished(folder, arguments, [*rows, *drawn], None, ())
        rows, closing, told = _model(robot, target, arguments.mujoco or target.mujoco, folder, rows)
        return _finished(folder, arguments, [*rows, *drawn], closing, told)


def _folder(path: Path) -> Path:
    """Of a diagnosis that was given by its folder or its ``calibration.yaml``."""
    return path if path.is_dir() else path.parent


def _drawn(target: Target, posterior: Posterior | None) -> list[Row]:
    """How the target's domain randomisation has what the posterior draws; nothing where none was asked for."""
    if posterior is None:
        return []
    rows = []
    for effect, targets in posterior.drawn().items():
        one = holding.randomised({} if target.randomisation is None else target.randomisation.holds, effect)
        where = "all" if () in targets else ", ".join(dict.fromkeys(name for names in targets for name in names))
        rows.append(Row(f"{effect}, drawn", where, one.grade, one.how))
    return rows


def _model(robot: Any, target: Any, version: str, folder: Path, rows: list[Row]) -> tuple[list[Row], Any, Any]:
    """Write the user's model with what MJCF can hold; rows as it came out, how far it closes the gap, what to know."""
    written = mjcf.write(robot, version=version, without=target.without)
    alone = target.name == "mujoco"
    main = written.save(folder if alone else folder / MODEL)
    versions.check(main, version)
    (folder / CHANGES).write_text(_changes(written), encoding="utf-8")
    if alone:
        rows = [_as_written(row, written) for row in rows]
    return rows, replay.closing(robot, written.compile()), written.told


def _as_written(row: Row, written: Any) -> Row:
    """A row as the files really have it."""
    if row.effect in written.exact:
        return row
    if row.effect in written.approximate:
        return Row(row.effect, row.where, "approximate", written.approximate[row.effect])
    why = row.how if row.grade == "not" else "not with these numbers on this robot: tiago_mj.gap.apply has it"
    return Row(row.effect, row.where, "not", written.lacking.get(row.effect, why))


def _row(holds: Mapping[str, Any], effect: str, target: tuple[str, ...] | None) -> Row:
    one = held(holds, effect)
    return Row(effect, "all" if target is None else ", ".join(target), one.grade, one.how)


def _changes(written: Any) -> str:
    """The difference to the user's files, as ``patch -p1`` takes it."""
    out: list[str] = []
    for path, data in written.files.items():
        name = path.relative_to(written.root).as_posix()
        before, after = (text.decode("utf-8", "replace").splitlines(True) for text in (path.read_bytes(), data))
        out += difflib.unified_diff(before, after, f"a/{name}", f"b/{name}", n=1)
    return "".join(line if line.endswith("\n") else f"{line}\n\\ No newline at end of file\n" for line in out)


def _finished(folder: Path, arguments: argparse.Namespace, rows: list[Row], closing: Any, told: Any) -> dict[str, Any]:
    target = TARGETS[arguments.to]
    replayed = None
    if closing is not None:
        known = math.isfinite(closing.closed)
        replayed = {"closed": closing.closed if known else None, "before": closing.before, "after": closing.after}
    report = {
        "target": target.name,
        "version": target.version,
        "tried": target.tried,
        "effects": [vars(row) for row in rows],
        "replayed": replayed,
        "notes": list(told),
    }
    (folder / TABLE).write_text(_text({**report, "files": []}) + "\n", encoding="utf-8")
    files = sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())
    return {**report, "files": [str(arguments.out / name) for name in files]}


def _text(report: Mapping[str, Any]) -> str:
    """The table and what else there is to say, as Markdown."""
    lines = [f"{report['target']} {report['version']}: {report['tried']}.", ""]
    if report["effects"]:
        lines += ["| effect | on | held | how, or why not |", "|---|---|---|---|"]
        lines += [f"| {e['effect']} | {e['where']} | {e['grade']} | {e['how']} |" for e in report["effects"]]
    else:
        lines.append("The diagnosis names no effect: nothing is changed.")
    replayed = report["replayed"]
    if replayed is not None and replayed["closed"] is not None:
        which = "the file" if report["target"] == "mujoco" else f"the model in {MODEL}/"
        lines += [
            "",
            f"Replayed in MuJoCo, {which} closes {100 * replayed['closed']:.1f} % of the gap between the nominal model "
            f"and all effects: {replayed['before']:.3g} before, {replayed['after']:.3g} after (r.m.s.; rad, m).",
        ]
    lines += ["", *report["notes"]] if report["notes"] else []
    lines += ["", *(f"wrote {name}" for name in report["files"])] if report["files"] else []
    return "\n".join(lines)

"""Size and structure of the code: lines, rooms, functions, duplicate definitions, counted from the source.

    python -m benchmarks.house [--json]

Every figure is of the checkout that the script lies in; nothing of it is imported.
"""

from __future__ import annotations

import argparse
import ast
import functools
import io
import json
import re
import sys
import tokenize
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).resolve().parents[1]
PACKAGE: Final = ROOT / "tiago_mj"
#: Rooms of the diagnosis and of what it shares with the simulation.
DIAGNOSIS: Final = ("gap", "effects")
#: Of the benchmarks, those whose lines are not counted: cases of real robots and the audit.
NOT_COUNTED: Final = ("real", "truth_audit")
#: Rooms in which an effect's name may stand in code.
NAMED_IN: Final = ("effects", "demo", "export")
#: Names that effects share with what is none: arguments of environments, attributes of MJCF, fields of sidecars.
SHARED_NAMES: Final = {
    "registration.py": ("object_offset",),
    "models/convert/additions.py": ("armature",),
    "recordings/record/environment.py": ("velocity_limit",),
}
LONG_FUNCTION, MANY_ARGUMENTS, LARGE_CLASS = 60, 6, 300
NO_SOURCE: Final = re.compile(r"chosen by\s+(?:#:?\s*)?hand", re.IGNORECASE)


def files(folder: Path) -> list[Path]:
    """Python files of a folder, or the file itself."""
    return sorted(folder.rglob("*.py")) if folder.is_dir() else [folder]


@functools.cache
def tree(path: Path) -> ast.Module:
    """A file's syntax."""
    return ast.parse(path.read_text())


def lines(paths: Iterable[Path]) -> int:
    """Lines of files together."""
    return sum(len(path.read_text().splitlines()) for path in paths)


def code_lines(paths: Iterable[Path]) -> int:
    """Lines that hold code: without blank ones, comments and docstrings."""
    return sum(_coded(path) for path in paths)


@functools.cache
def _coded(path: Path) -> int:
    text = path.read_text()
    told = {line for node in ast.walk(tree(path)) for line in _docstring(node)}
    quiet = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER}
    out: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type not in quiet:
            out.update(range(token.start[0], token.end[0] + 1))
    return len(out - told)


def _docstring(node: ast.AST) -> range:
    if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef) and node.body:
        first = node.body[0]
        if isinstance(first, ast.Expr) and isinstance(first.value, ast.Constant) and isinstance(first.value.value, str):
            return range(first.lineno, (first.end_lineno or first.lineno) + 1)
    return range(0)


def functions(paths: Iterable[Path]) -> Iterator[ast.FunctionDef | ast.AsyncFunctionDef]:
    """Functions and methods of files."""
    for path in paths:
        for node in ast.walk(tree(path)):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                yield node


def long_functions(paths: Iterable[Path]) -> int:
    """Functions of more lines than are read at one look."""
    return sum((f.end_lineno or f.lineno) - f.lineno + 1 > LONG_FUNCTION for f in functions(paths))


def functions_of_many(paths: Iterable[Path]) -> int:
    """Functions of more arguments than are held in mind; ``self`` and ``cls`` are none."""
    return sum(_arguments(f) > MANY_ARGUMENTS for f in functions(paths))


def _arguments(function: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    given = function.args
    named = [a.arg for a in (*given.posonlyargs, *given.args, *given.kwonlyargs)]
    return len([name for name in named if name not in ("self", "cls")])


def large_classes(paths: Iterable[Path]) -> int:
    """Classes of more lines than a page or five."""
    found = [node for path in paths for node in ast.walk(tree(path)) if isinstance(node, ast.ClassDef)]
    return sum((c.end_lineno or c.lineno) - c.lineno + 1 > LARGE_CLASS for c in found)


def numbers_without_source(paths: Iterable[Path]) -> int:
    """Comments that say a number was chosen by hand."""
    return sum(len(NO_SOURCE.findall(path.read_text())) for path in paths)


def effect_names() -> frozenset[str]:
    """Names of the library's effects, as they are declared: the first argument of the decorator ``effect``."""
    out = set()
    for path in files(PACKAGE / "effects"):
        for node in ast.walk(tree(path)):
            if isinstance(node, ast.ClassDef):
                for given in node.decorator_list:
                    if isinstance(given, ast.Call) and isinstance(given.func, ast.Name) and given.func.id == "effect":
                        out.add(ast.literal_eval(given.args[0]))
    return frozenset(out)


def names_in_code(names: frozenset[str]) -> dict[str, int]:
    """Strings in code that are an effect's name, by module, outside the rooms that may hold them: not those of
    :data:`SHARED_NAMES`."""
    out: dict[str, int] = {}
    for path in files(PACKAGE):
        where = path.relative_to(PACKAGE)
        if where.parts[0] in NAMED_IN:
            continue
        sought = names.difference(SHARED_NAMES.get(where.as_posix(), ()))
        count = sum(isinstance(node, ast.Constant) and node.value in sought for node in ast.walk(tree(path)))
        if count:
            out[where.as_posix()] = count
    return out


def standing(pattern: str, folder: Path = PACKAGE) -> list[str]:
    """Modules in which a pattern stands, once for each time that it does."""
    return [
        path.relative_to(PACKAGE).as_posix()
        for path in files(folder)
        for _ in re.findall(pattern, path.read_text(), re.MULTILINE)
    ]


def taking(argument: str) -> set[str]:
    """Functions of the diagnosis that take an argument of this name, as module and name."""
    return {
        f"{path.relative_to(PACKAGE).as_posix()}:{f.name}"
        for path in files(PACKAGE / "gap")
        for f in functions([path])
        if argument in [a.arg for a in (*f.args.posonlyargs, *f.args.args, *f.args.kwonlyargs)]
    }


def imports_in_functions() -> int:
    """Imports that a module makes only once a function of it is called."""
    within = (ast.Import, ast.ImportFrom)
    return sum(isinstance(node, within) for f in functions(files(PACKAGE)) for node in ast.walk(f))


def figures() -> dict[str, object]:
    """Every figure, by what it counts."""
    package, deciding = files(PACKAGE), [p for room in DIAGNOSIS for p in files(PACKAGE / room)]
    benchmarks = [
        p for p in files(ROOT / "benchmarks") if p.relative_to(ROOT / "benchmarks").parts[0] not in NOT_COUNTED
    ]
    pipeline = list(functions([PACKAGE / "gap" / "pipeline.py"]))
    return {
        "lines in gap and effects": lines(deciding),
        "lines in the package": lines(package),
        "lines in benchmarks, without real and the audit": lines(benchmarks),
        "lines of code in gap": code_lines(files(PACKAGE / "gap")),
        "lines of code in the package": code_lines(package),
        "functions of gap that take trials": len(taking("trials")),
        "returns in the pipeline": sum(isinstance(node, ast.Return) for f in pipeline for node in ast.walk(f)),
        "definitions of evidence": sorted({*standing(r"def log_evidence\b"), *standing(r"^class Evidence\b")}),
        "loops that drive a chain": standing(r"(?<!class )\bChain\("),
        "descriptions of the result": sorted({*standing(r"^class Diagnosis\b"), *standing(r"^class _?Diagnosis\w+\(")}),
        "numbers that decide without a source": numbers_without_source(package),
        f"functions of more than {LONG_FUNCTION} lines": long_functions(package),
        f"functions of more than {MANY_ARGUMENTS} arguments": functions_of_many(package),
        f"classes of more than {LARGE_CLASS} lines": large_classes(package),
        "modules at the top of the package": len(list(PACKAGE.glob("*.py"))),
        "names of effects in code, outside effects, demo and the export's tables": names_in_code(effect_names()),
        "imports within functions": imports_in_functions(),
    }


def main(words: list[str] | None = None) -> int:
    """Command line."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.house", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--json", action="store_true", help="print the figures as data")
    found = figures()
    if parser.parse_args(words).json:
        print(json.dumps(found, indent=2))
        return 0
    for name, figure in found.items():
        if isinstance(figure, dict):
            each = ", ".join(f"{module} {count}" for module, count in figure.items())
            print(f"{sum(figure.values()):>8}  {name}, {len(figure)} of them: {each}")
        elif isinstance(figure, list):
            print(f"{len(figure):>8}  {name}: {', '.join(figure)}")
        else:
            print(f"{figure:>8}  {name}")
    return 0


if __name__ == "__main__":
    sys.exit(main())

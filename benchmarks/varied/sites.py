"""Where the numbers stand that are varied, and a program in which some of them are other ones.

A number is varied where the comment above its assignment names a result, as ``varied.json``, or says that it was
chosen. A program is changed as it is imported: the assignment's value is multiplied before anything else sees it, so
that whatever is derived from it, a default of an argument or another constant, follows.
"""

from __future__ import annotations

import ast
import functools
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any, Final

ROOT: Final = Path(__file__).resolve().parents[2]
#: What the comment above such a number holds.
MARK: Final = re.compile(r"varied(_\w+)?\.json|chosen by\s+(?:#:?\s*)?hand", re.IGNORECASE)
#: Numbers that stand for how far something may be from 1: that distance is what is multiplied.
ABOUT_ONE: Final = frozenset(
    {
        "REFUTING_RATIO",
        "RELINEARIZING_MISFIT",
        "NOISE_ONLY_DISCREPANCY",
        "WIDTHS",
        "NEAR_PERIODS",
        "NEAR_WIDTHS",
        "CONVERGED_COST_RATIO",
        "MAX_COST_RATIO",
        "MAX_WEIGHTED_COST_RATIO",
        "ADEQUATE_DISCREPANCY",
        "ADEQUATE_WITH_EFFECTS",
        "MIN_SHARE_OF_BEST_GAIN",
    }
)
#: Name of the function that a changed program multiplies with.
_TIMES: Final = "__times__"


def sites(package: Path = ROOT / "tiago_mj") -> list[str]:
    """Names of all numbers that are varied, as ``module:NAME``."""
    return [f"{_module(path)}:{name}" for path in sorted(package.rglob("*.py")) for name in _marked(path.read_text())]


def comment(source: str, name: str) -> str:
    """The comment above the block of assignments that an assignment to a name stands in, without its ``#:``.

    Raises:
        KeyError: nothing of that name is assigned at the module's top.
    """
    lines = source.splitlines()
    for node in _body(source):
        if _name(node) == name:
            at = node.lineno - 1
            while at > 0 and lines[at - 1].strip() and not lines[at - 1].startswith("#"):
                at -= 1
            last = at
            while at > 0 and lines[at - 1].startswith("#"):
                at -= 1
            return " ".join(line.lstrip("#: ") for line in lines[at:last])
    raise KeyError(name)


def _marked(source: str) -> Iterator[str]:
    for node in _body(source):
        name = _name(node)
        if name and not _is_text(node) and MARK.search(comment(source, name)):
            yield name


@functools.cache
def _body(source: str) -> Sequence[ast.stmt]:
    """Statements of a module; each is asked for once per name."""
    return ast.parse(source).body


def _is_text(node: ast.stmt) -> bool:
    value = getattr(node, "value", None)
    return isinstance(value, ast.Constant) and isinstance(value.value, str)


def _name(node: ast.stmt) -> str:
    if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name) and node.value is not None:
        return node.target.id
    return ""


def _module(path: Path) -> str:
    return ".".join(path.relative_to(ROOT).with_suffix("").parts)


def times(value: Any, factor: float, about: float = 0.0) -> Any:
    """A number, or each of several, with its distance from another one multiplied: whole ones stay whole, at least 1.

    Raises:
        TypeError: it is no number.
    """
    if isinstance(value, tuple):
        return tuple(times(one, factor, about) for one in value)
    if isinstance(value, Mapping):
        return {name: times(one, factor, about) for name, one in value.items()}
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise TypeError(f"{value!r} is no number that can be varied")
    return max(1, round(value * factor)) if isinstance(value, int) else about + (value - about) * factor


class Varied(MetaPathFinder):
    """Imports modules with numbers multiplied.

    Attributes:
        left: numbers whose module was not imported yet.
    """

    def __init__(self, factors: Mapping[str, float]) -> None:
        """Start with nothing imported.

        Args:
            factors: by ``module:NAME``.
        """
        self._factors: dict[str, dict[str, float]] = {}
        for site, factor in factors.items():
            module, name = site.split(":")
            self._factors.setdefault(module, {})[name] = factor
        self.left = set(factors)

    def find_spec(self, fullname: str, path: Any = None, target: ModuleType | None = None) -> ModuleSpec | None:
        """Only of modules that hold such a number."""
        if fullname not in self._factors:
            return None
        spec = PathFinder.find_spec(fullname, path, target)
        if spec is None or spec.origin is None:
            return None
        factors = self._factors[fullname]
        spec.loader = _Loader(fullname, spec.origin, factors)
        self.left -= {f"{fullname}:{name}" for name in factors}
        return spec


class _Loader(SourceFileLoader):
    """Compiles a module's source anew, multiplied; nothing of it is kept on the drive."""

    def __init__(self, fullname: str, path: str, factors: Mapping[str, float]) -> None:
        super().__init__(fullname, path)
        self._by = dict(factors)

    def get_code(self, fullname: str) -> CodeType:
        module = ast.parse(self.get_data(self.path))
        for node in module.body:
            if (name := _name(node)) in self._by:
                assert isinstance(node, ast.AnnAssign)
                assert node.value is not None
                by = [ast.Constant(self._by.pop(name)), ast.Constant(1.0 if name in ABOUT_ONE else 0.0)]
                node.value = ast.Call(ast.Name(_TIMES, ast.Load()), [node.value, *by], [])
        if self._by:
            raise KeyError(f"{fullname} has no number {', '.join(sorted(self._by))}")
        return compile(ast.fix_missing_locations(module), self.path, "exec")

    def exec_module(self, module: ModuleType) -> None:
        module.__dict__[_TIMES] = times
        super().exec_module(module)


def install(factors: Mapping[str, float]) -> Varied:
    """Have what is imported from here on hold other numbers.

    Raises:
        ImportError: a module with such a number is imported already.
    """
    if there := {site.split(":")[0] for site in factors}.intersection(sys.modules):
        raise ImportError(f"{', '.join(sorted(there))} is imported already and cannot be varied")
    finder = Varied(factors)
    sys.meta_path.insert(0, finder)
    return finder

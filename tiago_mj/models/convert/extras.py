"""Additions to a URDF: what MuJoCo needs and URDF cannot say, as a YAML file beside it.

``docs/models.md`` lists the keys. Every key and every name is checked, so that a typo is an error and not silence.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from pydantic import Field

from tiago_mj.io.loading import is_file, load_yaml
from tiago_mj.io.quoting import quoted
from tiago_mj.io.schema import Open, SchemaError, checked
from tiago_mj.models.convert.errors import ConversionError

Settings = Mapping[str, Any]
#: That include each other.
_FILES = 100


@dataclass(frozen=True)
class Extras:
    """The additions; the field names are the keys of the file. Names in mappings are shell patterns, later ones win."""

    where: str = "the additions"
    option: Settings = field(default_factory=dict)
    bodies: Mapping[str, Settings] = field(default_factory=dict)
    joints: Mapping[str, Settings] = field(default_factory=dict)
    geoms: Mapping[str, Settings] = field(default_factory=dict)
    collision: Mapping[str, Any] = field(default_factory=dict)
    capsules: tuple[str, ...] = ()
    sites: tuple[Settings, ...] = ()
    actuators: Mapping[str, Settings] = field(default_factory=dict)
    sensors: tuple[Settings, ...] = ()
    exclude: tuple[tuple[str, str], ...] = ()
    keyframes: Mapping[str, Mapping[str, float]] = field(default_factory=dict)

    def error(self, what: str, mend: str) -> ConversionError:
        """An error that names this file."""
        return ConversionError(self.where, what, mend)


class _Form(Open):
    """Types of the keys of an additions file: which are lists and mappings; MuJoCo checks the values."""

    bodies: dict[str, dict[str, Any]] = Field(default={}, description="give mappings")
    joints: dict[str, dict[str, Any]] = Field(default={}, description="give mappings")
    geoms: dict[str, dict[str, Any]] = Field(default={}, description="give mappings")
    capsules: list[str] = Field(default=[], description="give names")
    sites: list[dict[str, Any]] = Field(default=[], description="give mappings")
    actuators: dict[str, dict[str, Any]] = Field(default={}, description="give mappings")
    sensors: list[dict[str, Any]] = Field(default=[], description="give mappings")
    keyframes: dict[str, dict[str, float]] = Field(default={}, description="give joints and their values")


_KINDS: dict[str, type] = {
    f.name: tuple if str(f.type).startswith("tuple") else dict for f in fields(Extras) if f.name != "where"
}


def read(path: Path) -> Extras:
    """Read an additions file and the files that it includes (``include: [other.yaml]``, which it then overrides).

    Raises:
        ConversionError: the file cannot be read, or holds an unknown key or a value of the wrong kind.
    """
    merged = _merged(path, (), [])
    try:
        checked(_Form, merged)
    except SchemaError as fault:
        raise ConversionError(str(path), f"{fault.path} {fault.problem}", fault.mend) from None
    settings: dict[str, Any] = {}
    for key, value in merged.items():
        settings[key] = tuple(value) if _KINDS[key] is tuple else value
    settings["exclude"] = tuple(_pair(path, entry) for entry in settings.get("exclude", ()))
    return Extras(where=str(path), **settings)


def beside(urdf: Path) -> Path | None:
    """The additions file of a URDF: the same name with the ending ``.yaml``; None where there is none."""
    path = urdf.with_suffix(".yaml")
    return path if path.is_file() else None


def _merged(path: Path, within: tuple[Path, ...], read: list[Path]) -> dict[str, Any]:
    if path in within:
        raise ConversionError(str(path), "includes itself", "remove one include")
    read.append(path)
    if len(read) > _FILES:
        raise ConversionError(str(path), f"more than {_FILES} files are included", "include each once")
    content = _load(path)
    included = content.pop("include", [])
    merged: dict[str, Any] = {}
    for name in included if isinstance(included, list) else [included]:
        _merge(merged, _merged(path.parent / str(name), (*within, path), read))
    for key, value in content.items():
        if key not in _KINDS:
            raise ConversionError(str(path), f'unknown key "{key}"', f"use one of include, {', '.join(_KINDS)}")
        if not isinstance(value, list if _KINDS[key] is tuple else dict):
            wanted = "a list" if _KINDS[key] is tuple else "a mapping"
            raise ConversionError(str(path), f'"{key}" is not {wanted}', f"give {wanted}")
    _merge(merged, content)
    return merged


def _merge(target: dict[str, Any], more: dict[str, Any]) -> None:
    """Lists are joined; mappings are joined entry by entry."""
    for key, value in more.items():
        if key not in target:
            target[key] = value
        elif isinstance(value, list):
            target[key] = target[key] + value
        else:
            target[key] = {**target[key], **value}


def _load(path: Path) -> dict[str, Any]:
    if not is_file(path):
        raise ConversionError(str(path), "cannot be read (no such file)", "give the path of a YAML file")
    try:
        content = load_yaml(path, "is not YAML")
    except ValueError as fault:
        what, _, mend = str(fault).rpartition(": ")
        raise ConversionError(str(path), what, mend) from None
    if content is None:
        return {}
    if not isinstance(content, dict):
        raise ConversionError(str(path), "is not a mapping of keys", "see docs/models.md for the keys")
    return content


def _pair(path: Path, entry: Any) -> tuple[str, str]:
    if not (isinstance(entry, list) and len(entry) == 2):
        raise ConversionError(str(path), f"exclude entry {quoted(entry)} is not a pair", "give [body, body]")
    return str(entry[0]), str(entry[1])

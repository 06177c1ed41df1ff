"""Where the model files lie: inside the installed package, or in the checkout of an editable installation."""

from __future__ import annotations

import shlex
from importlib import resources
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from tiago_mj.io.loading import is_pipe

#: Bytes in which an XML file's first element is sought.
_BEGINNING = 1_000_000
CHECKOUT = Path(__file__).resolve().parents[2] / "models"


def models_folder() -> Path:
    """Folder that holds ``robots/``, ``sources/`` and ``PROVENANCE.md``.

    Raises:
        FileNotFoundError: neither the package nor a checkout carries it.
    """
    installed = Path(str(resources.files("tiago_mj.models"))) / "data"
    for folder in (installed, CHECKOUT):
        if (folder / "robots").is_dir():
            return folder
    raise FileNotFoundError(f"no model files under {installed} or {CHECKOUT}: reinstall tiago-mj")


def refuse_urdf(path: Path) -> None:
    """Refuse a URDF, or what makes one, where an MJCF is wanted; MuJoCo would load it without servos and limits.

    Raises:
        ValueError: says which command makes an MJCF of it, or that it is a pipe.
    """
    if is_pipe(path):
        raise ValueError(f"{path} is a pipe: name a file")
    if path.suffix.lower() == ".xacro":
        urdf = shlex.quote(path.stem if path.stem.endswith(".urdf") else f"{path.stem}.urdf")
        made = f"xacro {shlex.quote(str(path))} > {urdf}"
        raise ValueError(f"{path} is xacro, not MJCF: run {made}, then tiago-mj convert {urdf}")
    if path.suffix.lower() == ".urdf" or _root_of(path) == "robot":
        mjcf = path.with_suffix(".mjcf.xml" if path.suffix == ".xml" else ".xml").name
        convert = f"tiago-mj convert {shlex.quote(str(path))} --out {shlex.quote(mjcf)}"
        raise ValueError(f"{path} is a URDF, not MJCF: give {mjcf} instead, which is made by: {convert}")


def _root_of(path: Path) -> str:
    """Tag of an XML file's root; empty where it is no XML."""
    parser: Any = ElementTree.XMLPullParser(("start",))
    try:
        with path.open("rb") as file:
            parser.feed(file.read(_BEGINNING))
        return next((str(element.tag) for _, element in parser.read_events()), "")
    except (OSError, ElementTree.ParseError, LookupError, ValueError):
        return ""


def model_file(name: str) -> Path:
    """Path of a model file, such as ``robots/gripper_ta11.xml``.

    Raises:
        FileNotFoundError: no such file; the message lists what the folder holds.
    """
    folder = models_folder()
    path = folder / name
    if not path.is_file():
        there = sorted(p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.suffix in {".xml", ".urdf"})
        raise FileNotFoundError(f"no model file {name!r}; there are {', '.join(there)}")
    return path

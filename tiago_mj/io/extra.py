"""Optional dependencies (extras): imported when needed, with instructions to install them."""

from __future__ import annotations

import importlib.metadata
import json
import shlex
import sys
from importlib import import_module
from pathlib import Path
from typing import Any, Final
from urllib.parse import urlsplit
from urllib.request import url2pathname

#: Of the distribution.
NAME: Final = "tiago-mj"
#: Every version that the tests were run with, in the clone.
CONSTRAINTS: Final = "constraints.txt"


def load(name: str, purpose: str, extra: str = "gap") -> Any:
    """Import a library of an extra.

    Args:
        name: of the module.
        purpose: what needs it, for the complaint.
        extra: of this package that brings it.

    Raises:
        ModuleNotFoundError: it is not installed; says how to.
    """
    try:
        return import_module(name)
    except ModuleNotFoundError as fault:
        package = (fault.name or name).partition(".")[0]  # it may be one that the library itself needs
        raise ModuleNotFoundError(
            f"{purpose} needs {package}, which is not installed; install it with: {install(extra)}"
        ) from fault


def pyarrow() -> Any:
    """pyarrow with its Parquet and CSV parts."""
    for part in ("csv", "parquet"):
        load(f"pyarrow.{part}", "reading and writing recordings")
    return load("pyarrow", "reading and writing recordings")


def install(extra: str | None) -> str:
    """Command that adds an extra to this interpreter's environment; None: that which installs the package again."""
    which = f"[{extra}]" if extra else ""
    folder, editable = clone()
    if folder is None:
        return f"{pip()} -c {CONSTRAINTS} '.{which}'  # in a clone of {NAME}"
    package = shlex.quote(f"{folder}{which}")
    return f"{pip()} -c {shlex.quote(str(folder / CONSTRAINTS))} {'-e ' if editable else ''}{package}"


def in_clone(extra: str) -> str:
    """The same for the environment of docs/install.md, given in the folder of the clone: no path of a machine."""
    return f".venv/bin/pip install -q -c {CONSTRAINTS} '.[{extra}]'"


def pip() -> str:
    """``pip install`` of this interpreter, which need not be the one that ``pip`` finds."""
    return f"{shlex.quote(sys.executable)} -m pip install"


def clone() -> tuple[Path | None, bool]:
    """The clone that this package was installed from, and whether it is run from there; None where there is none."""
    try:
        said = importlib.metadata.distribution(NAME).read_text("direct_url.json")
        content = json.loads(said or "{}")
        url = urlsplit(content.get("url", ""))
        if url.scheme != "file":
            return None, False
        folder = Path(url2pathname(url.path))
        editable = bool(content.get("dir_info", {}).get("editable"))
    except (importlib.metadata.PackageNotFoundError, OSError, ValueError):
        return None, False
    return (folder, editable) if (folder / CONSTRAINTS).is_file() else (None, False)

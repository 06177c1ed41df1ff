"""Libraries of extras, loaded when they are needed."""

from __future__ import annotations

from importlib import import_module
from typing import Any


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
            f"{purpose} needs {package}, which is not installed; install it with: pip install 'tiago-mj[{extra}]'"
        ) from fault


def pyarrow() -> Any:
    """pyarrow with its Parquet and CSV parts."""
    for part in ("csv", "parquet"):
        load(f"pyarrow.{part}", "reading and writing recordings")
    return load("pyarrow", "reading and writing recordings")

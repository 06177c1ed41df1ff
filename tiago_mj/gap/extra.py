"""Libraries of the extra ``gap``, loaded when they are needed."""

from __future__ import annotations

from importlib import import_module
from typing import Any


def load(name: str, purpose: str) -> Any:
    """Import a library of the extra.

    Raises:
        ModuleNotFoundError: it is not installed; says how to.
    """
    try:
        return import_module(name)
    except ModuleNotFoundError as fault:
        package = name.partition(".")[0]
        raise ModuleNotFoundError(
            f"{purpose} needs {package}, which is not installed; install it with: pip install 'tiago-mj[gap]'"
        ) from fault


def pyarrow() -> Any:
    """pyarrow with its Parquet and CSV parts."""
    for part in ("csv", "parquet"):
        load(f"pyarrow.{part}", "reading and writing recordings")
    return load("pyarrow", "reading and writing recordings")

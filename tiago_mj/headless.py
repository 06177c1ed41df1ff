"""Rendering without a display: to be settled before anything imports ``mujoco``, which chooses its OpenGL then."""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Mapping, MutableMapping


def choose_gl(environment: MutableMapping[str, str] = os.environ, platform: str = sys.platform) -> None:
    """Set ``MUJOCO_GL=egl`` on Linux without a display, where the variable is unset and an EGL library is there.

    Without the library the variable stays unset: ``mujoco`` then imports, and rendering says what to install.
    """
    if "MUJOCO_GL" not in environment and without_display(environment, platform) and _has_egl():
        environment["MUJOCO_GL"] = "egl"


def without_display(environment: Mapping[str, str] = os.environ, platform: str = sys.platform) -> bool:
    """Whether this is Linux and neither X nor Wayland is there to open a window on."""
    return platform.startswith("linux") and not any(environment.get(d) for d in ("DISPLAY", "WAYLAND_DISPLAY"))


def hush_unmade_viewers() -> None:
    """Keep gymnasium's offscreen viewer from printing a traceback when one that never came to be is thrown away.

    Where no OpenGL context can be made its destructor fails on the missing context; what matters was said already.
    """
    known = sys.unraisablehook

    def hook(fault: sys.UnraisableHookArgs) -> None:
        if "OffScreenViewer.__del__" not in getattr(fault.object, "__qualname__", ""):
            known(fault)

    sys.unraisablehook = hook


def _has_egl() -> bool:
    try:
        ctypes.CDLL("libEGL.so.1")
    except OSError:
        return False
    return True

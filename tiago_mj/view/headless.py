"""Rendering without a display: the OpenGL backend is chosen before ``mujoco`` is imported."""

from __future__ import annotations

import contextlib
import ctypes
import importlib.util
import os
import sys
import weakref
from collections.abc import Mapping, MutableMapping
from types import MappingProxyType
from typing import Any, Final

#: Libraries of which one must be there, on Linux, for a value of ``MUJOCO_GL``; and what brings them.
LIBRARIES: Final[Mapping[str, tuple[tuple[str, ...], str]]] = MappingProxyType(
    {
        "egl": (("libEGL.so.1",), "Debian: libegl1 libegl-mesa0 libgl1-mesa-dri"),
        "osmesa": (("libOSMesa.so", "libOSMesa.so.8", "libOSMesa.so.6"), "Debian: libosmesa6"),
    }
)
#: Other values that ``mujoco`` knows on Linux; those that mean no OpenGL come last.
OTHERS: Final = ("", "glfw", "glx", "enable", "enabled", "on", "true", "1", "disable", "disabled", "off", "false", "0")
#: What was wrong with ``MUJOCO_GL``; said when something is to be rendered.
complaints: list[str] = []


def choose_gl(environment: MutableMapping[str, str] = os.environ, platform: str = sys.platform) -> None:
    """Set ``MUJOCO_GL`` on Linux so that ``mujoco`` can be imported and, if possible, render."""
    if not platform.startswith("linux") or "mujoco" in sys.modules:
        return
    if "MUJOCO_GL" not in environment:
        if without_display(environment, platform) and _loads("egl"):
            environment["MUJOCO_GL"] = "egl"
        return
    given = environment["MUJOCO_GL"].lower().strip()
    if given in OTHERS or (given in LIBRARIES and _loads(given)):
        return
    if given in LIBRARIES:
        complaints.append(f"MUJOCO_GL={given} is set, but its library is not installed ({LIBRARIES[given][1]})")
    else:
        complaints.append(f"MUJOCO_GL={given} is set, which MuJoCo does not know")
    environment["MUJOCO_GL"] = "disabled"


def load_triton_before_mesa(platform: str = sys.platform) -> None:
    """Load the library of Triton, where torch brought it, before OpenGL's.

    Mesa and Triton have an LLVM each. Where Mesa's comes first, as whoever renders without a graphics driver has it,
    the process ends with a segmentation fault as soon as torch imports Triton, which an optimiser does when it is made
    (pytorch/pytorch#129100). The other way round both work. It takes 0.03 s.
    """
    if not platform.startswith("linux") or "triton" in sys.modules:
        return
    found = importlib.util.find_spec("triton")
    if found is None or found.origin is None:
        return
    with contextlib.suppress(OSError):  # of another form, or for another machine: then nothing was to be loaded
        ctypes.CDLL(os.path.join(os.path.dirname(found.origin), "_C", "libtriton.so"))


def without_display(environment: Mapping[str, str] = os.environ, platform: str = sys.platform) -> bool:
    """Whether this is Linux and neither X nor Wayland is there to open a window on."""
    return platform.startswith("linux") and not any(environment.get(d) for d in ("DISPLAY", "WAYLAND_DISPLAY"))


def hush_unmade_viewers() -> None:
    """Prevent a traceback from gymnasium's offscreen viewer when it is deleted after its construction failed."""
    known = sys.unraisablehook

    def hook(fault: sys.UnraisableHookArgs) -> None:
        if "OffScreenViewer.__del__" not in getattr(fault.object, "__qualname__", ""):
            known(fault)

    sys.unraisablehook = hook


def _loads(backend: str) -> bool:
    for name in LIBRARIES[backend][0]:
        try:
            ctypes.CDLL(name)
        except OSError:
            continue
        return True
    return False


def free_apart(viewer: Any) -> None:
    """Make gymnasium's offscreen viewer free its OpenGL objects in its own context, whenever it is freed or collected.

    ``mjr_freeContext`` deletes by number in whichever context is current. Where that is another viewer's, which counts
    from the same number, the frames of the other would be black from then on.
    """
    viewer.free = weakref.finalize(viewer, _free, viewer.opengl_context, viewer.con)
    viewer.free.atexit = False  # MuJoCo has ended the display by then


def _free(context: Any, objects: Any) -> None:
    context.make_current()
    objects.free()
    context.free()

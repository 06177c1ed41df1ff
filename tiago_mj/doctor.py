"""``tiago-mj doctor``: what works on this machine, and how to mend what does not."""

from __future__ import annotations

import argparse
import importlib
import importlib.metadata
import json
import os
import platform
import sys
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from typing import Any, Final

import gymnasium
import numpy as np
from packaging.requirements import Requirement
from packaging.version import Version

from tiago_mj import __version__
from tiago_mj.io import extra
from tiago_mj.io.extra import NAME

#: Distributions whose versions say most when something is reported.
LISTED: Final = ("mujoco", "gymnasium", "gymnasium-robotics", "numpy", "scipy", "stable-baselines3", "torch")
#: Extras that users do not need.
OF_DEVELOPERS: Final = ("dev", "docs", "bench")


@dataclass(frozen=True)
class Check:
    """One thing that was looked at.

    Attributes:
        name: of the thing.
        works: whether it does.
        found: what was found.
        mend: how to make it work; empty where it does.
        needed: whether nothing of the package works without it.
    """

    name: str
    works: bool
    found: str
    mend: str = ""
    needed: bool = False


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of the command."""
    parser.add_argument("--json", action="store_true", help="print the same as data")
    parser.epilog = "Exit status: 0 where the base install works, 1 where it does not."


def run(arguments: argparse.Namespace) -> int:
    """Look at everything and say it; 1 where something is missing without which nothing works."""
    checks = list(examine())
    works = all(check.works for check in checks if check.needed)
    if arguments.json:
        data = {"works": works, "versions": versions(), "checks": [asdict(check) for check in checks]}
        print(json.dumps(data, indent=1, ensure_ascii=False))
        return 0 if works else 1
    print(f"{NAME} {__version__}; " + ", ".join(f"{name} {version}" for name, version in versions().items()))
    width = max(len(check.name) for check in checks)
    for check in checks:
        print(f"{'ok     ' if check.works else 'missing'}  {check.name:<{width}}  {check.found}")
        if check.mend:
            print(f"{'':9}{'':{width}}  mend: {check.mend}")
    print("The base install works." if works else "The base install does not work: mend what is missing above.")
    return 0 if works else 1


def versions() -> dict[str, str]:
    """Versions of what is installed, by distribution."""
    found = {"python": platform.python_version()}
    for name in LISTED:
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    return found


def examine() -> Iterator[Check]:
    """Everything that is looked at, the base first."""
    yield _python()
    lacking = missing(None)
    mend = extra.install(None) if lacking else ""
    yield Check("libraries", not lacking, ", ".join(lacking) or "all of the base", mend, needed=True)
    yield _tried("an environment", _step, f"reinstall it: {extra.install(None)}", needed=True)
    yield _tried(
        "pictures (OpenGL)",
        _picture,
        "Debian: apt-get install libegl1 libegl-mesa0 libgl1-mesa-dri; then leave MUJOCO_GL unset, or set it to egl",
    )
    yield _tried("films (ffmpeg)", _films, f"{extra.pip()} 'imageio[ffmpeg]'")
    for name in extras():
        lacking = missing(name)
        mend = extra.install(name) if lacking else ""
        yield Check(f"extra {name}", not lacking, f"lacks {', '.join(lacking)}" if lacking else "installed", mend)
    usable = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    yield Check("processors", True, f"{usable} of {os.cpu_count()} may be used")


def _python() -> Check:
    fit = sys.version_info >= (3, 11)
    mend = "" if fit else "use Python 3.11 or later"
    return Check("python", fit, f"{platform.python_version()} on {platform.system()} {platform.machine()}", mend, True)


def _tried(name: str, do: Callable[[], str], mend: str, *, needed: bool = False) -> Check:
    """What came of trying something: whatever it raises is the finding."""
    try:
        return Check(name, True, do(), needed=needed)
    except Exception as fault:
        said = " ".join(str(fault).split()) or type(fault).__name__
        return Check(name, False, said[:200], mend, needed)


def _step() -> str:
    name = "tiago_mj/GripperTactile-v0"
    env: gymnasium.Env[Any, Any] = gymnasium.make(name)
    env.reset(seed=0)
    observation, *_ = env.step(np.zeros(2))
    env.close()
    if not np.isfinite(observation).all():
        raise ArithmeticError(f"{name} steps to {observation}")
    return f"{name} steps"


def _picture() -> str:
    import mujoco

    context = mujoco.GLContext(64, 64)
    context.free()
    return f"MUJOCO_GL={os.environ.get('MUJOCO_GL', 'unset')} renders"


def _films() -> str:
    imageio_ffmpeg = importlib.import_module("imageio_ffmpeg")

    return f"ffmpeg {imageio_ffmpeg.get_ffmpeg_version()}"


def extras() -> list[str]:
    """Extras that users may want."""
    found = importlib.metadata.metadata(NAME).get_all("Provides-Extra") or []
    return [name for name in found if name not in OF_DEVELOPERS]


def missing(extra: str | None) -> list[str]:
    """Libraries of an extra, of the base if None, that are not installed or too old."""
    lacking = []
    for line in importlib.metadata.requires(NAME) or ():
        requirement = Requirement(line)
        marker = requirement.marker
        of_base = marker is None or marker.evaluate({"extra": ""})
        if of_base != (extra is None) or (marker is not None and not marker.evaluate({"extra": extra or ""})):
            continue
        if requirement.name == NAME:  # an extra that is made of others
            lacking += [name for other in sorted(requirement.extras) for name in missing(other)]
            continue
        try:
            version = Version(importlib.metadata.version(requirement.name))
        except importlib.metadata.PackageNotFoundError:
            lacking.append(requirement.name)
            continue
        if not requirement.specifier.contains(version, prereleases=True):
            lacking.append(f"{requirement.name}{requirement.specifier} (there is {version})")
    return list(dict.fromkeys(lacking))

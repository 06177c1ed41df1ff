"""``tiago-mj demo``: a grasp, the real force curve, the real arm, one page. No network, no GPU, under a minute."""

from __future__ import annotations

import argparse
import json
import platform
import shlex
import sys
import time
from pathlib import Path
from typing import Any, Final

import mujoco
import numpy as np

from tiago_mj import __version__, atomic, figures
from tiago_mj.demo import arm_torque, page, report
from tiago_mj.demo.grasp import Grasp, grasp, strip
from tiago_mj.progress import Progress
from tiago_mj.sensing import ta11_curve

#: Largest film that is put into the page [bytes]; a larger one is left beside it, with the filmstrip in the page.
FILM_LIMIT: Final = 3_000_000


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of the command."""
    parser.add_argument("--data", type=Path, metavar="DIR", help="holds tiago_arm/, a recording of a real arm")
    parser.add_argument("--out", type=Path, metavar="DIR", default=Path("out"), help="where to write (out)")
    parser.add_argument("--seed", type=int, metavar="N", default=0, help="of the sensor noise (0)")
    parser.add_argument("--json", action="store_true", help="print demo.json instead of the summary")


def run(arguments: argparse.Namespace) -> int:
    """Run the command.

    Raises:
        ValueError: an argument is unusable; says which and how to mend it.
    """
    began = time.monotonic()
    if arguments.seed < 0:
        raise ValueError(f"--seed is {arguments.seed}: give 0 or more")
    out: Path = arguments.out
    if out.exists() and not out.is_dir():
        raise ValueError(f"--out {out}: this is a file: name a folder")
    out.mkdir(parents=True, exist_ok=True)
    with Progress("demo", quiet=arguments.json) as progress:
        data = _make(arguments, progress, began)
    if arguments.json:
        print(json.dumps(data, indent=2))
        return 0
    print("\n".join(report.lines(data)))
    compared = "a real force curve" if data["arm"] is None else "a real force curve and a real arm"
    print(f"Done in {data['made']['seconds']:.0f} s: a grasp, compared with {compared}.")
    print(f"Written: {out / 'demo.html'}, its numbers in demo.json, its pictures beside it.")
    print(f"Next: open {out / 'demo.html'}; then tiago-mj rollout --env TIAGoTactile-v0 --policy pi --film tiago.mp4")
    return 0


def _make(arguments: argparse.Namespace, progress: Progress, began: float) -> dict[str, Any]:
    """Grasp, compare and write; what ``demo.json`` holds."""
    out: Path = arguments.out
    folder = arm_torque.find(arguments.data)
    arm = None if folder is None else arm_torque.compare(arm_torque.load(folder))
    progress.stage("grasping, with a film")
    done = grasp(seed=arguments.seed)
    progress.stage("comparing the force curve")
    curve = ta11_curve.compare(seed=arguments.seed)
    data: dict[str, Any] = {
        "seed": arguments.seed,
        "grasp": report.grasp_data(done),
        "curve": report.curve_data(curve),
        "arm": None if arm is None else report.arm_data(arm),
        "made": {
            "command": _command(arguments),
            "version": __version__,
            "python": platform.python_version(),
            "mujoco": mujoco.__version__,
            "numpy": np.__version__,
        },
    }
    progress.stage("drawing the pictures")
    pictures = _pictures(done, curve, arm)
    for name, content in pictures.items():
        atomic.write_bytes(out / f"{name}.png", content)
    embedded = {name: page.embedded(content, ".png") for name, content in pictures.items()}
    embedded.update(_film(done, out))
    data["made"]["seconds"] = time.monotonic() - began
    atomic.write_text(out / "demo.json", json.dumps(data, indent=2) + "\n")
    atomic.write_text(out / "demo.html", page.render(data, embedded))
    return data


def _pictures(done: Grasp, curve: ta11_curve.Comparison, arm: arm_torque.ArmComparison | None) -> dict[str, bytes]:
    """PNG files by name."""
    pictures = {"force": figures.png(figures.force(done.trace)), "curve": figures.png(figures.curve(curve))}
    if arm is not None:
        pictures["arm"] = figures.png(figures.arm(arm))
    if done.film is not None:
        chosen, titles = strip(done)
        pictures["filmstrip"] = figures.png(
            figures.filmstrip([done.film.draw(processes=None)[i] for i in chosen], titles)
        )
    return pictures


def _film(done: Grasp, out: Path) -> dict[str, str]:
    """Write the film; hand it back for the page where it is small enough. Without an encoder there is the filmstrip."""
    if done.film is None:
        return {}
    path = out / "film.mp4"
    try:
        done.film.write(path)
    except (ImportError, RuntimeError) as fault:
        print(
            f"no film, only pictures: {' '.join(str(fault).split())}; try: pip install 'imageio[ffmpeg]'",
            file=sys.stderr,
        )
        return {}
    content = path.read_bytes()
    return {"film": page.embedded(content, ".mp4")} if len(content) <= FILM_LIMIT else {}


def _command(arguments: argparse.Namespace) -> str:
    """The command that makes the same page."""
    words = ["tiago-mj", "demo"]
    for name in ("data", "out"):
        if getattr(arguments, name) is not None:
            words += [f"--{name}", shlex.quote(str(getattr(arguments, name)))]
    return " ".join([*words, "--seed", str(arguments.seed)])

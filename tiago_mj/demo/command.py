"""``tiago-mj demo``: an effect hidden and found, a grasp, the real force curve, TIAGo as a whole; one page."""

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

from tiago_mj import __version__
from tiago_mj.demo import arm_torque, hidden, page, report
from tiago_mj.demo.grasp import Grasp, grasp
from tiago_mj.demo.whole import whole
from tiago_mj.gap.command import Told
from tiago_mj.io import atomic, extra
from tiago_mj.io.progress import Progress
from tiago_mj.sensing import ta11_curve
from tiago_mj.view import figures
from tiago_mj.view.film import Frame, write_frames

#: Largest film that is put into the page [bytes]; a larger one is left beside it, with the filmstrip in the page.
FILM_LIMIT: Final = 3_000_000
#: Folder of the diagnosis' report, in that of the page.
DIAGNOSIS: Final = "diagnosis"
#: Files that only some runs write.
PARTS: Final = ("arm.png", "gap.png", "film.mp4", "nominal.mp4", "repaired.mp4")


def run(arguments: argparse.Namespace) -> int:
    """Run the command.

    Raises:
        ValueError: an argument is unusable; says which and how to mend it.
    """
    began = time.monotonic()
    if arguments.seed < 0:
        raise ValueError(f"--seed is {arguments.seed}: give 0 or more")
    out: Path = arguments.out
    with Progress("demo", quiet=arguments.json) as progress, atomic.replacing_set(out, parts=PARTS) as new:
        data = _make(arguments, new, progress, began)
    if arguments.json:
        print(json.dumps(data, indent=2))
        return 0
    print("\n".join(report.lines(data)))
    compared = "a real force curve" if data["arm"] is None else "a real force curve and a real arm"
    print(f"Done in {data['made']['seconds']:.0f} s: {report.outcome(data)}a grasp, compared with {compared}.")
    print(f"Written: {out / 'demo.html'}, for a browser, its numbers in demo.json, its pictures beside it.")
    print("Next: tiago-mj rollout --env TIAGoTactile-v0 --policy pi --film tiago.mp4")
    return 0


def _make(arguments: argparse.Namespace, out: Path, progress: Progress, began: float) -> dict[str, Any]:
    """Hide and find an effect, grasp, compare and write into ``out``; what ``demo.json`` holds."""
    folder = arm_torque.find(arguments.data)
    arm = None if folder is None else arm_torque.compare(arm_torque.load(folder))
    progress.stage("hiding an effect, and recording grasps with it")
    answer, no_answer = _answer(arguments.seed, out / DIAGNOSIS, progress)
    progress.stage("grasping")
    done = grasp(seed=arguments.seed)
    progress.stage("comparing the force curve")
    curve = ta11_curve.compare(seed=arguments.seed)
    progress.stage("grasping with the whole robot")
    trace, robot = whole(seed=arguments.seed, pictures=done.film is not None)
    data: dict[str, Any] = {
        "seed": arguments.seed,
        "hidden": None if answer is None else report.hidden_data(answer),
        "no_hidden": no_answer,
        "grasp": report.grasp_data(done),
        "curve": report.curve_data(curve),
        "whole": report.whole_data(trace),
        "arm": None if arm is None else report.arm_data(arm),
        "made": {
            "command": _command(arguments),
            "version": __version__,
            "python": platform.python_version(),
            "mujoco": mujoco.__version__,
            "numpy": np.__version__,
        },
    }
    pictures = {"force": figures.png(figures.force(done.trace)), "curve": figures.png(figures.curve(curve))}
    if arm is not None:
        pictures["arm"] = figures.png(figures.arm(arm))
    if answer is not None and answer.diagnosis.overlays:  # none where time was over before it could be drawn
        pictures["gap"] = figures.png(figures.gap(answer.diagnosis.overlays[0], *hidden.SHOWN))
    for name, content in pictures.items():
        atomic.write_bytes(out / f"{name}.png", content)
    embedded = {name: page.embedded(content, ".png") for name, content in pictures.items()}
    embedded |= _films(done, answer, out, progress)
    strip = page.photo(np.concatenate(robot, axis=1)) if robot else None
    data["made"]["seconds"] = time.monotonic() - began
    atomic.write_text(out / "demo.json", json.dumps(data, indent=2) + "\n")
    atomic.write_text(out / "demo.html", page.render(data, embedded, strip))
    return data


def _answer(seed: int, folder: Path, progress: Progress) -> tuple[hidden.Answer | None, str]:
    """Hidden effect and the answer of the diagnosis; or None, and why."""

    try:
        return hidden.find(seed, folder, Told(progress, "diagnosing: ")), ""
    except ModuleNotFoundError as fault:
        return None, str(fault)


def _films(done: Grasp, answer: hidden.Answer | None, out: Path, progress: Progress) -> dict[str, str]:
    """Write the films, and return those small enough for the page; pictures where no encoder is found."""
    films: dict[str, tuple[list[Frame], float]] = {}
    if answer is not None and answer.films:
        taken = answer.films["measured"]
        progress.stage("drawing the film", 2 * ((len(taken.snapshots) - answer.departure) // hidden.EVERY))
        for role, frames in hidden.haunted_films(answer, progress.at).items():
            films[role] = frames, taken.fps / hidden.EVERY
    if done.film is not None:
        progress.stage("drawing the grasp", len(done.film.snapshots))
        films["film"] = done.film.draw(processes=None, done=progress.at), done.film.fps
    embedded = {}
    for name, (frames, fps) in films.items():
        path = out / f"{name}.mp4"
        try:
            write_frames(path, frames, fps)
        except (ImportError, RuntimeError) as fault:
            what = f"no film, only pictures: {' '.join(str(fault).split())}"
            print(f"{what}; try: {extra.pip()} 'imageio[ffmpeg]'", file=sys.stderr)
            return {}
        content = path.read_bytes()
        if len(content) <= FILM_LIMIT:
            embedded[name] = page.embedded(content, ".mp4")
    return embedded


def _command(arguments: argparse.Namespace) -> str:
    """The command that makes the same page."""
    words = ["tiago-mj", "demo"]
    for name in ("data", "out"):
        if getattr(arguments, name) is not None:
            words += [f"--{name}", shlex.quote(str(getattr(arguments, name)))]
    return " ".join([*words, "--seed", str(arguments.seed)])

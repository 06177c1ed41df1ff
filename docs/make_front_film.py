"""Film the README's moving picture: `python docs/make_front_film.py`.

A gripper with hidden friction is recorded and diagnosed, as the README's commands do. Then it and its simulator are
given the same commands: the simulator's ghost departs from the robot, the effect that the diagnosis found is switched
on, and the ghost returns. Distances between the two are drawn larger than they are; forces as they are.
"""

import argparse
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import tiago_mj  # noqa: F401  (chooses the headless renderer before mujoco is imported)

import gymnasium  # isort: skip
import imageio.v3 as iio
import mujoco
import numpy as np
from make_pictures import IMAGES, antialiased
from PIL import Image, ImageDraw, ImageFont

from tiago_mj.effects import read_effects
from tiago_mj.envs.flat import core_of
from tiago_mj.io import atomic
from tiago_mj.models import names
from tiago_mj.view import colours

ENV = "GripperTactile-v0"
HIDDEN = '{"coulomb_friction": {"force": 2.5}}'
#: Fingers go from open to this far beyond the object's surface [m], so many times, in so many seconds each.
OPEN, SQUEEZE, CYCLES, PERIOD = 0.034, 0.004, 4, 1.0
#: Seconds of the motion after which the effect is switched on; seconds in which the camera's ghost turns blue.
SWITCHED = 2.0
#: Distances between robot and ghost are drawn this many times larger.
LARGER = 12
#: The robot's fingers, as dark as its curve.
FINGERS = (0.2, 0.22, 0.25)
#: How far the ghost is drawn in front of the robot [m].
TOWARDS = 0.0008
#: Frames a second of the film, and how many times slower than life it is.
FPS, SLOWER = 12.5, 2.5
SCENE, PANEL, HEIGHT, TOP = 420, 440, 340, 44
INK, SOFT, PAPER, LINE = (26, 31, 38), (91, 100, 112), (255, 255, 255), (223, 227, 232)


@dataclass(frozen=True)
class Run:
    """Robot and simulator under the same commands: time (T,) [s], positions (T, nq), forces on the pads (T, 2) [N]."""

    time: np.ndarray
    robot: np.ndarray
    ghost: np.ndarray
    measured: np.ndarray
    simulated: np.ndarray


def found(folder: Path) -> Path:
    """Record the robot and diagnose it; the calibration that is found."""
    tiago = [sys.executable, "-m", "tiago_mj.cli"]
    recorded, diagnosis = folder / "recordings", folder / "diagnosis"
    record = ["record", "--env", ENV, "--policy", "pi", "--episodes", "10", "--effects", HIDDEN, "--out", recorded]
    subprocess.run([*tiago, *record], check=True)
    subprocess.run([*tiago, "diagnose", recorded, "--out", diagnosis], check=True)
    return diagnosis / "calibration.yaml"


def moved(calibration: Path) -> tuple[Run, mujoco.MjModel]:
    """Both under the same commands; the simulator gets the calibration's effects half-way."""
    make = {"control": "position", "object_offset": 0.0, "max_episode_steps": -1}
    robot = gymnasium.make(f"tiago_mj/{ENV}", effects=HIDDEN, **make)
    simulator = gymnasium.make(f"tiago_mj/{ENV}", **make)
    cores = core_of(robot), core_of(simulator)
    for one in (robot, simulator):
        one.reset(seed=0)
    low, high = cores[0].drive.low, cores[0].drive.high
    touch = cores[0].item.width / 2
    rows: list[list[np.ndarray]] = [[], [], [], []]
    steps = round(CYCLES * PERIOD / cores[0].dt)
    for step in range(steps):
        phase = 0.5 - 0.5 * np.cos(2 * np.pi * step * cores[0].dt / PERIOD)
        wanted = OPEN + (touch - SQUEEZE - OPEN) * phase
        action = np.clip(2 * (wanted - low) / (high - low) - 1, -1, 1)
        if step == round(SWITCHED / cores[0].dt):
            cores[1].give_effects(list(read_effects(str(calibration))))
        for k, (env, core) in enumerate(zip((robot, simulator), cores, strict=True)):
            env.step(action)
            rows[k].append(core.data.qpos.copy())
            rows[2 + k].append(np.array(core.state.force_contact))
    time = np.arange(1, steps + 1) * cores[0].dt
    return Run(time, *(np.array(one) for one in rows)), cores[0].model


def scenes(run: Run, model: mujoco.MjModel, rows: np.ndarray) -> list[np.ndarray]:
    """Pictures of robot and ghost at rows, each (HEIGHT - TOP, SCENE, 3)."""
    width, height = 2 * SCENE, 2 * (HEIGHT - TOP)
    model.vis.global_.offwidth, model.vis.global_.offheight = width, height
    fingers = {int(model.jnt_bodyid[model.joint(name).id]) for name in names.FINGERS}
    moving = {body for body in range(model.nbody) if fingers & {body, *above(model, body)}}
    camera, data, ghost = mujoco.MjvCamera(), mujoco.MjData(model), mujoco.MjData(model)
    camera.lookat[:], camera.distance, camera.azimuth, camera.elevation = (0.636, 0.0, 0.62), 0.265, 180, -58
    for geom in range(model.ngeom):
        if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_PLANE:
            model.geom_matid[geom], model.geom_rgba[geom] = -1, (0.0, 0.0, 0.0, 0.0)
        elif model.geom_bodyid[geom] == 0:
            model.geom_matid[geom], model.geom_rgba[geom] = -1, (0.93, 0.94, 0.95, 1.0)
        elif model.geom_bodyid[geom] in moving:
            model.geom_matid[geom], model.geom_rgba[geom] = -1, (*FINGERS, 1.0)
    pictures = []
    with mujoco.Renderer(model, height, width) as renderer:
        for row in rows:
            data.qpos[:] = run.robot[row]
            ghost.qpos[:] = run.robot[row] + LARGER * (run.ghost[row] - run.robot[row])
            for one in (data, ghost):
                mujoco.mj_kinematics(model, one)
                mujoco.mj_comPos(model, one)
                mujoco.mj_camlight(model, one)
            renderer.update_scene(data, camera)
            drawn = renderer.scene
            for flag in (mujoco.mjtRndFlag.mjRND_SKYBOX, mujoco.mjtRndFlag.mjRND_REFLECTION):
                drawn.flags[flag] = 0
            first = drawn.ngeom
            dynamic = int(mujoco.mjtCatBit.mjCAT_DYNAMIC)
            mujoco.mjv_addGeoms(model, ghost, mujoco.MjvOption(), mujoco.MjvPerturb(), dynamic, drawn)
            for k in range(first, drawn.ngeom):
                geom = drawn.geoms[k]
                own = geom.objtype == mujoco.mjtObj.mjOBJ_GEOM and int(model.geom_bodyid[geom.objid]) in moving
                geom.matid = -1
                geom.pos[:] += TOWARDS * np.array([1.0, 0.0, 1.6])  # in front of the robot where both are in one place
                geom.rgba[:] = (*colours.rgb(colour_of(run.time[row])), 0.5 if own else 0.0)
            pixels = antialiased(renderer.render())
            pictures.append(np.where((pixels == 0).all(axis=-1, keepdims=True), np.uint8(255), pixels))
    return pictures


def above(model: mujoco.MjModel, body: int) -> set[int]:
    """Bodies that carry a body."""
    found = set()
    while body:
        body = int(model.body_parentid[body])
        found.add(body)
    return found


def colour_of(time: float) -> str:
    """The ghost's: of the nominal simulator, and of the repaired one once the effect is switched on."""
    return colours.LOOKS["nominal" if time < SWITCHED else "repaired"].colour


def panel(run: Run, row: int, name: str) -> Image.Image:
    """The force curves until a row, (HEIGHT - TOP, PANEL), with the effect's switch above them."""
    k = 2  # drawn twice as large, and made smaller afterwards: smooth lines
    image = Image.new("RGB", (k * PANEL, k * (HEIGHT - TOP)), PAPER)
    draw = ImageDraw.Draw(image)
    on = run.time[row] >= SWITCHED
    switch(draw, k, on, name)
    left, right, top, bottom = 46 * k, (PANEL - 14) * k, 84 * k, (HEIGHT - TOP - 30) * k
    most = 8.0
    for newtons in (0, 2, 4, 6, 8):
        y = bottom - (bottom - top) * newtons / most
        draw.line((left, y, right, y), fill=LINE, width=k)
        draw.text((left - 6 * k, y), str(newtons), fill=SOFT, font=font(11 * k), anchor="rm")
    draw.text((left, top - 8 * k), "force on the fingertip [N]", fill=SOFT, font=font(12 * k), anchor="ls")
    draw.text((right, bottom + 8 * k), "time", fill=SOFT, font=font(11 * k), anchor="rt")

    def points(values: np.ndarray, which: np.ndarray) -> list[tuple[float, float]]:
        x = left + (right - left) * run.time[which] / run.time[-1]
        y = bottom - (bottom - top) * np.clip(values[which], 0, most) / most
        return list(zip(x.tolist(), y.tolist(), strict=True))

    until = np.arange(row + 1)
    if row > 1:
        draw.line(points(run.measured[:, 0], until), fill=INK, width=4 * k, joint="curve")
        before, after = until[run.time[until] < SWITCHED], until[run.time[until] >= SWITCHED]
        for which in (before, after):
            if len(which) > 1:
                line = points(run.simulated[:, 0], which)
                draw.line(line, fill=colours.rgb255(colour_of(run.time[which[0]])), width=2 * k, joint="curve")
    if on:
        x = left + (right - left) * SWITCHED / run.time[-1]
        draw.line((x, top, x, bottom), fill=SOFT, width=k)
    return image.resize((PANEL, HEIGHT - TOP), Image.Resampling.LANCZOS)


def switch(draw: ImageDraw.ImageDraw, k: int, on: bool, name: str) -> None:
    """The effect with its switch."""
    colour = colours.rgb255(colours.LOOKS["repaired"].colour) if on else (170, 177, 186)
    x, y, w, h = 16 * k, 16 * k, 44 * k, 24 * k
    draw.rounded_rectangle((x, y, x + w, y + h), radius=h // 2, fill=colour)
    knob = x + w - h if on else x
    draw.ellipse((knob + 3 * k, y + 3 * k, knob + h - 3 * k, y + h - 3 * k), fill=PAPER)
    draw.text((x + w + 12 * k, y + h / 2), name, fill=INK if on else SOFT, font=font(16 * k), anchor="lm")


def header(on: bool) -> Image.Image:
    """Who is who, (TOP, SCENE + PANEL)."""
    k = 2
    image = Image.new("RGB", (k * (SCENE + PANEL), k * TOP), (244, 246, 248))
    draw = ImageDraw.Draw(image)
    x = 16 * k
    ghost = "repaired" if on else "nominal"
    words = {
        "nominal": f"its simulator (distances {LARGER} times larger)",
        "repaired": "the simulator with what was found",
    }
    for colour, text in ((colours.LOOKS["measured"].colour, "robot"), (colours.LOOKS[ghost].colour, words[ghost])):
        draw.rounded_rectangle((x, 14 * k, x + 16 * k, 30 * k), radius=4 * k, fill=colours.rgb255(colour))
        draw.text((x + 24 * k, 22 * k), text, fill=INK, font=font(16 * k), anchor="lm")
        x += (24 + 26) * k + int(draw.textlength(text, font=font(16 * k)))
    return image.resize((SCENE + PANEL, TOP), Image.Resampling.LANCZOS)


def font(size: float) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    """The one that Pillow brings."""
    return ImageFont.load_default(size)


def film(run: Run, model: mujoco.MjModel, name: str) -> list[np.ndarray]:
    """All frames, each (HEIGHT, SCENE + PANEL, 3)."""
    shown = np.arange(0, run.time[-1], 1 / (FPS * SLOWER))
    rows = np.unique(np.searchsorted(run.time, shown).clip(0, len(run.time) - 1))
    frames = []
    for row, scene in zip(rows, scenes(run, model, rows), strict=True):
        frame = Image.new("RGB", (SCENE + PANEL, HEIGHT), PAPER)
        frame.paste(header(run.time[row] >= SWITCHED), (0, 0))
        frame.paste(Image.fromarray(scene), (0, TOP))
        frame.paste(panel(run, row, name), (SCENE, TOP))
        frames.append(np.asarray(frame))
    return frames


def said(calibration: Path) -> str:
    """What was found, in a few words."""
    (effect,) = read_effects(str(calibration))
    ((_, value),) = effect.parameters.items()
    return f"found: {effect.name.replace('_', ' ').capitalize()} {float(np.mean(value)):.1f} N"


def main() -> None:
    """Make the film; a calibration that is already there may be given instead of recording and diagnosing."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--calibration", type=Path, help="of an earlier diagnosis of the same recordings")
    given = parser.parse_args().calibration
    with tempfile.TemporaryDirectory() as folder:
        calibration = given or found(Path(folder))
        run, model = moved(calibration)
        frames = film(run, model, said(calibration))
    path = IMAGES / "front.webp"
    with atomic.replacing(path) as temporary:
        iio.imwrite(temporary, frames, extension=".webp", duration=round(1000 / FPS), loop=0, quality=62, method=6)
    print(f"{path.name}: {len(frames)} frames, {path.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main()

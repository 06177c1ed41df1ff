"""Thousands of grippers on a GPU in MuJoCo Warp: control steps per second, and how well they agree with the CPU.

    pip install '.[warp]'
    python benchmarks/warp.py [--worlds 4096] [--rounds 5]

Every world is the model of `GripperTactile-v0`: the fingers close in the first half of an episode, each program at its
own speed, and hold in the second. The commands are those of the scalar environment, and the CPU's answer to them, in
double precision, is what the worlds are compared with: force curves (every control step's contact force of both pads)
in units of the curve's peak, and finger positions. Beside that stands how far the CPU is from itself when state and
commands are rounded to single precision: a grasp slides freely sideways, so that small differences grow.

A round times one episode of all worlds, whose control step is one CUDA graph, and one episode of MuJoCo alone on one
CPU thread; the first, untimed episode compiles and is compared.

Without a GPU, or without the package, it says so and measures nothing. `--device cpu --worlds 8` runs the same on
Warp's CPU device, as a check of the agreement alone: it is no speed to speak of, so none is saved.
"""

from __future__ import annotations

import argparse
import os
import statistics
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import gymnasium
import mujoco
import numpy as np
from machine import save
from mujoco import rollout

import tiago_mj  # noqa: F401
from tiago_mj.models import names
from tiago_mj.sensing.sources import PadForces

ID = "tiago_mj/GripperTactile-v0"
#: Different programs; more worlds repeat them.
PROGRAMS = 64
SLOWEST = 0.6  # of full closing speed: the slowest that reaches the object in half an episode
#: What an episode begins with; all else follows from it.
STATE = ("time", "qpos", "qvel", "act", "qacc_warmstart", "ctrl")
#: Contacts and constraints that room is made for, as a multiple of the most that the CPU met.
ROOM = 2
#: Of the overflows that MuJoCo Warp reports, those for want of room; the others are solvers that ran out of iterations.
ROOMS = ("NEFC", "BROADPHASE", "NARROWPHASE", "CCD", "CONTACT_MATCH")


def programs(env: Any, count: int) -> np.ndarray:
    """Controls of the scalar environment, (count, control steps, actuators) [as ``ctrl``]."""
    core, limit = env.unwrapped, env.spec.max_episode_steps
    controls = np.zeros((count, limit, core.model.nu))
    for k, speed in enumerate(np.linspace(1.0, SLOWEST, count)):
        env.reset(seed=0)
        for step in range(limit):
            env.step(np.full(2, -speed if step < limit // 2 else 0.0, dtype=np.float32))
            controls[k, step] = core.data.ctrl
    return controls


def begin(env: Any) -> np.ndarray:
    """State after the reset, (n,)."""
    core = env.unwrapped
    env.reset(seed=0)
    mujoco.mj_forward(core.model, core.data)
    kind = mujoco.mjtState.mjSTATE_FULLPHYSICS
    state = np.empty(mujoco.mj_stateSize(core.model, kind))
    mujoco.mj_getState(core.model, core.data, state, kind)
    return state


def on_cpu(model: mujoco.MjModel, start: np.ndarray, controls: np.ndarray, substeps: int) -> tuple[np.ndarray, float]:
    """Sensor data of every program at every control step, (programs, steps, n), and seconds on one thread."""
    every = np.repeat(controls, substeps, axis=1)
    data = mujoco.MjData(model)
    begun = time.perf_counter()
    states, sensed = rollout.rollout(model, data, start[None], every)
    spent = time.perf_counter() - begun
    positions = states[:, substeps - 1 :: substeps, 1 : 1 + model.nq]
    return np.concatenate([positions, sensed[:, substeps - 1 :: substeps]], axis=-1), spent


def room(model: mujoco.MjModel, start: np.ndarray, controls: np.ndarray, substeps: int) -> tuple[int, int]:
    """Contacts and constraints to make room for in a world."""
    data = mujoco.MjData(model)
    mujoco.mj_setState(model, data, start, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    most = [1, 1]
    for control in controls:
        data.ctrl[:] = control
        for _ in range(substeps):
            mujoco.mj_step(model, data)
            most = [max(most[0], data.ncon), max(most[1], data.nefc)]
    return ROOM * most[0], ROOM * most[1]


class Worlds:
    """All worlds on a device, and one episode's controls."""

    def __init__(self, libraries: tuple[Any, Any], env: Any, start: np.ndarray, controls: np.ndarray, worlds: int):
        self.wp, self.mjw = libraries
        core = env.unwrapped
        model, self.substeps = core.model, core.n_substeps
        data = mujoco.MjData(model)
        mujoco.mj_setState(model, data, start, mujoco.mjtState.mjSTATE_FULLPHYSICS)
        mujoco.mj_forward(model, data)
        data.qacc_warmstart[:] = 0  # as `rollout` begins
        contacts, constraints = room(model, start, controls[0], self.substeps)
        self.model = self.mjw.put_model(model)
        self.data = self.mjw.put_data(model, data, nworld=worlds, nconmax=contacts, njmax=constraints)
        tiled = controls[np.arange(worlds) % len(controls)].swapaxes(0, 1)
        self.controls = [self.wp.array(np.ascontiguousarray(row), dtype=self.wp.float32) for row in tiled]
        self.start = {name: self.wp.clone(getattr(self.data, name)) for name in STATE}
        self.step = self._step_as_a_graph()

    def _substeps(self) -> None:
        for _ in range(self.substeps):
            self.mjw.step(self.model, self.data)

    def _step_as_a_graph(self) -> Callable[[], None]:
        """One control step: on a GPU one graph, as thousands of launches a step would cost more than the physics."""
        self._substeps()  # compiles, and allocates what must not be allocated in a graph
        if not self.wp.get_device().is_cuda:
            return self._substeps
        with self.wp.ScopedCapture() as capture:
            self._substeps()
        return lambda: self.wp.capture_launch(capture.graph)

    def episode(self, watch: Callable[[], None] | None = None) -> float:
        """Seconds of an episode of all worlds."""
        for name, value in self.start.items():
            self.wp.copy(getattr(self.data, name), value)
        self.wp.synchronize()
        begun = time.perf_counter()
        for row in self.controls:
            self.wp.copy(self.data.ctrl, row)
            self.step()
            if watch is not None:
                watch()
        self.wp.synchronize()
        return time.perf_counter() - begun

    def followed(self, count: int) -> np.ndarray:
        """Positions and sensor data of the first worlds at every control step, (count, steps, n)."""
        rows: list[np.ndarray] = []
        read = (self.data.qpos, self.data.sensordata)
        self.episode(lambda: rows.append(np.concatenate([a.numpy()[:count] for a in read], axis=1)))
        return np.stack(rows, axis=1)

    def full(self) -> list[str]:
        """What there was too little room for, in any world."""
        met = int(np.bitwise_or.reduce(self.data.overflow.numpy()))
        return [name for name in ROOMS if met & int(self.mjw.OverflowType[name])]


def agreement(model: mujoco.MjModel, cpu: np.ndarray, found: np.ndarray) -> dict[str, float]:
    """Errors against the CPU, over all programs; forces in units of the peak. Both are (programs, steps, n): positions
    and sensor data."""
    pads = PadForces(model)
    forces, others = (pads.truth(values[..., model.nq :]) for values in (cpu, found))
    error = np.abs(others - forces) / forces.max()
    fingers = [model.joint(name).qposadr[0] for name in names.FINGERS]
    final = slice(-forces.shape[1] // 10, None)
    return {
        "peak_newtons": float(forces.max()),
        "force_rms": float(np.sqrt((error**2).mean())),
        "force_p95": float(np.percentile(error, 95)),
        "held_force_worst": float(np.abs((others - forces)[:, final].mean(axis=1)).max() / forces.max()),
        "finger_worst_metres": float(np.abs(found[..., fingers] - cpu[..., fingers]).max()),
        "diverged": float((~np.isfinite(found)).any(axis=(1, 2)).sum()),
    }


def in_words(agree: dict[str, float]) -> str:
    return (
        f"force rms {agree['force_rms']:.2%} of the peak of {agree['peak_newtons']:.1f} N, 95 % of the control steps "
        f"within {agree['force_p95']:.2%}, held force within {agree['held_force_worst']:.2%}, fingers within "
        f"{agree['finger_worst_metres'] * 1e6:.0f} µm, {agree['diverged']:.0f} diverged"
    )


@contextmanager
def silence() -> Iterator[None]:
    """Nothing on standard error, also from C: without a GPU Warp warns of that, which is said here in one line."""
    sys.stderr.flush()
    kept, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 2)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)


def libraries(device: str) -> tuple[tuple[Any, Any] | None, str]:
    """Warp and MuJoCo Warp, or why there is nothing to measure."""
    here = Path(__file__).resolve().parent
    sys.path[:] = [folder for folder in sys.path if Path(folder or ".").resolve() != here]  # this file is called warp
    try:
        import mujoco_warp
        import warp
    except ModuleNotFoundError as fault:
        return None, f"{fault.name} is not installed: pip install mujoco-warp"
    warp.config.log_level = warp.LOG_WARNING
    with silence():
        warp.init()
    if device == "cpu" or warp.get_cuda_device_count() > 0:
        return (warp, mujoco_warp), ""
    return None, "no GPU that CUDA can use is at hand"


def main(words: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--worlds", type=int, default=4096)
    parser.add_argument("--rounds", type=int, default=5, help="samples of each")
    parser.add_argument("--device", default="cuda:0", help="Warp's name of it; cpu: only the agreement")
    given = parser.parse_args(words)
    if given.worlds < 1 or given.rounds < 1:
        parser.error("--worlds and --rounds are 1 or more")
    found, why_not = libraries(given.device)
    if found is None:
        print(f"MuJoCo Warp is not measured: {why_not}")
        return
    wp, mjw = found
    env = gymnasium.make(ID)
    core = env.unwrapped
    controls, start = programs(env, min(PROGRAMS, given.worlds)), begin(env)
    cpu, _ = on_cpu(core.model, start, controls, core.n_substeps)
    rounded, _ = on_cpu(core.model, *(values.astype(np.float32) for values in (start, controls)), core.n_substeps)
    itself = agreement(core.model, cpu, rounded)
    with wp.ScopedDevice(given.device):
        device, begun = wp.get_device(), time.perf_counter()
        free = device.free_memory if device.is_cuda else 0
        worlds = Worlds(found, env, start, controls, given.worlds)
        agree = agreement(core.model, cpu, worlds.followed(len(controls)))
        compiled = time.perf_counter() - begun
        if worlds.full():
            raise SystemExit(f"too little room in MuJoCo Warp for {', '.join(worlds.full())}: raise ROOM")
        print(f"{given.worlds} grippers on {device.name}, {len(controls)} programs; against the CPU:")
        for label, one in (("MuJoCo Warp", agree), ("the CPU, rounded to single precision", itself)):
            print(f"  {label}: {in_words(one)}")
        if not device.is_cuda:
            return
        limit = len(worlds.controls)
        taken: list[tuple[float, float]] = []
        for k in range(given.rounds):
            alone = on_cpu(core.model, start, controls[k % len(controls)][None], core.n_substeps)[1]
            taken.append((worlds.episode() / limit / given.worlds, alone / limit))
        rates = {
            "steps_per_second": 1 / statistics.median(gpu for gpu, _ in taken),
            "mujoco_alone_steps_per_second": 1 / statistics.median(alone for _, alone in taken),
            "times_one_thread": statistics.median(alone / gpu for gpu, alone in taken),
        }
        results = {
            "device": device.name,
            "worlds": given.worlds,
            "compile_seconds": compiled,
            "mujoco_warp": mjw.__version__,
            "warp": wp.__version__,
            "memory_mb": (free - device.free_memory) / 1e6,
            "agreement": agree,
            "cpu_rounded": itself,
            **rates,
        }
    print(
        f"{rates['steps_per_second']:,.0f} control steps/s; MuJoCo alone on one CPU thread "
        f"{rates['mujoco_alone_steps_per_second']:,.0f}: {rates['times_one_thread']:.0f} times as many"
    )
    print("saved", save("warp", results).name)


if __name__ == "__main__":
    main()

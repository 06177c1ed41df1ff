"""How far a grasp's force curve is from the one computed at a 0.1 ms physics step.

    python benchmarks/time_step.py

The same commands run at each step: `close` at full speed on an object 5 mm off the middle, into the effort limit; and
`wave`, which touches, lets go and touches again. A curve is both fingers' contact force at every control step. Errors
are in units of the reference's peak: `rms` and `p95` over the episode, `max` at the worst control step, which is always
one in which contact begins or ends (the reading is one physics step old, and the force jumps by damping times approach
speed there).
"""

from __future__ import annotations

import gymnasium
import numpy as np
from machine import save

import tiago_mj  # noqa: F401
from tiago_mj.envs import arguments

REFERENCE = 1e-4
STEPS = (1 / 240, 1 / 480, 1 / 960, 1 / 1920)


def curve(timestep: float, item: str, program: str, control_hz: float) -> np.ndarray:
    """Contact forces (steps, 2) [N] of a second and a quarter of commands."""
    arguments.MAX_TIMESTEP = timestep
    env = gymnasium.make("tiago_mj/GripperTactile-v0", object=item, control_hz=control_hz).unwrapped
    env.reset(seed=0)
    forces = []
    for step in range(round(1.25 * control_hz)):
        time = step / control_hz
        wave = -0.5 if time < 0.55 else -0.1 * np.sin(2 * np.pi * 3 * time)
        env.step(np.full(2, -1.0 if program == "close" else wave))
        forces.append(env.state.force_contact)
    return np.array(forces)


def main() -> None:
    default = arguments.MAX_TIMESTEP
    rows = []
    for control_hz in (240.0, 25.0):
        for program in ("close", "wave"):
            for item in ("cylinder", "box", "cylinder_soft"):
                reference = curve(REFERENCE, item, program, control_hz)
                for timestep in STEPS:
                    try:
                        error = np.abs(curve(timestep, item, program, control_hz) - reference) / reference.max()
                    except ValueError as refusal:  # the contact would be unstable
                        print(f"{control_hz:5.0f} Hz {program:6}{item:14} {timestep * 1e3:6.3f} ms refused: {refusal}")
                        continue
                    row = {
                        "control_hz": control_hz,
                        "program": program,
                        "object": item,
                        "timestep": timestep,
                        "rms": float(np.sqrt((error**2).mean())),
                        "p95": float(np.percentile(error, 95)),
                        "max": float(error.max()),
                    }
                    rows.append(row)
                    print(
                        f"{control_hz:5.0f} Hz {program:6}{item:14} {timestep * 1e3:6.3f} ms"
                        f"  rms {row['rms']:.4f}  p95 {row['p95']:.4f}  max {row['max']:.3f}"
                    )
    print("saved", save("time_step", {"default": default, "reference": REFERENCE, "rows": rows}).name)


if __name__ == "__main__":
    main()

"""Upper bound on the return of any controller in the paper's task, and the return of optimal control of the nominal
model.

    python benchmarks/force_bound.py [--servos ideal pal] [--evaluations 9000] [--seed 0]

GripperTactile-v0 with the object in the middle, goal 1.0, 300 steps. Four figures per servo, as rewards [sensor units]:

`exact`: proven without noise: fingers that close at the speed limit until they can touch, then no error at all.
`pressed`: the same, but the force rises as that of fingers that go on closing at the limit.
`achieved`: found: both fingers close at the limit, then follow a sequence of velocities around the contact, optimised
by CMA-ES (Hansen and Ostermeier 2001) on the simulator itself, then a proportional law on noise-free forces keeps the
goal.
`expected` beside each: its mean with the sensor's noise (the open-loop sequence does not react to noise; the law that
keeps the goal is taken as if it did not, so that this is what a perfect filter would earn).

`below`: by how much `achieved` stays below `exact` [%]: the gap in which the truth lies.
"""

from __future__ import annotations

import argparse
from dataclasses import asdict
from typing import Any

import cma
import gymnasium
import mujoco
import numpy as np
from machine import save

import tiago_mj
from tiago_mj.envs.hold_force import HoldForce
from tiago_mj.evaluate.bound import expected_distance, least_cost
from tiago_mj.sensing.load_cell import TA11_NOISE, LoadCell

EPISODE = 300
#: Control steps with a velocity of their own, before and after the first reading of a contact. The servo's lag is 40
#: ms, 9.6 steps; the contact's time constant, (80 + 100) N·s/m over (2000 + 10 000) N/m, is 15 ms, 3.6 steps.
BEFORE, AFTER = 10, 18
#: Time constant of a contact of 10 kN/m and 100 N·s/m under a finger whose velocity is commanded [control steps].
CONTACT_STEPS = 2.4
#: Steps after the sequence in which the proportional law has settled, to the last digit that is printed.
SETTLED = 50
#: Of the law that keeps the goal: at most so much of the error is taken away in a control step.
SHARE = 0.15


class Simulation:
    """The noise-free episode from shortly before the contact on."""

    def __init__(self, servo: str) -> None:
        cell = LoadCell(noise=0.0, threshold=5 * TA11_NOISE)
        made: Any = gymnasium.make(
            f"{tiago_mj.registration.NAMESPACE}/GripperTactileGoal-v0",
            servo=servo,
            object_offset=0.0,
            sensing=cell,
            visual=False,
        )
        self.core: HoldForce = made.unwrapped
        self.core.reset(seed=0)
        self.bound = least_cost(self.core, EPISODE)
        self.begin = self.bound.both_contacts - 1 - BEFORE
        self._signature = mujoco.mjtState.mjSTATE_INTEGRATION
        for _ in range(self.begin):
            self.core.step(-np.ones(2))
        self._state = np.empty(mujoco.mj_stateSize(self.core.model, self._signature))
        mujoco.mj_getState(self.core.model, self.core.data, self._state, self._signature)
        stiffness = 2000.0 if servo == "pal" else self.core.object_choice.most("stiffness")  # type: ignore[union-attr]
        unit = self.core.load_cell.units(1.0)
        self._gain = SHARE / (stiffness * unit * self.core.dt * float(self.core.velocity_limit[0]))

    def forces(self, sequence: np.ndarray, steps: int) -> np.ndarray:
        """Readings from step ``begin`` on, (steps, 2), for actions of both fingers, (BEFORE + AFTER,)."""
        core = self.core
        mujoco.mj_setState(core.model, core.data, self._state, self._signature)
        force = np.zeros(2)
        rows = np.empty((steps, 2))
        for step in range(steps):
            if step < len(sequence):
                action = np.full(2, sequence[step])
            else:
                action = np.clip(self._gain * (force - core.goal), -1, 1)
            _, _, _, _, info = core.step(action)
            force = rows[step] = info["force_raw"]
        return rows

    def cost(self, sequence: np.ndarray, steps: int) -> float:
        """Distance from the goal over so many steps."""
        return float(np.abs(self.forces(sequence, steps) - self.core.goal).sum())


def optimise(simulation: Simulation, evaluations: int, seed: int) -> np.ndarray:
    """The best sequence that is found, (BEFORE + AFTER,), from starts that brake at the contact or a step beside it."""
    horizon = BEFORE + AFTER + SETTLED
    found = []
    for start, contact in enumerate((BEFORE - 1, BEFORE, BEFORE + 1)):
        later = np.maximum(np.arange(BEFORE + AFTER) - contact, 0)
        strategy = cma.CMAEvolutionStrategy(
            np.where(later > 0, -0.5 * np.exp(-later / CONTACT_STEPS), -0.98),
            0.15,
            # Seed 0 would be the clock's.
            {"bounds": [-1, 1], "maxfevals": evaluations // 3, "seed": 3 * seed + start + 1, "verbose": -9},
        )
        strategy.optimize(lambda sequence: simulation.cost(sequence, horizon))
        found.append((strategy.result.fbest, np.asarray(strategy.result.xbest)))
    return min(found, key=lambda one: one[0])[1]


def bound_of(servo: str, evaluations: int, seed: int) -> dict[str, Any]:
    """All figures for one servo."""
    simulation = Simulation(servo)
    bound, goal = simulation.bound, simulation.core.goal
    sequence = np.round(optimise(simulation, evaluations, seed), 4)  # what is written is what was played
    rest = simulation.forces(sequence, EPISODE - simulation.begin)
    distance = np.concatenate([np.tile(goal, (simulation.begin, 1)), np.abs(rest - goal)])
    noisy = np.full(2, TA11_NOISE)
    exact = least_cost_with(simulation, TA11_NOISE)
    return {
        "first_reading_of_contact": bound.first_contact,
        "exact": {"reward": -bound.exact, "expected": -exact["expected"]},
        "pressed": {"reward": -bound.pressed, "expected": -exact["pressed_expected"]},
        "achieved": {
            "reward": -float(distance.sum()),
            "expected": -float(expected_distance(distance, noisy).sum()),
            "from_step": simulation.begin + 1,
            "actions": sequence.tolist(),
            "forces": [[round(float(f), 4) for f in row] for row in rest[: BEFORE + AFTER]],
        },
        "below": 100 * (float(distance.sum()) / bound.exact - 1),
    }


def least_cost_with(simulation: Simulation, noise: float) -> dict[str, float]:
    """The bound of the same episode with the sensor's noise."""
    core = simulation.core
    quiet, core.load_cell = core.load_cell, LoadCell(noise=noise)
    try:
        return asdict(least_cost(core, EPISODE))
    finally:
        core.load_cell = quiet


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--servos", nargs="+", default=["ideal", "pal"])
    parser.add_argument("--evaluations", type=int, default=9000, help="of CMA-ES, for each servo")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    found = {}
    for servo in arguments.servos:
        found[servo] = bound_of(servo, arguments.evaluations, arguments.seed)
        row = found[servo]
        names = ("exact", "pressed", "achieved")
        rewards = "; ".join(f"{n} {row[n]['reward']:.2f} ({row[n]['expected']:.2f} with noise)" for n in names)
        contact = row["first_reading_of_contact"]
        print(f"{servo}: contact from step {contact} on; {rewards}; {row['below']:.2f} % below exact", flush=True)
    print("saved", save("force_bound", found).name)


if __name__ == "__main__":
    main()

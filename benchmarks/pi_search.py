"""Gains of the PI force controller, searched with as many environment steps as an agent is trained on.

    python benchmarks/pi_search.py [--steps 400000] [--servos ideal pal] [--seed 0] [--write]

The paper compares its agent with a controller whose gains it does not give. Here CMA-ES (Hansen and Ostermeier 2001)
looks for proportional and integral gain, closing speed and touch force that give the largest mean reward in
GripperTactile-v0 with the object in the middle, beginning at the documented gains. All candidates of a generation are
played at once, each in several environments; the best candidates are then played again with other seeds, which counts
as steps, too. Gains are searched by their logarithms, as they are scales.

`results`: per servo the gains, `steps` spent, and `reward`, mean and standard deviation of 100 episodes (seeds 10 000
and up) of the searched and of the documented gains. `--write` puts the gains where ``--policy pi-tuned`` finds them.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import cma
import gymnasium
import numpy as np
from machine import save

import tiago_mj
from tiago_mj.control import tuned
from tiago_mj.control.force_pi import ForcePI, Gains
from tiago_mj.io import atomic

ENV = "tiago_mj/GripperTactile-v0"
EPISODE = 300
#: Candidates of a generation and episodes of each; the reward's spread over episodes is small (sensor noise alone).
CANDIDATES, REPEATS = 16, 2
#: Candidates that are played again at the end, and episodes of each.
FINALISTS, FINAL_EPISODES = 5, 8
#: Lowest and highest value of each gain: proportional [m/s/N], integral [m/s/(N·s)], closing speed over the finger
#: speed limit, touch force [N].
LOW = np.array([1e-4, 1e-4, 0.3, 0.1])
HIGH = np.array([0.2, 2.0, 1.0, 6.0])
#: Seeds of the comparison; none of the search's.
TEST_SEED, TEST_EPISODES = 10_000, 100


@dataclass(frozen=True)
class Candidate:
    """Gains as the search has them, and what they earned."""

    values: tuple[float, ...]
    reward: float


def gains_of(values: np.ndarray, speed: float) -> Gains:
    """Gains of one candidate (4,), or of many, (n, 4), for a controller of n environments."""
    columns = values[..., None, :] if values.ndim > 1 else values
    proportional, integral, closing, touch = (columns[..., i] for i in range(4))
    if values.ndim == 1:
        return Gains(float(proportional), float(integral), float(closing) * speed, float(touch))
    return Gains(proportional, integral, closing * speed, touch)  # type: ignore[arg-type]  # arrays: see ForcePI


def rewards(envs: Any, controller: ForcePI, seed: int) -> np.ndarray:
    """Sum of the rewards of one episode of every environment."""
    observation, info = envs.reset(seed=seed)
    controller.reset()
    total = np.zeros(envs.num_envs)
    for _ in range(EPISODE):
        observation, reward, *_, info = envs.step(controller(observation, info))
        total += reward
    return total


class Trial:
    """Plays gains in one environment's settings, and counts the steps."""

    def __init__(self, servo: str, threads: int) -> None:
        self._arguments = {"servo": servo, "object_offset": 0.0, "visual": False}
        self._threads = threads
        self._envs: dict[int, Any] = {}
        self.one = gymnasium.make(ENV, **self._arguments)
        self.speed = float(self.one.unwrapped.velocity_limit.min())
        self.steps = 0

    def __call__(self, values: np.ndarray, repeats: int, seed: int) -> np.ndarray:
        """Mean reward of each candidate, (n, 4) -> (n,)."""
        count = len(values) * repeats
        if count not in self._envs:
            self._envs[count] = gymnasium.make_vec(
                ENV, num_envs=count, threads=self._threads, autoreset_mode="Disabled", **self._arguments
            )
        controller = ForcePI.for_env(self.one, gains_of(np.repeat(values, repeats, axis=0), self.speed))
        self.steps += count * EPISODE
        return rewards(self._envs[count], controller, seed).reshape(len(values), repeats).mean(axis=1)

    def cost(self, candidates: int, repeats: int) -> int:
        """Steps that this many would take."""
        return candidates * repeats * EPISODE


def search(servo: str, budget: int, seed: int, threads: int) -> dict[str, Any]:
    """The best gains for a servo, and what they and the documented ones earn."""
    trial = Trial(servo, threads)
    documented = ForcePI.for_env(trial.one).gains
    begin = np.array([documented.proportional, documented.integral, 0.9, documented.touch])
    span = np.log(HIGH / LOW)
    strategy = cma.CMAEvolutionStrategy(
        np.log(begin / LOW) / span,
        0.2,
        {"bounds": [0, 1], "popsize": CANDIDATES, "seed": seed + 1, "verbose": -9},  # 0 would be the clock
    )
    best: list[Candidate] = []
    reserve = trial.cost(FINALISTS, FINAL_EPISODES)
    while trial.steps + trial.cost(CANDIDATES, REPEATS) + reserve <= budget:
        asked = strategy.ask()
        values = LOW * np.exp(np.array(asked) * span)
        earned = trial(values, REPEATS, seed=seed + 1 + trial.steps // EPISODE)
        strategy.tell(asked, list(-earned))
        best += [Candidate(tuple(v), float(r)) for v, r in zip(values, earned, strict=True)]
        best = sorted(best, key=lambda one: -one.reward)[: FINALISTS - 1]
    centre = tuple(LOW * np.exp(np.clip(strategy.mean, 0, 1) * span))
    finalists = np.array([*(one.values for one in best), centre])
    final = trial(finalists, FINAL_EPISODES, seed=seed + 1 + trial.steps // EPISODE)
    chosen = Gains(**rounded(asdict(gains_of(finalists[int(np.argmax(final))], trial.speed))))
    row = {"gains": asdict(chosen), "steps": trial.steps, "reward": tested(servo, chosen, threads)}
    return {**row, "documented": {"gains": asdict(documented), "reward": tested(servo, documented, threads)}}


def tested(servo: str, gains: Gains, threads: int) -> dict[str, float]:
    """Mean and standard deviation of the reward over episodes that the search has not seen."""
    arguments = {"servo": servo, "object_offset": 0.0, "visual": False}
    envs = gymnasium.make_vec(ENV, num_envs=TEST_EPISODES, threads=threads, autoreset_mode="Disabled", **arguments)
    earned = rewards(envs, ForcePI.for_env(gymnasium.make(ENV, **arguments), gains), TEST_SEED)
    return {"mean": float(earned.mean()), "sd": float(earned.std(ddof=1))}


def rounded(gains: dict[str, float]) -> dict[str, float]:
    """Four digits: more mean nothing."""
    return {name: float(f"{value:.4g}") for name, value in gains.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=int, default=400_000, help="environment steps of each search")
    parser.add_argument("--servos", nargs="+", default=["ideal", "pal"])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--write", action="store_true", help=f"put the gains into tiago_mj/control/{tuned.FILE}")
    arguments = parser.parse_args()
    found = {}
    for servo in arguments.servos:
        found[servo] = search(servo, arguments.steps, arguments.seed, arguments.threads)
        row = found[servo]
        print(
            f"{servo}: {row['gains']}, {row['steps']} steps; reward {row['reward']['mean']:.2f} ± "
            f"{row['reward']['sd']:.2f}, documented {row['documented']['reward']['mean']:.2f}",
            flush=True,
        )
    print("saved", save("pi_search", found).name)
    if arguments.write:
        path = Path(tiago_mj.__file__).parent / "control" / tuned.FILE
        table = json.loads(path.read_text()) if path.exists() else {}
        table |= {servo: row["gains"] for servo, row in found.items()}
        atomic.write_text(path, json.dumps(table, indent=1) + "\n")


if __name__ == "__main__":
    main()

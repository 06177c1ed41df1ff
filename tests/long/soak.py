"""Long random runs of every environment: nothing that is not finite, no growth of memory, the same bits every time.

    python tests/long/soak.py [--steps 2000000] [--bound-steps 60] [--bounds-again] [ID ...]

* **Steps**: so many control steps, the same number for each id, half of them scalar, half by the vector environment;
  actions uniform, at their limits, or closing the fingers, in turns of an episode. Every observation, reward and
  ``info`` is checked: finite, and the observation in its space. Memory is read when half of an id's steps are done and
  at their end.
* **Bounds**: every effect on every id with all its parameters at the lower bound of a fit, then all at the upper, on
  every target that it has, and the same checks.
* **Bits**: hashes of all that 120 steps answer, without effects and with all of them, by the scalar environment and by
  the vector environment on 1, 2 and 5 threads; twice, in processes of their own.

Exits with 1 if anything was found. The result is in results/soak.json. After a fault at the bounds was mended,
``--bounds-again`` makes that part alone anew and puts it into the result that is there, with what it was made on.
"""

from __future__ import annotations

import argparse
import gc
import hashlib
import json
import math
import sys
import time
import warnings
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import gymnasium
import mujoco
import numpy as np

import tiago_mj
from tiago_mj.effects import EFFECTS, Entry
from tiago_mj.envs.flat import core_of

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))
from machine import RESULTS, machine, save
from measuring import in_a_process, resident_mb

STEPS, BOUND_STEPS, BIT_STEPS = 2_000_000, 60, 120
MANY, THREADS = 64, (1, 2, 5)
#: Growth of resident memory in the second half of a run that is none: pages that the allocator keeps [MB].
GROWTH_MB = 1.0
#: With which MuJoCo gives a state up and starts anew.
UNSTABLE = [
    int(warning)
    for warning in (
        mujoco.mjtWarning.mjWARN_BADQPOS,
        mujoco.mjtWarning.mjWARN_BADQVEL,
        mujoco.mjtWarning.mjWARN_BADQACC,
    )
]


# What is checked ------------------------------------------------------------------------------------------------------


def not_finite(answer: Any, where: str = "") -> Iterator[str]:
    """Places in an answer of ``step`` or ``reset`` that hold a number which is not finite."""
    if isinstance(answer, Mapping):
        for key, value in answer.items():
            yield from not_finite(value, f"{where}/{key}")
    elif isinstance(answer, (tuple, list)) or _of_objects(answer):
        for k, value in enumerate(answer):
            yield from not_finite(value, f"{where}/{k}")
    elif answer is not None and not isinstance(answer, str) and not np.isfinite(answer).all():
        yield where


def _of_objects(answer: Any) -> bool:
    return isinstance(answer, np.ndarray) and answer.dtype.kind == "O"


class Faults:
    """What was found, each place once, with how often."""

    def __init__(self) -> None:
        self.found: dict[str, int] = {}

    def add(self, words: str) -> None:
        """Count one."""
        self.found[words] = self.found.get(words, 0) + 1

    def check(self, answer: Any, space: gymnasium.Space[Any], what: str) -> None:
        """Look at one answer of ``step`` or ``reset``."""
        for where in not_finite(answer):
            self.add(f"{what}: not finite at {where}")
        if answer[0] not in space:
            self.add(f"{what}: observation outside its space")


def diverged(env: Any) -> bool:
    """Whether MuJoCo has given a scalar environment's state up."""
    return any(core_of(env).data.warning[k].number for k in UNSTABLE)


def actions(rng: np.random.Generator, steps: int, shape: tuple[int, ...], episode: int) -> np.ndarray:
    """Of one episode, (steps, ...): uniform, at the limits, or random with closing fingers."""
    given = rng.uniform(-1, 1, (steps, *shape))
    if episode % 3 == 1:
        given = np.sign(given)
    elif episode % 3 == 2:
        given[..., -2:] = -np.abs(given[..., -2:])
    return given.astype(np.float32)


# Steps ----------------------------------------------------------------------------------------------------------------


def scalar_steps(name: str, steps: int, faults: Faults) -> dict[str, Any]:
    """Random steps of one environment; rate and memory."""
    env = gymnasium.make(f"tiago_mj/{name}")
    limit, rng = env.spec.max_episode_steps, np.random.default_rng(1)
    done, episode, halfway, begin = 0, 0, math.nan, time.perf_counter()
    while done < steps:
        faults.check(env.reset(seed=None if episode else 1), env.observation_space, f"{name} scalar reset")
        for action in actions(rng, min(limit, steps - done), env.action_space.shape, episode):
            faults.check(env.step(action), env.observation_space, f"{name} scalar")
            done += 1
        if diverged(env):
            faults.add(f"{name} scalar: diverged")
        episode += 1
        if math.isnan(halfway) and done >= steps / 2:
            halfway = _memory()
    return _figures(done, halfway, begin, f"{name} scalar", faults)


def vector_steps(name: str, steps: int, faults: Faults) -> dict[str, Any]:
    """The same by the vector environment."""
    envs = gymnasium.make_vec(f"tiago_mj/{name}", num_envs=MANY, autoreset_mode="SameStep")
    limit, rng = envs.spec.max_episode_steps, np.random.default_rng(2)
    done, episode, halfway, begin = 0, 0, math.nan, time.perf_counter()
    faults.check(envs.reset(seed=2), envs.observation_space, f"{name} vector reset")
    while done < steps:
        for action in actions(rng, min(limit, -(-(steps - done) // MANY)), envs.action_space.shape, episode):
            answer = envs.step(action)
            faults.check(answer, envs.observation_space, f"{name} vector")
            if answer[-1]["diverged"].any():
                faults.add(f"{name} vector: diverged")
            done += MANY
        episode += 1
        if math.isnan(halfway) and done >= steps / 2:
            halfway = _memory()
    figures = _figures(done, halfway, begin, f"{name} vector", faults)
    envs.close()
    return figures


def _memory() -> float:
    gc.collect()
    return resident_mb()


def _figures(done: int, halfway: float, begin: float, what: str, faults: Faults) -> dict[str, Any]:
    end = _memory()
    if end - halfway > GROWTH_MB:
        faults.add(f"{what}: memory grew by {end - halfway:.1f} MB in the second half")
    seconds = time.perf_counter() - begin
    return {"steps": done, "seconds": seconds, "growth_mb": end - halfway, "resident_mb": end}


# Bounds ---------------------------------------------------------------------------------------------------------------


def at_bounds(name: str, which: int, targets: Any) -> list[Entry]:
    """An effect on every target, each parameter at its lower (0) or upper (1) bound there."""
    declared, entries = EFFECTS[name], []
    for index, target in enumerate(targets.names(declared.targets)):
        side = targets.side(declared.targets, index)
        values = {}
        for key, p in declared.parameters.items():
            share = 1.0 if p.nominal is None else targets.nominal(p.nominal, declared.targets, index)
            values[key] = p.bounds[side][which] * share
        entries.append(Entry(name, (target,), values))
    return entries


def bounds(name: str, steps: int, faults: Faults) -> dict[str, Any]:
    """Every effect at both bounds on one id."""
    targets = core_of(gymnasium.make(f"tiago_mj/{name}")).wiring().targets
    runs, refused = 0, {}
    for effect in EFFECTS:
        for which, bound in enumerate(("lower", "upper")):
            what = f"{name} with {effect} at its {bound} bounds"
            entries = at_bounds(effect, which, targets)
            try:
                env = gymnasium.make(f"tiago_mj/{name}", effects=entries)
            except ValueError as fault:
                refused[f"{effect} {bound}"] = str(fault)
                continue
            runs += 1
            rng = np.random.default_rng(3)
            for episode in range(3):
                faults.check(env.reset(seed=episode), env.observation_space, f"{what}, reset")
                for action in actions(rng, -(-steps // 3), env.action_space.shape, episode):
                    faults.check(env.step(action), env.observation_space, what)
                if diverged(env):
                    faults.add(f"{what}: diverged")
            env.close()
    return {"runs": runs, "steps_each": 3 * -(-steps // 3), "refused": refused}


# Bits -----------------------------------------------------------------------------------------------------------------


def bits(name: str) -> dict[str, str]:
    """Hashes of all that an environment answers, by what it is."""
    found = {}
    for kind, effects in (("nominal", None), ("every effect", {effect: {} for effect in EFFECTS})):
        env = gymnasium.make(f"tiago_mj/{name}", effects=effects, max_episode_steps=60)
        found[f"{kind}, scalar"] = _hash(env, BIT_STEPS, resets=True)
        for threads in THREADS:
            envs = gymnasium.make_vec(
                f"tiago_mj/{name}", num_envs=6, threads=threads, effects=effects, max_episode_steps=60
            )
            found[f"{kind}, {threads} threads"] = _hash(envs, BIT_STEPS // 2, resets=False)
            envs.close()
    return found


def _hash(env: Any, steps: int, resets: bool) -> str:
    digest = hashlib.sha256()
    _add(digest, env.reset(seed=5))
    for k, action in enumerate(actions(np.random.default_rng(4), steps, env.action_space.shape, 2)):
        answer = env.step(action)
        _add(digest, answer)
        if resets and answer[3]:
            _add(digest, env.reset(seed=k))
    return digest.hexdigest()


def _add(digest: Any, answer: Any) -> None:
    if isinstance(answer, Mapping):
        for key in sorted(answer):
            digest.update(key.encode())
            _add(digest, answer[key])
    elif isinstance(answer, (tuple, list)) or _of_objects(answer):
        for value in answer:
            _add(digest, value)
    else:
        digest.update(np.ascontiguousarray(answer).tobytes())


def compare_bits(ids: list[str], faults: Faults) -> dict[str, Any]:
    """The hashes of two processes, and of 1, 2 and 5 threads."""
    one, other = (in_a_process(__file__, ["--bits", *ids]) for _ in range(2))
    for name in ids:
        for what, value in one[name].items():
            if other[name][what] != value:
                faults.add(f"{name}, {what}: other bits in another process")
        for kind in ("nominal", "every effect"):
            if len({one[name][f"{kind}, {threads} threads"] for threads in THREADS}) > 1:
                faults.add(f"{name}, {kind}: other bits on another number of threads")
    return {"ids": len(ids), "processes": 2, "threads": list(THREADS), "hashes": one}


def bounds_again(ids: list[str], steps: int) -> int:
    """Make the bounds of some ids anew, in the result that is there; the exit status."""
    path = RESULTS / "soak.json"
    whole = json.loads(path.read_text())
    results, faults = whole["results"], Faults()
    results["bounds_again"] = {"measured": machine(), "ids": ids, "found_before": {}}
    for name in ids:
        results["bounds"][name] = bounds(name, steps, faults)
    for words in [one for one in results["faults"] if " at its " in one and one.split()[0] in ids]:
        results["bounds_again"]["found_before"][words] = results["faults"].pop(words)
    results["faults"] |= faults.found
    path.write_text(json.dumps(whole, indent=1) + "\n")
    return told(results["faults"])


def told(found: dict[str, int]) -> int:
    """Print what was found; the exit status."""
    for words, count in found.items():
        print(f"{count} times: {words}")
    print(f"{len(found)} faults")
    return 1 if found else 0


# Everything -----------------------------------------------------------------------------------------------------------


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("ids", nargs="*", default=list(tiago_mj.ENVIRONMENTS))
    parser.add_argument("--steps", type=int, default=STEPS, help="in all")
    parser.add_argument("--bound-steps", type=int, default=BOUND_STEPS, help="of every effect at each bound")
    parser.add_argument("--bounds-again", action="store_true", help="that part alone, into the result that is there")
    parser.add_argument("--bits", action="store_true", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.bits:
        print(json.dumps({name: bits(name) for name in given.ids}))
        return 0
    warnings.simplefilter("error")
    if given.bounds_again:
        return bounds_again(given.ids, given.bound_steps)
    made_on, faults = machine(), Faults()  # the commit that is measured, not the one at the end
    each = -(-given.steps // (2 * len(given.ids)))
    results: dict[str, Any] = {"measured": made_on, "steps": {}, "bounds": {}}
    for name in given.ids:
        rows = {"scalar": scalar_steps(name, each, faults), "vector": vector_steps(name, each, faults)}
        results["steps"][name] = rows
        print(
            name, {kind: f"{row['steps']} steps, {row['growth_mb']:+.2f} MB" for kind, row in rows.items()}, flush=True
        )
    for name in given.ids:
        results["bounds"][name] = bounds(name, given.bound_steps, faults)
        print(name, results["bounds"][name]["runs"], "runs at bounds", flush=True)
    results["bits"] = compare_bits(given.ids, faults)
    every = [row for rows in results["steps"].values() for row in rows.values()]
    results["total_steps"] = sum(row["steps"] for row in every)
    results["most_growth_mb"] = max(row["growth_mb"] for row in every)
    results["runs_at_bounds"] = sum(row["runs"] for row in results["bounds"].values())
    results["faults"] = faults.found
    command = f"python benchmarks/{Path(__file__).name} {' '.join(sys.argv[1:])}".strip()
    print("saved", save("soak", results, command).name)
    return told(faults.found)


if __name__ == "__main__":
    sys.exit(main())

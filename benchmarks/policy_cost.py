"""What hidden effects cost a policy: as `tiago-mj cost` says it after a diagnosis, and as it is.

    python benchmarks/policy_cost.py DIR

In DIR, an empty folder, a policy's rollouts are logged on a "robot", the simulator with effects that are hidden, and
diagnosed. Then the cost is computed from the diagnosis; and from the hidden effects themselves, each exactly: with all
of them, and with all but each, on the same seeds. Every figure of docs/policy-cost.md is of its result file.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from dataclasses import asdict
from pathlib import Path
from typing import Any

import gymnasium
import yaml
from machine import save

import tiago_mj  # noqa: F401  (registers the environments)
from tiago_mj.policy_cost import cost
from tiago_mj.rollout.policies import make_policy

#: Environment, who made the rollouts and how many, what is hidden, and whose cost is asked.
CASES: dict[str, tuple[str, str, int, dict[str, dict[str, float]], tuple[str, ...]]] = {
    "steady": (
        "GripperTactileSteady-v0",
        "ppo-steady",
        12,
        {"command_delay": {"seconds": 0.02}, "encoder_quantization": {"step": 0.0001}},
        ("ppo-steady", "pi-tuned"),
    ),
    "paper": (
        "GripperTactile-v0",
        "pi",
        4,
        {"command_delay": {"seconds": 0.02}, "force_bias": {"offset": 0.05}},
        ("pi",),
    ),
}


def main() -> None:
    """Run all cases and write the result file."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, metavar="DIR")
    folder: Path = parser.parse_args().folder
    folder.mkdir(parents=True, exist_ok=True)
    print(
        save("policy_cost", {name: run(name, folder / name) for name in CASES}, "python benchmarks/policy_cost.py DIR")
    )


def run(name: str, folder: Path) -> dict[str, Any]:
    """One case: rollouts, diagnosis, and the costs of each policy."""
    env, actor, episodes, hidden, policies = CASES[name]
    folder.mkdir(exist_ok=True)
    given = f"effects={json.dumps(hidden)}"
    _tiago(
        folder, "rollout", "--env", env, "--policy", actor, "--episodes", str(episodes), "--env-option", given,
        "--record", "rollouts",
    )  # fmt: skip
    _, diagnosing = _tiago(folder, "diagnose", "rollouts", "--out", "diagnosis", "--jobs", "1")
    calibration = yaml.safe_load((folder / "diagnosis" / "calibration.yaml").read_text())
    found: dict[str, Any] = {"hidden": hidden, "named": calibration["effects"], "diagnosing_s": diagnosing}
    for policy in policies:
        words = ("cost", "diagnosis", "--policy", policy)
        printed, seconds = _tiago(folder, *words)
        found[policy] = {
            "printed": printed,
            "seconds": seconds,
            "data": json.loads(_tiago(folder, *words, "--json")[0]),
            "truth": truth(env, policy, hidden),
        }
    printed, seconds = _tiago(folder, "cost", "diagnosis", "--rollouts", "rollouts")
    found["logged actions"] = {"printed": printed, "seconds": seconds}
    return found


def truth(env: str, policy: str, hidden: dict[str, dict[str, float]]) -> dict[str, Any]:
    """What the hidden effects cost the policy, as they are, on the same seeds."""
    identifier = f"tiago_mj/{env}"

    def make(effects: Any) -> gymnasium.Env[Any, Any]:
        return gymnasium.make(identifier, effects=effects or None, visual=False)

    nominal = gymnasium.make(identifier)
    found = cost(make, make_policy(policy, nominal, seed=0, trust=False), hidden)
    nominal.close()
    costs = {one.item.name: asdict(one.mended) for one in found.effects}
    return {"costs": costs, "total": asdict(found.total), "nominal": asdict(found.nominal)}


def _tiago(folder: Path, *words: str) -> tuple[str, float]:
    """What a command prints, and the processor time that it took [s]."""
    import resource

    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    since = time.monotonic()
    program = [sys.executable, "-m", "tiago_mj.cli", *words]
    done = subprocess.run(program, cwd=folder, check=True, capture_output=True, text=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    print(f"{seconds:5.0f} s ({time.monotonic() - since:.0f} s): tiago-mj {' '.join(words)}", flush=True)
    return done.stdout, round(seconds, 1)


if __name__ == "__main__":
    main()

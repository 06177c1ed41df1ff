"""The main path in one notebook: ``marimo edit docs/notebooks/grasp_and_diagnose.py``, or run it as a program."""

import marimo

app = marimo.App(width="medium", app_title="Grasp, record, diagnose, repair")


@app.cell
def _():
    import json
    import subprocess
    import sys
    import tempfile
    from pathlib import Path

    import gymnasium
    import marimo as mo
    import matplotlib.pyplot as plt
    import numpy as np

    import tiago_mj  # registers the environments
    from tiago_mj.control.force_pi import ForcePI

    folder = Path(tempfile.mkdtemp(prefix="tiago_mj-"))
    return ForcePI, Path, folder, gymnasium, json, mo, np, plt, subprocess, sys, tiago_mj


@app.cell
def _(mo):
    mo.md("""
    # Grasp, record, diagnose, repair

    A gripper holds a force. A second one, which stands for the real robot, has friction that the simulator lacks.
    Its recordings are diagnosed, and the simulator is repaired with what was found.
    """)


@app.cell
def _(ForcePI, gymnasium, np):
    def grasp(effects=None):
        """Readings of one grasp by the force controller, (300, 2), and its return."""
        env = gymnasium.make("tiago_mj/GripperTactile-v0", effects=effects)
        controller = ForcePI.for_env(env)
        observation, info = env.reset(seed=0)
        readings, total = [], 0.0
        for _ in range(300):
            observation, reward, _, _, info = env.step(controller(observation, info))
            readings.append(info["force_raw"].copy())
            total += reward
        env.close()
        return np.array(readings), total

    friction = {"coulomb_friction": {"force": 2.5}}
    nominal, real = grasp(), grasp(friction)
    return friction, grasp, nominal, real


@app.cell
def _(folder, friction, json, subprocess, sys):
    def command(*words):
        """Run a tiago-mj command; what its --json says."""
        done = subprocess.run([sys.executable, "-m", "tiago_mj.cli", *map(str, words), "--json"], capture_output=True)
        if done.returncode:
            raise RuntimeError(done.stderr.decode())
        return json.loads(done.stdout)

    recorded = command(
        "record", "--env", "GripperTactile-v0", "--policy", "pi", "--episodes", 10,
        "--effects", json.dumps(friction), "--out", folder / "recordings",
    )  # fmt: skip
    return command, recorded


@app.cell
def _(command, folder, recorded):
    assert len(recorded["recordings"]) == 10
    found = command("diagnose", folder / "recordings", "--out", folder / "diagnosis")
    verdict = found["verdict"]
    [(one["name"], one["parameters"]) for one in verdict["effects"]]
    return found, verdict


@app.cell
def _(folder, grasp, nominal, np, plt, real, verdict):
    assert verdict["kind"] == "effect"
    repaired = grasp(str(folder / "diagnosis" / "calibration.yaml"))
    figure, axes = plt.subplots(figsize=(7, 3.5), layout="constrained")
    for _label, (_readings, _total) in {"nominal": nominal, "real": real, "repaired": repaired}.items():
        axes.plot(np.arange(300) / 240, _readings[:, 1], label=f"{_label}, return {_total:.0f}")
    axes.set_xlabel("time [s]")
    axes.set_ylabel("left reading [sensor units]")
    axes.legend()
    figure
    return (repaired,)


@app.cell
def _(found, nominal, np, real, repaired, verdict):
    _far = np.abs(nominal[0] - real[0]).mean()
    _near = np.abs(repaired[0] - real[0]).mean()
    assert _near < 0.5 * _far
    print(f"named: {[one['name'] for one in verdict['effects']]}")
    print(f"closed on recordings kept aside: {found['shrink']['closed']:.0%}")
    print(f"mean difference of readings from the real ones: nominal {_far:.3f}, repaired {_near:.3f}")


if __name__ == "__main__":
    app.run()

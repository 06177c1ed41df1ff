"""Measure contact compliance: stiffness, damping, impedance, time step, contact counts. Writes results/compliance.json.

Run from the repository's root: ``python benchmarks/compliance.py``.
"""

from __future__ import annotations

import itertools
import json
import os
import platform
import subprocess
import sys
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "physics")]

import squeeze_bench as bench  # noqa: E402

from tiago_mj.models import compliance as cp  # noqa: E402

GEOMS = ("right", "object")
#: The spring-damper itself: an impedance with next to no virtual mass (n · 0.02 / Â), and a step that it is stable at.
REFERENCE = {"impedance": 0.02, "timestep": 1 / 96000}


def machine() -> dict[str, Any]:
    cpu = next(
        (line.split(":")[1].strip() for line in Path("/proc/cpuinfo").read_text().splitlines() if "model name" in line),
        platform.processor(),
    )
    commit = subprocess.run(["git", "rev-parse", "HEAD"], cwd=ROOT, capture_output=True, text=True, check=True)
    return {
        "command": "python benchmarks/compliance.py",
        "cpu": cpu,
        "cores": len(os.sched_getaffinity(0)),
        "os": platform.freedesktop_os_release()["PRETTY_NAME"],
        "python": platform.python_version(),
        "mujoco": mujoco.__version__,
        "commit": commit.stdout.strip(),
    }


def squeezes() -> list[dict[str, Any]]:
    rows = []
    for shape, k, step, mass, half in itertools.product(
        ("cylinder", "box", "sphere"), (1e3, 3e3, 1e4, 3e4, 1e5), (1 / 480, 1 / 960), (0.1, 0.421), (0.01, 0.03)
    ):
        model = bench.gripper(shape, half_width=half, mass=mass, timestep=step, servo=False, table=False)
        wanted, points = cp.Compliance(k, 100.0), cp.shared_contact_points(model, *GEOMS)
        least = cp.least_impedance(wanted, cp.inverse_weight(model, *GEOMS), contact_points=points, timestep=step)
        impedance = max(cp.DEFAULT_IMPEDANCE, float(least))
        for side in bench.SIDES:
            cp.set_pair_compliance(model, side, wanted, impedance=impedance)
        forces, distances, _ = bench.squeeze(model, np.array([2.0, 4.0, 8.0]))
        slopes = [np.polyfit(distances[:, i], forces[:, i], 1)[0] for i in range(2)]
        error = max(abs(slope / k - 1) for slope in slopes)
        rows.append(
            {"shape": shape, "stiffness": k, "rate": round(1 / step), "mass": mass, "half_width": half, "error": error}
        )
    return rows


def drops() -> list[dict[str, Any]]:
    rows = []
    for shape, (k, c), step in itertools.product(
        ("sphere", "box", "cylinder"), ((1e4, 100.0), (1e4, 20.0), (1e3, 30.0), (3e4, 300.0)), (1 / 480, 1 / 960)
    ):
        model, wanted = bench.drop(shape, timestep=step), cp.Compliance(k, c)
        weight, points = cp.inverse_weight(model, "object", "table"), cp.shared_contact_points(model, "object", "table")
        least = cp.least_impedance(wanted, weight, contact_points=points, timestep=step)
        cp.set_pair_compliance(model, "contact", wanted, impedance=max(cp.DEFAULT_IMPEDANCE, float(least)))
        found = np.linalg.lstsq(*bench.first_touch(model), rcond=None)[0]
        rows.append({"shape": shape, "stiffness": k, "damping": c, "rate": round(1 / step), "error": found[1] / c - 1})
    return rows


def motions() -> list[dict[str, Any]]:
    """Damping that a dropped sphere's path shows: the contact's and, on top, the integrator's."""
    rows = []
    for (k, c), rate in itertools.product(((1e4, 100.0), (1e4, 20.0), (1e3, 30.0)), (480, 960, 1920, 10000)):
        model = bench.drop("sphere", timestep=1 / rate)
        mass = float(cp.set_pair_compliance(model, "contact", cp.Compliance(k, c)).virtual_mass)
        states, _ = bench.first_touch(model, seconds=0.1)
        found = bench.oscillator(states, 1 / rate, stiffness=k, damping=c, mass=0.421, virtual_mass=mass)
        rows.append({"stiffness": k, "damping": c, "rate": rate, "extra": dict(zip("kc", found - 1, strict=True))})
    return rows


def creeps() -> list[dict[str, Any]]:
    rows = []
    for impratio, friction_damping, d in itertools.product((1.0, 10.0, 100.0), (None, 200.0), (0.5, 0.9)):
        model = bench.gripper(servo=False, table=False, impratio=impratio)
        for side in bench.SIDES:
            cp.set_pair_compliance(
                model, side, cp.Compliance(1e4, 100.0), impedance=d, friction_damping=friction_damping
            )
        law = 0.421 * 9.81 / 2 / ((friction_damping or 100.0) * impratio)
        rows.append(
            {"impratio": impratio, "friction_damping": friction_damping or 100.0, "impedance": d}
            | {"speed": bench.creep_speed(model), "law": law}
        )
    return rows


def curve(shape: str, offset: float, compliance: cp.Compliance, impedance: float, timestep: float) -> np.ndarray:
    """Pad forces while closing, also at settings that ``set_pair_compliance`` refuses as unstable."""
    model = bench.gripper(shape, timestep=timestep, offset=offset)
    per_point = (1 - impedance) * cp.inverse_weight(model, *GEOMS) / cp.shared_contact_points(model, *GEOMS)
    for side in bench.SIDES:
        pair = model.pair(side).id
        model.pair_solref[pair] = -per_point * np.array([compliance.stiffness, compliance.damping])
        model.pair_solimp[pair, :2] = impedance
    return bench.closing(model)


def impedances() -> list[dict[str, Any]]:
    rows = []
    for (k, c), shape, offset in itertools.product(((1e4, 100.0), (3e4, 1000.0)), ("cylinder", "box"), (0.0, 0.002)):
        wanted = cp.Compliance(k, c)
        true = curve(shape, offset, wanted, **REFERENCE)
        for d in (0.1, 0.3, 0.5, 0.7, 0.8, 0.9, 0.95):
            fine = curve(shape, offset, wanted, d, 1 / 9600)
            for rate in (480, 960, 1920):
                forces = curve(shape, offset, wanted, d, 1 / rate)
                model = bench.gripper(shape, timestep=1 / rate)
                weight, points = cp.inverse_weight(model, *GEOMS), cp.shared_contact_points(model, *GEOMS)
                number = cp.stability_number(wanted, weight, contact_points=points, impedance=d, timestep=1 / rate)
                rows.append(
                    {"stiffness": k, "damping": c, "shape": shape, "offset": offset, "impedance": d, "rate": rate}
                    | {"virtual_mass": points * d / ((1 - d) * weight), "stability_number": float(number)}
                    | {"chatter": float(np.abs(np.diff(forces[-24:], axis=0)).max())}
                    | {"step_rms": rms(forces - fine, true), "step_max": peak(forces - fine, true)}
                    | {"model_rms": rms(fine - true, true), "model_max": peak(fine - true, true)}
                )
    return rows


def rms(difference: np.ndarray, reference: np.ndarray) -> float:
    """Root mean square of a difference while there is contact, as a share of the largest force."""
    return float(np.sqrt((difference[reference.max(axis=1) > 0] ** 2).mean()) / reference.max())


def peak(difference: np.ndarray, reference: np.ndarray) -> float:
    return float(np.abs(difference).max() / reference.max())


def contact_points() -> list[dict[str, Any]]:
    """Number of points between a pad and an object by shape, tilt about y and z [degree] and penetration [m]."""
    rows = []
    for shape, tilt in itertools.product(bench.SHAPES, ((0, 0), (0.1, 0), (1, 0), (3, 0), (0, 3), (2, 2))):
        model = bench.gripper(shape, gap=0.0, table=False)
        data, counts = mujoco.MjData(model), {}
        for depth in (1e-6, 1e-5, 1e-4, 5e-4, 1e-3, 2e-3, 5e-3):
            data.qpos[:2] = depth, -0.01
            mujoco.mju_euler2Quat(data.qpos[5:9], np.radians([0, *tilt]), "xyz")
            mujoco.mj_forward(model, data)
            counts[f"{depth:g}"] = data.ncon
        rows.append({"shape": shape, "tilt": tilt, "points": counts})
    return rows


def main() -> None:
    result = {
        "machine": machine(),
        "squeeze": squeezes(),
        "drop": drops(),
        "motion": motions(),
        "creep": creeps(),
        "impedance": impedances(),
        "contact_points": contact_points(),
    }
    target = ROOT / "benchmarks" / "results" / "compliance.json"
    target.parent.mkdir(exist_ok=True)
    blocks = [f'"machine": {json.dumps(result.pop("machine"), indent=1)}']
    for name, rows in result.items():
        lines = ",\n  ".join(json.dumps(row) for row in rows)
        blocks.append(f'"{name}": [\n  {lines}\n ]')
    target.write_text("{\n " + ",\n ".join(blocks) + "\n}\n")
    print(f"squeeze: worst error of the stiffness {max(abs(r['error']) for r in result['squeeze']):.1e}")
    print(f"drop: worst error of the damping {max(abs(r['error']) for r in result['drop']):.1e}")
    for r in result["motion"]:
        print(
            f"motion of a dropped sphere: {r['stiffness']:g} N/m, {r['damping']:g} N·s/m at {r['rate']} Hz: "
            f"damping {r['extra']['c']:+.1%}, stiffness {r['extra']['k']:+.1%}"
        )
    for r in result["creep"]:
        print(
            f"creep: impratio {r['impratio']:g}, friction {r['friction_damping']:g} N·s/m, d {r['impedance']:g}: "
            f"{1e3 * r['speed']:.4f} mm/s, law {1e3 * r['law']:.4f}"
        )
    print("impedance: error of the force curve, share of its peak; rms (max)")
    print("    K      C shape    offset    d  rate   number  M [kg]  time step        virtual mass     chatter [N]")
    for r in result["impedance"]:
        print(
            f"{r['stiffness']:6g} {r['damping']:5g} {r['shape']:9} {r['offset']:5g} {r['impedance']:5g} {r['rate']:5d} "
            f"{r['stability_number']:8.2f} {r['virtual_mass']:7.3f} {r['step_rms']:7.1%} ({r['step_max']:6.1%}) "
            f"{r['model_rms']:7.1%} ({r['model_max']:6.1%}) {r['chatter']:9.4f}"
        )
    for r in result["contact_points"]:
        print(f"contact points: {r['shape']:9} tilt {r['tilt']}: {r['points']}")
    print(f"written: {target.relative_to(ROOT)}")


if __name__ == "__main__":
    main()

"""The demonstration's numbers as data: what ``demo.json`` holds, the page shows and the terminal prints."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np

from tiago_mj.demo.arm_torque import HOW_TO_GET, SOURCE, ArmComparison
from tiago_mj.demo.grasp import ENV, Grasp
from tiago_mj.demo.hidden import Answer
from tiago_mj.gap.report import verdict, words
from tiago_mj.io.quantities import quantity
from tiago_mj.models import names
from tiago_mj.rollout import Trace
from tiago_mj.sensing import ta11_curve


def hidden_data(answer: Answer) -> dict[str, Any]:
    """Hidden effect and the diagnosis of it; the magnitude in the effect's own unit."""

    found, value = answer.diagnosis, answer.value
    return {
        "effect": words.title(answer.name).lower().replace("coulomb", "Coulomb"),
        "parameter": answer.parameter,
        "truth": quantity(answer.truth, answer.unit),
        "said": verdict.headline(found),
        "kind": found.kind,
        "right": answer.right,
        "value": None if value is None else quantity(value[0], answer.unit),
        "interval": None if value is None else [quantity(end, answer.unit) for end in value[1:]],
        "holds": value is not None and value[1] <= answer.truth <= value[2],
        "closed": found.shrink.closed,
        "seconds": found.seconds,
        "complete": found.complete,
        "larger": answer.larger if answer.films else None,
        "report": f"{answer.folder.name}/report.html",
    }


def whole_data(trace: Trace) -> dict[str, Any]:
    """The whole robot's grasp."""
    last = max(1, len(trace.time) // 10)
    return {
        "seconds": float(trace.time[-1]),
        "contact_times": dict(zip(names.SIDES, trace.contact_times(), strict=True)),
        "final_force": dict(zip(names.SIDES, trace.force[-last:].mean(axis=0).tolist(), strict=True)),
        "goal": float(trace.goal[0]),
    }


def grasp_data(done: Grasp) -> dict[str, Any]:
    """The grasp: forces in sensor units and newtons, times in seconds."""
    goal = float(done.trace.goal[0])
    return {
        "env": ENV,
        "return": done.episode.episode_return,
        "success": done.episode.success,
        "steps": done.episode.steps,
        "seconds": float(done.trace.time[-1]),
        "goal": goal,
        "goal_newtons": goal * done.newtons_per_unit,
        "contact_times": dict(zip(names.SIDES, done.trace.contact_times(), strict=True)),
        "both_contacts": done.episode.both_contacts,
        "final_force": dict(zip(names.SIDES, done.episode.final_force, strict=True)),
        "peak_force": done.episode.peak_force,
        "slow_motion": None if done.film is None else done.film.slow_motion,
        "no_film": done.no_film,
    }


def curve_data(comparison: ta11_curve.Comparison) -> dict[str, Any]:
    """The force curve: slopes in sensor units per metre, dead bands in millimetres."""

    def line(fitted: ta11_curve.Line) -> dict[str, float]:
        return {"slope": fitted.slope, "dead_band_mm": 1e3 * fitted.dead_band, "rms": fitted.rms}

    measured = zip(ta11_curve.MEASURED, comparison.measured, strict=True)
    return {
        "source": ta11_curve.SOURCE,
        "measured": [{"series": s.session, "object": s.object, **line(fitted)} for s, fitted in measured],
        "simulated": [
            {
                "object": replay.object,
                **line(replay.line),
                "dq_mm": [round(1e3 * dq, 6) for dq in replay.dq],
                "force": replay.force.mean(axis=1).tolist(),
                "drift_um_per_s": float(1e6 * np.abs(replay.drift).max()),
            }
            for replay in comparison.replays
        ],
        "slopes": comparison.slopes,
        "slopes_agree": comparison.slopes_agree,
        "dead_bands_mm": [1e3 * band for band in comparison.dead_bands],
        "unexplained_force": comparison.unexplained_force,
    }


def arm_data(comparison: ArmComparison) -> dict[str, Any]:
    """The arm: torques in newton metres."""
    return {
        "source": SOURCE,
        "genuine": comparison.genuine,
        "seconds": float(comparison.time[-1] - comparison.time[0]),
        "cutoff_hz": comparison.cutoff,
        "joints": [asdict(row) for row in comparison.rows],
        "torso": dict(zip(("measured_rms", "predicted_rms"), comparison.torso, strict=True)),
        "wrist_effort": dict(zip(("wrist", "compared"), comparison.dead, strict=True)),
    }


def headline(data: dict[str, Any]) -> tuple[str, str]:
    """Heading of the page: the project, and what the page shows of it (empty without a diagnosis)."""
    hidden = data["hidden"]
    what = "Why does a robot not do what its simulator does? From logs: the cause, its value and a repaired model."
    if hidden is None:
        return what, ""
    found = "found" if hidden["right"] else "not found"
    if not hidden["right"] and not hidden["complete"]:
        found = f"not found in {hidden['seconds']:.0f} s; run it again while the machine has less else to do"
    return what, (
        f"In a simulated robot {hidden['effect']} of {hidden['truth']} was hidden, and the diagnosis was given its "
        f"recordings alone: {found}."
    )


def outcome(data: dict[str, Any]) -> str:
    """What became of the hidden effect, as the beginning of a list; empty without a diagnosis."""
    if data["hidden"] is None:
        return ""
    return "an effect found, " if data["hidden"]["right"] else "an effect hidden and not found, "


def lines(data: dict[str, Any]) -> list[str]:
    """Lines printed on the terminal."""
    grasp, curve, arm = data["grasp"], data["curve"], data["arm"]
    touches = [
        f"{side} finger {'never touches' if time is None else f'touches after {time:.2f} s'}"
        for side, time in grasp["contact_times"].items()
    ]
    low, high = curve["slopes"]
    slopes = ", ".join(f"{row['object']} {row['slope']:.0f}" for row in curve["simulated"])
    bands = ", ".join(f"{abs(row['dead_band_mm']):.2f}" for row in curve["simulated"])
    hidden, robot = data["hidden"], data["whole"]
    shown = [f"Hidden effect: not diagnosed: {data['no_hidden']}"]
    if hidden is not None:
        other = "one of its class was named" if hidden["right"] else "another effect or none was named"
        value = other if hidden["value"] is None else f"found {hidden['value']}"
        if hidden["interval"] is not None:
            value += f" ({hidden['interval'][0]} to {hidden['interval'][1]})"
        shown = [
            f"Hidden effect: {hidden['effect']}, {hidden['truth']}; {'right' if hidden['right'] else 'wrong'}, {value}",
            f"  said in {hidden['seconds']:.0f} s: {hidden['said']}",
        ]
    shown += [
        f"Grasp: PI force controller, {grasp['env']}, seed {data['seed']}",
        f"  return {grasp['return']:.1f} in {grasp['steps']} steps, {'success' if grasp['success'] else 'no success'}; "
        + ", ".join(touches),
        f"  goal {grasp['goal']:.2f} sensor units ({grasp['goal_newtons']:.2f} N); held right "
        f"{grasp['final_force']['right']:.3f}, left {grasp['final_force']['left']:.3f}; peak {grasp['peak_force']:.3f}",
    ]
    if grasp["no_film"]:
        shown.append(f"  no pictures of it: {grasp['no_film']}")
    shown += [
        "Force curve: against six series measured on a real TIAGo gripper with TA11 load cells",
        f"  slope {low:.0f} to {high:.0f} sensor units per metre; simulated {slopes}: "
        + ("within their spread" if curve["slopes_agree"] else "outside their spread"),
        f"  dead band {curve['dead_bands_mm'][0]:.2f} to {curve['dead_bands_mm'][1]:.2f} mm; simulated {bands} mm: "
        f"it remains, worth up to {curve['unexplained_force']:.2f} sensor units",
    ]
    held = ", ".join(f"{side} {force:.3f}" for side, force in robot["final_force"].items())
    shown.append(f"TIAGo as a whole: held {held} where {robot['goal']:.2f} was asked")
    if arm is None:
        return [*shown, "Arm: no recording given", *(f"  {line}" for line in HOW_TO_GET)]
    shown.append("Arm: torque of a real TIAGo against the nominal model's, RMS in N·m")
    for row in arm["joints"]:
        shown.append(
            f"  {row['joint']}: measured {row['measured_rms']:.1f}, predicted {row['predicted_rms']:.1f}, gap "
            f"{row['gap_rms']:.1f}, bias {row['bias']:+.1f}; {100 * row['explained']:.0f} % of the variance explained"
        )
    shown.append("  torso and arm_5 to arm_7 cannot be compared: the page says why")
    return shown

"""One recording as it can be watched: the measured robot beside its simulators, with the place of the gap.

The measured robot stands as its joints' encoders read; so do the simulated ones, so that an encoder that reads wrong is
seen as it is seen in the recording. What no encoder reads of a simulated robot (the object, a free joint) is where the
simulation has it; what none reads of the measured one is where the trial began.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from tiago_mj.effects import EFFECTS
from tiago_mj.effects.spec import Entry
from tiago_mj.gap.analysis import outcome
from tiago_mj.gap.analysis.recorded import Recorded
from tiago_mj.gap.inference import noise_model
from tiago_mj.gap.report import pattern, verdict, words
from tiago_mj.gap.report.overlays import stretches
from tiago_mj.gap.result import PHASES, Diagnosis, Overlay
from tiago_mj.gap.simulation import phases, replay
from tiago_mj.gap.simulation.along_a_motion import along_a_motion
from tiago_mj.gap.simulation.plant import Plant
from tiago_mj.gap.simulation.session import session_of
from tiago_mj.io.deadline import Deadline
from tiago_mj.models import names, scene
from tiago_mj.recordings.recording import Trial

Array = NDArray[np.float64]

#: Places with a smaller share of the gap than this are not marked.
LEAST_SHARE: Final = 0.08
#: A row of a marked place counts where the nominal simulator is farther off than this share of the farthest there.
MARKED_SHARE: Final = 0.5
#: Pauses between two marked stretches that are shorter than this share of the trial are marked, too.
PAUSE: Final = 0.02


@dataclass(frozen=True)
class Motion:
    """Motion of one robot, row by row.

    Attributes:
        role: ``measured``, ``nominal`` or ``repaired``.
        qpos: MuJoCo's positions, (T, nq) [m, rad].
    """

    role: str
    qpos: Array


@dataclass(frozen=True)
class Mark:
    """Interval of the time line that contains part of the gap: from and to [s], and a label."""

    start: float
    end: float
    what: str


@dataclass(frozen=True)
class Story:
    """One trial with its replays, ready to be watched.

    Attributes:
        robot: name of what was simulated.
        model: with the trial's object in it.
        signals: time (T,) and curves; those of simulators empty where nothing could be replayed.
        motions: of the robots, the measured one first.
        joints: addresses in ``qpos`` of the joints that are compared.
        verdict: what a diagnosis found, as a sentence; empty without one.
        lit: bodies that the diagnosis names, or that are farthest off.
        where: that part, in a few words.
        marks: on the time line.
        channels: of ``signals``, those with most of the gap first.
        unmeasured: bodies of which nothing measured says where they are.
        notes: sentences that a viewer should know.
    """

    robot: str
    model: mujoco.MjModel
    signals: Overlay
    motions: tuple[Motion, ...]
    joints: tuple[int, ...]
    verdict: str
    lit: frozenset[int]
    where: str
    marks: tuple[Mark, ...]
    channels: tuple[str, ...]
    unmeasured: frozenset[int]
    notes: tuple[str, ...]

    @property
    def time(self) -> Array:
        """Times of the rows, (T,) [s]."""
        return self.signals.time


def tell(
    plant: Plant,
    trial: Trial,
    effects: Sequence[Entry] | None,
    diagnosis: Diagnosis | None = None,
    *,
    seed: int = 0,
    deadline: Deadline | None = None,
) -> Story:
    """Motions of the measured, the nominal and the repaired robot in one trial, and where the gap lies.

    Args:
        plant: the nominal simulator, of this trial among others.
        trial: recorded.
        effects: of the repaired simulator, beside the plant's; None or empty: there is no repaired one.
        diagnosis: says what is guilty and where; without one the channel that is farthest off is lit.
        seed, deadline: of the simulations.

    Raises:
        OutOfTimeError: the deadline is over.
    """
    data = noise_model.collect(plant, [trial])
    model = _with_object(plant, trial)
    measured, said = _measured(plant, trial)
    poses = {"measured": measured}
    if along_a_motion(plant, [trial]):
        said.append("Nothing was commanded that can be replayed, so that only the measured robot is there.")
        signals = _efforts(plant, trial, data)
    else:
        on = replay.grid(plant, [trial])
        sims: list[tuple[int, tuple[Entry, ...]]] = [(0, ())] + ([(0, tuple(effects))] if effects else [])
        simulated, qpos = replay.motions(plant, on, sims, replay.Run(seed=seed, deadline=deadline or Deadline()))
        for k, role in enumerate(("nominal", "repaired")[: len(sims)]):
            poses[role], end = _until_divergence(plant, simulated.position[k], qpos[k], len(trial.time))
            if end is not None:
                said.append(f"The {role} simulator diverged at {trial.time[end]:.2f} s.")
        signals = _overlay(plant, trial, on, data, simulated)
    channels = _ordered(signals, diagnosis)
    lit, where = _guilty(plant, diagnosis, channels)
    return Story(
        robot=plant.name,
        model=model,
        signals=signals,
        motions=tuple(Motion(role, qpos) for role, qpos in poses.items()),
        joints=tuple(int(address) for address in plant.wiring.qpos),
        verdict=_verdict(diagnosis),
        lit=lit,
        where=where,
        marks=_marks(signals, channels, diagnosis),
        channels=channels,
        unmeasured=_unmeasured(model, trial),
        notes=tuple(said),
    )


def _until_divergence(plant: Plant, position: Array, qpos: Array, rows: int) -> tuple[Array, int | None]:
    """Positions of a simulated robot, (T, nq), with its joints as their encoders read; from the row in which it
    diverged, where there is one, it stands still."""
    finite = np.isfinite(position[:rows]).all(axis=1) & np.isfinite(qpos[:rows]).all(axis=1)
    shown = qpos[:rows].copy()
    shown[:, plant.wiring.qpos] = position[:rows]
    if finite.all():
        return shown, None
    end = int(np.argmin(finite))
    shown[end:] = shown[max(end - 1, 0)]
    return shown, end


def _overlay(plant: Plant, trial: Trial, on: replay.Grid, data: noise_model.Data, simulated: replay.Signals) -> Overlay:
    """Measured and simulated curves of a trial; of the repaired simulator where two were replayed."""
    measured = np.isfinite(data.value).any(axis=1, keepdims=True)
    predicted = np.where(measured, noise_model.predicted(data, simulated), np.nan)
    nominal = replay.Signals(*(getattr(simulated, f)[:1] for f in replay.Signals.__dataclass_fields__))
    phase = phases.phases(plant, nominal)
    signals = outcome.overlay(Recorded(session_of(plant, [trial]), data, phase), predicted[:1], predicted[-1:], 0)
    return signals if len(predicted) > 1 else replace(signals, repaired={})


def _with_object(plant: Plant, trial: Trial) -> mujoco.MjModel:
    item = plant.starts[trial.name].item
    if item is None:
        return plant.model
    model = copy.copy(plant.model)
    scene.set_object(model, item)
    return model


def _measured(plant: Plant, trial: Trial) -> tuple[Array, list[str]]:
    """Positions of the measured robot, (T, nq), and sentences on what was not measured."""
    qpos = np.tile(plant.starts[trial.name].qpos, (len(trial.time), 1))
    missing = []
    for joint, address in zip(plant.joints, plant.wiring.qpos, strict=True):
        values = trial.positions.get(joint)
        if values is None or not (there := np.isfinite(values)).any():
            missing.append(joint)
            continue
        qpos[:, address] = np.interp(trial.time, trial.time[there], values[there])
    if not missing:
        return qpos, []
    return qpos, [f"The position of {words.listed(missing)} was not measured: it is drawn where it began."]


def _unmeasured(model: mujoco.MjModel, trial: Trial) -> frozenset[int]:
    """Freely moving bodies, whose pose no encoder measures."""
    return frozenset(
        int(model.jnt_bodyid[joint])
        for joint in range(model.njnt)
        if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_FREE
        and model.joint(joint).name not in trial.positions
        and int(model.body_subtreemass[model.jnt_bodyid[joint]] > 0)
        and model.body(int(model.jnt_bodyid[joint])).name == names.OBJECT_BODY
    )


def _efforts(plant: Plant, trial: Trial, data: noise_model.Data) -> Overlay:
    """Measured curves (positions, velocities, efforts) of a trial that cannot be replayed."""
    values = {name: data.value[0, : len(trial.time), c] for c, name in enumerate(data.channels)}
    values |= {f"effort.{name}": np.asarray(effort) for name, effort in trial.efforts.items()}
    slides = dict(zip(plant.joints, plant.wiring.targets.slides, strict=True))
    units = {"position": ("rad", "m"), "velocity": ("rad/s", "m/s"), "effort": ("N·m", "N"), "force": ("", "")}
    return Overlay(
        trial=trial.name,
        time=trial.time,
        phases=np.zeros(len(trial.time), dtype=int),
        measured=values,
        nominal={},
        repaired={},
        units={n: units[n.partition(".")[0]][int(slides.get(n.partition(".")[2], False))] for n in values},
        floor={name: float(noise) for name, noise in zip(data.channels, data.noise, strict=True)},
    )


# What the diagnosis says ----------------------------------------------------------------------------------------------


def _verdict(diagnosis: Diagnosis | None) -> str:
    if diagnosis is None:
        return ""
    if not diagnosis.complete:
        return verdict.headline(diagnosis)
    if diagnosis.kind == "no_gap" or not diagnosis.best.effects:
        return {"no_gap": "No gap was found.", "unknown": "There is a gap whose cause is not known."}.get(
            diagnosis.kind, "No effect is named."
        )
    return f"{words.begin(pattern.clauses(diagnosis.best, pattern.joints(diagnosis)))}."


def _off(signals: Overlay, name: str) -> Array:
    """Distance of the nominal from the measured curve of a channel, in units of its noise floor, (T,); 0 where
    unknown."""
    if name not in signals.nominal:
        return np.zeros(len(signals.time))
    away = np.abs(signals.nominal[name] - signals.measured[name]) / max(signals.floor.get(name, 1.0), 1e-12)
    return np.nan_to_num(away, nan=0.0, posinf=0.0)


def _ordered(signals: Overlay, diagnosis: Diagnosis | None) -> tuple[str, ...]:
    """Channels by decreasing share of the gap."""
    share: dict[str, float] = {}
    for place in diagnosis.where if diagnosis is not None else ():
        share[place.channel] = share.get(place.channel, 0.0) + place.share
    off = {name: float(np.mean(_off(signals, name) ** 2)) for name in signals.measured}
    return tuple(sorted(signals.measured, key=lambda name: (-share.get(name, 0.0), -off[name])))


def _marks(signals: Overlay, channels: Sequence[str], diagnosis: Diagnosis | None) -> tuple[Mark, ...]:
    """Intervals of the time line with most of the gap."""
    if not channels or len(signals.time) < 2 or (diagnosis is not None and diagnosis.kind == "no_gap"):
        return ()
    name = channels[0]
    off = _off(signals, name)
    if not off.max() > 1:
        return ()
    share: dict[str, float] = {}
    for place in diagnosis.where if diagnosis is not None else ():
        if place.channel == name:
            share[place.phase] = share.get(place.phase, 0.0) + place.share
    within = [PHASES.index(p) for p, s in share.items() if s >= LEAST_SHARE and p in PHASES]
    rows = np.isin(signals.phases, within) if within else np.ones(len(off), dtype=bool)
    if not (rows & (off > 1)).any():
        rows = np.ones(len(off), dtype=bool)
    rows &= off > MARKED_SHARE * off[rows].max()
    found: list[Mark] = []
    pause = PAUSE * float(signals.time[-1] - signals.time[0])
    for here, start, end in stretches(signals.time, rows.astype(int)):
        if not here:
            continue
        said = words.channel(name)
        if found and start - found[-1].end <= pause:
            found[-1] = Mark(found[-1].start, end, said)
        else:
            found.append(Mark(start, end, said))
    return tuple(found)


def _guilty(plant: Plant, diagnosis: Diagnosis | None, channels: Sequence[str]) -> tuple[frozenset[int], str]:
    """Bodies to highlight, and their label."""
    if diagnosis is not None and diagnosis.kind == "no_gap":
        return frozenset(), ""
    if diagnosis is not None and diagnosis.best.effects:
        bodies: set[int] = set()
        for effect in diagnosis.best.effects:
            kind = EFFECTS[effect.name].targets if effect.name in EFFECTS else "joint"
            for name in effect.targets or plant.wiring.targets.names(kind):
                bodies |= _of_target(plant, kind, name)
        return frozenset(bodies), pattern.labels(diagnosis.best, pattern.joints(diagnosis))
    if not channels:
        return frozenset(), ""
    kind, _, name = channels[0].partition(".")
    return frozenset(_of_target(plant, "sensor" if kind == "force" else "joint", name)), words.channel(channels[0])


def _of_target(plant: Plant, kind: str, name: str) -> set[int]:
    """Bodies of a target of an effect."""
    model = plant.model
    if kind == "object":
        body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, names.OBJECT_BODY)
        return {body} if body >= 0 else set()
    if kind == "sensor":
        wanted = (names.PAD_BODY.get(name, ""), names.LOAD_CELL_BODY.get(name, ""))
        ids = [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, body) for body in wanted]
        return {body for body in ids if body >= 0}
    if kind == "command":
        if name not in plant.actuators:
            return set()
        name = plant.joints[plant.wiring.targets.actuated[plant.actuators.index(name)]]
    joint = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, name)
    if kind not in ("joint", "command") or joint < 0:
        return set()
    body = int(model.jnt_bodyid[joint])
    return {b for b in range(model.nbody) if model.body_weldid[b] == model.body_weldid[body]}


def curves(signals: Overlay, name: str) -> Mapping[str, Array]:
    """Curves of a channel by role, each (T,)."""
    of = {"measured": signals.measured, "nominal": signals.nominal, "repaired": signals.repaired}
    return {role: np.asarray(values[name]) for role, values in of.items() if name in values}

"""The library set to the true effect and the true numbers, against recordings of reality: what is left must be noise.

    python -m benchmarks.truth_audit [NAME ...] [--steps coarse,fine] [--every N] [--out results]

No search and no fit: each case of the list below is recorded in the blind check's reality, with nominal numbers that
are off by a few per cent, and simulated by the diagnosis's own simulator with those very numbers and the true effect.
Channel by channel and trial by trial the mean square of what is left is told in variances of the sensor's noise. Where
it is more than 1, no magnitude of any effect can mend it, and a diagnosis takes it for a further effect.

Numbers go in by the effects of the library, as the diagnosis could put them; nothing is clipped to a prior. Effects of
chance get reality's own draws. Readings on a grid are compared by randomised quantile residuals (Dunn and Smyth 1996,
J. Comput. Graph. Stat. 5, 236): standard normal where the prediction is right.
"""

from __future__ import annotations

import argparse
import copy
import itertools
import json
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy import stats

from benchmarks.blind import cases, recordings, robots
from benchmarks.blind.cases import FAST_RATE, RATE, Case, EffectChoice, Made
from benchmarks.blind.dictionary import ARM, CONSTANT, GRIPPER, PLAIN, available, draw
from benchmarks.blind.effects.gears import ROTOR, SPRING_DAMPING, TwoMass
from benchmarks.machine import RESULTS, machine, save
from tiago_mj.effects import EFFECTS
from tiago_mj.effects.declare import overrides
from tiago_mj.effects.spec import Entry
from tiago_mj.gap.inference import noise_model
from tiago_mj.gap.inference.predictor import Predictor
from tiago_mj.gap.simulation import replay
from tiago_mj.gap.simulation.plant import Plant, plant_of
from tiago_mj.models import names
from tiago_mj.recordings.read import read_recordings

Array = NDArray[np.float64]

NAME: Final = "truth_audit"
#: Physics steps of the library that are tried [s]: the environments' own, and one at which halving it changes what is
#: left by no more than 0.02 noise variances (measured with no effect), by setting.
COARSE: Final = 2.1e-3
FINE: Final = {GRIPPER: 1.25e-4, PLAIN: 1.25e-4, ARM: 2.5e-4}
#: Integrators at the fine step, where the model's own needs a finer one: ``implicitfast`` adds damping to the inertia
#: after dry friction was found, so that a wrist that friction holds gives way as if it were heavier. In ``arm/none/0``
#: it leaves 50, 15, 4.4, 1.9 and 1.3 at 2, 1, 0.5, 0.25 and 0.125 ms, Euler 1.2 at each of them; at 2 ms Euler would
#: not bear a wrist that moves.
INTEGRATOR: Final = {ARM: mujoco.mjtIntegrator.mjINT_EULER}
#: A case passes where every channel, pooled over its trials, leaves no more than this many noise variances ...
POOLED: Final = 1.3
#: ... and no single trial of a channel more than chance does in one case of a thousand, corrected for their number.
CHANCE: Final = 1e-3
#: A load cell reads more than noise beyond this many deviations of it.
TOUCHING: Final = 5.0
TRIALS: Final = 6
SPREAD: Final = 0.04
SECONDS: Final = {RATE: 6.0, FAST_RATE: 2.3}
#: Where reality's lump hangs on the arm's tool, from its centre of mass along its axes [m].
PLACE: Final = {"z": -0.05}
#: Numbers of a case over the library's: the middle of rubber's two time constants, 0.7 and 1.4 of the drawn one.
SCALE: Final = {"pad_creep": {"time_constant": 1.05}}
#: Settings with their (rate, interface), one after the other for the cases of one effect.
WAYS: Final = {
    GRIPPER: ((RATE, "velocity"), (FAST_RATE, "position"), (FAST_RATE, "velocity"), (RATE, "position")),
    PLAIN: ((RATE, "position"), (FAST_RATE, "position")),
    ARM: ((RATE, "velocity"), (RATE, "position")),
}
#: Cases of each effect, by setting.
EACH: Final = {GRIPPER: 2, PLAIN: 2, ARM: 1}


@dataclass(frozen=True)
class Left:
    """What one prediction leaves of a case, in variances of the noise.

    Attributes:
        channels: names, C.
        trial: mean square by trial and channel, (ntrials, C); NaN where nothing was measured.
        count: samples that it is of, (ntrials, C).
        onsets: rows at which a touch begins or ends, which are left out, and the largest residual there [deviations].
    """

    channels: tuple[str, ...]
    trial: Array
    count: NDArray[np.int_]
    onsets: tuple[int, float] = (0, 0.0)

    @property
    def pooled(self) -> Array:
        """By channel, over all trials, (C,)."""
        whole = np.nansum(self.trial * self.count, axis=0)
        return whole / np.maximum(self.count.sum(axis=0), 1)

    @property
    def beyond_chance(self) -> int:
        """Trials of a channel whose sum of squares exceeds its bound."""
        cells = max(int((self.count > 0).sum()), 1)
        bound = stats.chi2.isf(CHANCE / cells, np.maximum(self.count, 1)) / np.maximum(self.count, 1)
        return int((np.nan_to_num(self.trial) > bound).sum())

    @property
    def passes(self) -> bool:
        """Whether nothing but noise is left."""
        return bool((self.pooled <= POOLED).all() and not self.beyond_chance)


def planned() -> dict[str, Case]:
    """All cases, by names such as ``gripper/backlash/1``."""
    out = {}
    for setting, each in EACH.items():
        for number, effect in enumerate((None, *available(setting))):
            for k in range(each):
                name = f"{setting}/{effect or 'none'}/{k}"
                ways = WAYS[setting]
                out[name] = _case(setting, effect, (number, k), *ways[(k * len(ways) // 2 + number) % len(ways)])
    return out


def _case(setting: str, effect: str | None, number: tuple[int, int], rate: float, interface: str) -> Case:
    seed = [5309, sorted(EACH).index(setting), *number]
    rng = np.random.default_rng(seed)
    chosen: tuple[EffectChoice, ...] = ()
    if effect is not None:
        target = cases.effect_targets(setting, effect, rng)
        chosen = (EffectChoice(effect, target, draw(effect, setting, rng)),)
    return Case(
        seed=int(rng.integers(2**31)), setting=setting, interface=interface, effects=chosen, spread=SPREAD,
        offset=0.005 if setting == GRIPPER and rng.random() < 0.5 else 0.0,
        rate=rate, seconds=SECONDS[rate], trials=TRIALS,
    )  # fmt: skip


# The true numbers ----------------------------------------------------------------------------------------------------


def numbers(made: Made, plant: Plant, folder: Path) -> tuple[tuple[Entry, ...], ...]:
    """What of reality's numbers differs from the nominal ones, as effects of the library, trial by trial."""
    case = made.case
    real = cases.real_robot(case, folder)  # as it was before its effects changed it
    nominal = robots.robot_of(case.setting, robots.Jitter(np.random.default_rng(0), 0.0), folder=folder)
    shared = list(_of_joints(real, nominal, case))
    if case.setting == PLAIN:
        shared += _of_the_link(real, nominal, plant)
        (link,) = (e for e in shared if e.name == "payload")
        shared.append(Entry("armature", (real.joints[0],), {"mass": _moved(real, case, link.parameters)}))
    if real.item is None or nominal.item is None:
        return (tuple(shared),) * case.trials
    shared += [
        Entry("contact_stiffness", None, {"factor": real.item.stiffness / nominal.item.stiffness}),
        Entry("contact_damping", None, {"factor": real.item.damping / nominal.item.damping}),
        Entry("contact_inertia", None, {"factor": _virtual_mass(real, nominal, plant)}),
        Entry("contact_friction", None, {"factor": real.item.friction / nominal.item.friction}),
        Entry("object_mass", None, {"factor": real.item.mass / nominal.item.mass}),
        Entry("object_size", None, {"radius": (real.item.width - nominal.item.width) / 2}),
    ]
    for side, sensor in enumerate(plant.sensors):
        shared.append(Entry("force_gain", (sensor,), {"factor": float(real.units[side] / nominal.units[side])}))
    offsets = made.setup.offsets - case.offset
    return tuple((*shared, Entry("object_offset", None, {"distance": float(away)})) for away in offsets)


def _of_joints(real: robots.Robot, nominal: robots.Robot, case: Case) -> Iterator[Entry]:
    inertia, drag = _inertia(real) - _inertia(nominal), _on_motors(real, case)
    for j, joint in enumerate(real.joints):
        on, dof, dof_then = (joint,), real.dof[j], nominal.dof[j]
        yield Entry("servo_stiffness", on, {"factor": float(real.stiffness[j] / nominal.stiffness[j])})
        yield Entry("servo_damping", on, {"damping": float(real.damping[j] - nominal.damping[j] + drag[j])})
        yield Entry("force_limit", on, {"limit": float(real.limit[j])})
        viscous = real.model.dof_damping[dof] - nominal.model.dof_damping[dof_then] - drag[j]
        yield Entry("viscous_friction", on, {"damping": float(viscous)})
        dry = real.model.dof_frictionloss[dof] - nominal.model.dof_frictionloss[dof_then]
        if dry:
            yield Entry("coulomb_friction", on, {"force": float(dry)})
        if len(real.joints) > 1:  # a single link's inertia goes with its mass and where that is
            yield Entry("armature", on, {"mass": float(inertia[j])})


def _on_motors(real: robots.Robot, case: Case) -> Array:
    """Damping that reality's gears move from the joints to the motors before them, (n,)."""
    moved = np.zeros(len(real.joints))
    for effect in cases.effects_of(case):
        if isinstance(effect, TwoMass):
            effect.build(copy.deepcopy(real))
            moved += effect._drag
    return moved


def _moved(real: robots.Robot, case: Case, link: Mapping[str, float]) -> float:
    """What else the only joint has of inertia [kg·m²]: less by what its motor has behind a gear; more by what a payload
    and the link's own change have about their common centre, which the library takes for one point."""
    before = real.model.dof_armature[real.dof[0]]
    moved = 0.0
    for choice, effect in zip(case.effects, cases.effects_of(case), strict=True):
        if isinstance(effect, TwoMass):
            moved += max(before - ROTOR * real.inertia[0], 0.0) - before
        if choice.name == "payload":
            both = choice.parameters["mass"] * link["mass"] / (choice.parameters["mass"] + link["mass"])
            moved += both * sum(link[axis] ** 2 for axis in "xyz")
    return float(moved)


def _virtual_mass(real: robots.Robot, nominal: robots.Robot, plant: Plant) -> float:
    """Of the contacts, over the nominal model's: d / (1 - d), in units of the bodies' inverse weights."""
    of_real, of_nominal = real.model.pair_solimp[0, 0], plant.model.pair_solimp[0, 0]
    bodies = [r.model.geom_bodyid[[r.model.pair_geom1[0], r.model.pair_geom2[0]]] for r in (real, nominal)]
    weights = [r.model.body_invweight0[b, 0].sum() for r, b in zip((real, nominal), bodies, strict=True)]
    return float(of_real / (1 - of_real) / (of_nominal / (1 - of_nominal)) * weights[1] / weights[0])


def _inertia(robot: robots.Robot) -> Array:
    return robot.model.dof_M0[robot.dof]


def _of_the_link(real: robots.Robot, nominal: robots.Robot, plant: Plant) -> list[Entry]:
    """Mass, centre of mass and inertia of the last link about its joint."""
    body = plant.wiring.tool
    mass, then = (float(r.model.body_mass[body]) for r in (real, nominal))
    first = [float(r.model.body_mass[body]) * r.model.body_ipos[body] for r in (real, nominal)]
    place = (first[0] - first[1]) / (mass - then) - nominal.model.body_ipos[body]
    added = {"mass": mass - then, **dict(zip("xyz", map(float, place), strict=True))}
    # What a point there lacks of the inertia about the joint is the rotor's.
    whole = _inertia(real)[0] - _inertia(nominal)[0]
    arm = nominal.model.body_ipos[body] + place
    point = (mass - then) * float(arm @ arm)
    return [Entry("payload", None, added), Entry("armature", (real.joints[0],), {"mass": float(whole - point)})]


# The true effect -----------------------------------------------------------------------------------------------------


def truths(case: Case, robot: robots.Robot | None = None) -> list[tuple[Entry, ...]]:
    """The case's effects at their true numbers, in each of their forms."""
    ways: list[list[tuple[Entry, ...]]] = []
    for choice in case.effects:
        declared = EFFECTS[choice.name]
        parameters = {n: v for n, v in choice.parameters.items() if n in declared.parameters}
        parameters |= CONSTANT.get(choice.name, {}) | (PLACE if (choice.name, case.setting) == ("payload", ARM) else {})
        if case.setting == PLAIN and robot is not None and choice.name in ("backlash", "joint_elasticity"):
            parameters |= _motor(choice, robot)
        target = None if choice.target == "all" else tuple(choice.target)
        parameters |= {name: factor * parameters[name] for name, factor in SCALE.get(choice.name, {}).items()}
        if choice.name == "force_crosstalk" and robot is not None:
            ways.append([_crosstalk(choice, robot)])
            continue
        forms = itertools.product(*(form.values for form in declared.forms.values()))
        ways.append(
            [(Entry(choice.name, target, parameters | dict(zip(declared.forms, form, strict=True))),) for form in forms]
        )
    return [tuple(itertools.chain(*one)) for one in itertools.product(*ways)]


def _crosstalk(choice: EffectChoice, robot: robots.Robot) -> tuple[Entry, ...]:
    """Crosstalk cell by cell: reality's comes after the cells' own gains, the library's before them."""
    units = dict(zip(names.SIDES, robot.units, strict=True))
    sides = names.SIDES if choice.target == "all" else choice.target
    return tuple(
        Entry(choice.name, (side,), {"ratio": choice.parameters["ratio"] * float(units[other] / units[side])})
        for side in sides
        for other in set(names.SIDES) - {side}
    )


def _motor(choice: EffectChoice, robot: robots.Robot) -> dict[str, float]:
    """Inertia of the motor, and damping of the spring before it, of the only joint."""
    (inertia,) = robot.inertia
    motor = {"motor": float(ROTOR * inertia)}
    if choice.name == "backlash":
        return motor
    return motor | {"damping": float(SPRING_DAMPING * np.sqrt(choice.parameters["stiffness"] * inertia))}


def lost(made: Made) -> NDArray[np.bool_] | None:
    """Which commands, or readings, reality lost, (ntrials, rows, n): its own draws; None: it loses none."""
    by_chance = [c for c in made.case.effects if c.name in ("dropped_commands", "force_dropout")]
    if not by_chance:
        return None
    (choice,) = by_chance
    rng = np.random.default_rng([made.setup.noise_seed, 1])
    rows, commands = made.setup.rows, choice.name == "dropped_commands"
    n = made.recorded.commands.shape[2] if commands else made.recorded.force.shape[2]
    columns = cases.effects_of(made.case)[0].targets
    chance = np.zeros(n)
    chance[columns] = choice.parameters["probability"]
    shape = (len(made.recorded.time), n)
    out = np.stack([rng.random(shape) < chance for _ in range(rows)], axis=1)
    # The first reading cannot be missed; the first command is what a receiver has, whatever becomes of it.
    return out if commands else np.concatenate([np.zeros_like(out[:, :1]), out], axis=1)


# What is left --------------------------------------------------------------------------------------------------------


def noise_of(made: Made, channels: Sequence[str]) -> tuple[Array, Array]:
    """Standard deviation of the noise of each channel, and step of the grid that its readings lie on; (C,) each, and 0
    for none."""
    robot, case = made.robot, made.case
    by = {
        **{f"position.{j}": robot.noise[0, k] for k, j in enumerate(robot.joints)},
        **{f"velocity.{j}": robot.noise[1, k] for k, j in enumerate(robot.joints)},
        "force.right": robot.force_noise, "force.left": robot.force_noise,
    }  # fmt: skip
    sigma, grid = np.array([float(by[name]) for name in channels]), np.zeros(len(channels))
    for choice in case.effects:
        for c, name in enumerate(channels):
            kind, _, part = name.partition(".")
            if choice.target != "all" and part not in choice.target:
                continue
            factor = {"force_noise": kind == "force", "encoder_scale": kind != "force"}.get(choice.name, False)
            step = {"encoder_quantization": "position", "force_quantization": "force"}.get(choice.name) == kind
            sigma[c] *= choice.parameters["factor"] if factor else 1.0
            grid[c] = choice.parameters["step"] if step else grid[c]
    return sigma, grid


def at_onsets(value: Array, predicted: Array, sigma: Array, channels: Sequence[str]) -> NDArray[np.bool_]:
    """Rows at which a touch begins or ends in what was measured or predicted, (ntrials, T).

    The pads' dampers make a force jump by up to a newton within one physics step: which of two rows is the first to
    show it is decided by a fraction of reality's own step, so that these rows say nothing of a form.
    """
    out = np.zeros(value.shape[:2], dtype=bool)
    for c, name in enumerate(channels):
        if name.startswith("force."):
            for readings in (value[..., c], predicted[..., c]):
                touching = np.nan_to_num(np.abs(readings)) > TOUCHING * sigma[c]
                out[:, 1:] |= touching[:, 1:] != touching[:, :-1]
    return out


def left(
    value: Array, predicted: Array, sigma: Array, grid: Array, channels: tuple[str, ...], *, onsets: bool = False
) -> Left:
    """What a prediction leaves of the measured, (ntrials, T, C); with ``onsets`` those rows count as well."""
    apart = (value - predicted) / sigma
    rng = np.random.default_rng(0)
    for c in np.flatnonzero(grid):
        low = stats.norm.cdf(apart[..., c] - grid[c] / 2 / sigma[c])
        high = stats.norm.cdf(apart[..., c] + grid[c] / 2 / sigma[c])
        drawn = stats.norm.ppf(low + rng.random(low.shape) * (high - low))
        # Many deviations away both are 0 or 1: what is left is how far beyond the cell it lies.
        far = np.sign(apart[..., c]) * np.maximum(np.abs(apart[..., c]) - grid[c] / 2 / sigma[c], 0.0)
        apart[..., c] = np.where(np.isfinite(drawn), drawn, far)
        apart[..., c] = np.where(np.isfinite(value[..., c]), apart[..., c], np.nan)
    at = np.zeros(apart.shape[:2], dtype=bool) if onsets else at_onsets(value, predicted, sigma, channels)
    largest = float(np.nanmax(np.abs(apart[at]), initial=0.0)) if at.any() else 0.0
    apart[at] = np.nan
    known = np.isfinite(apart)
    count = known.sum(axis=1)
    square = np.where(known, apart, 0.0) ** 2
    trial = np.where(count > 0, square.sum(axis=1) / np.maximum(count, 1), np.nan)
    return Left(channels, trial, count, (int(at.sum()), largest))


@dataclass(frozen=True)
class Opened:
    """A case recorded, and read as a diagnosis reads it."""

    made: Made
    plant: Plant
    on: replay.Grid
    data: noise_model.Data
    numbers: tuple[tuple[Entry, ...], ...]


def opened(case: Case) -> Opened:
    """Record a case, read its recordings, and find the true numbers."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        if case.setting == PLAIN:
            (folder / robots.PLAIN_FILE).write_text(robots.PLAIN)
        made = cases.simulate(case, folder)
        recordings.write(made, folder)
        trials = read_recordings([folder]).trials
        plant = plant_of(trials)
        on, data = replay.grid(plant, trials), noise_model.collect(plant, trials)
        missed = lost(made)
        if missed is not None and case.effects[0].name == "dropped_commands":
            on = replace(on, delivered=1.0 - missed)
        elif missed is not None:
            value = data.value.copy()
            for c, name in enumerate(data.channels):
                if name.startswith("force."):
                    value[..., c][missed[..., plant.sensors.index(name.partition(".")[2])]] = np.nan
            data = replace(data, value=value)
        return Opened(made, _begun(made, plant, on), on, data, numbers(made, plant, folder))


def _begun(made: Made, plant: Plant, on: replay.Grid) -> Plant:
    """The plant with its joints where they truly are at first: a replay begins at the first reading, whose noise stays
    where friction or play holds a joint. Behind an encoder's own effect it begins there."""
    sensed = any(overrides(EFFECTS[effect.name], "measure_position") for effect in made.case.effects)
    if sensed or made.recorded.begun is None:
        return plant
    columns = [made.robot.joints.index(joint) for joint in plant.joints]
    starts = dict(plant.starts)
    for trial, true in zip(on.trials, made.recorded.begun, strict=True):
        qpos = starts[trial.name].qpos.copy()
        qpos[plant.wiring.qpos] = true[columns]
        starts[trial.name] = replace(starts[trial.name], qpos=qpos)
    return replace(plant, starts=starts)


@dataclass(frozen=True)
class Audited:
    """What the library leaves of a case: apart from rows at which a touch begins or ends, of all rows, and the form of
    the effect that leaves least."""

    rest: Left
    of_all: Left
    form: Mapping[str, float]


def audited(one: Opened, step: float, *, with_effect: bool = True) -> Audited:
    """What the library leaves at a physics step [s]: of the forms of the effect, the one that leaves least."""
    plant = replace(one.plant, max_timestep=min(step, one.plant.max_timestep))
    if step < COARSE and one.made.case.setting in INTEGRATOR:
        model = copy.copy(plant.model)
        model.opt.integrator = int(INTEGRATOR[one.made.case.setting])
        plant = replace(plant, model=model)
    predict = Predictor(plant, one.on, one.data, threads=1, corrected=False)
    sigma, grid = noise_of(one.made, one.data.channels)
    found = []
    for effects in truths(one.made.case, one.made.robot) if with_effect else [()]:
        predicted = predict([(k, (*effects, *numbers)) for k, numbers in enumerate(one.numbers)])
        both = (left(one.data.value, predicted, sigma, grid, one.data.channels, onsets=o) for o in (False, True))
        forms = {n: v for e in effects for n, v in e.parameters.items() if n in EFFECTS[e.name].forms}
        found.append(Audited(*both, forms))
    return min(found, key=lambda one: float(one.rest.pooled.max()))


def row(name: str, case: Case, ways: Sequence[str] = ("coarse", "fine")) -> dict[str, Any]:
    """One case as it is kept."""
    begun, fine = time.perf_counter(), FINE[case.setting]
    one, commit = opened(case), machine()["commit"]
    out: dict[str, Any] = {
        "case": name,
        "rate_hz": case.rate,
        "interface": case.interface,
        "effects": [{"name": e.name, "target": e.target, "parameters": e.parameters} for e in case.effects],
        "without": round(float(audited(one, COARSE, with_effect=False).rest.pooled.max()), 2),
    }
    for way in ways:
        step = fine if way == "fine" else COARSE
        found = audited(one, step)
        rest, strict, forms = found.rest, found.of_all, found.form
        out[way] = {
            "step_ms": 1e3 * step,
            "commit": commit,
            "channels": {n: round(float(v), 3) for n, v in zip(rest.channels, rest.pooled, strict=True)},
            "worst": round(float(rest.pooled.max()), 3),
            "worst_trial": round(float(np.nanmax(rest.trial)), 3),
            "beyond_chance": rest.beyond_chance,
            "passes": rest.passes,
            "onset_rows": rest.onsets[0],
            "worst_at_onsets": round(rest.onsets[1], 1),
            "worst_with_onsets": round(float(strict.pooled.max()), 3),
            "passes_with_onsets": strict.passes,
            **({"form": forms} if forms else {}),
        }
    return {**out, "seconds": round(time.perf_counter() - begun, 1)}


def main() -> None:
    """Audit, print, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", help="parts of names of cases, such as gripper/backlash; all by default")
    parser.add_argument("--every", type=int, default=1, help="each so many-th case alone")
    parser.add_argument("--steps", default="coarse,fine", help="which, by commas")
    parser.add_argument("--out", default=NAME, help="name of the result file; - writes none")
    parser.add_argument("--merge", action="store_true", help="put these cases into the result file, which keeps others")
    arguments = parser.parse_args()
    steps = arguments.steps.split(",")
    wanted = {n: c for n, c in planned().items() if not arguments.names or any(part in n for part in arguments.names)}
    rows = []
    for name, case in itertools.islice(wanted.items(), 0, None, arguments.every):
        rows.append(row(name, case, steps))
        print(_line(rows[-1], steps), flush=True)
        if arguments.out != "-" and arguments.merge:
            save(arguments.out, merged(arguments.out, rows), f"python -m benchmarks.{NAME}")
    counts = counted(rows, steps)
    print(f"{len(rows)} cases; only noise in {counts['passes']}, no more than {POOLED} in {counts['within_1.3']}")
    if arguments.out != "-" and not arguments.merge:
        save(arguments.out, {**counts, "rows": rows}, f"python -m benchmarks.{NAME}")


def counted(rows: Sequence[Mapping[str, Any]], ways: Sequence[str]) -> dict[str, Any]:
    """How many cases pass, by step."""
    return {
        "cases": len(rows),
        "passes": {way: sum(r[way]["passes"] for r in rows if way in r) for way in ways},
        "within_1.3": {way: sum(r[way]["worst"] <= POOLED for r in rows if way in r) for way in ways},
        "passes_with_onsets": {way: sum(r[way]["passes_with_onsets"] for r in rows if way in r) for way in ways},
    }


def merged(name: str, rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """A result file's rows with these in place of those of the same cases; by step each says which commit it is of."""
    path = RESULTS / f"{name}.json"
    kept = {r["case"]: r for r in json.loads(path.read_text())["results"]["rows"]} if path.exists() else {}
    for new in rows:
        kept[new["case"]] = {**kept.get(new["case"], {}), **new}
    order = list(planned())
    both = sorted((r for r in kept.values() if r["case"] in order), key=lambda r: order.index(r["case"]))
    return {**counted(both, ("coarse", "fine")), "rows": both}


def _line(one: Mapping[str, Any], steps: Sequence[str]) -> str:
    said = f"{one['case']:34}{one['rate_hz']:4.0f} Hz {one['interface']:9} without {one['without']:9.2f}"
    for step in steps:
        at = one[step]
        where = max(at["channels"], key=at["channels"].get)
        mark = "  " if at["passes"] else " !"
        said += f"  {step}: {at['worst']:7.2f} (trial {at['worst_trial']:7.2f}, {where[:14]}){mark}"
    return said


if __name__ == "__main__":
    main()

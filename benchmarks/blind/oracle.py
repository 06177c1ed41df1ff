"""Upper bounds for a diagnosis: how visible an effect is, and how much of the gap the true effect closes.

Decided by the generator's own simulations of the recorded commands, on the test trials, never by the diagnosis:

* **gap**: reality with the effect against the same reality without it, mean squared difference over the noise's
  variance, channel by channel.
* **distance**: the same difference e as a whole, over what the user's uncertainty of the nominal numbers can imitate.
  With D the changes that M draws of the nominal numbers and of the object's place make (in units of the noise), the
  covariance of what is measured without an effect is I + D Dᵀ / M, and the squared distance is
  eᵀ (I + D Dᵀ / M)⁻¹ e. With nominal numbers that are known exactly it is the sum of the squared differences.
* **ordinary**: nine of ten draws are nearer than this to all the others: what a robot without any effect may reach.
* **closable**: what the nominal simulation leaves of the gap when the true effect, and nothing else, is added to it.

An effect is *detectable* where its gap reaches :data:`VISIBLE` in a channel and its distance :data:`DISTANT` and what
is ordinary.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.blind import cases, effort_sensors, reality, robots
from benchmarks.blind.cases import Case, Made
from benchmarks.blind.effects.unknown import LateStamps
from benchmarks.blind.effort_sensors import EffortSensor

Array = NDArray[np.float64]

#: Draws of the nominal numbers. There are some thirty of them: fewer draws leave directions in which every robot is
#: far from all others.
DRAWS: Final = 48
#: Share of the draws that is ordinary.
ORDINARY: Final = 0.9
VISIBLE: Final = 1.0
DISTANT: Final = 100.0


def judge(made: Made, folder: Path | None = None) -> dict[str, Any]:
    """Detectability and closable gap of a case, for its label."""
    case = made.case
    sigma = noise(made)
    test = [k for k in cases.TEST if k < case.trials] or [case.trials - 1]
    # Where joints move far in the test trials alone, what can be known is what others show.
    others = [k for k in range(case.trials) if k not in test][: len(test)] if case.narrow < 1 else []
    shown, end = slice(len(test) if others else 0, None), slice(0, len(test))
    skew = float(np.prod([1 + e.parameters["rate"] for e in case.effects if e.name == "clock_skew"]))
    drawn = [_drawn(case, folder, number) for number in range(DRAWS)]
    robots_without = [cases.real_robot(case, folder), _nominal(case, folder), *drawn]
    late = [e for e in cases.effects_of(case) if isinstance(e, LateStamps)]
    without = _run(robots_without, [], made, [*test, *others], rate=case.rate / skew, stamped=late)
    measured = stacked(made.recorded, test)
    before = float(np.mean(((measured - without[1, end]) / sigma) ** 2))
    imitations = ((without[2:, shown] - without[1, shown]) / sigma).reshape(DRAWS, -1)
    usual = ordinary(imitations)
    _, itself = _shows((without[0, shown] - without[1, shown]) / sigma, 0.0, imitations)
    out: dict[str, Any] = {"nominal_gap": before, "ordinary": usual, "distance_without": itself}
    if not case.effects:
        return {**out, "gap": {}, "distance": 0.0, "detectable": False, "closable": None, "each": []}
    with_it = _with(case, cases.effects_of(case), made, [*test, *others], folder)
    noisy = [_noise(effect, made, sigma) for effect in cases.effects_of(case)]
    per, distance = _shows((with_it[0, shown] - without[0, shown]) / sigma, sum(noisy), imitations)
    each = []
    if len(case.effects) > 1:
        for k in range(len(case.effects)):
            kept = replace(case, effects=tuple(e for n, e in enumerate(case.effects) if n != k))
            left = [e for n, e in enumerate(cases.effects_of(case)) if n != k]
            rest = _with(kept, left, made, [*test, *others], folder)
            each.append(_shows((with_it[0, shown] - rest[0, shown]) / sigma, noisy[k], imitations))
    else:
        each.append((per, distance))
    after = float(np.mean(((measured - with_it[1, end]) / sigma) ** 2))
    return {
        **out,
        "gap": dict(zip(channels(made), (float(x) for x in per), strict=True)),
        "distance": distance,
        "each": [
            {"gap": float(gap.max()), "distance": away, "detectable": _seen(gap, away, usual)} for gap, away in each
        ],
        "detectable": all(_seen(gap, away, usual) for gap, away in each),
        "after_true_effect": after,
        "after_truth": float(np.mean(((measured - with_it[0, end]) / sigma) ** 2)),
        "closable": _closed(before, after),
    }


def _seen(gap: Array, distance: float, usual: float) -> bool:
    return bool(gap.max() >= VISIBLE and distance >= max(DISTANT, usual))


def ordinary(imitations: Array) -> float:
    """Squared distance that :data:`ORDINARY` of the draws, (M, n), do not reach from all the others."""
    products = imitations @ imitations.T
    away = []
    for k in range(len(products)):
        rest = np.delete(np.arange(len(products)), k)
        overlap = products[rest, k]
        within = len(rest) * np.eye(len(rest)) + products[np.ix_(rest, rest)]
        away.append(products[k, k] - overlap @ np.linalg.solve(within, overlap))
    return float(np.quantile(away, ORDINARY))


def _shows(e: Array, noisy: Any, imitations: Array) -> tuple[Array, float]:
    """Gap by channel and squared distance of a difference (test trials, T, channels); ``noisy``: variance on top."""
    per = (e**2).mean(axis=(0, 1)) + noisy
    flat = e.ravel()
    overlap = imitations @ flat
    within = DRAWS * np.eye(DRAWS) + imitations @ imitations.T
    distance = float(flat @ flat - overlap @ np.linalg.solve(within, overlap))
    return per, distance + float((np.asarray(noisy) ** 2).sum()) / 4 * e.shape[0] * e.shape[1]


def _noise(effect: Any, made: Made, sigma: Array) -> Array:
    """Variance that an effect adds to the noise, in units of the floor's, by channel."""
    out = np.zeros(len(sigma))
    if made.robot.pads is not None:
        share = (robots.FORCE_NOISE / sigma[-2:]) ** 2  # a coarse grid hides what is added
        out[-2:] = share * (np.broadcast_to(np.asarray(effect.noise_factor(_Columns(made)), dtype=float), 2) ** 2 - 1)
    return out


def _nominal(case: Case, folder: Path | None) -> robots.Robot:
    return robots.robot_of(case.setting, robots.Jitter(np.random.default_rng(0), 0.0), folder=folder)


def _with(case: Case, effects: list[Any], made: Made, test: list[int], folder: Path | None) -> Array:
    """The real and the nominal robot with effects."""
    changed = [cases.real_robot(case, folder), _nominal(case, folder)]
    for robot in changed:
        for effect in effects:
            effect.build(robot)
    return _run(changed, effects, made, test)


def channels(made: Made) -> list[str]:
    """Names, in the order of the arrays here."""
    joints = made.robot.joints
    forces = ["force.right", "force.left"] if made.robot.pads is not None else []
    efforts = [f"effort.{j}" for j in joints] if made.case.effort else []
    return [*(f"position.{j}" for j in joints), *(f"velocity.{j}" for j in joints), *forces, *efforts]


def _closed(before: float, after: float) -> float | None:
    return None if before <= 1.1 else 1 - (max(after, 1.0) - 1) / (before - 1)


class _Columns:
    """As much of a world as a noise factor needs."""

    def __init__(self, made: Made) -> None:
        self.q = made.recorded.position[:, 0]


def _drawn(case: Case, folder: Path | None, number: int) -> robots.Robot:
    jitter = robots.Jitter(np.random.default_rng([case.seed, 5, number]), case.spread)
    return robots.robot_of(case.setting, jitter, folder=folder)


def noise(made: Made) -> Array:
    """Noise of every channel, and the error of rounding where it has a grid."""
    steps = {grid.kind: grid.steps(made.robot) for grid in made.case.grids}
    position, velocity = made.robot.noise
    parts = [np.sqrt(position**2 + steps["position"] ** 2 / 12) if "position" in steps else position, velocity]
    if made.robot.pads is not None:
        force = np.full(2, robots.FORCE_NOISE)
        parts.append(np.sqrt(force**2 + steps["force"] ** 2 / 12) if "force" in steps else force)
    if made.setup.effort is None:
        return np.concatenate(parts)
    # Commands are not told, so that motion alone tells nothing.
    return np.concatenate([np.full(sum(map(len, parts)), np.inf), made.setup.effort.noise])


def stacked(recorded: reality.Recorded, trials: list[int] | slice) -> Array:
    """Channels side by side, (ntrials, T, channels)."""
    parts = [recorded.position, recorded.velocity, recorded.force]
    parts += [] if recorded.effort is None else [recorded.effort]
    return np.concatenate([part[trials] for part in parts], axis=2)


def _sensors(made: Made, n: int, each: int) -> EffortSensor:
    """The drives' sensors of several robots, one robot after the other: as they are, as they are said to be, and as
    far from that as they may be."""
    case, true = made.case, made.setup.effort
    assert true is not None
    ideal = replace(true, gain=np.ones_like(true.gain), offset=np.zeros_like(true.offset))
    drawn = [effort_sensors.sensor(case.effort, case.seed + 1 + k, made.robot) for k in range(n - 2)]
    several = [true, ideal, *drawn][:n]
    gain, offset = (np.repeat([getattr(one, name) for one in several], each, axis=0) for name in ("gain", "offset"))
    return replace(true, gain=gain, offset=offset)


def _run(
    several: list[robots.Robot],
    effects: list[Any],
    made: Made,
    test: list[int],
    *,
    rate: float | None = None,
    stamped: Sequence[Any] = (),
) -> Array:
    """Silent simulations of the recorded commands, (robots, test trials, T, channels).

    The second robot's object stands where the user says that it does, further ones' as far from there as reality's
    may. ``rate`` is that of the commands by the recorder's clock, if that is not the control's; ``stamped`` are effects
    that have them at the instants that they write.
    """
    n, count = len(several), len(test)
    offsets = np.tile(made.setup.offsets[test], n)
    rng = np.random.default_rng([made.case.seed, 6])
    offsets[count:] = made.case.offset
    offsets[2 * count :] += made.case.placement * rng.standard_normal(max(n - 2, 0) * count)
    rate = rate or made.setup.rate
    setup = replace(made.setup, rate=rate, offsets=offsets, start=np.tile(made.setup.start[test], (n, 1)), silent=True)
    if setup.effort is not None:
        setup = replace(setup, effort=_sensors(made, n, count))
    for effect in stamped:
        setup = replace(setup, instants=effect.stamp(np.arange(setup.rows + 1) / rate))
    plan = np.tile(made.recorded.commands[test], (n, 1, 1))
    together = robots.stack(several, count)
    together.step = together.coarse
    recorded = reality.run_built(together, effects, setup, plan)
    whole = stacked(recorded, slice(None))
    return whole.reshape(n, count, *whole.shape[1:])

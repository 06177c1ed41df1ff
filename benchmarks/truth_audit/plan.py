"""Cases of the audit: every effect in every setting, each from a seed of its own."""

from __future__ import annotations

from typing import Final

import numpy as np

from benchmarks.blind import cases
from benchmarks.blind.cases import FAST_RATE, RATE, Case, EffectChoice
from benchmarks.blind.dictionary import ARM, GRIPPER, PLAIN, available, draw

TRIALS: Final = 6
SPREAD: Final = 0.04
SECONDS: Final = {RATE: 6.0, FAST_RATE: 2.3}
#: Settings with their (rate, interface), one after the other for the cases of one effect.
WAYS: Final = {
    GRIPPER: ((RATE, "velocity"), (FAST_RATE, "position"), (FAST_RATE, "velocity"), (RATE, "position")),
    PLAIN: ((RATE, "position"), (FAST_RATE, "position")),
    ARM: ((RATE, "velocity"), (RATE, "position")),
}
#: Cases of each effect, by setting.
EACH: Final = {GRIPPER: 2, PLAIN: 2, ARM: 1}


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

"""This package's own form of randomisation: the posterior itself, and four lines that give it to an environment."""

from __future__ import annotations

import json
from typing import Final

from tiago_mj.export.holding import exact
from tiago_mj.randomisation.posterior import Posterior

MODULE, FILE = "simulators.py", "posterior.json"
HELD: Final = exact("`posterior.json`: drawn from the posterior itself, as `train --randomise` does")
TEXT: Final = '''\
"""Simulators drawn from the posterior of {source}, for environments of tiago_mj. Written by tiago-mj export.

    gymnasium.make_vec("tiago_mj/...", num_envs=64, draw_effects=draw_effects)
"""

import json
from pathlib import Path

from tiago_mj.randomisation.posterior import Posterior

POSTERIOR = Posterior.of_data(json.loads((Path(__file__).parent / "{file}").read_text(encoding="utf-8")))


def draw_effects(rng):
    """Effects of one simulator, of a numpy.random.Generator."""
    return POSTERIOR.sample(rng)
'''


def write(posterior: Posterior) -> dict[str, str]:
    """The module and the posterior."""
    data = json.dumps(posterior.as_data(), indent=1, ensure_ascii=False) + "\n"
    return {MODULE: TEXT.format(source=posterior.source, file=FILE), FILE: data}

"""MuJoCo Playground 0.2 (MJX): a randomisation function that gives every environment one simulator of a table of draws.

Format: ``randomization_fn(model, rng)`` of Brax's training and Playground's wrappers, which returns a batched model and
the axes of its fields. MJX computes no constants anew, so that what follows from masses is in the table as well.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from tiago_mj.export.draws import FILE, KINDS, Draws, table
from tiago_mj.export.drives import Numbers
from tiago_mj.export.holding import Held, exact
from tiago_mj.export.targets.target import Randomisation

MODULE: Final = "playground_randomisation.py"
_DRAWN: Final = exact("`randomizer` of playground_randomisation.py: drawn together with all others of its row")
HOLDS: Final[Mapping[str, Held]] = MappingProxyType(
    dict.fromkeys(
        (
            *("servo stiffness", "servo damping", "effort limit", "motor constant", "dry friction"),
            *("viscous friction", "armature", "mass"),
        ),
        _DRAWN,
    )
)
TEXT: Final = '''\
"""Simulators of {robot} drawn from the posterior of {source}, for MuJoCo Playground 0.2. Written by tiago-mj export.

    train(environment=env, randomization_fn=randomizer(env.mj_model), ...)

Every environment gets one row of {file} at the start: numbers that go together stay together.
"""

import json
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

DRAWS = json.loads((Path(__file__).parent / "{file}").read_text(encoding="utf-8"))
KINDS = {kinds}


def tables(mj_model):
    """Of each field that varies all draws, (draws, ...)."""
    out = {{}}
    for field, columns in DRAWS["columns"].items():
        whole = np.repeat(np.asarray(getattr(mj_model, field), dtype=float)[None], DRAWS["count"], axis=0)
        for name, values in columns.items():
            part = getattr(mj_model, KINDS[field])(name)
            whole[:, part.dofadr[0] if field.startswith("dof_") else part.id] = values
        out[field] = whole
    return out


def randomizer(mj_model):
    """A function that gives environments their simulators."""
    fields = {{field: jnp.asarray(whole) for field, whole in tables(mj_model).items()}}

    def randomize(model, rng):
        rows = jax.vmap(lambda key: jax.random.randint(key, (), 0, DRAWS["count"]))(rng)
        axes = jax.tree_util.tree_map(lambda _: None, model)
        axes = axes.tree_replace({{field: 0 for field in fields}})
        return model.tree_replace({{field: whole[rows] for field, whole in fields.items()}}), axes

    return randomize
'''


def write(draws: Draws, numbers: Numbers) -> dict[str, str]:
    """The module and its table."""
    kinds = {field: KINDS[field].replace("dof", "joint") for field in draws.fields}
    text = TEXT.format(
        robot=numbers.robot.file.stem,
        source=draws.source,
        file=FILE,
        kinds=repr(kinds),
    )
    return {MODULE: text, FILE: table(draws.source, draws.fields, "MuJoCo's fields and units")}


RANDOMISATION: Final = Randomisation(HOLDS, (MODULE, FILE), write)

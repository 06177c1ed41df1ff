"""Whether a declaration of an effect can work: what is refused in one line when a class is declared."""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Mapping, Sequence
from typing import TYPE_CHECKING, Final

from tiago_mj.effects.fields import Parameter

if TYPE_CHECKING:
    from tiago_mj.effects.declare import Effect

#: What an effect may take from the model, and what its targets are then.
TAKEN_FROM: Final = {
    "frictionloss": "joint",
    "damping": "joint",
    "servo_damping": "command",
    "inertia": "joint",
    "tool_mass": "joint",
    "object_half_width": "object",
}
#: What readings show by themselves, whatever the motion: that they lie on a grid, how large their noise is, exact
#: repeats of the one before, and what a load cell reads before anything is touched.
SYMPTOMS: Final = ("grid", "noise", "repeats", "rest")
#: What agrees with the targets in :attr:`Effect.clause`.
GRAMMAR: Final = ("t", "s", "is", "has")


def check_parameters(name: str, parameters: Mapping[str, Parameter], reserved: Collection[str]) -> None:
    """Names, identities, defaults and bounds; ``reserved`` names are those of what every effect has."""
    for key, p in parameters.items():
        where = f"effect {name!r}: parameter {key!r}"
        if key in reserved:
            raise ValueError(f"{where} has the name of something that every effect has: choose another")
        if p.identity not in (None, 0.0, 1.0, math.inf):
            raise ValueError(f"{where} has identity {p.identity!r}: use 0 (an addition), 1 (a factor), inf (a limit)")
        if p.nominal not in ((None, "velocity", "effort") if p.identity == math.inf else (None,)):
            raise ValueError(f"{where} is nominal={p.nominal!r}: only a limit is a share of 'velocity' or 'effort'")
        for (low, high), default in zip(p.bounds, p.default, strict=True):
            if not (math.isfinite(low) and math.isfinite(high) and low < high and low <= default <= high):
                raise ValueError(
                    f"{where} has default {default:g} and bounds ({low:g}, {high:g}): give finite bounds, low first, "
                    "with the default between them"
                )
            if default == p.identity:
                raise ValueError(f"{where} has its identity as default: choose a magnitude that is clearly visible")
            if (low < 0 or (low == 0 and not p.tried)) and p.identity != 0:
                raise ValueError(f"{where} has the lower bound {low:g}: only what is added may be 0 or negative")
            if p.identity in (0.0, 1.0) and not low <= p.identity <= high:
                raise ValueError(f"{where} has bounds ({low:g}, {high:g}), beyond its identity {p.identity:g}")
    switches = [key for key, p in parameters.items() if p.identity is not None]
    if len(switches) != 1:
        raise ValueError(
            f"effect {name!r} has {len(switches)} parameters with an identity: give one to the parameter that switches "
            "the effect off, None to the others"
        )


def check_clauses(name: str, declared: type[Effect], known: Sequence[str]) -> None:
    """Clauses for reports, whose fields are known."""
    for said in (declared.clause, declared.clause_less):
        for field in re.findall(r"{(.*?)%?}", said):
            if field not in known:
                raise ValueError(
                    f"effect {name!r}: its clause {said!r} has {{{field}}}: use one of "
                    f"{', '.join(f'{{{one}}}' for one in known)}"
                )
    if declared.clause_less and not declared.clause:
        raise ValueError(f"effect {name!r} has a clause_less and no clause: give both, or the clause alone")


def check_symptom(name: str, declared: type[Effect]) -> None:
    """How readings show it."""
    if declared.shows_as not in ("", *SYMPTOMS):
        raise ValueError(f"effect {name!r} shows_as {declared.shows_as!r}: use one of {', '.join(SYMPTOMS)}")


def check_taken(name: str, taken: str | None, targets: str, first: Parameter) -> None:
    """What is taken from the model, which its targets have."""
    if taken is None:
        return
    if TAKEN_FROM.get(taken) != targets:
        possible = ", ".join(key for key, whose in TAKEN_FROM.items() if whose == targets) or "None"
        raise ValueError(f"effect {name!r} has takes_from={taken!r}: with targets={targets!r} use {possible}")
    if first.identity != 0.0:
        raise ValueError(f"effect {name!r} has takes_from={taken!r}: only an addition, of identity 0, can take away")


def check_prior(name: str, declared: type[Effect], targets: str, first: Parameter) -> None:
    """The priors of the nominal number, which are shares of something that its first parameter has."""
    possible = {
        None: first.identity in (0.0, 1.0),
        "stock": declared.takes_from is not None,
        "inertia": targets == "joint" and first.identity == 0.0,
        "limit": first.nominal is not None,
        "effort": targets in ("command", "joint") and first.identity == 0.0,
        "row": targets == "clock" and first.identity == 0.0,
        "reach": targets == "joint" and first.identity == 0.0,
    }
    for kind in ("nominal_prior", "own_model_prior", "effort_prior", "doubted_prior"):
        prior = getattr(declared, kind)
        if prior is not None and not possible[prior.share_of]:
            fitting = [repr(share) for share, fits in possible.items() if fits]
            raise ValueError(
                f"effect {name!r} has a {kind} with share_of={prior.share_of!r}: of its first parameter use "
                f"{' or '.join(fitting) or f'no {kind}'}"
            )

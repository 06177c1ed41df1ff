"""What a target is: a name, how it holds each quantity, and a function that writes its files."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from tiago_mj.export.draws import Draws
from tiago_mj.export.drives import Numbers
from tiago_mj.export.holding import Held


@dataclass(frozen=True)
class Target:
    """A simulator, or a format that simulators read.

    Attributes:
        name: after ``--to``.
        version: whose format is written.
        holds: how it has each quantity.
        write: text of its files by name.
        mujoco: version of MuJoCo for which the user's MJCF is written beside, into ``model``; None: none is.
        without: effects that this model is written without: the target has them elsewhere, or not at all.
        tried: what its files were tried with.
        randomised: how its domain randomisation has each quantity; what is not listed it has not.
        randomise: text of the files of its domain randomisation by name; None: it has none.
    """

    name: str
    version: str
    holds: Mapping[str, Held]
    write: Callable[[Numbers], Mapping[str, str]]
    mujoco: str | None
    without: tuple[str, ...]
    tried: str
    randomised: Mapping[str, Held] = field(default_factory=dict)
    randomise: Callable[[Draws, Numbers], Mapping[str, str]] | None = None

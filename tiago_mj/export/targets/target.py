"""What a target is: a name, how it holds each quantity, and a function that writes its files."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from tiago_mj.export.draws import Draws
from tiago_mj.export.drives import Numbers
from tiago_mj.export.holding import Held


@dataclass(frozen=True)
class Randomisation:
    """A target's domain randomisation.

    Attributes:
        holds: how it has each quantity; what is not listed it has not.
        files: that it is written into.
        write: text of these by name; None: they hold the posterior itself, and no robot is needed.
    """

    holds: Mapping[str, Held]
    files: tuple[str, ...]
    write: Callable[[Draws, Numbers], Mapping[str, str]] | None


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
        randomisation: None: it has none.
    """

    name: str
    version: str
    holds: Mapping[str, Held]
    write: Callable[[Numbers], Mapping[str, str]]
    mujoco: str | None
    without: tuple[str, ...]
    tried: str
    randomisation: Randomisation | None = None

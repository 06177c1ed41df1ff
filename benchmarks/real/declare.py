"""What a case of the benchmark is: recordings, a nominal model, what is true beside it, and what counts as right.

A declaration is data. Its text is sealed: answers carry the hash of the declarations that they were made for.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from benchmarks.real.logs import Log

#: How much of what is true is outside the nominal model.
WHOLE, SEMI, NOTHING = "whole truth", "semi-withheld", "nothing withheld"
KINDS: Final = (WHOLE, SEMI, NOTHING)
#: What a recording holds beside the measured motion.
COMMANDS, EFFORTS, BOTH = "commands", "efforts", "both"
RECORDINGS: Final = (COMMANDS, EFFORTS, BOTH)
#: How a truth is known.
PUBLISHED, WEIGHED, SENSOR, REGRESSION, REGISTER = (
    "published identification",
    "weighed",
    "another sensor",
    "regression on other recordings",
    "register of the servo, checked on its output",
)
KNOWN_BY: Final = (PUBLISHED, WEIGHED, SENSOR, REGRESSION, REGISTER)
#: A value within this share of the truth is right, whatever the truth's own uncertainty.
CLOSE: Final = 0.15
_JOINT: Final = re.compile(r'<joint name="([^"]+)"')


@dataclass(frozen=True)
class File:
    """One published file.

    Attributes:
        place: where it is looked for below the user's folder.
        path: in the repository.
        sha256: of its content.
        commit: where it is not the source's.
    """

    place: str
    path: str
    sha256: str
    commit: str = ""


@dataclass(frozen=True)
class Source:
    """Where recordings are published.

    Attributes:
        name: the folder's, too.
        repository: owner and name on GitHub.
        commit: 40 hexadecimal digits.
        licence: of the files, as their repository states it.
        files: all that cases and regressions need.
    """

    name: str
    repository: str
    commit: str
    licence: str
    files: tuple[File, ...]

    def url(self, file: File) -> str:
        """Of one file, as it was at the commit."""
        path = file.path.replace(" ", "%20")
        return f"https://raw.githubusercontent.com/{self.repository}/{file.commit or self.commit}/{path}"


@dataclass(frozen=True)
class Cause:
    """One thing that is true of the robot and not in the nominal model.

    Attributes:
        effects: what it may be called; each stands for its gap class. The value is the first one's parameter.
        target: joint; "" where an effect has no place.
        value: of the parameter; None where the kind is known and its size is not.
        unit: of the value.
        low, high: the truth's own uncertainty, about 90 %; None: 15 %.
        known_by: one of :data:`KNOWN_BY`.
        source: by whom, where, how; one sentence.
        alike: effects whose value is the same number as the first one's.
        others: of further effects, the values that are right: (effect, low, high).
    """

    effects: tuple[str, ...]
    target: str
    value: float | None
    unit: str
    low: float | None
    high: float | None
    known_by: str
    source: str
    alike: tuple[str, ...] = ()
    others: tuple[tuple[str, float, float], ...] = ()

    @property
    def accepted(self) -> tuple[float, float] | None:
        """Values that are right: within 15 % of the truth, or within its own uncertainty."""
        if self.value is None:
            return None
        around = sorted((self.value * (1 - CLOSE), self.value * (1 + CLOSE)))
        low = around[0] if self.low is None else min(around[0], self.low)
        high = around[1] if self.high is None else max(around[1], self.high)
        return low, high


@dataclass(frozen=True)
class Case:
    """One question with its answer.

    Attributes:
        name: unique; letters, digits and dashes.
        robot: which; at most six cases have the same.
        kind: one of :data:`KINDS`.
        recording: one of :data:`RECORDINGS`.
        source: name of the source.
        files: places of the files that are diagnosed.
        truth_files: places of those that a regression of ours had; none of ``files``, unless ``parts`` says which part
            of a file is whose.
        read: recordings from the user's folder.
        model: the nominal MJCF; None: a robot of this package, named in the recordings.
        nominal: where the model's numbers are from.
        withheld: what it lacks, in words.
        causes: all have to be named, each on its joint.
        may: effects that may be named beside them, by class: real, but too small or too little known to be asked for.
        known: effects that belong to the nominal simulator and that MJCF cannot state, in the form of ``effects=``.
        parts: of one file that serves both sides, which seconds are whose.
        note: what a reader of the answer has to know.
    """

    name: str
    robot: str
    kind: str
    recording: str
    source: str
    files: tuple[str, ...]
    read: Callable[[Path], list[Log]]
    model: Callable[[], str] | None
    nominal: str
    withheld: str
    causes: tuple[Cause, ...]
    truth_files: tuple[str, ...] = ()
    may: tuple[str, ...] = ()
    known: tuple[Mapping[str, Any], ...] = ()
    parts: str = ""
    note: str = ""

    @property
    def joints(self) -> tuple[str, ...]:
        """Of the nominal model; empty where that is a robot of this package."""
        return tuple(_JOINT.findall(self.model())) if self.model else ()

    def label(self) -> dict[str, Any]:
        """The declaration as data, with the model's text."""
        plain = {key: value for key, value in vars(self).items() if key not in ("read", "model", "causes")}
        causes = [{**vars(cause), "accepted": cause.accepted} for cause in self.causes]
        return {**plain, "causes": causes, "model": self.model() if self.model else None}


def text(cases: Sequence[Case]) -> str:
    """All declarations as they are sealed."""
    return json.dumps({case.name: case.label() for case in cases}, indent=1, sort_keys=True) + "\n"


def seal(cases: Sequence[Case]) -> str:
    """SHA-256 of :func:`text`."""
    return hashlib.sha256(text(cases).encode()).hexdigest()

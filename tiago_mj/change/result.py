"""The result of a comparison: what ``comparison.json`` holds (schema ``tiago_mj.comparison/1``), the page reads and
``compare()`` returns. Unknown numbers are None or NaN in memory and null in the file."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Annotated, Any, Final, Literal

from pydantic import Field, TypeAdapter

from tiago_mj.gap.parts import Named, Number, Target, Value
from tiago_mj.gap.report.json import clean
from tiago_mj.io.result_file import ResultFile
from tiago_mj.recordings.recording import Finding

SCHEMA: Final = "tiago_mj.comparison/1"
#: The file that holds it.
FILE_NAME: Final = "comparison.json"
BEFORE: Final = "before"
AFTER: Final = "after"

Kind = Literal["nothing_changed", "changed", "ambiguous", "unknown_change"]
Which = Literal["before", "after"]


@dataclass(frozen=True)
class Side:
    """One of the two sets.

    Attributes:
        recordings: names of its trials.
        folder: where they were read, as it was given.
        recorded: day of the recordings, where they or the user say it; "": not known.
    """

    recordings: tuple[str, ...]
    folder: str = ""
    recorded: str = ""


@dataclass(frozen=True)
class Change:
    """One effect that differs between the sets.

    Attributes:
        name, target: of the effect.
        parameter: the one that differs.
        acts_in: the set in which more of the effect acts.
        amount: how much more, with its 90 % interval: what is added, a factor, or a limit.
        before, after: the parameter in each set [its unit]; None: no limit.
        form: the effect's other parameters.
    """

    name: str
    target: Target
    parameter: str
    acts_in: Which
    amount: Value
    before: float | None
    after: float | None
    form: dict[str, Value]


@dataclass(frozen=True)
class Explanation:
    """A set of changes that may explain the difference; the empty set: nothing changed.

    Attributes:
        changes: none, one or two.
        probability: that it is the true one, up to the classes of its effects.
        evidence: log probability of the recordings under it, relative to that of no change [nats].
        left: mean squared residual of the worst channel, in units of what it should scatter by.
    """

    changes: tuple[Change, ...]
    probability: Number
    evidence: Number
    left: Number


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """The answer.

    Attributes:
        kind: what it says.
        probability: of the best explanation.
        best: the explanation that stands.
        alternatives: all that are not ruled out, the best first.
        ranking: all that were weighed.
        before, after: the sets.
        common: effects that both sets have, as far as they were found.
        reference: the set that the nominal model explains better: ``common`` was found in it.
        same_commands: how many pairs of recordings that repeat the same commands were compared; 0: none.
        robot: name of the nominal simulator.
        findings: of the lint.
        notes: sentences.
        complete: whether the search came to its end.
        physics_steps, seconds: what it took.
        seed, version: of the program.
    """

    kind: Kind
    probability: Number
    best: Explanation
    alternatives: tuple[Explanation, ...]
    ranking: tuple[Explanation, ...]
    before: Side
    after: Side
    common: tuple[Named, ...]
    reference: Which
    same_commands: int
    robot: str
    findings: tuple[Finding, ...]
    notes: tuple[str, ...]
    complete: bool
    physics_steps: int
    seconds: float
    seed: int
    version: str
    schema_name: Annotated[Literal["tiago_mj.comparison/1"], Field(alias="schema")] = "tiago_mj.comparison/1"


FILE: Final = TypeAdapter(Comparison)
KEPT: Final = ResultFile("comparison", FILE_NAME, "tiago-mj compare", SCHEMA, FILE)


def as_data(found: Comparison) -> dict[str, Any]:
    """What the file holds; only dicts, lists, strings, finite numbers, booleans and None."""
    data = FILE.dump_python(found, by_alias=True, warnings="none")
    data = {"schema": data.pop("schema"), **data}
    for one in data["findings"]:
        for key in ("refuses", "discredits"):
            one.pop(key, None)
    cleaned: dict[str, Any] = clean(data)
    return cleaned


def text(found: Comparison) -> str:
    """The file's text."""
    return json.dumps(as_data(found), indent=1, ensure_ascii=False, allow_nan=False) + "\n"

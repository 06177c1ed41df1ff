"""Kept cases of the blind check: their labels and answers, and which of them the experiments take."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

from benchmarks.blind import kept, plan, score
from benchmarks.blind.cases import Case
from benchmarks.machine import RESULTS

#: Wrong answers, spread over settings, rates and kinds: singles taken for nothing, singles with a needless second,
#: pairs of which one is missing. No lost commands: their truth is which were lost, see :data:`COMMANDS`.
WRONG: Final = (
    "11:50", "10:12", "9:8", "8:2", "13:58", "10:4", "7:70", "5:4", "7:102", "8:68", "7:16", "7:46",
    "9:104", "13:56", "11:4", "7:82", "7:84", "8:72", "9:97", "8:40",
)  # fmt: skip
#: Wrong, and of contacts: contact stiffness and damping, pad creep.
CONTACT: Final = ("10:50", "13:58", "7:30", "7:46", "8:2", "9:8", "9:10", "10:6", "4:6", "7:70")
#: Wrong pairs of which the missing effect is a nominal number, too.
TWINS: Final = (
    "10:4", "10:12", "11:4", "11:12", "5:4", "7:4", "7:12", "7:18", "7:26", "7:82", "7:104", "8:32", "8:40", "8:47",
    "8:68", "9:97", "9:104",
)  # fmt: skip
#: Wrong, with commands that were lost or lie on a grid, or a dead band of them.
COMMANDS: Final = (
    "10:2", "10:46", "10:47", "13:4", "13:54", "5:10", "5:12", "7:24", "8:12", "8:18", "8:24", "8:54", "8:90", "8:94",
    "8:118",
)  # fmt: skip


@dataclass(frozen=True)
class Kept:
    """A kept case.

    Attributes:
        name: ``SEED:NUMBER``.
        case: to make it again.
        label, answer: as they were kept.
    """

    name: str
    case: Case
    label: Mapping[str, Any]
    answer: Mapping[str, Any] | None

    @property
    def said(self) -> tuple[tuple[str, tuple[str, ...] | None], ...]:
        """Effects of the answer, by name and targets."""
        effects = (self.answer or {"verdict": {"effects": []}})["verdict"]["effects"]
        return tuple((e["name"], _target(e.get("target", "all"))) for e in effects)

    @property
    def ranked_truth(self) -> bool:
        """Whether the true effects, by class, were among the explanations that the answer ranks."""
        true = score.classes(self.label["effects"])
        return any(score.classes(one["effects"]) == true for one in (self.answer or {}).get("ranking", ()))

    @property
    def judged(self) -> score.Judged:
        """As it is scored."""
        return score.Judged(self.label, self.answer)


def _target(given: Any) -> tuple[str, ...] | None:
    if given == "all":
        return None
    return (given,) if isinstance(given, str) else tuple(given)


def every() -> dict[str, Kept]:
    """All kept cases of evaluations, by name.

    Without those that a seed makes otherwise today.
    """
    out: dict[str, Kept] = {}
    for path in sorted((RESULTS / "blind").glob("seed_*.json")):
        file = kept.load(path)
        run = file["run"]
        planned = plan.plan(
            run["cases"],
            run["seed"],
            only=run["kinds"],
            settings=run["settings"],
            rates=run["rates"],
            trials=run["trials"],
            seconds=run["seconds"],
            version=run["version"],
        )
        for row in file["cases"]:
            name = f"{run['seed']}:{row['case']}"
            case = planned[row["case"]]
            if case.seed != row["label"]["seed"]:
                continue  # the generator of today draws other kinds: that case is of the commit that kept it
            out[name] = Kept(name, case, row["label"], row["answer"])
    return out


def without_effect(grippers: int, hinges: int) -> list[str]:
    """Names of cases without an effect: grippers, each rate in turn, and hinges, which cost a tenth of them."""
    found = [k for k in every().values() if k.label["kind"] == "none" and k.answer is not None]
    by_rate = [[k.name for k in found if k.case.setting == "gripper" and k.case.rate == rate] for rate in (240, 25)]
    in_turn = [name for both in zip(*by_rate, strict=False) for name in both]
    return in_turn[:grippers] + [k.name for k in found if k.case.setting == "plain"][:hinges]

"""The result of a diagnosis: what ``diagnosis.json`` holds, the report reads and ``diagnose()`` returns.

:class:`Result` is the file, key by key (schema ``tiago_mj.diagnosis/1``): pydantic checks what is read by its types,
writes it, and gives its JSON schema (:func:`json_schema`). :class:`Diagnosis` has beside it what only the page shows.
Unknown numbers are None or NaN in memory and null in the file.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal, NotRequired, TypeAlias

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, TypeAdapter
from typing_extensions import TypedDict

from tiago_mj.effects.spec import Entry
from tiago_mj.gap.parts import (
    PHASES,
    Closing,
    Closings,
    Explanation,
    FitQuality,
    FittedNumber,
    Joint,
    Likeness,
    Named,
    NextMotion,
    Number,
    OpenNumber,
    Place,
    Repaired,
    Sorted,
    Value,
    identity,
    keys,
    written,
)
from tiago_mj.io.deadline import OutOfTimeError
from tiago_mj.recordings.recording import Finding

__all__ = [
    "PHASES",
    "Closing",
    "Explanation",
    "FitQuality",
    "FittedNumber",
    "Joint",
    "Named",
    "NextMotion",
    "OpenNumber",
    "Place",
    "Repaired",
    "Value",
    "identity",
    "keys",
    "written",
]

Array = NDArray[np.float64]

SCHEMA: Final = "tiago_mj.diagnosis/1"
KINDS: Final = ("no_gap", "effect", "ambiguous", "unknown")
SPLITS: Final = ("train", "validation", "test")
#: Who plays a policy whose return is told.
PLAYED: Final = ("nominal", "repaired", "measured")
BANDS: Final = ("bias", "below 1 Hz", "1-5 Hz", "above 5 Hz")
#: What a residual may follow (:mod:`tiago_mj.gap.analysis.regressors`); ``irregular``: none of the others.
SHAPES: Final = (
    *("offset", "drift", "speed", "acceleration", "position", "periodic", "direction", "place", "reversal", "jump"),
    *("touch", "force", "onset", "release", "frequency", "irregular"),
)
#: What carries it (:class:`ResidualShape`).
CARRIERS: Final = ("motion", "position", "velocity", "apart", "force", "both", "unclear")


if TYPE_CHECKING:
    Kind: TypeAlias = str
    Why: TypeAlias = str
    Splits: TypeAlias = Mapping[str, tuple[str, ...]]
    Return: TypeAlias = Mapping[str, Any]
else:  # what the file may hold there
    Kind, Why = Literal[KINDS], Literal["budget", "interrupted", "fault"]
    Splits = TypedDict("Splits", dict.fromkeys(SPLITS, tuple[str, ...]))
    ENDS = [f"{who}_{end}" for who in PLAYED for end in ("low", "high")]
    Return = TypedDict(
        "Return",
        {
            "policy": str | None,
            **dict.fromkeys(PLAYED, float | None),
            **dict.fromkeys(ENDS, NotRequired[float | None]),
            "trials": NotRequired[Mapping[str, Mapping[str, float | None]]],
        },
    )


@dataclass(frozen=True)
class Shrink:
    """How far the gap shrinks on trials that were used for nothing else. None: there was no test trial, or no gap.

    Attributes:
        before, after: mean squared residual in units of the noise floor.
        floor: what noise alone leaves, in the same units.
        closed, low, high: share of the excess over the floor that is gone, and its 90 % interval.
        per_channel: the same by channel.
        task: {policy, nominal, repaired, measured}: the return of a policy, predicted before and after, and more
            (:mod:`tiago_mj.gap.analysis.task`); or None.
        per_phase: the same by phase, all channels together.
        per_place: the same by channel, then by phase.
        resampled: what the intervals are drawn over, in words.
        accounted: ``after``, were the nominal model's own numbers as they were fitted, each object where it stood, and
            the physics step infinitely short.
        accounted_before: ``before`` likewise, with the nominal model's own numbers as they were fitted without any
            effect; told where what is named closes nothing by itself.
        weighed: share by which the squared residual falls beside these numbers, in units of the noise and tolerance
            found beside what is named; told where it falls by nothing in units of the noise.
        with_numbers: the gap before, and with the effects and the nominal model's numbers as fitted
            (:attr:`Result.numbers`): what the whole repair leaves; None where it has no such numbers.
    """

    before: float | None
    after: float | None
    floor: Number
    closed: float | None
    low: float | None
    high: float | None
    per_channel: Closings = field(default_factory=dict)
    task: Annotated[Return | None, Field(alias="return")] = None
    per_phase: Closings = field(default_factory=dict)
    per_place: Annotated[Mapping[str, Closings], Sorted, Field(alias="per_channel_and_phase")] = field(
        default_factory=dict
    )
    resampled: str = ""
    accounted: float | None = None
    accounted_before: float | None = None
    weighed: float | None = None
    with_numbers: Closing | None = None


@dataclass(frozen=True)
class ResidualShape:
    """What is left of the channel that leaves most, and what it looks like.

    Attributes:
        channel: whose residual it is.
        stages: of the signal chain that have such a residual; empty: any may.
        carrier: one of :data:`CARRIERS`, the readings that have it: position and velocity as one ``motion`` would; the
            ``position``, the ``velocity`` or the ``force`` alone; position and velocity ``apart``, so not as one motion
            would; ``both`` motion and force; or it is ``unclear``.
        name: one of :data:`SHAPES`. ``speed`` rises with it, with or without its sign; ``place`` depends on position
            and direction of motion together.
        share: of the residual's mean square that the shape explains on trials left out; of ``irregular`` the most that
            any shape does.
        runner_up, runner_up_share: the next best shape; None: no other explains anything.
        at, unit: frequency [Hz] of ``frequency``, period [m or rad] of ``periodic``; None and empty of the others.
    """

    channel: str
    stages: tuple[str, ...]
    carrier: str
    name: str
    share: Number
    runner_up: str | None = None
    runner_up_share: float | None = None
    at: float | None = None
    unit: str = ""

    @property
    def stage(self) -> str | None:
        """The stage, where it is but one."""
        return self.stages[0] if len(self.stages) == 1 else None


@dataclass(frozen=True)
class Stopped:
    """How far a search was that ended before its end.

    Attributes:
        why: ``budget`` (its time was spent), ``interrupted`` (by the user) or ``fault`` (of this program).
        seconds: that it took.
        tried: effects that were tried, at one magnitude at least.
        effects: that there were to try; 0: that was not known yet.
        needs: seconds that the whole search takes at most, at the speed of this one; None: not known.
    """

    why: Why
    seconds: float
    tried: int = 0
    effects: int = 0
    needs: float | None = None

    @classmethod
    def by(cls, ended: BaseException | None, seconds: float) -> Stopped:
        """By what ended the search; None: the time. Nothing else is known."""
        if ended is None or isinstance(ended, OutOfTimeError):
            return cls("budget", seconds)
        return cls("interrupted" if isinstance(ended, KeyboardInterrupt) else "fault", seconds)


@dataclass(frozen=True)
class TrialModels:
    """How the simulations went that a search tries: models with candidate effects in them, most of which are wrong.

    Attributes:
        simulations: that were made, the nominal ones among them.
        diverged: of these; what they were of was dropped.
        warnings: MuJoCo's, by what they say: how often each came.
    """

    simulations: int
    diverged: int
    warnings: Mapping[str, int] = field(default_factory=dict)


@dataclass(frozen=True)
class Remains:
    """Whether and where a gap above the floor is left after the best explanation."""

    flag: bool = False
    where: tuple[Place, ...] = ()


@dataclass(frozen=True)
class Verdict:
    """What is said to cause the gap.

    Attributes:
        kind: one of :data:`KINDS`.
        effects: of the best explanation; none for ``no_gap``, what is known for ``unknown``.
        probability: of the best explanation.
        alternatives: explanations that the data cannot tell from the best, the best among them.
        remains: what is left of the gap.
        not_excited: effects that the motion does not excite: not ruled out.
        part: whether it explains a part of the gap only, whose probability is told: on trials kept aside more is left
            than noise and a share of the gap that counts.
    """

    kind: Kind
    effects: tuple[Named, ...]
    probability: Number
    alternatives: tuple[Explanation, ...] = ()
    remains: Remains = Remains()
    not_excited: tuple[str, ...] = ()
    part: bool = False


@dataclass(frozen=True, kw_only=True)
class Result:
    """What ``diagnosis.json`` holds, in its order.

    Attributes:
        schema: its version.
        headline: the verdict in a sentence, as every report begins; empty until it is written.
        verdict: what is said.
        where: the gap table of the nominal model; shares sum to 1 where there is an excess.
        stage: of the signal chain that the pattern points to, or None.
        residual_shape: how what the best explanation leaves looks, where that is a gap; None: nothing, or not asked.
        shrink, ranking, next_motion: as named.
        numbers: of the nominal model, as they were fitted beside the best explanation and the validation trials confirm
            them: part of the repair, beside the effects. None where ``--numbers no`` was asked.
        numbers_joint, open_numbers: posterior of these, in their order; the model's other numbers with a prior.
        like: magnitudes on parts that are built alike, and which part differs; empty where no parts were said to be.
        findings: of the lint.
        splits: trial names by ``train``, ``validation``, ``test``.
        robot: what was simulated.
        notes: sentences that a reader should know (no test trial, channels left out, what the log cannot show).
        complete: False where the search ended before its end: all that is said is provisional, and has no probability.
        stopped: how far it was then; None: it came to its end.
        seed, version: of what was drawn at random, and of this package.
        seconds: that it took.
        physics_steps: that were simulated, or rows of efforts that were computed along the measured motion.
        trial_models: how the simulations of candidate effects went, which is no sign of a fault in the user's model;
            None as for ``physics_steps``.
    """

    schema: Literal["tiago_mj.diagnosis/1"] = SCHEMA
    headline: str = ""
    verdict: Verdict
    where: tuple[Place, ...]
    stage: str | None
    residual_shape: ResidualShape | None = None
    shrink: Shrink
    ranking: tuple[Explanation, ...]
    numbers: tuple[FittedNumber, ...] = ()
    numbers_joint: Joint | None = None
    open_numbers: tuple[OpenNumber, ...] = ()
    like: tuple[Likeness, ...] = ()
    findings: Annotated[tuple[Finding, ...], Field(alias="lint")]
    next_motion: NextMotion | None
    splits: Splits
    robot: str = ""
    notes: tuple[str, ...] = ()
    complete: bool
    stopped: Stopped | None = None
    seed: int
    version: str
    seconds: float
    physics_steps: int | None = None
    trial_models: TrialModels | None = None

    @property
    def kind(self) -> str:
        """Of the verdict."""
        return self.verdict.kind

    @property
    def replays(self) -> bool:
        """Whether commands were replayed; else efforts alone were compared, along the measured motion."""
        return not self.where or any(not place.channel.startswith("effort.") for place in self.where)

    @property
    def best(self) -> Explanation:
        """The best explanation, with what the ranking says of it."""
        ranked = self.ranked(Explanation(self.verdict.effects, self.verdict.probability))
        return replace(ranked, effects=self.verdict.effects)

    @property
    def repair(self) -> tuple[Named, ...]:
        """All that the repaired simulator has: the effects of the best explanation, and numbers as fitted."""
        return (*self.best.effects, *(one.effect for one in self.numbers))

    def ranked(self, one: Explanation) -> Explanation:
        """An explanation with what the ranking says of the same values, else of the same effects."""
        same = [row for row in self.ranking if identity(row) == identity(one)]
        row = next((row for row in same if row.effects == one.effects), same[0] if same else one)
        return replace(row, probability=one.probability)

    @property
    def alternatives(self) -> tuple[Explanation, ...]:
        """What the data cannot tell from the best, the best among them."""
        return self.verdict.alternatives

    @property
    def remains(self) -> bool:
        """Whether a gap above the floor is left after the best explanation."""
        return self.verdict.remains.flag

    @property
    def remains_where(self) -> tuple[Place, ...]:
        """Where it is left."""
        return self.verdict.remains.where

    @property
    def not_excited(self) -> tuple[str, ...]:
        """Effects that the motion does not excite."""
        return self.verdict.not_excited


@dataclass(frozen=True)
class Overlay:
    """Signals of one test (or last) trial for the report's pictures, one per channel.

    Attributes:
        trial: its name.
        time: (T,) [s].
        phases: per row, an index into :data:`PHASES`, (T,).
        measured, nominal, repaired: by channel, (T,) in the channel's unit; NaN where nothing was measured.
        units: by channel.
        floor: by channel, one standard deviation of its noise.
    """

    trial: str
    time: Array
    phases: NDArray[np.int_]
    measured: Mapping[str, Array]
    nominal: Mapping[str, Array]
    repaired: Mapping[str, Array]
    units: Mapping[str, str]
    floor: Mapping[str, float]


@dataclass(frozen=True, kw_only=True)
class Diagnosis(Result):
    """The whole answer: the result, and beside it what only the page shows.

    Attributes:
        overlays: for the pictures.
        given: effects that were known before, and are part of the nominal and of the repaired simulator.
        repaired: the user's own model, repaired; None for an environment.
        command: the command line that made it; not in the JSON, since the answer does not depend on it.
        limits: most that the nominal model's drives give, by ``joint`` and ``command``, then by name [N, N·m].
        asides: sentences on how the numbers were made, with no bearing on the answer.
        interrupted: whether the user ended it, be it before its end or while something beside the answer was made.
    """

    overlays: tuple[Overlay, ...] = ()
    given: tuple[Entry, ...] = ()
    repaired: Repaired | None = None
    command: str = ""
    limits: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    asides: tuple[str, ...] = ()
    interrupted: bool = False

    def with_verdict(self, **changes: Any) -> Diagnosis:
        """The same with some fields of its verdict changed."""
        return replace(self, verdict=replace(self.verdict, **changes))


#: Checks and writes what the file holds.
FILE: Final = TypeAdapter(Result)


def json_schema() -> dict[str, Any]:
    """JSON schema of ``diagnosis.json``."""
    dialect = "https://json-schema.org/draft/2020-12/schema"
    return {"$schema": dialect, "$id": SCHEMA, **FILE.json_schema(mode="serialization")}

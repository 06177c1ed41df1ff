"""What a diagnosis says: the value that every writer (JSON, HTML, terminal, calibration file) takes.

Field by field it is ``diagnosis.json`` (schema ``tiago_mj.diagnosis/1``); what a picture needs beside it is in
:class:`Overlay`. Unknown numbers are None, never NaN.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.effects.spec import Entry
from tiago_mj.io.deadline import OutOfTimeError
from tiago_mj.recordings.recording import Finding

Array = NDArray[np.float64]

SCHEMA: Final = "tiago_mj.diagnosis/1"
KINDS: Final = ("no_gap", "effect", "ambiguous", "unknown")
PHASES: Final = ("rest", "free motion", "reversal", "contact onset", "loading", "hold", "release")
BANDS: Final = ("bias", "below 1 Hz", "1-5 Hz", "above 5 Hz")
#: What a residual may follow (:mod:`tiago_mj.gap.analysis.regressors`); ``irregular``: none of the others.
SHAPES: Final = (
    *("offset", "drift", "speed", "acceleration", "position", "periodic", "direction", "place", "reversal", "jump"),
    *("touch", "force", "onset", "release", "frequency", "irregular"),
)
#: What carries it (:class:`ResidualShape`).
CARRIERS: Final = ("motion", "position", "velocity", "apart", "force", "both", "unclear")


@dataclass(frozen=True)
class Value:
    """A parameter with its 90 % interval, in ``unit``, and the standard deviations, where there are any, of its fit
    alone and of what no recording tells of it."""

    value: float
    low: float | None
    high: float | None
    unit: str
    deviation: float | None = None
    known_to: float | None = None


@dataclass(frozen=True)
class Named:
    """An effect on its targets, with what was fitted; ``target`` is ``"all"``, one name or several."""

    name: str
    target: str | tuple[str, ...]
    parameters: Mapping[str, Value] = field(default_factory=dict)


@dataclass(frozen=True)
class Evidence:
    """What speaks for an explanation and against it.

    Attributes:
        met: how well it meets the recordings it was fitted to [nats].
        price: what it costs: nominal numbers that had to move, freedom that its magnitudes have, rarity [nats].
        misfit: mean squared residual of the worst channel, in units of floor and tolerance.
        lasting: mean square of the worst channel's residual over quarters of a second, in units of what it should
            scatter by.
        edge: whether one of its magnitudes lies at the bound of what is possible.
        sharp: the larger of ``misfit`` and ``lasting`` in units of what is left to tolerate beside the best
            explanation; None: not known.
        agreement: what trials gain by its effects over what they gain and lose together [nats]; None: not known.
    """

    met: float
    price: float
    misfit: float
    lasting: float
    edge: bool = False
    sharp: float | None = None
    agreement: float | None = None


@dataclass(frozen=True)
class Explanation:
    """A set of effects that may explain the gap; the empty set is the nominal model.

    Attributes:
        effects: none, one or two.
        probability: calibrated, that it is the true one, up to its classes; NaN where the search did not come to its
            end.
        validation_gain: drop of the validation trials' mean squared residual [in units of the floor] against the
            nominal model with its own numbers as they were fitted, nothing added: 0 for the empty set.
        evidence: for it; None where it was judged otherwise.
    """

    effects: tuple[Named, ...]
    probability: float
    validation_gain: float
    evidence: Evidence | None = None


@dataclass(frozen=True)
class Place:
    """One row of the gap table. ``gap`` is the mean squared residual in units of the floor; ``share`` of the excess."""

    channel: str
    phase: str
    band: str
    gap: float
    low: float
    high: float
    share: float


@dataclass(frozen=True)
class Closing:
    """Gap of a part of the test trials, before and after; ``closed`` is None where there was nothing to close.

    ``low`` and ``high`` are the ends of its 90 % interval, which holds ``closed``; None where it is not known.
    ``accounted`` is as in :class:`Shrink`, of this part.
    """

    before: float
    after: float
    closed: float | None
    low: float | None = None
    high: float | None = None
    accounted: float | None = None


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
    """

    before: float | None
    after: float | None
    floor: float
    closed: float | None
    low: float | None
    high: float | None
    per_channel: Mapping[str, Closing] = field(default_factory=dict)
    task: Mapping[str, Any] | None = None
    per_phase: Mapping[str, Closing] = field(default_factory=dict)
    per_place: Mapping[str, Mapping[str, Closing]] = field(default_factory=dict)
    resampled: str = ""
    accounted: float | None = None
    accounted_before: float | None = None


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
    share: float
    runner_up: str | None = None
    runner_up_share: float | None = None
    at: float | None = None
    unit: str = ""

    @property
    def stage(self) -> str | None:
        """The stage, where it is but one."""
        return self.stages[0] if len(self.stages) == 1 else None


@dataclass(frozen=True)
class NextMotion:
    """The motion of the menu that best tells the alternatives apart."""

    file: str
    resolves: tuple[tuple[str, str], ...]
    expected_probability: float


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


@dataclass(frozen=True)
class Repaired:
    """A user's own model with the effects in it that a model file holds, and how it was simulated.

    Attributes:
        xml: MJCF; empty where it could not be written.
        fault: why not.
        holds, lacks: names of effects.
        rate_hz: of commands.
        interface: what they are.
        timestep: physics step [s].
        joints, actuators: names, in the order in which effects know them.
    """

    xml: str
    fault: str
    holds: tuple[str, ...]
    lacks: tuple[str, ...]
    rate_hz: float
    interface: str
    timestep: float
    joints: tuple[str, ...]
    actuators: tuple[str, ...]


def fault_of(ended: BaseException | None) -> BaseException | None:
    """What ended a search, unless it was the time."""
    return None if isinstance(ended, OutOfTimeError) else ended


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

    why: str
    seconds: float
    tried: int = 0
    effects: int = 0
    needs: float | None = None

    @classmethod
    def by(cls, ended: BaseException | None, seconds: float) -> Stopped:
        """By what ended the search, apart from the time; nothing else is known."""
        if ended is None:
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
class Diagnosis:
    """The whole answer.

    Attributes:
        kind: one of :data:`KINDS`.
        best: the best explanation (no effects for ``no_gap``; what is known for ``unknown``).
        alternatives: explanations that the data cannot tell from the best, the best among them.
        remains, remains_where: whether and where a gap above the floor is left after the best explanation.
        not_excited: effects that the motion does not excite: not ruled out.
        where: the gap table of the nominal model; shares sum to 1 where there is an excess.
        stage: of the signal chain that the pattern points to, or None.
        shrink, ranking, findings, next_motion: as named.
        splits: trial names by ``train``, ``validation``, ``test``.
        robot: what was simulated.
        complete: False where the search ended before its end: all that is said is provisional, and has no probability.
        stopped: how far it was then; None: it came to its end.
        overlays: for the pictures, not in the JSON.
        notes: sentences that a reader should know (no test trial, channels left out, what the log cannot show).
        given: effects that were known before, and are part of the nominal and of the repaired simulator.
        repaired: the user's own model, repaired; None for an environment.
        ended: what ended the search before its end, apart from the time: a fault, or the user.
        command: the command line that made it; in the page, not in the JSON, since the answer does not depend on it.
        limits: most that the nominal model's drives give, by ``joint`` and ``command``, then by name [N, N·m]; for the
            page, not in the JSON.
        asides: sentences on how the numbers were made, with no bearing on the answer; for the page, not in the JSON.
        physics_steps: that were simulated; None where efforts were explained along the measured motion.
        trial_models: how the simulations of candidate effects went, which is no sign of a fault in the user's model;
            None as for ``physics_steps``.
        residual_shape: what the best explanation leaves looks like, where that is a gap; None: nothing is left, or it
            was not asked.
    """

    kind: str
    best: Explanation
    alternatives: tuple[Explanation, ...]
    remains: bool
    remains_where: tuple[Place, ...]
    not_excited: tuple[str, ...]
    where: tuple[Place, ...]
    stage: str | None
    shrink: Shrink
    ranking: tuple[Explanation, ...]
    findings: tuple[Finding, ...]
    next_motion: NextMotion | None
    splits: Mapping[str, tuple[str, ...]]
    robot: str
    complete: bool
    seed: int
    version: str
    seconds: float
    overlays: tuple[Overlay, ...] = ()
    notes: tuple[str, ...] = ()
    given: tuple[Entry, ...] = ()
    repaired: Repaired | None = None
    ended: BaseException | None = None
    stopped: Stopped | None = None
    command: str = ""
    physics_steps: int | None = None
    limits: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    asides: tuple[str, ...] = ()
    trial_models: TrialModels | None = None
    residual_shape: ResidualShape | None = None

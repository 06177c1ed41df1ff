"""Commands that both sets lose: the share that each loses, which is counted and not searched for.

Which commands were lost is another draw in every recording, so that the recordings of two sets differ although nothing
changed. They are decoded in all of them beside what both sets have in common, and what is compared afterwards is
simulated with each recording's own losses. What may have changed is how many are lost.
"""

from __future__ import annotations

from collections.abc import Sequence

from tiago_mj.change.reference import Reference
from tiago_mj.effects import EFFECTS
from tiago_mj.gap.compared import Compared
from tiago_mj.gap.detectors.readings import Known
from tiago_mj.gap.search import lost_commands


def counted(compared: Compared, known: Reference, sets: Sequence[Sequence[int]]) -> list[tuple[Known, ...]]:
    """The share of its commands that each set loses, with its deviation; of each set none where the common explanation
    loses none, and of one in which hardly any was lost.

    Args:
        compared: both sets beside the nominal model.
        known: what they have in common.
        sets: indices of their trials.
    """
    motion, predict = compared.proposed.servo_motion, compared.predict
    mine = [entry for entry in known.found if EFFECTS[entry.name].loses_commands]
    if known.delivered is None or motion is None or not mine:
        return [() for _ in sets]
    rest = tuple(entry for entry in known.common if not EFFECTS[entry.name].loses_commands)
    everything = range(len(predict.on.trials))
    found = lost_commands.decode(predict, motion, [rest] * len(everything), known.trials)
    pool = [c for c in compared.proposed.pool if (c.effect, c.target) == (mine[0].name, mine[0].target)]
    out = []
    for trials in sets:
        losing = lost_commands.losing_candidates(pool, found, predict.plant.wiring.targets.command, trials)
        out.append(tuple(Known(c, c.grid[0], float(c.spread or 0.0)) for c in losing or ()))
    return out

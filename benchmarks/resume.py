"""What the journal of a diagnosis costs, and what it spares a run that goes on with all of it: processor seconds.

    python -m benchmarks.resume

A grasp with friction and a delay that the nominal model lacks is diagnosed by one thread, three times: as it is, with
its journal timed (digests, packing, writing), and going on from the whole journal, which is what a run finds that was
killed at its end.
"""

from __future__ import annotations

import json
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest import mock

from threadpoolctl import threadpool_limits

from benchmarks.machine import save
from tiago_mj import cli
from tiago_mj.gap import pipeline
from tiago_mj.gap.inference import remembered
from tiago_mj.gap.report import JOURNAL
from tiago_mj.gap.report import json as as_json
from tiago_mj.io.journal import Journal
from tiago_mj.recordings.read import read_recordings

EFFECTS = {"coulomb_friction": {"force": 3.0}, "command_delay": {"seconds": 0.03}}
EPISODES = 5


class Timed:
    """Processor seconds of some functions together."""

    def __init__(self) -> None:
        self.seconds = 0.0

    def of(self, function: Callable[..., Any]) -> Callable[..., Any]:
        def timed(*given: Any, **named: Any) -> Any:
            begun = time.process_time()
            try:
                return function(*given, **named)
            finally:
                self.seconds += time.process_time() - begun

        return timed


def main() -> None:
    with tempfile.TemporaryDirectory() as root, threadpool_limits(1):
        logs, journal = Path(root) / "logs", Path(root) / JOURNAL
        words = ["record", "--env", "GripperTactile-v0", "--policy", "pi", "--episodes", str(EPISODES)]
        if cli.main([*words, "--effects", json.dumps(EFFECTS), "--out", str(logs)]):
            raise SystemExit("the grasps could not be recorded")
        trials = read_recordings([logs]).trials

        def diagnosed(**asked: Any) -> tuple[float, Any]:
            begun = time.process_time()
            found = pipeline.diagnose(trials, threads=1, **asked)
            return time.process_time() - begun, as_json.as_data(replace(found, seconds=0.0))

        plain, answer = diagnosed()
        timed = Timed()
        with (
            mock.patch.object(remembered, "digest", timed.of(remembered.digest)),
            mock.patch.object(remembered, "packed", timed.of(remembered.packed)),
            mock.patch.object(remembered, "unpacked", timed.of(remembered.unpacked)),
            mock.patch.object(Journal, "add", timed.of(Journal.add)),
            mock.patch.object(pipeline, "begun_with", timed.of(pipeline.begun_with)),
        ):
            with_journal, same = diagnosed(journal=journal)
        size = journal.stat().st_size
        resumed, again = diagnosed(journal=journal, resume=True)
        results = {
            "recordings": f"{EPISODES} grasps with {json.dumps(EFFECTS)}",
            "cpu_s": round(plain, 1),
            "cpu_s_with_journal": round(with_journal, 1),
            "cpu_s_of_journal": round(timed.seconds, 3),
            "share_of_journal": round(timed.seconds / with_journal, 5),
            "journal_bytes": size,
            "cpu_s_going_on_from_all_of_it": round(resumed, 1),
            "same_answer": answer == same == again,
        }
    print(json.dumps(results, indent=1))
    print(save("resume", results, "python -m benchmarks.resume"))


if __name__ == "__main__":
    main()

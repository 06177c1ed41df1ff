"""Folder of a run, and how its labels stay sealed until every case is diagnosed.

    DIR/cases/NNN/recordings/    what the diagnosis is given, and nothing else
    DIR/cases/NNN/diagnosis/     what it wrote
    DIR/.sealed/NNN.json         the label of one case, apart from the cases
    DIR/seal.txt                 SHA-256 of all labels, written and printed before the first diagnosis
    DIR/seal-of-N.txt            the same of the first N, where the run had no more when it was begun
    DIR/labels.json              the labels, once everything is diagnosed
    DIR/scores.json, DIR/index.html

A part that is there is not made again, so a run goes on where it stopped, and may be continued with more cases.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from tiago_mj.io import atomic

#: The seal, and that of a run's first cases.
SEAL: Final = "seal.txt"
EARLIER: Final = "seal-of-{}.txt"


@dataclass(frozen=True)
class Store:
    """A run's folder."""

    root: Path

    def case(self, number: int) -> Path:
        """Folder of a case."""
        return self.root / "cases" / f"{number:03d}"

    def recordings(self, number: int) -> Path:
        """What the diagnosis is given."""
        return self.case(number) / "recordings"

    def diagnosis(self, number: int) -> Path:
        """What the diagnosis writes."""
        return self.case(number) / "diagnosis"

    def label_file(self, number: int) -> Path:
        """The sealed label of a case; it is there once its recordings are complete."""
        return self.root / ".sealed" / f"{number:03d}.json"

    def keep_label(self, number: int, label: dict[str, Any]) -> None:
        """Put a label under seal."""
        atomic.write_text(self.label_file(number), json.dumps(label, indent=1, sort_keys=True) + "\n")

    def labels_text(self, count: int) -> str:
        """All labels as ``labels.json`` will hold them."""
        labels = {f"{k:03d}": json.loads(self.label_file(k).read_text()) for k in range(count)}
        return json.dumps(labels, indent=1, sort_keys=True) + "\n"

    def begin(self, run: dict[str, Any]) -> None:
        """Note what is run. More cases of a run that lies here go on with it: its seal is kept, and checked.

        Raises:
            ValueError: another run lies here, or one of more cases.
        """
        path = self.root / ".sealed" / "run.json"
        there = json.loads(path.read_text()) if path.exists() else None
        if there == run:
            return
        if there is not None and there["cases"] < run["cases"] and there | {"cases": run["cases"]} == run:
            if (seal := self.root / SEAL).exists():
                seal.replace(self.root / EARLIER.format(there["cases"]))
        elif there is not None:
            differ = ", ".join(f"{k} {there.get(k)!r}" for k in run if there.get(k) != run[k])
            raise ValueError(
                f"{self.root.name} holds another run ({differ}): give another --out, or the same options and no fewer "
                "cases"
            )
        atomic.write_text(path, json.dumps(run, indent=1) + "\n")

    def run(self) -> dict[str, Any]:
        """What is run here.

        Raises:
            ValueError: nothing is.
        """
        path = self.root / ".sealed" / "run.json"
        if not path.exists():
            raise ValueError(f"{self.root.name} holds no run: give one of python -m benchmarks.blind")
        return dict(json.loads(path.read_text()))

    def seal(self, count: int) -> str:
        """Seal the labels; later calls check that they are as they were.

        Returns:
            SHA-256 of the text that ``labels.json`` will hold.

        Raises:
            ValueError: the labels are not those that were sealed.
        """
        path = self.root / SEAL
        if not path.exists():
            atomic.write_text(path, f"{self._digest(count)}  labels.json\n")
        counts = {path: count, **{p: int(p.stem.split("-")[-1]) for p in self.root.glob(EARLIER.format("*"))}}
        for one, first in counts.items():
            sealed = one.read_text().split()[0]
            if sealed != self._digest(first):
                raise ValueError(f"{one.name} sealed other labels than these ({sealed[:12]}…): start a new folder")
        return self._digest(count)

    def _digest(self, count: int) -> str:
        return hashlib.sha256(self.labels_text(count).encode()).hexdigest()

    def unseal(self, count: int) -> dict[str, Any]:
        """Open the labels, when every case has its answer.

        Raises:
            ValueError: the seal is missing or broken, or a case has no answer yet.
        """
        if not (self.root / SEAL).exists():
            raise ValueError("there is no seal: the labels must be sealed before they are opened")
        self.seal(count)
        missing = [k for k in range(count) if not self.answered(k)]
        if missing:
            raise ValueError(f"case {missing[0]:03d} is not diagnosed yet: the labels stay sealed")
        text = self.labels_text(count)
        atomic.write_text(self.root / "labels.json", text)
        return dict(json.loads(text))

    def answered(self, number: int) -> bool:
        """Whether a case has an answer, be it that the diagnosis failed."""
        return (self.diagnosis(number) / "diagnosis.json").exists() or self.failure(number).exists()

    def failure(self, number: int) -> Path:
        """What a failed diagnosis said."""
        return self.case(number) / "failed.txt"

    def answer(self, number: int) -> dict[str, Any] | None:
        """The diagnosis of a case; None where it failed."""
        path = self.diagnosis(number) / "diagnosis.json"
        return dict(json.loads(path.read_text())) if path.exists() else None

    def followed_file(self, number: int) -> Path:
        """What became of a case's recommended motion."""
        return self.case(number) / "next.json"

    def followed(self, number: int) -> dict[str, Any] | None:
        """The same, read; None where none was played."""
        path = self.followed_file(number)
        return dict(json.loads(path.read_text())) if path.exists() else None

"""Write the JSON schema of ``diagnosis.json``: ``python docs/make_diagnosis_schema.py``."""

from __future__ import annotations

import json
from pathlib import Path

from tiago_mj.gap.result import json_schema

FILE = Path(__file__).with_name("diagnosis.schema.json")


def text() -> str:
    """What the file holds."""
    return json.dumps(json_schema(), indent=1, ensure_ascii=False, allow_nan=False) + "\n"


if __name__ == "__main__":
    FILE.write_text(text(), encoding="utf-8")

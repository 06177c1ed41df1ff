"""The benchmark of real recordings lies in the checkout, beside the tests and outside the package."""

import os
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

REALDATA = Path(os.environ.get("TIAGO_MJ_REALDATA", ROOT.parent / "shared" / "realdata"))


@pytest.fixture(scope="session")
def fetched():
    """The folder of the recordings for a source or a case; the test is skipped where its files are absent."""
    from benchmarks.real.cases import SOURCES, place

    def folder(source, places=None):
        for file in SOURCES[source].files:
            if (places is None or file.place in places) and place(REALDATA, file) is None:
                pytest.skip(f"{file.place} is not here: fetch it and set TIAGO_MJ_REALDATA to its folder")
        return REALDATA

    return folder

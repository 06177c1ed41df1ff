"""Public recordings of real robots: no part of this package, read where they are: in the folder that TIAGO_MJ_REALDATA
names, or in ``shared/realdata`` beside the repository."""

import os
from pathlib import Path

import pytest

REALDATA = Path(os.environ.get("TIAGO_MJ_REALDATA", Path(__file__).parents[3] / "shared" / "realdata"))


def real(name):
    """A folder or file of them; the test is skipped where it is absent."""
    path = REALDATA / name
    if not path.exists():
        pytest.skip(f"the real recordings {name} are not here: set TIAGO_MJ_REALDATA to their folder")
    return path

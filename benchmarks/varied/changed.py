"""``python -m benchmarks.varied.changed FACTORS COMMAND…``: a command of ``tiago-mj`` with some numbers other ones.

FACTORS is a JSON object of factors by ``module:NAME`` (:mod:`benchmarks.varied.sites`).
"""

from __future__ import annotations

import json
import sys

from benchmarks.varied import sites


def main(words: list[str]) -> int:
    """Run the command.

    Raises:
        ImportError: a number's module was never imported, so that the command ran unchanged.
    """
    finder = sites.install(json.loads(words[0]))
    from tiago_mj.cli import main as command  # after the finder is there: it changes what is imported

    status = command(words[1:])
    if finder.left:
        raise ImportError(f"never imported: {', '.join(sorted(finder.left))}")
    return status


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

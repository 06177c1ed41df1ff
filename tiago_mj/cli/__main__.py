"""``python -m tiago_mj.cli``."""

import sys

from tiago_mj.cli import main

if __name__ == "__main__":
    sys.exit(main())

"""``python -m docs.site build`` and ``python -m docs.site serve``."""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import threading
import time
from pathlib import Path

from docs.site import assemble, offline

OUT = assemble.ROOT / "out" / "site"
#: Sphinx's roles before code, which docstrings have and Markdown does not know.
ROLE = re.compile(r":(?:class|func|meth|data|mod|attr|exc):(?=<code>)")


def main() -> int:
    """Build or show the site; exit status 1 where a link leads nowhere or something is loaded from a network."""
    parser = argparse.ArgumentParser(prog="python -m docs.site", description="Build or show the documentation.")
    parser.add_argument("what", choices=("build", "serve"), help="HTML in OUT/html, or a preview that follows changes")
    parser.add_argument("--out", type=Path, default=OUT, help="folder (out/site)")
    parser.add_argument("--port", type=int, default=8000, help="of the preview (8000)")
    arguments = parser.parse_args()
    began = time.monotonic()
    configuration = assemble.assemble(arguments.out.resolve(), lambda line: print(line, file=sys.stderr, flush=True))
    print(f"pages written in {time.monotonic() - began:.0f} s", file=sys.stderr, flush=True)
    mkdocs = [sys.executable, "-m", "mkdocs"]
    os.environ["NO_MKDOCS_2_WARNING"] = "1"  # why MkDocs: docs/site/__init__.py
    if arguments.what == "serve":
        threading.Thread(target=_follow, args=(arguments.out.resolve(),), daemon=True).start()
        address = f"127.0.0.1:{arguments.port}"
        print(f"http://{address} follows changes; Ctrl-C ends it", file=sys.stderr, flush=True)
        return subprocess.run([*mkdocs, "serve", "-q", "-f", configuration, "-a", address], check=False).returncode
    status = subprocess.run([*mkdocs, "build", "--strict", "-f", configuration], check=False).returncode
    if status:
        return status
    for page in (arguments.out.resolve() / "html" / "api").glob("*.html"):
        page.write_text(ROLE.sub("", page.read_text(encoding="utf-8")), encoding="utf-8")
    complaints = offline.loads_of_others(arguments.out.resolve() / "html")
    for line in complaints:
        print(f"loaded from another host: {line}", file=sys.stderr)
    print(f"{arguments.out / 'html' / 'index.html'}: built in {time.monotonic() - began:.0f} s")
    return 1 if complaints else 0


def _follow(out: Path) -> None:
    """Write pages again whose files change."""
    since = time.time()
    while True:
        time.sleep(1)
        now = time.time()
        try:
            assemble.refresh(out, since)
        except (OSError, ValueError) as fault:  # a page that is being written
            print(fault, file=sys.stderr)
        since = now


if __name__ == "__main__":
    sys.exit(main())

"""Kill every command that writes, at many random moments, and check what is left; then go on, and compare.

    python tests/long/faults.py --kills 50 --out benchmarks/results/faults.json

Each command runs with small inputs into a folder that was used before, or into a new one, and is killed (SIGKILL): half
of the times at a moment drawn evenly over its run, half of the times just after it has changed something in the folder
or beside it. What is left must be the old files or the new ones, whole. After one to six kills it is run undisturbed:
the result must be that of a run that was never killed, bit for bit but for the times that it took, and nothing else may
lie there. A full drive, a folder that cannot be written, and two processes at once are tried, too.

The commands but diagnose-all run in forks of this process, which has their libraries loaded: a kill then falls into
their work, not into the loading.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
sys.path.insert(0, str(Path(__file__).resolve().parent))
import fault_commands
from fault_commands import JOURNAL, Command, digests

from benchmarks.blind.__main__ import main as blind_check
from benchmarks.machine import machine
from tiago_mj import cli
from tiago_mj.io import held

#: Modules that start something when they are imported, which a fork must do itself.
NOT_AHEAD = ("OpenGL", "mujoco.egl", "mujoco.osmesa", "__main__", "joblib.externals.loky")
#: Commands that run in processes of their own, and the share of their time that passes before they begin to work:
#: in a fork, a second diagnosis ends within a library (libc++).
FRESH, LOADING = ("diagnose-all",), 0.25
#: Pages that may tell times; the numbers in them are those of JSON files, which are compared.
TIMED = ".html"
#: Seconds between two looks at a folder, and at a process; longest wait after a change before the kill.
LOOK, GLANCE, AFTER = 0.002, 0.02, 0.01
#: Most kills before a run is let through.
IN_A_ROW = 6
PAGE = 4096
#: Commands whose libraries are all that there are.
AHEAD = ("diagnose", "train", "evaluate")
#: A run that is over before its kill shortens the time from which moments are drawn.
QUICKER = 0.9


class WrongError(Exception):
    """What must not be."""


@dataclass
class Lab:
    """Where the commands run.

    Attributes:
        root: folder of inputs and references.
        work: folder that holds the one that is written, ``out``, and nothing else.
    """

    root: Path
    work: Path

    @property
    def out(self) -> Path:
        return self.work / "out"

    @property
    def said(self) -> Path:
        return self.root / "said.txt"

    def start(self, words: Sequence[str], said: Path | None = None) -> int:
        """Start a command in a fork; its process."""
        pid = os.fork()
        if pid:
            return pid
        status = 1
        try:
            target = os.open(said or self.said, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, 1)
            os.dup2(target, 2)
            os.chdir(self.root)
            if words[0] in FRESH:
                os.execv(sys.executable, [sys.executable, "-m", "tiago_mj.cli", *words])
            status = blind_check(words[1:]) if words[0] == "blind" else cli.main(list(words))
        except SystemExit as stop:
            status = stop.code if isinstance(stop.code, int) else 1
            if isinstance(stop.code, str):
                print(stop.code, file=sys.stderr)
        except BaseException:
            traceback.print_exc()
        finally:
            sys.stderr.flush()
            os._exit(status)

    def run(self, words: Sequence[str]) -> int:
        """Run a command to its end; its exit status."""
        return os.waitstatus_to_exitcode(os.waitpid(self.start(words), 0)[1])

    def done(self, words: Sequence[str]) -> None:
        """The same; it must end well."""
        status = self.run(words)
        if status:
            raise WrongError(f"{words[0]}: exit status {status}: {self.said.read_text()[-500:]}")

    def strays(self) -> list[str]:
        """What is neither the folder nor in it by right."""
        below = [str(path.relative_to(self.work)) for path in self.work.rglob("*")]
        return [name for name in below if held.MARK in name or (name.split("/")[0] != "out") or JOURNAL in name]

    def clear(self) -> None:
        for path in self.work.iterdir():
            shutil.rmtree(path)

    def seen(self) -> frozenset[tuple[str, int, int]]:
        """Names, inodes and sizes of everything that is there."""
        found = set()
        for folder, folders, files in os.walk(self.work):
            for name in (*folders, *files):
                with contextlib.suppress(OSError):
                    status = os.lstat(os.path.join(folder, name))
                    found.add((os.path.join(folder, name), status.st_ino, status.st_size))
        return frozenset(found)


@dataclass
class References:
    """What undisturbed runs give.

    Attributes:
        name, command: that is run.
        old, new: digests of the files before and after.
        kept: copy of the old folder; None: there was none.
        loose: pages, which tell how long something took: of these the numbers are not compared.
        seconds: of a run.
        changes: in the folder and beside it in a run.
        new_pages: of the drive that the new files take; what they are more than the old ones, where these stay.
    """

    name: str
    command: Command
    old: dict[str, str]
    new: dict[str, str]
    kept: Path | None
    loose: set[str]
    seconds: float
    changes: int
    new_pages: int

    def digests(self, folder: Path) -> dict[str, str]:
        found = digests(folder)
        without = digests(folder, numbers=False) if self.loose else {}
        return {name: without[name] if name in self.loose else one for name, one in found.items()}

    def state(self, folder: Path) -> str:
        """``nothing``, ``old`` or ``new``.

        Raises:
            WrongError: it is a mixture, or a file is not whole.
        """
        try:
            found = self.digests(folder)
        except ValueError as fault:
            raise WrongError(f"not whole: {fault}") from fault
        names = self.command.together
        if names:
            found = {name: one for name, one in found.items() if name in names}
        for name, wanted in (("nothing", {}), ("new", self.new), ("old", self.old)):
            wanted = {key: one for key, one in wanted.items() if not names or key in names}
            if found == wanted:
                return name
        odd = [name for name in {**found, **self.new} if found.get(name) != self.new.get(name)]
        raise WrongError(f"a mixture: of {sorted(found)} these are not new: {sorted(odd)}")


def refer(lab: Lab, name: str, command: Command) -> References:
    """Run a command undisturbed, twice."""
    kept = None
    old: dict[str, str] = {}
    if command.old is not None:
        lab.clear()
        lab.done(command.old(lab.out))
        kept = lab.root / f"old-{name}"
        shutil.copytree(lab.out, kept)
    twice, plain, changes, seconds = [], [], 0, 0.0
    for _ in range(2):
        put(lab, kept)
        begun, before = time.monotonic(), lab.seen()
        process, changes = lab.start(command.new(lab.out)), 0
        while os.waitpid(process, os.WNOHANG)[0] == 0:
            now = lab.seen()
            changes, before = changes + (now != before), now
            time.sleep(LOOK)
        seconds = time.monotonic() - begun
        twice.append(digests(lab.out))
        plain.append(digests(lab.out, numbers=False))
    if twice[0].keys() != twice[1].keys() or not twice[0]:
        raise WrongError(f"two undisturbed runs write other files: {lab.said.read_text()[-500:]}")
    loose = {one for one in twice[0] if twice[0][one] != twice[1][one] or one.endswith(TIMED)}
    unlike = [one for one in loose if plain[0][one] != plain[1][one]]
    if unlike:
        raise WrongError(f"two undisturbed runs write other bits: {unlike}")
    pages = _pages(lab.out) - (_pages(kept) if kept is not None and command.together else 0)
    found = References(name, command, old, {}, kept, loose, seconds, changes, pages)
    found.new = found.digests(lab.out)
    if kept is not None:
        found.old = found.digests(kept)
    return found


def _pages(folder: Path) -> int:
    return sum(-(-path.stat().st_size // PAGE) for path in folder.rglob("*") if path.is_file())


def put(lab: Lab, kept: Path | None) -> None:
    """Make the folder what it was before the run."""
    lab.clear()
    if kept is not None:
        shutil.copytree(kept, lab.out)


def kill_once(lab: Lab, of: References, rng: random.Random, words: list[str], *, writing: bool) -> bool:
    """Run and kill; whether it was killed before it was over."""
    first = LOADING * of.seconds if of.name in FRESH else 0.0
    until, changes = rng.uniform(first, of.seconds), rng.randint(1, max(of.changes, 1))
    begun, before, process = time.monotonic(), lab.seen(), lab.start(words)
    while os.waitpid(process, os.WNOHANG)[0] == 0:
        if writing:
            now = lab.seen()
            changes, before = changes - (now != before), now
            if not changes:
                time.sleep(rng.uniform(0, AFTER))
        if (writing and changes <= 0) or (not writing and time.monotonic() - begun > until):
            os.kill(process, signal.SIGKILL)
            return os.waitstatus_to_exitcode(os.waitpid(process, 0)[1]) == -signal.SIGKILL
        time.sleep(LOOK if writing else min(GLANCE, max(until - (time.monotonic() - begun), 0.0)))
    return False


def kills(lab: Lab, of: References, count: int, rng: random.Random, until: float) -> dict[str, Any]:
    """Kill a command many times; what was found."""
    found: Counter[str] = Counter()
    through, wrong = 0, []
    while found["kills"] < count and time.monotonic() < until:
        kept = of.kept if through % 3 else None
        if of.command.together:  # what was trained before is part of the new folder
            kept = of.kept
        put(lab, kept)
        words = of.command.new(lab.out)
        try:
            for _ in range(min(rng.randint(1, IN_A_ROW), count - found["kills"])):
                writing = rng.random() < 0.5
                if kill_once(lab, of, rng, words, writing=writing):
                    words = [*of.command.new(lab.out), *of.command.goes_on]
                    found["kills"] += 1
                    found["while_writing"] += writing
                    found[f"left_{of.state(lab.out)}"] += 1
                else:  # the machine is quicker than it was
                    of.seconds, of.changes = of.seconds * QUICKER, max(of.changes - 1, 1)
            lab.done(words)
            if of.digests(lab.out) != of.new:
                odd = [n for n, one in of.digests(lab.out).items() if of.new.get(n) != one]
                raise WrongError(f"going on gives other bits: {odd}")
            if lab.strays():
                raise WrongError(f"left behind: {lab.strays()}")
        except WrongError as fault:
            wrong.append(str(fault))
        through += 1
    return {**found, "let_through": through, "same_bits": through - len(wrong), "wrong": wrong}


@contextlib.contextmanager
def drive(folder: Path, pages: int) -> Iterator[None]:
    """A drive of so many pages in memory.

    Raises:
        PermissionError: this process may not mount one.
    """
    done = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", f"size={pages * PAGE}", "tmpfs", str(folder)], capture_output=True, check=False
    )
    if done.returncode:
        raise PermissionError("no drive may be mounted here")
    try:
        yield
    finally:
        subprocess.run(["umount", "-l", str(folder)], check=True)


def again(folder: Path, options: str) -> None:
    """Mount a drive again with other options."""
    subprocess.run(["mount", "-o", f"remount,{options}", str(folder)], check=True)


def refused(lab: Lab, of: References) -> dict[str, Any]:
    """Run where it cannot be written: one line, status 2, and what was there before still there."""
    begun, status = time.monotonic(), lab.run(of.command.new(lab.out))
    lines = [line for line in lab.said.read_text().splitlines() if "tiago-mj" in line.split(":")[0]]
    told = [line for line in lines if " of " not in line.split(":")[1]]
    found = {"status": status, "seconds": round(time.monotonic() - begun, 1), "left": of.state(lab.out)}
    if status != 2 or "Traceback" in lab.said.read_text():
        raise WrongError(f"exit status {status}: {lab.said.read_text()[-300:]}")
    return {**found, "said": told[-1].replace(str(lab.work), "DIR") if told else ""}


def full_drive(lab: Lab, of: References) -> dict[str, Any]:
    """Room for less than half of what is to be written; then room for all."""
    room = max(of.new_pages * 2 // 5, 2)
    with drive(lab.work, (_pages(of.kept) if of.kept else 0) + room):
        put(lab, of.kept)
        found = refused(lab, of)
        left = [name for name in lab.strays() if held.MARK in name]
        if left:
            raise WrongError(f"left behind: {left}")
        again(lab.work, "size=64m")
        lab.done(of.command.new(lab.out))
        if of.digests(lab.out) != of.new:
            raise WrongError("with more room it gives other bits")
    return found


def read_only(lab: Lab, of: References) -> dict[str, Any]:
    """A drive that cannot be written."""
    with drive(lab.work, 64 * 256):
        put(lab, of.kept)
        again(lab.work, "ro")
        return refused(lab, of)


def two_at_once(lab: Lab, of: References) -> dict[str, Any]:
    """Two processes with the same command and folder."""
    put(lab, of.kept)
    processes = [lab.start(of.command.new(lab.out), lab.root / f"said-{k}.txt") for k in range(2)]
    statuses = sorted(os.waitstatus_to_exitcode(os.waitpid(process, 0)[1]) for process in processes)
    said = [(lab.root / f"said-{k}.txt").read_text() for k in range(2)]
    if statuses[0] != 0 or statuses[1] not in (0, 2) or any("Traceback" in one for one in said):
        raise WrongError(f"exit statuses {statuses}: {said}")
    if of.digests(lab.out) != of.new or lab.strays():
        raise WrongError(f"two at once leave {of.state(lab.out)}, and {lab.strays()}")
    return {"statuses": statuses, "left": "new"}


def tried(call: Any, lab: Lab, of: References) -> Any:
    """What came of it, what was wrong, or that it was skipped."""
    try:
        return call(lab, of)
    except PermissionError as fault:
        return {"skipped": str(fault)}
    except WrongError as fault:
        return {"wrong": [str(fault)]}


def load_ahead(lab: Lab, commands: dict[str, Command]) -> None:
    """Import what the commands import, so that forks of this process need not."""
    listed = lab.root / "modules.txt"
    script = (
        "import sys; from tiago_mj import cli; cli.main(sys.argv[2:]); "
        "open(sys.argv[1], 'w').write(' '.join(sys.modules))"
    )
    for command in [commands[name] for name in AHEAD if name in commands] or commands.values():
        lab.clear()
        words = [sys.executable, "-c", script, str(listed), *command.new(lab.out)]
        subprocess.run(words, capture_output=True, check=False)
        for name in listed.read_text().split() if listed.exists() else ():
            if not name.startswith(NOT_AHEAD):
                with contextlib.suppress(Exception):
                    importlib.import_module(name)
    lab.clear()


def main() -> None:
    parser = argparse.ArgumentParser(description="Kill every command that writes, and check what is left.")
    parser.add_argument("--kills", type=int, default=50, metavar="N", help="of each command (50)")
    parser.add_argument("--commands", metavar="LIST", help="only some; in a file that is there the others stay")
    parser.add_argument("--minutes", type=float, default=120.0, metavar="M", help="most for all (120)")
    parser.add_argument("--seed", type=int, default=0, metavar="N")
    parser.add_argument("--out", type=Path, required=True, metavar="FILE", help="JSON")
    given = parser.parse_args()
    results: dict[str, Any] = {}
    if given.commands is not None and given.out.exists():  # the others stay as they are
        results = json.loads(given.out.read_text())["results"]
    made_on = machine()  # before the run: the files may change meanwhile
    with tempfile.TemporaryDirectory() as root:
        lab = Lab(Path(root) / "lab", Path(root) / "work")
        lab.root.mkdir()
        lab.work.mkdir()
        commands = fault_commands.make_inputs(lab.root, lab.run)
        commands = {k: v for k, v in commands.items() if given.commands is None or k in given.commands.split(",")}
        load_ahead(lab, commands)
        deadline = time.monotonic() + 60 * given.minutes
        for number, (name, command) in enumerate(commands.items()):
            rng = random.Random(f"{given.seed} {name}")
            of = refer(lab, name, command)
            until = time.monotonic() + (deadline - time.monotonic()) / (len(commands) - number)
            results[name] = {
                "commit": made_on["commit"],
                "seconds_undisturbed": round(of.seconds, 2),
                "compared_without_numbers": sorted(of.loose),
                "killed": kills(lab, of, given.kills, rng, until),
                "full_drive": tried(full_drive, lab, of),
                "read_only": tried(read_only, lab, of),
                "two_at_once": tried(two_at_once, lab, of),
            }
            print(name, json.dumps(results[name]), flush=True)
            words = f"python tests/long/faults.py --kills {given.kills} --seed {given.seed} --out FILE"
            data = {"command": words, "machine": made_on, "results": results}
            given.out.write_text(json.dumps(data, indent=1) + "\n")
    parts = [part for of_one in results.values() for part in of_one.values() if isinstance(part, dict)]
    if any(part.get("wrong") for part in parts):
        raise SystemExit(1)


if __name__ == "__main__":
    main()

"""Hostile files for every reader: none may hang, take much memory, run anything, or end in more than one line.

    python tests/long/fuzz.py --inputs 100000 --out benchmarks/results/fuzz.json

Input K is a valid input of one reader in which one file was changed (``tests/fuzzing/mutate.py``); seed and K alone say
which and how, so that ``--again K`` tries one anew (HDF5 and DAE files hold the time at which they were written, so
that in them a change may hit something else). Readers run in a process of its own, one input after the other, as
a user's process would call them; some inputs go through the command line. What is asked of each:

- a result, or one line of the reader's own error (through the command line: exit status 0, or 2 and one line);
- at most 20 s and 500 MB more than before, the process's address space being limited to 3 GB more;
- nothing run, fetched, unpickled or written outside of its folder, as the interpreter's audit events tell;
- nothing left in the output where it was refused.
"""

from __future__ import annotations

import argparse
import collections
import faulthandler
import json
import multiprocessing
import os
import random
import resource
import shutil
import sys
import tempfile
import time
import traceback
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

SECONDS, MEGABYTES = 20.0, 500.0
#: Address space beyond what a process has when all libraries are loaded [bytes].
SPACE = 3_000_000_000
#: A process tries so many inputs, then another takes over.
TURN = 25_000
#: Share of the inputs of a reader that go through the command line, where a command reads the same and is over soon.
BY_COMMAND = 0.02


def plan(seed: int, number: int) -> tuple[str, random.Random]:
    """Reader of an input, and the generator of what is done to it."""
    from fuzzing.targets import COMMANDS, TARGETS

    rng = random.Random(f"{seed}-{number}")
    everything = {**TARGETS, **COMMANDS}
    name = rng.choices(list(everything), [target.share for target in everything.values()])[0]
    return name, rng


class Worker:
    """Tries inputs in this process."""

    def __init__(self, seed: int) -> None:
        from fuzzing.verdicts import Watch

        self.seed = seed
        self.folder = Path(tempfile.mkdtemp(prefix="fuzz-", dir="/dev/shm" if os.path.isdir("/dev/shm") else None))
        self.valid: dict[str, dict[str, bytes]] = {}
        self.watch = Watch()

    def warm_up(self) -> None:
        """Write every valid input, and read it: what readers import is not what files cost."""
        from fuzzing.targets import COMMANDS, TARGETS
        from fuzzing.verdicts import ACCEPTED, by_command, tried

        for name, target in {**TARGETS, **COMMANDS}.items():
            source = self.folder / "valid" / name.replace(" ", "-")
            source.mkdir(parents=True)
            target.write(source)
            self.valid[name] = {
                str(path.relative_to(source)): path.read_bytes() for path in sorted(source.rglob("*")) if path.is_file()
            }
            if name in TARGETS:
                verdict, said = tried(target, source)
                if verdict != ACCEPTED and name != "policy zip":
                    raise SystemExit(f"the valid input of {name} is not accepted: {verdict}: {said}")
            if target.command:
                verdict, said = by_command(target.command, source, self.folder / "out")
                if verdict != ACCEPTED:
                    raise SystemExit(f"the valid input of {name} is not accepted by the command: {verdict}: {said}")
                shutil.rmtree(self.folder / "out", ignore_errors=True)

    def one(self, number: int) -> dict[str, Any]:
        """Try an input."""
        from fuzzing.mutate import changed
        from fuzzing.targets import COMMANDS, TARGETS
        from fuzzing.verdicts import by_command, tried

        name, rng = plan(self.seed, number)
        target = TARGETS.get(name) or COMMANDS[name]
        files = self.valid[name]
        file = rng.choice([one for one in files if not one.endswith(target.fixed)] if target.fixed else list(files))
        kind, data = changed(file, files[file], rng)
        source, out = self.folder / "in", self.folder / "out"
        for there in (source, out):
            shutil.rmtree(there, ignore_errors=True)
        for one, content in files.items():
            path = source / one
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(data if one == file else content)
        before, began = resident(), time.perf_counter()
        commanded = name in COMMANDS or (bool(target.command) and rng.random() < BY_COMMAND)
        if commanded:
            verdict, said = by_command(target.command, source, out)
        else:
            verdict, said = tried(target, source, self.watch)
        took, most = time.perf_counter() - began, peak() - before
        if most > MEGABYTES and peak() > self.highest:
            verdict = f"took {most:.0f} MB"
        self.highest = max(self.highest, peak())
        if took > SECONDS:
            verdict = f"took {took:.0f} s"
        return {
            "number": number, "reader": name, "file": Path(file).suffix or file, "kind": kind, "command": commanded,
            "verdict": verdict, "said": said, "seconds": took, "megabytes": max(most, 0.0),
        }  # fmt: skip

    highest = 0.0


def resident() -> float:
    """Memory of this process now [MB]."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize() / 1e6


def peak() -> float:
    """Most memory of this process so far [MB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e6


def work(seed: int, begin: int, end: int, pipe: Any) -> None:
    """Try inputs, and say what came of each."""
    faulthandler.enable()
    nowhere = os.open(os.devnull, os.O_WRONLY)
    worker = Worker(seed)
    os.chdir(worker.folder)
    try:
        worker.warm_up()
        os.dup2(nowhere, 1)
        os.dup2(nowhere, 2)
        worker.highest = peak()
        space = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize() + SPACE
        resource.setrlimit(resource.RLIMIT_AS, (space, space))
        pipe.send(None)
        for number in range(begin, end):
            pipe.send(number)
            pipe.send(worker.one(number))
    except BaseException:
        pipe.send({"verdict": "the harness failed", "said": traceback.format_exc()})
        raise
    finally:
        shutil.rmtree(worker.folder, ignore_errors=True)


class Tally:
    """What came of all inputs."""

    def __init__(self) -> None:
        self.readers: dict[str, dict[str, Any]] = {}
        self.kinds: dict[str, collections.Counter[str]] = collections.defaultdict(collections.Counter)
        self.findings: list[dict[str, Any]] = []
        self.commands = self.inputs = 0

    def add(self, told: dict[str, Any]) -> None:
        self.inputs += 1
        self.commands += told.get("command", False)
        reader = self.readers.setdefault(
            told["reader"], {"accepted": 0, "refused": 0, "findings": 0, "slowest_s": 0.0, "most_mb": 0.0}
        )
        fine = told["verdict"] in ("accepted", "refused")
        outcome = told["verdict"] if fine else "findings"
        reader[outcome] += 1
        self.kinds[told.get("kind", "")][outcome] += 1
        reader["slowest_s"] = max(reader["slowest_s"], round(told.get("seconds", 0.0), 2))
        reader["most_mb"] = max(reader["most_mb"], round(told.get("megabytes", 0.0)))
        if not fine:
            self.findings.append({key: told[key] for key in told if key not in ("seconds", "megabytes")})
            print(f"  {told['number']} {told['reader']}: {told['verdict']} | {told['said'][:200]}", flush=True)

    def data(self, seed: int, seconds: float) -> dict[str, Any]:
        return {
            "inputs": self.inputs,
            "seed": seed,
            "seconds": round(seconds),
            "through_the_command_line": self.commands,
            "limits": {"seconds": SECONDS, "megabytes": MEGABYTES},
            "findings": self.findings,
            "readers": dict(sorted(self.readers.items())),
            "kinds": {kind: dict(counts) for kind, counts in sorted(self.kinds.items())},
        }


def run(seed: int, inputs: int, first: int = 0) -> Tally:
    """Try inputs, one process after the other."""
    tally, number, began = Tally(), first, time.monotonic()
    context = multiprocessing.get_context("spawn")
    while number < first + inputs:
        ours, theirs = context.Pipe()
        process = context.Process(target=work, args=(seed, number, min(number + TURN, first + inputs), theirs))
        process.start()
        theirs.close()
        current, patience, why = None, 300.0, ""
        while not why:
            try:
                told = ours.recv() if ours.poll(patience) else "hangs"
            except (EOFError, OSError):
                why = "the process ended"
                break
            if told == "hangs":
                why = f"hangs for more than {SECONDS:.0f} s"
            elif isinstance(told, int):
                current, patience = told, SECONDS + 5
            elif isinstance(told, dict):
                if "number" not in told:
                    raise SystemExit(told["said"])
                tally.add(told)
                number, current = told["number"] + 1, None
                if tally.inputs % 5000 == 0:
                    print(f"{tally.inputs} inputs, {time.monotonic() - began:.0f} s", flush=True)
        if why.startswith("hangs"):
            process.kill()
        process.join()
        if current is not None:
            name, _ = plan(seed, current)
            ended = f"{why} ({process.exitcode})"
            tally.add({"number": current, "reader": name, "kind": "", "verdict": ended, "said": ""})
            number = current + 1
        elif number < first + inputs and why == "the process ended" and process.exitcode not in (0, None):
            raise SystemExit(f"the process ended with {process.exitcode} between inputs")
    return tally


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--inputs", type=int, default=1000, metavar="N")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, metavar="FILE", help="JSON with command, machine, counts and findings")
    parser.add_argument(
        "--again", type=int, metavar="K", help="try input K alone, in this process, and print all of it"
    )
    parser.add_argument("--keep", type=Path, metavar="DIR", help="with --again: leave the input there")
    arguments = parser.parse_args()
    if arguments.again is not None:
        faulthandler.enable()
        worker = Worker(arguments.seed)
        worker.warm_up()
        worker.highest = peak()
        print(json.dumps(worker.one(arguments.again), indent=1))
        if arguments.keep:
            shutil.copytree(worker.folder / "in", arguments.keep)
        shutil.rmtree(worker.folder)
        return
    began = time.monotonic()
    tally = run(arguments.seed, arguments.inputs)
    results = tally.data(arguments.seed, time.monotonic() - began)
    if arguments.out:
        from benchmarks.machine import machine

        command = f"python tests/long/fuzz.py --inputs {arguments.inputs} --seed {arguments.seed}"
        content = {"command": command, "machine": machine(), "results": results}
        arguments.out.parent.mkdir(parents=True, exist_ok=True)
        arguments.out.write_text(json.dumps(content, indent=1) + "\n")
    print(f"{tally.inputs} inputs in {results['seconds']} s, {len(tally.findings)} findings")
    sys.exit(1 if tally.findings else 0)


if __name__ == "__main__":
    main()

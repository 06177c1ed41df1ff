"""Many independent tasks at once: in processes of this machine, or on a Ray cluster.

joblib does the scheduling: its own processes (loky), or Ray's through ``ray.util.joblib``. Both come with the extra
``scale``. A task's result must depend on nothing but the task, so that neither the backend nor the number of processes
can change it; and it must be allowed to run again, which it does where a node of the cluster is lost.
"""

from __future__ import annotations

import logging
import os
import pickle
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor
from contextlib import contextmanager, redirect_stdout, suppress
from dataclasses import dataclass
from functools import cache
from typing import Any, Final, TypeVar

from tiago_mj.io import extra

Task = TypeVar("Task")
Result = TypeVar("Result")

BACKENDS: Final = ("local", "ray")
#: What needs the extra.
PURPOSE: Final = "running many processes"
#: Where the cluster is, HOST:PORT: Ray's own variable; without it, the cluster that this machine is part of.
ADDRESS: Final = "RAY_ADDRESS"
#: Seconds to wait for the head's port; Ray itself would try for five minutes.
PATIENCE: Final = 5.0
#: Seconds between a process's looks at whether the one that started it is still there.
LOOK: Final = 0.5
#: A lost process begins again elsewhere this often, then its loss is taken for the tasks' fault. What it had not
#: finished is run again however often it takes: Ray retries every second or so while it has not noticed the loss.
#: Hardly any of a processor is reserved: what a lost node did must find room on those that are left, but none on a
#: head that offers no processor.
ACTORS: Final = {"max_restarts": 5, "max_task_retries": -1, "num_cpus": 0.01, "scheduling_strategy": "SPREAD"}


def run_all(
    function: Callable[[Task], Result],
    tasks: Sequence[Task],
    *,
    jobs: int = 1,
    backend: str = "local",
    done: Callable[[Task], None] | None = None,
) -> list[Result]:
    """The results of all tasks, in the tasks' order, each once.

    Args:
        function: of a module that the processes can import. On a cluster every node needs the same installation, and
            the files that a task names at the same place.
        tasks: what it is called with, one at a time.
        jobs: processes; 0: one a processor of the machine or of the cluster.
        backend: ``"local"``, where one process is this one, or ``"ray"``.
        done: called in this process with each task that is done, in the tasks' order; on a cluster when all are.

    Raises:
        ValueError: jobs or backend is unusable.
        ModuleNotFoundError: the extra ``scale`` is not installed.
        OSError: the cluster cannot be reached, or processes died over and over.
        Exception: what ``function`` raised first.
    """
    if backend not in BACKENDS:
        raise ValueError(f"backend is {backend!r}: use one of {', '.join(BACKENDS)}")
    if jobs < 0:
        raise ValueError(f"--jobs is {jobs}: give 0 or more")
    if backend == "local" and (jobs == 1 or len(tasks) < 2):
        results = []
        for task in tasks:
            results.append(function(task))
            if done is not None:
                done(task)
        return results
    joblib = extra.load("joblib", PURPOSE, "scale")
    if backend == "local":
        with joblib.parallel_config(backend="loky"):
            call = _Call(function, os.getpid())
            return _parallel(joblib, call, tasks, jobs, BrokenExecutor, done, return_as="generator")
    ray = extra.load("ray", PURPOSE, "scale")
    with redirect_stdout(sys.stderr), _connected(ray):  # Ray would tell of lost processes between the results
        processors = int(ray.cluster_resources().get("CPU", 0))
        if jobs > processors:
            raise ValueError(f"--jobs is {jobs}, but the Ray cluster has {processors} processors: give fewer, or 0")
        extra.load("ray.util.joblib", PURPOSE, "scale").register_ray()
        logging.getLogger("ray.util.multiprocessing.pool").setLevel(logging.ERROR)  # warns of joblib's own arguments
        jobs = min(jobs or processors, max(len(tasks), 2))  # no idle ones on a large cluster; joblib runs one here
        with joblib.parallel_config(backend="ray", ray_remote_args=dict(ACTORS)):
            return _parallel(joblib, _Call(function, folder=os.getcwd()), tasks, jobs, ray.exceptions.RayError, done)


def _parallel(
    joblib: Any,
    function: _Call,
    tasks: Sequence[Any],
    jobs: int,
    lost: type[Exception],
    done: Callable[[Any], None] | None,
    **options: Any,
) -> list[Any]:
    """One task a dispatch: tasks last seconds, and a lost process shall cost no more than one."""
    from tiago_mj.io import mujoco_log

    call = joblib.delayed(function)
    try:
        results: list[Any] = []
        found = joblib.Parallel(n_jobs=jobs or -1, batch_size=1, **options)(call(task) for task in tasks)
        for task, (result, warned) in zip(tasks, found, strict=True):
            results.append(result)
            mujoco_log.tell(warned)
            if done is not None:
                done(task)
    except lost as fault:
        reason = " ".join(str(fault).split())[:300]
        raise OSError(f"a process ended in the middle of its task (too little memory?): {reason}") from fault
    return results


@dataclass(frozen=True)
class _Call:
    """A function that another process imports only after MuJoCo's warnings are redirected there.

    Attributes:
        function: that is called.
        starter: process that started the other one, which ends with it; None: another program sees to that.
        folder: in which the other one works, where it is there: Ray's work where Ray was started, and do not find
            files by the names that this process knows them by; None: it works in the right one.
    """

    function: Callable[[Any], Any]
    starter: int | None = None
    folder: str | None = None

    def __call__(self, task: Any) -> tuple[Any, dict[str, int]]:
        """The result, and MuJoCo's warnings by kind."""
        from tiago_mj.io import mujoco_log

        with mujoco_log.counted() as warned:
            result = self.function(task)
        return result, dict(warned)

    def __reduce__(self) -> tuple[Any, ...]:
        return _recalled, (pickle.dumps(self.function), self.starter, self.folder)


def _recalled(pickled: bytes, starter: int | None, folder: str | None) -> _Call:
    from tiago_mj.view import headless

    headless.hush_unmade_viewers()
    if starter is not None:
        _end_with(starter)
    if folder is not None:
        with suppress(OSError):
            os.chdir(folder)
    return _Call(pickle.loads(pickled), starter, folder)


@cache
def _end_with(starter: int) -> None:
    """End this process when its parent ends."""

    def watch() -> None:
        while os.getppid() == starter:
            time.sleep(LOOK)
        os._exit(1)

    if hasattr(os, "getppid") and sys.platform != "win32":  # there a parent that is gone keeps its number
        threading.Thread(target=watch, daemon=True).start()


@contextmanager
def _connected(ray: Any) -> Iterator[None]:
    """A connection to the cluster, left again unless it was there before."""
    if ray.is_initialized():
        yield
        return
    address = os.environ.get(ADDRESS) or "auto"
    host, colon, port = address.rpartition(":")
    mend = f"start one with 'ray start --head', or give the address of a running one as {ADDRESS}=HOST:PORT"
    try:
        if colon and port.isdecimal() and "/" not in host:
            socket.create_connection((host.strip("[]"), int(port)), timeout=PATIENCE).close()
        ray.init(address=address, log_to_driver=False, logging_level=logging.ERROR)
    except (OSError, RuntimeError, ValueError, OverflowError) as fault:
        reason = " ".join(str(fault).split())[:300]
        raise OSError(f"no Ray cluster answers at {address!r} ({reason}): {mend}") from fault
    try:
        yield
    finally:
        ray.shutdown()

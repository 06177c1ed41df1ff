"""What a long command says of how far it is."""

from __future__ import annotations

import io
import threading
import time

import pytest

from tiago_mj import progress
from tiago_mj.progress import Progress


class Clock:
    """Time that moves when it is told to."""

    def __init__(self, monkeypatch):
        self.now = 100.0
        monkeypatch.setattr(progress.time, "monotonic", lambda: self.now)


def test_a_line_tells_stage_share_and_time_left(monkeypatch):
    clock = Clock(monkeypatch)
    told = Progress("diagnose", quiet=True)
    with told:
        told.stage("screening", total=154)
        told.advance(34)
        clock.now += 7.0
        assert told.said() == "diagnose: screening 34 of 154, 22 %, about 25 s left"


def test_with_weights_share_and_time_left_are_of_the_whole(monkeypatch):
    clock = Clock(monkeypatch)
    with Progress("diagnose", quiet=True, weights={"screening": 3.0, "fitting": 6.0, "writing": 1.0}) as told:
        told.stage("screening", total=10)
        told.advance(5)
        assert "5 of 10, 15 %" in told.said()
        clock.now += 36.0
        told.stage("fitting")
        assert told.said() == "diagnose: fitting, 30 %, about 84 s left"


def test_no_more_time_is_left_than_the_budget_has(monkeypatch):
    clock = Clock(monkeypatch)
    with Progress("diagnose", quiet=True, budget=60.0) as told:
        told.stage("screening", total=100)
        told.advance()
        clock.now += 20.0
        assert told.said().endswith("about 40 s left")


def test_what_an_earlier_run_did_tells_nothing_of_the_speed(monkeypatch):
    clock = Clock(monkeypatch)
    with Progress(quiet=True) as told:
        told.stage("steps", total=1000, done=900)
        clock.now += 10.0
        told.at(950, "return -198.0")
        assert told.said() == "steps 950 of 1000, 95 %, about 10 s left, return -198.0"


def test_a_log_gets_lines_also_while_a_stage_does_not_advance():
    log = io.StringIO()
    with Progress("rollout", every=0.05, stream=log) as told:
        told.stage("episode 1 of 2")
        begun = time.monotonic()
        while log.getvalue().count("\n") < 3 and time.monotonic() < begun + 10:  # a loaded machine is late
            time.sleep(0.01)
        took = time.monotonic() - begun
    assert 3 <= log.getvalue().count("rollout: episode 1 of 2, ") <= took / 0.05 + 2


def test_what_is_over_at_once_says_nothing_in_a_log():
    log = io.StringIO()
    with progress.told("rollout", "steps", 5) as told:
        told._stream = log
        told.advance(5)
    assert log.getvalue() == ""


def test_a_terminal_shows_a_line_that_moves():
    console = pytest.importorskip("rich.console").Console(file=io.StringIO(), force_terminal=True, width=100)
    with Progress("diagnose", console=console) as told:
        told.stage("replay [1]", 10)
        time.sleep(3 * progress.LOOK)
    assert "diagnose: replay [1] 0 of 10" in console.file.getvalue()


def test_quiet_is_silent():
    log = io.StringIO()
    with Progress("diagnose", quiet=True, every=0.02, stream=log):
        time.sleep(0.1)
    assert log.getvalue() == ""


def test_many_threads_may_advance_it():
    with Progress(quiet=True) as told:
        told.stage("screening", 8000)
        threads = [threading.Thread(target=lambda: [told.advance() for _ in range(1000)]) for _ in range(8)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert "8000 of 8000, 100 %" in told.said()


def test_progress_before_a_stage_is_refused():
    with Progress(quiet=True) as told, pytest.raises(RuntimeError, match=r"stage\(name, total\)"):
        told.advance()


@pytest.mark.parametrize(
    ("amount", "said"), [(25.2, "25 s"), (200.0, "3 min 20 s"), (239.8, "4 min"), (2400.0, "40 min"), (9000.0, "2.5 h")]
)
def test_times_are_said_as_people_say_them(amount, said):
    assert progress.seconds(amount) == said


def test_a_stage_that_is_over_at_once_does_not_flicker_on_a_screen(monkeypatch):
    clock = Clock(monkeypatch)
    with Progress("diagnose", quiet=True) as told:
        told.stage("fitting", total=4)
        told.advance()
        assert "fitting 1 of 4" in told.settled()
        clock.now += 5.0
        told.stage("blink")
        clock.now += 0.1
        assert "fitting 1 of 4" in told.settled()
        told.stage("pairs")
        clock.now += 0.3
        assert "fitting 1 of 4" in told.settled()
        clock.now += 2 * progress.SETTLED
        assert "pairs" in told.settled()
        told.stage("writing", total=2)
        clock.now += 2 * progress.SETTLED
        assert "writing" in told.settled()


def test_a_diagnosis_never_goes_back_to_a_stage_before():
    from tiago_mj.gap.command import STAGES, Told

    with Progress("diagnose", quiet=True, weights=dict(STAGES.values())) as shown:
        told, lines = Told(shown), []
        for stage in ("replaying", "screening", "fitting", "screening", "refitting", "pairs", "refitting", "pairs"):
            told(stage, 3)
            lines.append(shown.said().split(": ")[1].partition(",")[0])
    shares = [list(dict(STAGES.values())).index(line.removesuffix(" 0 of 3")) for line in lines]
    assert shares == sorted(shares)
    assert lines[3] == lines[2]
    assert lines[6] == lines[5] == lines[7]

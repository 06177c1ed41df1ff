"""What a long command says of how far it is."""

from __future__ import annotations

import io
import itertools
import threading
import time

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from tiago_mj.io import progress
from tiago_mj.io.progress import Estimate, Progress


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


def test_share_and_time_left_are_of_the_whole_where_it_is_known(monkeypatch):
    clock = Clock(monkeypatch)
    with Progress("diagnose", quiet=True) as told:
        told.stage("screening", part=True)
        told.worked(0.0, 100.0)
        clock.now += 36.0
        told.stage("fitting", part=True)
        told.worked(30.0, 70.0)
        assert told.said() == "diagnose: fitting, 30 %, about 84 s left"
        told.stage("drawing", total=2)
        assert told.said() == "diagnose: drawing 0 of 2, 0 %, 36 s so far"


def test_where_more_turns_up_the_share_grows_more_slowly_and_the_time_left_is_that_of_what_is_left():
    told = Estimate()
    told.worked(0.0, 100.0, 0.0)
    told.worked(50.0, 50.0, 50.0)
    assert told.share == pytest.approx(0.5)
    told.worked(50.0, 150.0, 50.0)
    assert told.share == pytest.approx(0.5)
    assert told.seconds_left(50.0) == pytest.approx(150.0)
    told.worked(125.0, 75.0, 125.0)
    assert told.share == pytest.approx(0.75)  # half of what was left is done
    told.worked(200.0, 0.0, 200.0)
    assert told.share == 1.0
    assert told.seconds_left(200.0) == 0.0


def test_time_passes_while_nothing_is_heard_and_what_is_late_is_never_about_to_end():
    told = Estimate()
    told.worked(0.0, 100.0, 0.0)
    told.worked(50.0, 50.0, 10.0)
    left = [told.seconds_left(10.0 + late) for late in (0.0, 1.0, 10.0, 100.0)]
    assert left == pytest.approx([10.0, 9.09, 5.0, 0.909], rel=1e-3)


@example([(0.0, None, 0.0, 0.0), (5e-324, None, 1.0, 0.0), (0.0, 1.0, 0.0, 0.0)])
@given(
    st.lists(
        st.tuples(st.floats(0, 1e9), st.none() | st.floats(0, 1e12), st.floats(0, 1e4), st.floats(0, 1e4)), max_size=40
    )
)
def test_the_share_never_falls_and_the_time_left_is_finite_whatever_is_told(ticks):
    told, now, done, before = Estimate(), 0.0, 0.0, 0.0
    for more, left, passed, late in ticks:
        now, done = now + passed, done + more
        told.worked(done, left, now)
        assert before <= told.share <= 1.0
        before = told.share
        rest = told.seconds_left(now + late)
        assert rest is None or 0.0 <= rest < float("inf")


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


def test_a_stage_of_a_diagnosis_that_comes_again_is_told_and_the_share_goes_on(monkeypatch):
    from tiago_mj.gap.command import STAGES, Told

    clock = Clock(monkeypatch)
    with Progress("diagnose", quiet=True) as shown:
        told, done, lines = Told(shown), 0, []
        for stage in ("replaying", "screening", "pairs", "refitting", "pairs", "refitting"):
            for _ in range(3):
                told(stage, done, 100.0)
                clock.now, done = clock.now + 1.0, done + 10
            assert STAGES[stage] in shown.said()
            lines.append(shown.now()[0])
    assert lines == sorted(lines)
    assert len(set(lines)) == len(lines)


def test_a_line_of_a_log_that_says_nothing_new_comes_ever_more_rarely():
    log = io.StringIO()
    with Progress("diagnose", every=0.02, stream=log) as told:
        told.stage("pairs")
        time.sleep(1.3)
    assert 3 <= log.getvalue().count("\n") <= 8  # after 1, 2, 4, 8, 16 and 32 times so long


def test_no_two_lines_of_a_log_are_equal_and_a_stage_that_comes_again_is_no_news(monkeypatch):
    log, waits = io.StringIO(), iter([False] * 60 + [True])
    with Progress("diagnose", quiet=True, stream=log) as told:
        clock = Clock(monkeypatch)

        def wait(seconds):
            clock.now += seconds
            told.stage(("fitting", "pairs")[int(clock.now) % 2], part=True)
            told._whole = told._whole or Estimate()
            told._whole.share = 0.985
            monkeypatch.setattr(told._whole, "seconds_left", lambda now: 5.0)
            return next(waits)

        monkeypatch.setattr(told._over, "wait", wait)
        told._lines()
    lines = log.getvalue().splitlines()
    assert any("about 5 s left" in line for line in lines)
    assert sum(a == b for a, b in itertools.pairwise(lines)) == 0
    assert len(lines) <= 14  # in 4.5 minutes; every 4.5 s it would be 60


def test_a_log_is_not_silent_for_longer_than_half_a_minute(monkeypatch):
    log, waits = io.StringIO(), iter([False] * 100 + [True])
    with Progress("diagnose", quiet=True, stream=log) as told:
        told.stage("pairs")
        clock, lines = Clock(monkeypatch), []

        def wait(seconds):
            clock.now += seconds
            if log.getvalue().count("\n") > len(lines):
                lines.append(clock.now)
            return next(waits)

        monkeypatch.setattr(told._over, "wait", wait)
        told._lines()
    apart = [b - a for a, b in itertools.pairwise(lines)]
    assert max(apart) <= 32.0
    assert apart[-1] > 25.0

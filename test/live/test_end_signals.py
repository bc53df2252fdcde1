"""Signals end a program once and in order, however many come and whatever it is about."""

from __future__ import annotations

import itertools
import os
import select
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from subprocess import PIPE

import pytest
from rigs.paths import ROOT

from rgbd_glue_ros.closing import END_SIGNALS, SAME_REQUEST_S, uninterrupted
from rgbd_glue_ros.compiled import compiled
from rgbd_glue_ros.live.end_signals import EndSignals, InterruptOnce

PATIENCE_S = 20.0
ATTEMPTS = 10  # where a signal meets the end is by chance
SIGNAL_PERIOD_S = 1e-3
"""Hundreds of thousands a second nest the interpreter's calls of a handler up to its limit."""
ORDERS = [END_SIGNALS, END_SIGNALS[::-1]]

# Its children are the attempts: what they import takes half a second, which is done once.
FORKS = f"""
import os, sys
for _ in range({ATTEMPTS}):
    child = os.fork()
    if child == 0:
        break
    print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
else:
    sys.exit()
"""

WAITS = f"""
import threading
from rgbd_glue_ros.compiled import compiled
from rgbd_glue_ros.live.end_signals import EndSignals
{FORKS}
end_signals = EndSignals()
for _ in range(4):  # which signals may meet too
    threading.Thread(target=threading.Event().wait, daemon=True).start()
print(os.getpid(), flush=True)
end_signals.wait()
print("ended in order", flush=True)
"""

IS_INTERRUPTED = f"""
import time
from rgbd_glue_ros.live.end_signals import InterruptOnce
{FORKS}
InterruptOnce()
try:
    print(os.getpid(), flush=True)
    time.sleep(60)
except KeyboardInterrupt:
    for _ in range(100):
        time.sleep(0.001)  # as results are written
    print("ended in order", flush=True)
    sys.exit(130)
"""


@pytest.fixture(autouse=True)
def _handlers_as_before() -> Iterator[None]:
    before = {number: signal.getsignal(number) for number in END_SIGNALS}
    signal.signal(signal.SIGHUP, signal.SIG_DFL)  # under nohup it is ignored
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.parametrize("order", ORDERS, ids=str)
@pytest.mark.parametrize(("program", "code"), [(WAITS, 0), (IS_INTERRUPTED, 130)])
def test_repeated_signals_end_a_program_once_and_in_order(
    program: str, code: int, order: tuple[signal.Signals, ...]
) -> None:
    no_warning = "ignore:This process:DeprecationWarning"  # of threads, which OpenBLAS may have
    with subprocess.Popen(
        [sys.executable, "-W", no_warning, "-c", program],
        cwd=ROOT,
        stdout=PIPE,
        stderr=PIPE,
        text=True,
    ) as process:
        assert process.stdout is not None
        for _ in range(ATTEMPTS):
            _signal_until_it_ends(int(process.stdout.readline()), order)
            assert process.stdout.readline() == "ended in order\n"
            assert int(process.stdout.readline()) == code
        assert process.communicate() == ("", "")


def _signal_until_it_ends(pid: int, order: tuple[signal.Signals, ...]) -> None:
    """Sends signals in turn, one every SIGNAL_PERIOD_S; kills what does not end."""
    deadline = time.monotonic() + PATIENCE_S
    handle = os.pidfd_open(pid)
    try:
        for how in itertools.cycle(order):
            with suppress(ProcessLookupError):  # it may have ended just now
                signal.pidfd_send_signal(handle, how)
            if select.select([handle], [], [], SIGNAL_PERIOD_S)[0]:
                break
            if time.monotonic() > deadline:
                signal.pidfd_send_signal(handle, signal.SIGKILL)
                break
    finally:
        os.close(handle)


def test_a_later_signal_interrupts_the_handling_of_the_first(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    interrupt = InterruptOnce()
    now_s = 100.0
    monkeypatch.setattr(time, "monotonic", lambda: now_s)
    with pytest.raises(KeyboardInterrupt):
        interrupt(signal.SIGINT, None)
    now_s += SAME_REQUEST_S / 2
    interrupt(signal.SIGTERM, None)
    now_s += SAME_REQUEST_S * 1.1
    with pytest.raises(KeyboardInterrupt):
        interrupt(signal.SIGINT, None)


@pytest.mark.parametrize("number", END_SIGNALS)
def test_a_signal_during_a_computation_is_deferred_to_its_end(number: signal.Signals) -> None:
    interrupt = InterruptOnce()
    done = []
    with pytest.raises(KeyboardInterrupt), uninterrupted():  # noqa: PT012
        signal.raise_signal(number)
        with uninterrupted():
            signal.raise_signal(number)
            done.append("inner")
        done.append("outer")
    assert done == ["inner", "outer"]
    assert {signal.getsignal(n) for n in END_SIGNALS} == {interrupt}


def test_a_computation_that_fails_after_a_signal_ends_as_interrupted() -> None:
    InterruptOnce()
    with pytest.raises(KeyboardInterrupt), uninterrupted():  # noqa: PT012
        signal.raise_signal(signal.SIGINT)
        raise ValueError


def test_a_second_request_interrupts_a_computation_that_may_be_stuck(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    InterruptOnce()
    now_s = 100.0
    monkeypatch.setattr(time, "monotonic", lambda: now_s)
    with uninterrupted():
        signal.raise_signal(signal.SIGINT)
        now_s += SAME_REQUEST_S * 1.1
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)


def test_writing_results_after_an_interrupt_is_interrupted_by_the_next_request(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    InterruptOnce()
    now_s = 100.0
    monkeypatch.setattr(time, "monotonic", lambda: now_s)
    try:
        signal.raise_signal(signal.SIGINT)
    except KeyboardInterrupt:
        with uninterrupted():
            signal.raise_signal(signal.SIGINT)
            now_s += SAME_REQUEST_S * 1.1
            with pytest.raises(KeyboardInterrupt):
                signal.raise_signal(signal.SIGINT)


def test_other_handlers_and_threads_are_left_alone() -> None:
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    before = [signal.getsignal(n) for n in END_SIGNALS]
    with uninterrupted():
        assert [signal.getsignal(n) for n in END_SIGNALS[1:]] == before[1:]
    seen: list[object] = []

    def compute() -> None:
        with uninterrupted():
            seen.extend(signal.getsignal(n) for n in END_SIGNALS)

    thread = threading.Thread(target=compute)
    thread.start()
    thread.join()
    assert seen == before


@pytest.mark.parametrize("take_over", [InterruptOnce, EndSignals])
def test_a_process_under_nohup_continues_to_ignore_sighup(
    take_over: type[InterruptOnce | EndSignals],
) -> None:
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    take_over()
    signal.set_wakeup_fd(-1)
    assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    assert signal.getsignal(signal.SIGTERM) is not signal.SIG_DFL


def test_a_deferred_signal_interrupts_between_the_compilation_of_two_functions() -> None:
    InterruptOnce()

    @compiled
    def doubled(number: float) -> float:
        return 2 * number

    with uninterrupted():
        signal.raise_signal(signal.SIGINT)
        with pytest.raises(KeyboardInterrupt):
            doubled(1.0)
    assert doubled(1.0) == 2.0

"""SIGINT and SIGTERM end a program once and in order, however many of them come."""

from __future__ import annotations

import itertools
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from subprocess import PIPE

import pytest
from rigs.paths import ROOT

from rgbd_glue_ros.live.end_signals import END_SIGNALS, SAME_REQUEST_S, InterruptOnce

PATIENCE_S = 20.0
ATTEMPTS = 10  # where a signal meets the end is by chance
ORDERS = [END_SIGNALS, END_SIGNALS[::-1]]

WAITS = """
import threading
from rgbd_glue_ros.live.end_signals import EndSignals

end_signals = EndSignals()
for _ in range(4):  # which signals may meet too
    threading.Thread(target=threading.Event().wait, daemon=True).start()
print("ready", flush=True)
end_signals.wait()
print("ended in order", flush=True)
"""

IS_INTERRUPTED = """
import sys, time
from rgbd_glue_ros.live.end_signals import InterruptOnce

InterruptOnce()
try:
    print("ready", flush=True)
    time.sleep(60)
except KeyboardInterrupt:
    for _ in range(100):
        time.sleep(0.001)  # as results are written
    print("ended in order", flush=True)
    sys.exit(130)
"""


@pytest.mark.parametrize("order", ORDERS, ids=str)
@pytest.mark.parametrize(("program", "code"), [(WAITS, 0), (IS_INTERRUPTED, 130)])
def test_signals_that_keep_coming_end_a_program_once_and_in_order(
    program: str, code: int, order: tuple[signal.Signals, ...]
) -> None:
    for _ in range(ATTEMPTS):
        with subprocess.Popen(
            [sys.executable, "-c", program], cwd=ROOT, stdout=PIPE, stderr=PIPE, text=True
        ) as process:
            assert process.stdout is not None
            assert process.stdout.readline() == "ready\n"
            deadline = time.monotonic() + PATIENCE_S
            for how in itertools.cycle(order):
                process.send_signal(how)
                if process.poll() is not None or time.monotonic() > deadline:
                    break
            process.kill()
            assert process.communicate() == ("ended in order\n", "")
        assert process.returncode == code


@pytest.fixture
def _handlers_as_before() -> Iterator[None]:
    before = {number: signal.getsignal(number) for number in END_SIGNALS}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.usefixtures("_handlers_as_before")
def test_a_signal_that_comes_later_interrupts_what_is_done_about_the_first(
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

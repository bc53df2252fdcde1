"""A state that changes, on a terminal and in a file."""

from __future__ import annotations

import fcntl
import io
import os
import pty
import struct
import termios
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TextIO

import pytest

from rgbd_glue_ros.cli.status_line import StatusLine

COLUMNS = 40


@contextmanager
def terminal(monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[TextIO, int]]:
    """A terminal of ``COLUMNS`` to write to, and where what it shows can be read."""
    shows, writes = pty.openpty()
    fcntl.ioctl(writes, termios.TIOCSWINSZ, struct.pack("HHHH", 24, COLUMNS, 0, 0))
    monkeypatch.setenv("COLUMNS", str(COLUMNS))
    with os.fdopen(writes, "w") as stream:
        yield stream, shows
    os.close(shows)


def written(shows: int, end: str) -> str:
    """What the terminal shows, up to its end, which may take a while to get there."""
    text = ""
    while not text.endswith(end):
        text += os.read(shows, 10_000).decode()
    return text


def test_on_a_terminal_one_line_is_written_again_and_again(monkeypatch: pytest.MonkeyPatch) -> None:
    with terminal(monkeypatch) as (stream, shows):
        line = StatusLine(stream)
        assert line.period_s < 1
        line.show("tracking, x 10.0 m", "")
        line.show("tracking, x 9.0 m", "")
        text = written(shows, "\rtracking, x 9.0 m")
        assert "\n" not in text
        # what was longer is covered by blanks
        assert "\rtracking, x 9.0 m \r" in text


def test_a_line_is_as_wide_as_the_terminal_at_most_and_a_new_reason_is_told_in_full(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    reason = "nobody publishes /odom: start the node, which takes longer to say"
    with terminal(monkeypatch) as (stream, shows):
        line = StatusLine(stream)
        for seconds in (1, 2):
            line.show(f"no pose for {seconds} s", reason)
        text = written(shows, "\r" + f"no pose for 2 s: {reason}"[: COLUMNS - 1])
        assert text.count(f"no pose for 1 s: {reason}\r\n") == 1
        assert text.count(reason) == 1
        # once it is over, it is news again
        line.show("tracking", "")
        line.show("no pose for 1 s", reason)
        text = written(shows, "\r" + f"no pose for 1 s: {reason}"[: COLUMNS - 1])
        assert f"no pose for 1 s: {reason}\r\n" in text


def test_a_line_that_stays_takes_the_place_of_the_state(monkeypatch: pytest.MonkeyPatch) -> None:
    with terminal(monkeypatch) as (stream, shows):
        line = StatusLine(stream)
        line.show("tracking", "")
        line.say("the odometry began anew")
        written(shows, "\r        \rthe odometry began anew\r\n")


def test_without_a_terminal_each_state_is_a_line_and_a_reason_is_there_where_it_is_new() -> None:
    stream = io.StringIO()
    line = StatusLine(stream)
    assert line.period_s == 1.0
    line.show("no pose yet", "it is dark")
    line.show("no pose yet", "it is dark")
    line.show("tracking", "")
    line.show("lost", "it is dark")
    assert stream.getvalue() == (
        "no pose yet: it is dark\nno pose yet\ntracking\nlost: it is dark\n"
    )


def test_a_reason_that_comes_back_after_another_is_new() -> None:
    stream = io.StringIO()
    line = StatusLine(stream)
    for reason in ("no frame for 2 s", "no frame for 3 s", "may be 5.8 m off", "no frame for 2 s"):
        line.show("no pose", reason)
    assert stream.getvalue() == (
        "no pose: no frame for 2 s\nno pose\nno pose: may be 5.8 m off\nno pose: no frame for 2 s\n"
    )


def test_a_reason_cannot_move_the_cursor() -> None:
    stream = io.StringIO()
    StatusLine(stream).show("lost", "frame \x1b[2J\rcamera")
    assert stream.getvalue() == "lost: frame \\x1b[2J\\rcamera\n"


def test_where_nothing_can_be_written_the_fault_is_kept() -> None:
    reader, writer = os.pipe()
    os.close(reader)
    stream = os.fdopen(writer, "w")
    line = StatusLine(stream)
    with pytest.raises(BrokenPipeError):
        line.say("x")
    assert isinstance(line.fault, BrokenPipeError)
    with pytest.raises(BrokenPipeError):
        stream.close()

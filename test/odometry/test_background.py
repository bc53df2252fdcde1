"""One thread beside the caller's, and the values that it brings up to date."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import pytest

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.odometry.background import BackgroundThread, BackgroundValue, Once

PATIENCE_S = 10.0


@pytest.fixture
def background() -> Iterator[BackgroundThread]:
    thread = BackgroundThread()
    yield thread
    thread.close()


def test_jobs_run_in_the_order_of_submission(background: BackgroundThread) -> None:
    done: list[int] = []
    for i in range(5):
        last = background.submit(done.append, i)
    last.result(PATIENCE_S)
    assert done == list(range(5))


def test_what_a_busy_thread_has_not_begun_is_done_by_who_asks_for_it(
    background: BackgroundThread,
) -> None:
    may_finish = threading.Event()
    busy = background.submit(may_finish.wait, PATIENCE_S)
    doing = background.start(threading.current_thread)
    assert doing.result() is threading.current_thread()
    may_finish.set()
    assert busy.result(PATIENCE_S)


def test_what_an_idle_thread_has_begun_is_done_once_and_waited_for(
    background: BackgroundThread,
) -> None:
    has_begun, may_finish, calls = threading.Event(), threading.Event(), []

    def work(value: int) -> int:
        calls.append(value)
        has_begun.set()
        may_finish.wait(PATIENCE_S)
        return 2 * value

    doing = background.start(work, 3)
    assert has_begun.wait(PATIENCE_S)
    threading.Timer(0.01, may_finish.set).start()
    assert (doing.result(), doing.result(), calls) == (6, 6, [3])


def test_work_that_fails_raises_for_everyone_who_asks() -> None:
    failing = Once(lambda: 1 // 0)
    for _ in range(2):
        with pytest.raises(ZeroDivisionError):
            failing.result()


def test_a_value_waits_for_its_update(background: BackgroundThread) -> None:
    value = BackgroundValue(background, 1)
    may_finish = threading.Event()

    def update(before: int, by: int) -> int:
        may_finish.wait(PATIENCE_S)
        return before + by

    value.update_later(update, 2)
    threading.Timer(0.01, may_finish.set).start()
    assert value.current() == 3


def test_a_replaced_value_ignores_earlier_updates(background: BackgroundThread) -> None:
    value = BackgroundValue(background, 1)
    value.update_later(lambda before: before + 1)
    value.replace(7)
    assert value.current() == 7


def test_a_failed_update_raises_when_the_value_is_read(background: BackgroundThread) -> None:
    value = BackgroundValue(background, 0)
    value.update_later(lambda before: 1 // before)
    with pytest.raises(ZeroDivisionError):
        value.current()


def test_a_failed_update_raises_once_and_leaves_the_value(background: BackgroundThread) -> None:
    value = BackgroundValue(background, 0)
    value.update_later(lambda before: 1 // before)
    with pytest.raises(ZeroDivisionError):
        value.current()
    assert value.current() == 0
    value.update_later(lambda before: before + 1)
    assert value.current() == 1


def test_closing_finishes_submitted_jobs_and_accepts_no_more() -> None:
    background = BackgroundThread()
    last = background.submit(int, "5")
    background.close()
    assert last.done()
    with pytest.raises(InputError, match="was closed"):
        background.submit(int, "5")

"""The worker between the subscriptions and the odometry."""

from __future__ import annotations

import logging
import queue
import threading

import pytest

from rgbd_glue_ros.live.worker import NewestWorker, QueueWorker

PATIENCE_S = 10.0


class Station:
    """Work that the test lets go on one item at a time."""

    def __init__(self) -> None:
        self.started: queue.Queue[int] = queue.Queue()
        self.go_on = threading.Semaphore(0)
        self.done: list[int] = []
        self.dropped: list[int] = []

    def work(self, item: int) -> None:
        self.started.put(item)
        assert self.go_on.acquire(timeout=PATIENCE_S)
        if item < 0:
            raise RuntimeError(f"item {item}")
        self.done.append(item)


def test_while_one_item_is_processed_only_the_newest_waits() -> None:
    station = Station()
    worker = NewestWorker(station.work, station.dropped.append)
    worker.submit(1)
    assert station.started.get(timeout=PATIENCE_S) == 1
    for item in (2, 3, 4):
        worker.submit(item)
    assert station.dropped == [2, 3]
    station.go_on.release(2)
    assert station.started.get(timeout=PATIENCE_S) == 4
    assert worker.close(PATIENCE_S)
    assert station.done == [1, 4]


def test_an_idle_worker_takes_the_first_and_the_newest_of_items_that_arrive_together() -> None:
    station = Station()
    worker = NewestWorker(station.work, station.dropped.append)
    station.go_on.release(2)
    with worker._changed:  # before the thread can take any
        for item in (1, 2, 3):
            worker.submit(item)
    assert [station.started.get(timeout=PATIENCE_S) for _ in range(2)] == [1, 3]
    assert worker.close(PATIENCE_S)
    assert station.done == [1, 3]
    assert station.dropped == [2]


def test_an_exception_is_logged_and_the_next_item_is_processed(
    caplog: pytest.LogCaptureFixture,
) -> None:
    station = Station()
    worker = NewestWorker(station.work, station.dropped.append)
    station.go_on.release(2)
    with caplog.at_level(logging.ERROR):
        worker.submit(-1)
        assert station.started.get(timeout=PATIENCE_S) == -1
        worker.submit(5)
        assert station.started.get(timeout=PATIENCE_S) == 5
        assert worker.close(PATIENCE_S)
    assert "item -1" in caplog.text
    assert station.done == [5]


def test_closing_finishes_the_current_item_and_drops_the_waiting_one() -> None:
    station = Station()
    worker = NewestWorker(station.work, station.dropped.append)
    worker.submit(1)
    station.started.get(timeout=PATIENCE_S)
    worker.submit(2)
    assert not worker.close(timeout_s=0.01)  # gives up waiting: item 1 is still in work
    station.go_on.release(2)
    assert worker.close(PATIENCE_S)
    assert station.done == [1]


def test_a_full_queue_blocks_the_submitter_and_drops_nothing() -> None:
    station = Station()
    worker = QueueWorker(station.work, size=2)
    for item in (1, 2, 3):  # one in work, two that wait
        worker.submit(item)
        if item == 1:
            assert station.started.get(timeout=PATIENCE_S) == 1
    submitted = threading.Event()

    def submit_one_more() -> None:
        worker.submit(4)
        submitted.set()

    threading.Thread(target=submit_one_more, daemon=True).start()
    assert not submitted.is_set()
    station.go_on.release()
    assert submitted.wait(PATIENCE_S)
    station.go_on.release(3)
    for item in (2, 3, 4):
        assert station.started.get(timeout=PATIENCE_S) == item
    assert worker.close(PATIENCE_S)
    assert station.done == [1, 2, 3, 4]


def test_closing_releases_a_waiting_submitter() -> None:
    station = Station()
    worker = QueueWorker(station.work, size=1)
    worker.submit(1)
    assert station.started.get(timeout=PATIENCE_S) == 1
    worker.submit(2)
    waiting = threading.Thread(target=worker.submit, args=[3], daemon=True)
    waiting.start()
    station.go_on.release()
    assert worker.close(PATIENCE_S)
    waiting.join(PATIENCE_S)
    assert not waiting.is_alive()
    assert station.done[0] == 1

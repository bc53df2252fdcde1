"""What is said of the messages that a topic had before it fell silent."""

from __future__ import annotations

from rgbd_glue_ros.live.arrivals import Arrivals
from rgbd_glue_ros.types import NANOSECONDS


def test_the_last_message_is_said_with_its_age_and_how_many_there_were() -> None:
    now_ns = 7 * NANOSECONDS
    arrivals = Arrivals(lambda: now_ns)
    assert str(arrivals) == ""
    arrivals.add()
    now_ns += 2 * NANOSECONDS
    assert str(arrivals) == "the only message came 2 s ago"
    for _ in range(572):
        arrivals.add()
    now_ns += 5 * NANOSECONDS
    assert str(arrivals) == "the last of 573 messages came 5 s ago"
    assert arrivals.count == 573

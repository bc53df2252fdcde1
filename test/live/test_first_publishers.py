"""When it is a fault that nothing arrives."""

from __future__ import annotations

from rgbd_glue_ros.live.first_publishers import FirstPublishers, Silence


def judged(*looks: tuple[bool, bool]) -> list[Silence]:
    first = FirstPublishers()
    return [first.judge(has_publishers=here, has_messages=heard) for here, heard in looks]


def test_before_the_first_publisher_a_node_waits() -> None:
    assert judged((False, False), (False, False)) == [Silence.WAITING] * 2


def test_publishers_that_have_just_appeared_get_until_the_next_look() -> None:
    seen = judged((False, False), (True, False), (True, False))
    assert seen == [Silence.WAITING, Silence.TOO_EARLY, Silence.FAULT]


def test_publishers_that_appeared_before_the_first_look_get_until_the_next_too() -> None:
    assert judged((True, False), (True, False)) == [Silence.TOO_EARLY, Silence.FAULT]


def test_once_something_has_arrived_silence_is_a_fault_also_without_publishers() -> None:
    seen = judged((False, False), (True, True), (False, False))
    assert seen == [Silence.WAITING, Silence.FAULT, Silence.FAULT]

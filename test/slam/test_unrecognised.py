"""Keyframes that show no place of a given map are said to, and not too often."""

from __future__ import annotations

from rgbd_glue_ros.slam.unrecognised import FIRST_SAID, Unrecognised


def said_of(unrecognised: Unrecognised, count: int) -> dict[int, str]:
    """What is said of so many further keyframes, by which of them it is said at."""
    lines = {n: unrecognised.add("/room", 57) for n in range(1, count + 1)}
    return {n: line for n, line in lines.items() if line is not None}


def test_keyframes_compared_with_a_map_in_vain_are_counted_with_what_to_check() -> None:
    said = said_of(Unrecognised(), FIRST_SAID)
    assert list(said) == [FIRST_SAID]
    assert said[FIRST_SAID].startswith(
        f"{FIRST_SAID} keyframes were compared with the 57 keyframes of /room, and none shows a "
    )
    assert "check that it is the map of this room" in said[FIRST_SAID]


def test_after_ten_times_as_many_in_vain_it_is_said_again() -> None:
    assert list(said_of(Unrecognised(), 1500)) == [10, 100, 1000]


def test_once_a_place_is_recognised_keyframes_in_vain_are_counted_from_there() -> None:
    unrecognised = Unrecognised()
    said_of(unrecognised, FIRST_SAID - 1)
    unrecognised.recognised()
    assert not said_of(unrecognised, FIRST_SAID - 1)
    assert len(said_of(unrecognised, 1)) == 1

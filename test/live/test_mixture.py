"""Which publishers send at once."""

from __future__ import annotations

from collections.abc import Iterable

import pytest

from rgbd_glue_ros.live.mixture import Mixture


def judged(*checks: tuple[int, Iterable[int | None]]) -> list[bool]:
    """What each check says of the publishers then counted, and the numbers that came before it."""
    mixture = Mixture()
    said = []
    for publishers, numbers in checks:
        for number in numbers:
            mixture.add(number)
        said.append(mixture.judge(publishers))
    return said


@pytest.mark.parametrize(
    ("numbers", "is_mixed"),
    [
        ([1, 2, 3, 4], False),
        # a driver was killed and started again: the dead one is counted for a while
        ([71, 72, 1, 2, 3], False),
        ([71, 72, 1, 1, 2], False),
        ([71, 1, 72, 2, 73, 3], True),
        ([1, 1, 2, 2, 3, 3], True),
        # as likely as another order
        ([5, 6, 6, 7, 7, 8, 8], True),
        ([], False),
    ],
)
def test_two_publishers_mix_if_the_numbers_of_their_messages_go_back_and_forth(
    numbers: list[int | None], *, is_mixed: bool
) -> None:
    assert judged((2, numbers)) == [is_mixed]
    assert judged((1, numbers)) == [False]


def test_each_check_is_of_the_messages_since_the_last() -> None:
    assert judged((2, [9, 1]), (2, [2, 1]), (2, [2, 1, 2, 1, 2, 1]), (2, [])) == [
        False,
        False,
        True,
        False,
    ]


def test_without_numbers_several_publishers_mix_if_they_last_and_something_comes() -> None:
    several = (2, [None, None])
    assert judged(several, several, (2, []), (1, [None]), several) == [
        False,
        True,
        False,
        False,
        False,
    ]

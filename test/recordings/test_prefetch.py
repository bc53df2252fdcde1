from __future__ import annotations

from collections.abc import Iterator

import pytest

from rgbd_glue_ros.recordings.prefetch import mapped_ahead


def test_results_computed_ahead_come_in_order() -> None:
    assert list(mapped_ahead(lambda x: x * x, range(100))) == [x * x for x in range(100)]


def test_an_error_of_the_function_comes_after_the_results_before_it() -> None:
    results = mapped_ahead(lambda x: 12 // (3 - x), range(10))
    assert [next(results) for _ in range(3)] == [4, 6, 12]
    with pytest.raises(ZeroDivisionError):
        next(results)


def test_an_error_of_the_source_comes_after_all_that_it_gave() -> None:
    def source() -> Iterator[int]:
        yield from (1, 2, 3)
        raise OSError

    results = mapped_ahead(lambda x: x, source())
    assert [next(results) for _ in range(3)] == [1, 2, 3]
    with pytest.raises(OSError):  # noqa: PT011 (the very one raised above)
        next(results)


def test_only_a_few_items_are_taken_ahead_of_their_use() -> None:
    taken: list[int] = []

    def source() -> Iterator[int]:
        for x in range(1000):
            taken.append(x)
            yield x

    results = mapped_ahead(lambda x: x, source())
    next(results)
    assert len(taken) < 10

"""Stamps are exact, whatever unit they are written in."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rgbd_glue_ros.files.stamp_text import format_stamp, parse_stamp
from rgbd_glue_ros.types import NANOSECONDS

STAMPS = st.integers(-(2**62), 2**62)


@given(STAMPS)
def test_a_stamp_survives_its_text_to_the_nanosecond(stamp_ns: int) -> None:
    assert parse_stamp(format_stamp(stamp_ns)) == stamp_ns


@pytest.mark.parametrize(
    ("text", "stamp_ns"),
    [
        ("1305031453.359684", 1305031453359684000),
        ("1.305031453359684000e+09", 1305031453359684000),
        ("0.033333", 33333000),
        ("-0.5", -NANOSECONDS // 2),
    ],
)
def test_a_stamp_is_read_without_passing_through_a_float(text: str, stamp_ns: int) -> None:
    assert parse_stamp(text) == stamp_ns


@pytest.mark.parametrize(
    "text",
    ["1305031102.175304", "1305031102175.304", "1305031102175304", "1305031102175304000"],
)
def test_a_stamp_is_the_same_in_seconds_and_in_their_parts(text: str) -> None:
    assert parse_stamp(text) == 1_305_031_102_175_304_000

"""Numbers of depth images that mean a distance, and those that mean none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rgbd_glue_ros.recordings.depth_encoding import MILLIMETRES, TUM, DepthEncoding


@pytest.mark.parametrize("encoding", [MILLIMETRES, TUM, DepthEncoding(4000.0)])
def test_nothing_and_overflow_are_no_depth_in_whole_numbers_of_any_unit(
    encoding: DepthEncoding,
) -> None:
    metres = encoding.metres(np.array([[0, 1, 65534, 65535]], np.uint16))
    np.testing.assert_array_equal(np.isnan(metres), [[True, False, False, True]])
    np.testing.assert_allclose(metres[0, 1:3], np.array([1, 65534]) / encoding.units_per_metre)


@pytest.mark.parametrize("kind", [np.int16, np.int32, np.int64, np.uint32])
def test_whole_numbers_of_any_size_are_as_those_of_16_bits(kind: type[np.generic]) -> None:
    values = np.array([[0, 1, 1500, 32767]])
    expected = MILLIMETRES.metres(values.astype(np.uint16))
    np.testing.assert_array_equal(MILLIMETRES.metres(values.astype(kind)), expected)
    if kind is np.int16:
        return
    many = MILLIMETRES.metres(np.array([[65535, 1000]], kind))
    np.testing.assert_array_equal(many, np.array([[np.nan, 1]], np.float32))
    tenths_of_mm = DepthEncoding(10_000.0).metres(np.array([[90_000, 65_535]], kind))
    np.testing.assert_allclose(tenths_of_mm, [[9.0, 6.5535]])


def test_negative_whole_numbers_are_no_depth() -> None:
    got = MILLIMETRES.metres(np.array([[-1, -(2**31), 1500]], np.int32))
    np.testing.assert_array_equal(got, np.array([[np.nan, np.nan, 1.5]], np.float32))


def test_numbers_that_were_rotated_are_rotated_back() -> None:
    rotated = replace(MILLIMETRES, rotation=3)
    metres = rotated.metres(np.array([[1500 << 3, 0, 65535]], np.uint16))
    np.testing.assert_allclose(metres, [[1.5, np.nan, np.nan]])


def test_floats_are_metres_unless_a_scale_is_given() -> None:
    image = np.array([[1.5, 0.0, -1.0, np.inf, np.nan]], np.float32)
    np.testing.assert_allclose(MILLIMETRES.metres(image), [[1.5, *[np.nan] * 4]])
    scaled = MILLIMETRES.with_scale(0.5).metres(image)
    np.testing.assert_allclose(scaled, [[0.75, *[np.nan] * 4]])

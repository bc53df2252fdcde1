"""Charts have round ticks that cover the data, and lose no peak."""

from __future__ import annotations

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rgbd_glue_ros.experiments.report.axes import linear, logarithmic, rising, symmetric, ticks
from rgbd_glue_ros.experiments.report.charts import SIDE, Area, Line, chart, plot
from rgbd_glue_ros.experiments.report.plans import plans, round_length


@given(st.floats(1e-6, 1e9))
def test_ticks_start_at_the_low_end_and_cover_the_high_end(high: float) -> None:
    values = ticks(0.0, high)
    assert values[0] == 0.0
    assert values[-1] >= high * (1 - 1e-6)
    assert 3 <= len(values) <= 8
    np.testing.assert_allclose(np.diff(values), values[1], rtol=1e-6)


def test_ticks_are_numbers_that_people_count_in() -> None:
    assert ticks(0, 33.3, 4) == [0, 10, 20, 30, 40]
    assert ticks(0, 0.012, 5) == [0, 0.0025, 0.005, 0.0075, 0.01, 0.0125]
    assert ticks(5, 5) == [5]


def test_values_lie_along_an_axis_by_their_differences_or_by_their_ratios() -> None:
    values = np.array([1.0, 10.0, 100.0, 1000.0])
    np.testing.assert_allclose(linear(1, 100).at(values), (values - 1) / 99)
    np.testing.assert_allclose(logarithmic(1, 5, 100).at(values), [0, 0.5, 1, 1.5])
    assert logarithmic(1, 5, 100).ticks == ((1, "1"), (5, "5"), (100, "100"))
    assert rising(33.3, 4).high == 40


def test_dots_are_where_their_points_are() -> None:
    cloud = Line("pairs", "red", np.array([1.0, 100.0]), np.array([0.0, 50.0]))
    page = plot("dots", [], logarithmic(1, 100), rising(100, 4), 4, [cloud])
    assert f'd="M0 {SIDE}h0M{SIDE} {SIDE // 2}h0"' in page


def points(page: str, css_class: str) -> list[tuple[float, float]]:
    path = re.search(rf'<path class="{css_class}"[^>]* d="([^"]*)"', page)
    assert path
    numbers = re.findall(r"([-\d.]+) ([-\d.]+)", path[1])
    return [(float(x), float(y)) for x, y in numbers]


def test_a_single_peak_among_many_points_is_drawn() -> None:
    y = np.zeros(100_000)
    y[77_777] = 10.0
    line = Line("peak", "red", np.arange(100_000.0), y, "thick")
    drawn = points(chart("peak", [line], (0.0, 100_000.0), 4), "thick")
    assert len(drawn) < 3000
    assert min(y for _, y in drawn) == 0.0
    assert max(y for _, y in drawn) == SIDE


def test_a_line_is_broken_where_its_value_is_not_known() -> None:
    line = Line("gap", "red", np.arange(5.0), np.array([1, 1, np.nan, 1, 1.0]), "thick")
    page = chart("gap", [line], (0.0, 4.0), 4)
    path = re.search(r'class="thick"[^>]* d="([^"]*)"', page)
    assert path
    assert path[1].count("M") == 2
    assert "nan" not in page


def test_a_point_between_gaps_is_a_dot() -> None:
    line = Line("gap", "red", np.arange(3.0), np.array([np.nan, 1, np.nan]), "thick")
    assert f'd="M{SIDE / 2:.1f} 0.0h0"' in chart("gap", [line], (0.0, 2.0), 4)


def test_an_area_goes_along_its_upper_line_and_back_along_its_lower_one() -> None:
    x, high = np.arange(3.0), np.array([1.0, 2.0, 1.0])
    page = chart("area", [], (0.0, 2.0), 4, symmetric(2.0, 4), [Area("", "red", x, -high, high)])
    assert 'd="M0.0 250.0L500.0 0.0L1000.0 250.0L1000.0 750.0L500.0 1000.0L0.0 750.0Z"' in page


def test_an_axis_about_zero_is_as_long_to_both_sides() -> None:
    axis = symmetric(0.33, 4)
    assert (axis.low, axis.high) == (-0.4, 0.4)
    assert [value for value, _ in axis.ticks] == [-0.4, -0.2, 0.0, 0.2, 0.4]


@pytest.mark.parametrize(
    ("longest", "length"),
    [(0.9, 0.5), (0.8, 0.5), (1.0, 1.0), (0.026, 0.02), (49.9, 20.0), (5.0, 5.0), (0.0099, 0.005)],
)
def test_a_scale_bar_is_one_two_or_five_of_a_power_of_ten(longest: float, length: float) -> None:
    assert round_length(longest) == length


def test_views_of_a_path_have_one_scale() -> None:
    x = np.array([0.0, 4.0, 4.0])
    y = np.array([0.0, 0.0, 1.0])
    times = np.arange(3.0)
    page = plans(
        [("a", [Line("", "red", x, y, "one")], times), ("b", [Line("", "red", y, x, "two")], times)]
    )
    first, second = (np.array(points(page, kind)) for kind in ("one", "two"))
    np.testing.assert_allclose(np.ptp(first[:, 0]), np.ptp(second[:, 1]), atol=0.2)
    np.testing.assert_allclose(np.ptp(first[:, 1]), np.ptp(second[:, 0]), atol=0.2)

"""Charts have round ticks that cover the data, and lose no peak."""

from __future__ import annotations

import re

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from rgbd_glue_ros.experiments.report.axes import linear, logarithmic, rising, ticks
from rgbd_glue_ros.experiments.report.charts import SIDE, Line, chart, plot


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

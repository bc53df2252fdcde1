"""The gates of errors are quantiles of chi²."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chi2

from rgbd_glue_ros.geometry.gates import chi_squared


@given(st.floats(0.01, 0.9999), st.integers(1, 12))
def test_the_quantile_of_chi_squared_is_scipys(confidence: float, degrees: int) -> None:
    assert chi_squared(confidence, degrees) == pytest.approx(chi2.ppf(confidence, degrees))

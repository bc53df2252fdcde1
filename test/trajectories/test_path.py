"""The path through poses."""

from __future__ import annotations

import numpy as np
import pytest
from rigs.trajectories import line

from rgbd_glue_ros.trajectories.path import path_length


def test_the_length_of_a_path_is_the_sum_of_its_steps() -> None:
    assert path_length(line(0.5, 31).poses) == pytest.approx(0.5, abs=1e-8)
    assert path_length(np.empty((0, 4, 4))) == 0.0

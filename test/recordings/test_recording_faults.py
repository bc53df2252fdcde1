"""What is said of a recording that holds little that can be used."""

from __future__ import annotations

import pytest

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.messages.fault_news import MAX_FAULTS
from rgbd_glue_ros.recordings.faults import Faults


def test_of_a_recording_full_of_faults_a_hundred_are_logged_and_all_are_counted(
    caplog: pytest.LogCaptureFixture,
) -> None:
    faults = Faults()
    for i in range(500):
        faults.add(InputError("/rgb/image", "x" * i, "record it again"))
    assert faults.count == 500
    assert faults.first is not None
    assert not faults.first.cause
    assert len(caplog.records) == MAX_FAULTS

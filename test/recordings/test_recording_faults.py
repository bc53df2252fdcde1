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
    # if nothing is usable, the first fault is the error, and would be told twice
    assert not caplog.records
    faults.are_skipped()
    assert len(caplog.records) == MAX_FAULTS


def test_once_a_recording_is_usable_a_fault_is_logged_at_once(
    caplog: pytest.LogCaptureFixture,
) -> None:
    faults = Faults()
    faults.are_skipped()
    for cause in ("is empty", "is empty", "is too short"):
        faults.add(InputError("/rgb/image", cause, "record it again"))
    assert [record.getMessage().partition(";")[0] for record in caplog.records] == [
        "/rgb/image: is empty",
        "/rgb/image: is too short",
    ]

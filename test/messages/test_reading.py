"""What all readers of messages share."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rigs.messages import CAMERA, HEAD, RGB, raw

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.messages.camera_info import intrinsics_from_message
from rgbd_glue_ros.messages.images import color_from_message
from rgbd_glue_ros.messages.making import camera_info, header
from rgbd_glue_ros.messages.reading import stamp_ns


def test_a_message_of_another_type_is_refused() -> None:
    info: Any = camera_info(CAMERA, HEAD)
    with pytest.raises(InputError, match="has the type CameraInfo; give a topic of Image or Com"):
        color_from_message(info, "/color")
    with pytest.raises(InputError, match="has the type Image; give a topic of CameraInfo"):
        intrinsics_from_message(raw(RGB, "rgb8"), "/info")  # type: ignore[arg-type]


@given(st.integers(0, 2**31 * 10**9 - 1))
def test_stamps_keep_every_nanosecond(nanoseconds: int) -> None:
    assert stamp_ns(header(nanoseconds, "").stamp) == nanoseconds

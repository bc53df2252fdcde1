"""Errors arrive in another process as they were raised."""

from __future__ import annotations

import pickle

import pytest

from rgbd_glue_ros.errors import InputError, MissingExtraError


@pytest.mark.parametrize(
    "error",
    [
        InputError("frame 3", "is\ndamaged", "restore it"),
        MissingExtraError("Dask", "scale", "working in parallel"),
    ],
)
def test_an_error_survives_the_way_to_another_process(error: Exception) -> None:
    copy = pickle.loads(pickle.dumps(error))  # noqa: S301 - our own
    assert type(copy) is type(error)
    assert str(copy) == str(error)
    assert vars(copy) == vars(error)

"""Tasks for workers, in a module that these can import."""

from __future__ import annotations

import os
from collections.abc import Iterator

import cv2


def digits(number: int) -> Iterator[str]:
    """The digits of a number; a minus breaks it down."""
    for character in str(number):
        if character == "-":
            raise ValueError(character)
        yield character


def threads(_: int) -> Iterator[tuple[str | None, int]]:
    """How many threads BLAS and OpenCV may use."""
    yield os.environ.get("OPENBLAS_NUM_THREADS"), cv2.getNumThreads()

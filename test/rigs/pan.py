"""A camera that passes a poster."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import cv2
import numpy as np

from rgbd_glue_ros.closing import Closing
from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.recordings.recording import selected
from rgbd_glue_ros.types import CameraIntrinsics, Float32, RgbdFrame, Trajectory, UInt8

WIDTH, HEIGHT, FOCAL = 320, 240, 300.0
PIXELS_PER_FRAME = 3
# depth of the wall where a frame's step is of 1.5 cm
WALL_M = 1.5
CAMERA = CameraIntrinsics(WIDTH, HEIGHT, FOCAL, FOCAL, 159.5, 119.5)


@dataclass(frozen=True)
class Pan(Closing):
    """A camera that passes a poster on a wall, 1.5 cm a frame at 30 Hz.

    Attributes:
        frame_count: how many frames there are.
        name: of the recording.
        breaks_after: number of the first frame that cannot be read; None where all can.
        rounds: lengths of the rounds after the first, each from the first stamp on.
        copies: how often each frame comes.
    """

    frame_count: int
    name: str = "pan"
    breaks_after: int | None = None
    rounds: tuple[int, ...] = ()
    copies: int = 1

    @property
    def ground_truth(self) -> Trajectory:
        poses = np.tile(np.eye(4), (self._length, 1, 1))
        poses[:, 0, 3] = np.arange(self._length) * PIXELS_PER_FRAME * WALL_M / FOCAL
        return Trajectory(self._stamps, poses)

    @property
    def _length(self) -> int:
        return max([self.frame_count, *self.rounds])

    @property
    def _stamps(self) -> np.ndarray[tuple[int, ...], np.dtype[np.int64]]:
        return np.arange(1, self._length + 1, dtype=np.int64) * 33_333_333

    def __iter__(self) -> Iterator[RgbdFrame]:
        rng = np.random.default_rng(0)
        size = HEIGHT, WIDTH + PIXELS_PER_FRAME * self._length
        noise = rng.integers(0, 256, (size[0] // 4, size[1] // 4), np.uint8)
        poster = cv2.resize(noise, size[::-1], interpolation=cv2.INTER_CUBIC)
        depth: Float32 = np.full((HEIGHT, WIDTH), WALL_M, np.float32)
        numbers = [i for count in (self.frame_count, *self.rounds) for i in range(count)]
        for i in numbers:
            if i == self.breaks_after:
                raise InputError("rgb/7.png", "is damaged", "restore it")
            view = poster[:, PIXELS_PER_FRAME * i :][:, :WIDTH]
            color: UInt8 = np.repeat(view[..., None], 3, axis=2)
            for _ in range(self.copies):
                yield RgbdFrame(int(self._stamps[i]), color, depth, CAMERA)

    def select(self, indices: Iterable[int]) -> Iterator[RgbdFrame]:
        return selected(self, indices)

    def close(self) -> None: ...

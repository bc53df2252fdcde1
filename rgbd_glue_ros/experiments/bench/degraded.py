"""Degraded sequences: what cameras, cables and busy machines do to a recording."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import islice
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from rgbd_glue_ros.experiments.bench.passer_by import PasserBy
from rgbd_glue_ros.recordings.recording import selected
from rgbd_glue_ros.recordings.wrapped import WrappedRecording
from rgbd_glue_ros.types import NANOSECONDS, RgbdFrame, UInt8

_SEED = 0
# Holes are blobs of about this size, like those of shiny, dark and far surfaces.
_HOLE_PX = 40


@dataclass(frozen=True)
class Degradation:
    """A deterministic degradation of a sequence.

    Attributes:
        name: in words.
        apply: returns the degraded frames, from the frames and their approximate number.
        kept: maximum number of frames that remain of a number.
    """

    name: str
    apply: Callable[[Iterable[RgbdFrame], int], Iterator[RgbdFrame]]
    kept: Callable[[int], int] = lambda count: count


@dataclass(frozen=True)
class DegradedSequence(WrappedRecording):
    """A degraded version of another ``Recording``.

    Attributes:
        recording: the original.
        degradation: applied to its frames.
    """

    degradation: Degradation

    @property
    def name(self) -> str:
        """The name of the original, and the degradation."""
        return f"{self.recording.name}, {self.degradation.name}"

    @property
    def frame_count(self) -> int:
        """At most the number of the original."""
        return self.degradation.kept(self.recording.frame_count)

    def __iter__(self) -> Iterator[RgbdFrame]:
        """The frames in order of time."""
        return self.degradation.apply(self.recording, self.recording.frame_count)

    def select(self, indices: Iterable[int]) -> Iterator[RgbdFrame]:
        """The frames with these increasing numbers; all before the last are computed too."""
        return selected(self, indices)


def first(count: int) -> Degradation:
    """Only the first frames."""

    def apply(frames: Iterable[RgbdFrame], _: int) -> Iterator[RgbdFrame]:
        return islice(frames, count)

    return Degradation(f"first {count} frames", apply, lambda frames: min(frames, count))


def every(step: int) -> Degradation:
    """Only every ``step``-th frame: a slow camera, or one that moves as much faster."""

    def apply(frames: Iterable[RgbdFrame], _: int) -> Iterator[RgbdFrame]:
        return islice(frames, 0, None, step)

    name = f"every {step}{_ORDINALS.get(step, 'th')} frame"
    return Degradation(name, apply, lambda frames: -(-frames // step))


_ORDINALS = {2: "nd", 3: "rd"}


def dropped(share: float) -> Degradation:
    """A random share of the frames is missing, but not the first."""

    def apply(frames: Iterable[RgbdFrame], _: int) -> Iterator[RgbdFrame]:
        rng = np.random.default_rng(_SEED)
        return (frame for i, frame in enumerate(frames) if rng.random() >= share or i == 0)

    return Degradation(f"{share:.0%} of the frames dropped", apply)


def depth_holes(share: float) -> Degradation:
    """A share of every depth image is unknown, in blobs at different places in every frame."""

    def apply(frames: Iterable[RgbdFrame], _: int) -> Iterator[RgbdFrame]:
        rng = np.random.default_rng(_SEED)
        for frame in frames:
            holes = _blobs(frame.depth.shape, share, rng)
            yield replace(frame, depth=np.where(holes, np.float32(np.nan), frame.depth))

    return Degradation(f"{share:.0%} of depth in holes", apply)


def _blobs(shape: tuple[int, ...], share: float, rng: np.random.Generator) -> NDArray[np.bool_]:
    height, width = shape
    coarse = rng.normal(size=(2 + height // _HOLE_PX, 2 + width // _HOLE_PX)).astype(np.float32)
    smooth = cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC)
    blobs: NDArray[np.bool_] = smooth < np.quantile(smooth, share)
    return blobs


def dim(light: float, noise: float = 2.0, haze: float = 0.0) -> Degradation:
    """A fraction of the light, with camera noise: a room at night.

    Args:
        light: remaining fraction, 0 to 1.
        noise: standard deviation, grey levels.
        haze: added grey levels.
    """

    def apply(frames: Iterable[RgbdFrame], _: int) -> Iterator[RgbdFrame]:
        rng = np.random.default_rng(_SEED)
        for frame in frames:
            noisy = light * frame.color + haze + rng.normal(0, noise, frame.color.shape)
            yield replace(frame, color=in_levels(noisy))

    return Degradation(f"{light:.0%} of the light", apply)


def in_levels(brightness: NDArray[np.floating[Any]]) -> UInt8:
    """Brightness as stored in an image: whole grey levels from 0 to 255."""
    return np.asarray(np.clip(np.rint(brightness), 0, 255), np.uint8)


def no_color(seconds: float) -> Degradation:
    """Colour is black for a while from the middle on: the light goes out."""

    def darken(frame: RgbdFrame) -> RgbdFrame:
        return replace(frame, color=np.zeros_like(frame.color))

    return Degradation(f"colour black for {seconds:g} s", _for_a_while(seconds, darken))


def no_depth(seconds: float) -> Degradation:
    """No depth is known for a while from the middle on: too near, too far, or in the sun."""

    def blind(frame: RgbdFrame) -> RgbdFrame:
        return replace(frame, depth=np.full_like(frame.depth, np.nan))

    return Degradation(f"no depth for {seconds:g} s", _for_a_while(seconds, blind))


def _for_a_while(
    seconds: float, change: Callable[[RgbdFrame], RgbdFrame]
) -> Callable[[Iterable[RgbdFrame], int], Iterator[RgbdFrame]]:
    """Changes the frames of a number of seconds from the middle frame on."""

    def apply(frames: Iterable[RgbdFrame], count: int) -> Iterator[RgbdFrame]:
        end_ns: int | None = None
        for index, frame in enumerate(frames):
            if index == count // 2:
                end_ns = frame.stamp_ns + round(seconds * NANOSECONDS)
            yield change(frame) if end_ns is not None and frame.stamp_ns < end_ns else frame

    return apply


def somebody_walks_by(somebody: PasserBy = PasserBy()) -> Degradation:  # noqa: B008 - frozen
    """A person walks up and down in front of the camera."""

    def apply(frames: Iterable[RgbdFrame], _: int) -> Iterator[RgbdFrame]:
        start_ns: int | None = None
        for frame in frames:
            start_ns = frame.stamp_ns if start_ns is None else start_ns
            yield somebody.before(frame, start_ns)

    return Degradation("a passer-by", apply)


DEGRADATIONS = (
    every(2),
    every(3),
    every(5),
    dropped(0.1),
    depth_holes(0.5),
    dim(0.1),
    no_color(1.0),
    no_depth(1.0),
    somebody_walks_by(),
)

"""Frames as no camera should give them: what may come out of broken drivers, clocks and files.

Each is a good frame, changed in one respect. Some are refused where they are made; the others have
to do no harm.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from rgbd_glue_ros.types import NANOSECONDS, LensModel, RgbdFrame

Random = np.random.Generator
Mutator = Callable[[RgbdFrame, Random], RgbdFrame]

NAN, INF = float("nan"), float("inf")
YEAR_NS = 365 * 24 * 3600 * NANOSECONDS


def _color(change: Callable[[Any, Random], Any]) -> Mutator:
    return lambda frame, random: replace(frame, color=change(frame.color, random))


def _depth(change: Callable[[Any, Random], Any]) -> Mutator:
    return lambda frame, random: replace(frame, depth=change(frame.depth, random))


def _camera(**changes: Any) -> Mutator:
    return lambda frame, _: replace(frame, intrinsics=replace(frame.intrinsics, **changes))


def _time(change: Callable[[int, Random], Any]) -> Mutator:
    return lambda frame, random: replace(frame, stamp_ns=change(frame.stamp_ns, random))


def _delay(delay_ns: Any) -> Mutator:
    return lambda frame, _: replace(frame, depth_delay_ns=delay_ns)


def _cut_to(width: int, height: int) -> Mutator:
    """The upper left corner of a frame."""

    def cut(frame: RgbdFrame, _: Random) -> RgbdFrame:
        camera = frame.intrinsics
        return replace(
            frame,
            color=frame.color[:height, :width].copy(),
            depth=frame.depth[:height, :width].copy(),
            intrinsics=replace(camera, width=width, height=height),
        )

    return cut


def _enlarged(frame: RgbdFrame, _: Random) -> RgbdFrame:
    camera = frame.intrinsics
    height, width = frame.depth.shape
    return replace(
        frame,
        color=np.repeat(np.repeat(frame.color, 2, axis=0), 2, axis=1),
        depth=np.repeat(np.repeat(frame.depth, 2, axis=0), 2, axis=1),
        intrinsics=camera.scaled(2 * width, 2 * height),
    )


def _some(value: float, part: float) -> Callable[[Any, Random], Any]:
    """A part of the pixels, spread at random, with another value."""

    def changed(image: Any, random: Random) -> Any:
        return np.where(random.random(image.shape[:2]) < part, np.float32(value), image)

    return changed


def _read_only(image: Any, _: Random) -> Any:
    copy = image.copy()
    copy.flags.writeable = False
    return copy


def _columns(image: Any, which: slice, value: int) -> Any:
    """Some columns of an image of any channels with another value."""
    copy = image.copy()
    copy[:, which] = value
    return copy


COLORS: Mapping[str, Mutator] = {
    "black": _color(lambda c, _: np.zeros_like(c)),
    "white": _color(lambda c, _: np.full_like(c, 255)),
    "noise": _color(lambda c, r: r.integers(0, 256, c.shape, np.uint8)),
    "negative": _color(lambda c, _: 255 - c),
    "half black": _color(lambda c, _: _columns(c, slice(c.shape[1] // 2), 0)),
    "upside down": _color(lambda c, _: c[::-1]),
    "mirrored": _color(lambda c, _: c[:, ::-1]),
    "stripes": _color(lambda c, _: _columns(0 * c, slice(1, None, 2), 255)),
    "over-exposed": _color(lambda c, _: np.clip(c.astype(int) * 8, 0, 255).astype(np.uint8)),
    "grey": _color(lambda c, _: c[..., 0]),
    "not contiguous": _color(lambda c, _: np.asfortranarray(c)),
    "read only": _color(_read_only),
    "floats": _color(lambda c, _: c.astype(np.float32)),
    "16 bits": _color(lambda c, _: c.astype(np.uint16)),
    "four channels": _color(lambda c, _: np.concatenate([c, c[..., :1]], axis=-1)),
    "no image": _color(lambda _, __: None),
    "of another size": _color(lambda c, _: c[::2, ::2]),
}

DEPTHS: Mapping[str, Mutator] = {
    "unknown": _depth(lambda d, _: np.full_like(d, np.nan)),
    "infinite": _depth(lambda d, _: np.full_like(d, np.inf)),
    "minus infinite": _depth(lambda d, _: np.full_like(d, -np.inf)),
    "zeros": _depth(lambda d, _: np.zeros_like(d)),
    "below zero": _depth(lambda d, _: -d),
    "huge": _depth(lambda d, _: np.full_like(d, 1e38)),
    "denormal": _depth(lambda d, _: np.full_like(d, 1e-42)),
    "a plane": _depth(lambda d, _: np.full_like(d, 1.5)),
    "a plane at the nearest": _depth(lambda d, _: np.full_like(d, 0.1)),
    "noise": _depth(lambda d, r: r.uniform(0, 8, d.shape).astype(np.float32)),
    "a chessboard": _depth(
        lambda d, _: np.where(sum(np.indices(d.shape)) % 2, 1.0, 5.0).astype(np.float32)
    ),
    "millimetres": _depth(lambda d, _: d * 1000),
    "kilometres": _depth(lambda d, _: d / 1000),
    "twice as far": _depth(lambda d, _: d * 2),
    "upside down": _depth(lambda d, _: d[::-1]),
    "mirrored": _depth(lambda d, _: d[:, ::-1]),
    "not contiguous": _depth(lambda d, _: np.asfortranarray(d)),
    "read only": _depth(_read_only),
    "with infinite pixels": _depth(_some(np.inf, 0.3)),
    "with huge pixels": _depth(_some(3e38, 0.3)),
    "with hardly a pixel": _depth(_some(np.nan, 0.9999)),
    "doubles": _depth(lambda d, _: d.astype(np.float64)),
    "whole numbers": _depth(lambda d, _: np.nan_to_num(d).astype(np.uint16)),
    "of another size": _depth(lambda d, _: d[::2]),
}

_SIZES = (
    [(n, n) for n in (0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 15, 16, 31, 33)]
    + [(320, 1), (320, 7), (1, 240), (7, 240), (64, 48)]
)  # fmt: skip

SIZES: Mapping[str, Mutator] = {
    **{f"{width}x{height} pixels": _cut_to(width, height) for width, height in _SIZES},
    "twice the pixels": _enlarged,
}

CAMERAS: Mapping[str, Mutator] = {
    "hardly a focal length": _camera(fx=0.01, fy=0.01),
    "a huge focal length": _camera(fx=1e6, fy=1e6),
    "a focal length beyond all bounds": _camera(fx=1e300, fy=1e300),
    "focal lengths far apart": _camera(fx=0.01, fy=1e6),
    "a centre far away": _camera(cx=1e6, cy=-1e6),
    "a centre beyond all bounds": _camera(cx=1e300),
    "a NaN": _camera(fx=NAN),
    "an infinity": _camera(cy=INF),
    "a focal length below zero": _camera(fx=-300.0),
    "a size of another image": _camera(width=640),
    "no size": _camera(width=0, height=0),
    "a strong lens": _camera(distortion=(10.0, 10.0, 0.0, 0.0, 10.0)),
    "a lens beyond all bounds": _camera(distortion=(1e300, 0.0, 0.0, 0.0, 0.0)),
    "a lens that turns images over": _camera(distortion=(-5.0, 0.0, 0.0, 0.0, 0.0)),
    "a lens of NaN": _camera(distortion=(NAN, 0.0, 0.0, 0.0, 0.0)),
    "a lens of three coefficients": _camera(distortion=(0.1, 0.1, 0.1)),
    "a lens of a hundred coefficients": _camera(distortion=(0.1,) * 100),
    "a wild fisheye": _camera(distortion=(50.0, -50.0, 50.0, 5.0), lens=LensModel.KANNALA_BRANDT),
    "a wild inverse lens": _camera(
        distortion=(50.0, -50.0, 0.1, 0.1, 0.1), lens=LensModel.INVERSE_BROWN_CONRADY
    ),
}

TIMES: Mapping[str, Mutator] = {
    "the stamp before": _time(lambda t, _: t - 33_000_000),
    "an earlier stamp": _time(lambda t, r: t - int(r.integers(NANOSECONDS, YEAR_NS))),
    "a nanosecond later": _time(lambda t, _: t - 33_000_000 + 1),
    "a minute later": _time(lambda t, _: t + 60 * NANOSECONDS),
    "a month later": _time(lambda t, _: t + YEAR_NS // 12),
    "a century later": _time(lambda t, _: t + 100 * YEAR_NS),
    "the end of time": _time(lambda *_: 2**63 - 1),
    "beyond the end of time": _time(lambda *_: 2**80),
    "below zero": _time(lambda *_: -1),
    "seconds": _time(lambda t, _: t / NANOSECONDS),
    "a numpy integer": _time(lambda t, _: np.int64(t)),
    "no stamp": _time(lambda *_: None),
    "depth a minute late": _delay(60 * NANOSECONDS),
    "depth a century early": _delay(-100 * YEAR_NS),
    "depth beyond the end of time": _delay(2**80),
    "depth late by no number": _delay(NAN),
    "depth late by a text": _delay("late"),
}

FRAMES: Mapping[str, Mutator] = {
    "another camera": lambda frame, _: replace(frame, frame_id="openni_rgb_optical_frame"),
    "a name without end": lambda frame, _: replace(frame, frame_id="x" * 1_000_000),
    "no name": lambda frame, _: replace(frame, frame_id=None),  # type: ignore[arg-type]
}

MUTATORS: Mapping[str, Mutator] = {
    f"{kind}: {name}": mutator
    for kind, mutators in (
        ("colour", COLORS),
        ("depth", DEPTHS),
        ("size", SIZES),
        ("camera", CAMERAS),
        ("time", TIMES),
        ("frame", FRAMES),
    )
    for name, mutator in mutators.items()
}

GUESSES: Mapping[str, Any] = {
    "NaN": np.full((4, 4), np.nan),
    "infinite": np.full((4, 4), np.inf),
    "zeros": np.zeros((4, 4)),
    "a kilometre away": np.array([[1.0, 0, 0, 1000], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]),
    "1e300 metres away": np.array([[1.0, 0, 0, 1e300], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]),
    "stretched": np.diag([2.0, 3.0, 4.0, 1.0]),
    "turned over": np.diag([1.0, -1.0, -1.0, 1.0]),
}
"""Poses of the camera by another odometry, which may be anything."""

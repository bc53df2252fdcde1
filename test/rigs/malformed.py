"""Messages as broken drivers, networks and people make them; none of them is a frame."""

from __future__ import annotations

import struct
import zlib
from array import array
from collections.abc import Callable

import cv2
import numpy as np

from rigs.ros import Triple

Breaker = Callable[[Triple, np.random.Generator], None]


def _set(part: str, **fields: object) -> Breaker:
    """Sets fields of the colour image, the depth image or the info."""

    def set_fields(triple: Triple, _random: np.random.Generator) -> None:
        message = getattr(triple, part)
        for name, value in fields.items():
            owner = message
            *path, last = name.split("__")
            for step in path:
                owner = getattr(owner, step)
            setattr(owner, last, array("d", value) if isinstance(value, list) else value)

    return set_fields


def _cut(part: str, keep: float) -> Breaker:
    def cut(triple: Triple, _random: np.random.Generator) -> None:
        message = getattr(triple, part)
        message.data = message.data[: int(len(message.data) * keep)]

    return cut


def _data(part: str, data: bytes) -> Breaker:
    def replace(triple: Triple, _random: np.random.Generator) -> None:
        getattr(triple, part).data = array("B", data)

    return replace


def _matrix(**entries: float) -> list[float]:
    K = {"fx": 300.0, "s": 0.0, "cx": 160.0, "l": 0.0, "fy": 300.0, "cy": 120.0, "z": 1.0}
    fx, s, cx, lower, fy, cy, z = {**K, **entries}.values()
    return [fx, s, cx, lower, fy, cy, 0.0, 0.0, z]


NAN, INF = float("nan"), float("inf")

INFOS: dict[str, Breaker] = {
    "K and P of zeros": _set("info", k=[0.0] * 9, p=[0.0] * 12),
    "K of NaN": _set("info", k=[NAN] * 9),
    "an infinite focal length": _set("info", k=_matrix(fx=INF)),
    "a focal length beyond all bounds": _set("info", k=_matrix(fx=1e300)),
    "a focal length of nothing": _set("info", k=_matrix(fy=1e-300)),
    "a principal point far away": _set("info", k=_matrix(cx=-1e9)),
    "a negative focal length": _set("info", k=_matrix(fx=-300.0)),
    "a focal length of zero": _set("info", k=_matrix(fy=0.0)),
    "a NaN as principal point": _set("info", k=_matrix(cx=NAN)),
    "a K of another resolution": _set("info", k=_matrix(cx=320.0, cy=240.0)),
    "skew": _set("info", k=_matrix(s=5.0)),
    "a K without its last 1": _set("info", k=_matrix(z=0.0)),
    "D with NaN": _set("info", d=[NAN, 0.0, 0.0, 0.0, 0.0]),
    "D with infinity": _set("info", d=[0.1, INF, 0.0, 0.0, 0.0]),
    "D of a hundred": _set("info", d=[0.1] * 100),
    "an unknown lens": _set("info", distortion_model="wobbly", d=[0.1] * 5),
    "a fisheye lens of five coefficients": _set(
        "info", distortion_model="equidistant", d=[0.1] * 5
    ),
    "an info without width": _set("info", width=0),
    "an info without size of an image elsewhere": _set(
        "info", width=0, height=0, k=_matrix(cx=640.0)
    ),
    "an info of 4 billion pixels a side": _set("info", width=2**32 - 1, height=2**32 - 1),
    "an info of another aspect": _set("info", width=320, height=100),
    "a region outside": _set("info", roi__x_offset=300, roi__width=320, roi__height=240),
    "a region of 4 billion": _set("info", roi__width=2**32 - 1, roi__height=2**32 - 1),
    "bins larger than the image": _set("info", binning_x=2**32 - 1, binning_y=2**32 - 1),
}

RAW: dict[str, Breaker] = {
    **INFOS,
    "colour cut off": _cut("color", 0.5),
    "colour without its last byte": _cut("color", 1 - 1e-6),
    "colour without data": _data("color", b""),
    "colour of width 0": _set("color", width=0),
    "colour of height 0": _set("color", height=0),
    "colour of 4 billion pixels a side": _set("color", width=2**32 - 1, height=2**32 - 1),
    "colour of 60,000 pixels a side": _set("color", width=60_000, height=60_000, step=180_000),
    "colour one row too high": _set("color", height=241),
    "colour with a step of 0": _set("color", step=0),
    "colour with a step too short": _set("color", step=959),
    "colour with a step of 4 billion": _set("color", step=2**32 - 1),
    "colour without an encoding": _set("color", encoding=""),
    "colour that is depth": _set("color", encoding="16UC1"),
    "colour in 16 bits": _set("color", encoding="rgb16"),
    "colour in an encoding of 10,000 letters": _set("color", encoding="x" * 10_000),
    "colour in an encoding with a zero byte": _set("color", encoding="rgb8é\n"),
    "depth cut off": _cut("depth", 0.3),
    "depth without data": _data("depth", b""),
    "depth of width 0": _set("depth", width=0),
    "depth of 4 billion pixels a side": _set("depth", width=2**32 - 1, height=2**32 - 1),
    "depth with a step too short": _set("depth", step=1279),
    "depth with a step of 4 billion": _set("depth", step=2**32 - 1),
    "depth that is colour": _set("depth", encoding="rgb8"),
    "depth in double precision": _set("depth", encoding="64FC1"),
    "depth of another aspect": _set("depth", width=320, height=100),
    "depth of another camera": _set("depth", header__frame_id="depth_optical"),
    "depth in a frame of 100,000 letters": _set("depth", header__frame_id="f" * 100_000),
}


def _bomb(side: int) -> bytes:
    """A PNG whose header claims so many pixels a side, with the right checksum."""
    _, png = cv2.imencode(".png", np.zeros((4, 4), np.uint16))
    head = b"IHDR" + struct.pack(">II", side, side) + png.tobytes()[24:29]
    return png.tobytes()[:12] + head + struct.pack(">I", zlib.crc32(head)) + png.tobytes()[33:]


def _jpeg() -> bytes:
    """A JPEG, which holds no depth: it has 8 bits and is lossy."""
    return cv2.imencode(".jpg", np.zeros((8, 8, 3), np.uint8))[1].tobytes()


def _huge_jpeg() -> bytes:
    """A JPEG whose header claims 65,535 pixels a side."""
    data = bytearray(_jpeg())
    at = data.index(b"\xff\xc0")
    data[at + 5 : at + 9] = b"\xff" * 4
    return bytes(data)


def _flipped(part: str) -> Breaker:
    """Turns round one bit in the middle, where a PNG has its pixels."""

    def flip(triple: Triple, random: np.random.Generator) -> None:
        data = getattr(triple, part).data
        data[len(data) // 2 + int(random.integers(-100, 100))] ^= 1 << int(random.integers(8))

    return flip


_QUANTISED = bytes(12)


def _rvl(runs: bytes, side: int = 300) -> Breaker:
    def replace(triple: Triple, _random: np.random.Generator) -> None:
        triple.depth.format = "16UC1; compressedDepth rvl"
        triple.depth.data = array("B", _QUANTISED + struct.pack("<II", side, side) + runs)

    return replace


COMPRESSED: dict[str, Breaker] = {
    **INFOS,
    "a JPEG cut off": _cut("color", 0.6),
    "a JPEG without its end": _cut("color", 1 - 1e-4),
    "a JPEG of two bytes": _data("color", b"\xff\xd8"),
    "a JPEG of nothing": _data("color", b""),
    "a JPEG of zeros": _data("color", bytes(5000)),
    "a JPEG of 65,535 pixels a side": _data("color", _huge_jpeg()),
    "a PNG of 60,000 pixels a side as colour": _data("color", _bomb(60_000)),
    "a PNG of 4 billion pixels a side as colour": _data("color", _bomb(2**32 - 1)),
    "depth as colour": _set("color", format="16UC1; compressedDepth png"),
    "depth cut off": _cut("depth", 0.5),
    "depth with one bit turned": _flipped("depth"),
    "depth without an image": _data("depth", _QUANTISED),
    "depth of four bytes": _data("depth", b"1234"),
    "depth as a PNG of 60,000 pixels a side": _data("depth", _QUANTISED + _bomb(60_000)),
    "depth as a JPEG": _data("depth", _jpeg()),
    "depth of floats that were not quantised": _set("depth", format="32FC1; compressedDepth png"),
    "a PNG that is said to be RVL": _set("depth", format="16UC1; compressedDepth rvl"),
    "RVL without end": _rvl(b"\xff" * 999),
    "RVL of 60,000 pixels a side": _rvl(b"", side=60_000),
    "depth of another camera": _set("depth", header__frame_id="depth_optical"),
}

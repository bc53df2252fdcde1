"""The encodings in which colour and depth are published, each against a closed form."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.messages.fields import CompressedImage, Image
from rgbd_glue_ros.messages.images import color_from_message, depth_from_message
from rgbd_glue_ros.messages.making import header

HEAD = header(1, "camera")
WIDTH, HEIGHT = 32, 24
# One colour all over: whatever is averaged between neighbours, it stays what it is.
R, G, B = 200, 120, 40
# The same by BT.601 with 8 bits of studio swing, which is what cameras mean by YUV
Y = round(16 + (65.738 * R + 129.057 * G + 25.064 * B) / 256)
U = round(128 + (-37.945 * R - 74.494 * G + 112.439 * B) / 256)
V = round(128 + (112.439 * R - 94.154 * G - 18.285 * B) / 256)


def message(encoding: str, pixels: NDArray[Any], height: int = HEIGHT) -> Image:
    data = np.ascontiguousarray(pixels)
    flat = data.reshape(-1).view(np.uint8)
    return Image(HEAD, height, WIDTH, encoding, 0, data.strides[0], flat)


def repeated(*values: int, dtype: type = np.uint8) -> NDArray[Any]:
    """Pixels of these channels."""
    return np.tile(np.array(values, dtype), (HEIGHT, WIDTH, 1))


def packed(*four: int) -> NDArray[np.uint8]:
    """Four bytes for two pixels beside each other."""
    return np.tile(np.array(four, np.uint8), (HEIGHT, WIDTH // 2))


def planes(*two: int) -> NDArray[np.uint8]:
    """The brightness of every pixel, then two bytes of colour for four."""
    colour = np.tile(np.array(two, np.uint8), (HEIGHT // 2, WIDTH // 2))
    return np.concatenate([np.full((HEIGHT, WIDTH), Y, np.uint8), colour])


def mosaic(pattern: str, dtype: type, scale: int) -> NDArray[Any]:
    """A Bayer pattern, named by its first four pixels."""
    levels = {"r": R, "g": G, "b": B}
    first: NDArray[Any] = np.array([levels[letter] * scale for letter in pattern], dtype).reshape(
        2, 2
    )
    return np.tile(first, (HEIGHT // 2, WIDTH // 2))


WIDE = 257  # 255 of 8 bits is 65535 of 16

COLORS: dict[str, NDArray[Any]] = {
    "rgb8": repeated(R, G, B),
    "RGB8": repeated(R, G, B),
    "bgr8": repeated(B, G, R),
    "8UC3": repeated(B, G, R),
    "8uc3": repeated(B, G, R),
    "rgba8": repeated(R, G, B, 7),
    "bgra8": repeated(B, G, R, 7),
    "8UC4": repeated(B, G, R, 7),
    "rgb16": repeated(R * WIDE, G * WIDE, B * WIDE, dtype=np.uint16),
    "bgr16": repeated(B * WIDE, G * WIDE, R * WIDE, dtype=np.uint16),
    "rgba16": repeated(R * WIDE, G * WIDE, B * WIDE, 9, dtype=np.uint16),
    "bgra16": repeated(B * WIDE, G * WIDE, R * WIDE, 9, dtype=np.uint16),
    "yuv422": packed(U, Y, V, Y),
    "UYVY": packed(U, Y, V, Y),
    "yuv422_yuy2": packed(Y, U, Y, V),
    "YUYV": packed(Y, U, Y, V),
    "YUY2": packed(Y, U, Y, V),
    "nv12": planes(U, V),
    "NV21": planes(V, U),
    **{
        f"bayer_{pattern}{bits}": mosaic(pattern, dtype, scale)
        for pattern in ("rggb", "bggr", "gbrg", "grbg")
        for bits, dtype, scale in ((8, np.uint8, 1), (16, np.uint16, WIDE))
    },
}


@pytest.mark.parametrize("encoding", COLORS)
def test_colour_is_the_same_in_every_encoding(encoding: str) -> None:
    pixels = COLORS[encoding]
    # whether a driver packs two pixels into four bytes or not, its rows are as wide
    if encoding.lower() in {"yuv422", "uyvy", "yuv422_yuy2", "yuyv", "yuy2"}:
        pixels = pixels.reshape(HEIGHT, WIDTH * 2)
    image = color_from_message(message(encoding, pixels), "/color")
    assert image.shape == (HEIGHT, WIDTH, 3)
    # rounding of YUV, and nothing else
    tolerance = 3 if encoding.lower().startswith(("yu", "uy", "nv")) else 0
    np.testing.assert_allclose(image.reshape(-1, 3), [[R, G, B]] * image[..., 0].size, 0, tolerance)


@pytest.mark.parametrize(
    ("encoding", "pixels"),
    [
        ("mono8", np.full((HEIGHT, WIDTH), 90, np.uint8)),
        ("MONO8", np.full((HEIGHT, WIDTH), 90, np.uint8)),
        ("8UC1", np.full((HEIGHT, WIDTH), 90, np.uint8)),
        ("mono16", np.full((HEIGHT, WIDTH), 90 * WIDE, np.uint16)),
    ],
)
def test_grey_is_the_same_in_every_encoding(encoding: str, pixels: NDArray[Any]) -> None:
    image = color_from_message(message(encoding, pixels), "/color")
    assert image.shape == (HEIGHT, WIDTH)
    assert set(image.ravel()) == {90}


@pytest.mark.parametrize("encoding", ["yuv422", "nv12", "bayer_rggb16"])
def test_an_image_with_fewer_bytes_than_its_encoding_needs_is_refused(encoding: str) -> None:
    with pytest.raises(InputError, match=r"^/color: .*(step is|truncated)"):
        color_from_message(message(encoding, repeated(R)[..., 0]), "/color")


def test_an_odd_width_that_a_subsampled_encoding_cannot_have_is_refused() -> None:
    odd = Image(HEAD, HEIGHT, 31, "yuv422", 0, 64, np.zeros(64 * HEIGHT, np.uint8))
    with pytest.raises(InputError, match="sides must be even"):
        color_from_message(odd, "/color")


METRES = np.linspace(0.5, 3.0, HEIGHT * WIDTH).reshape(HEIGHT, WIDTH)
METRES[0, :5] = 0


def units(per_metre: float, dtype: type = np.uint16) -> NDArray[Any]:
    return np.rint(METRES * per_metre).astype(dtype)


DEPTHS: dict[str, tuple[NDArray[Any], float | None]] = {
    "16UC1": (units(1000), None),
    "16uc1": (units(1000), None),
    "mono16": (units(1000), None),
    "Z16": (units(1000), None),
    "16SC1": (units(1000, np.int16), None),
    "32FC1": (np.where(METRES > 0, METRES, np.inf).astype(np.float32), None),
    "64FC1": (np.where(METRES > 0, METRES, np.nan), None),
    "16UC1 of 0.1 mm": (units(10000), 0.0001),
    "16UC1 of 0.25 mm": (units(4000), 0.00025),
    "16UC1 as TUM writes it": (units(5000), 0.0002),
    "32FC1 of mm": ((METRES * 1000).astype(np.float32), 0.001),
}


@pytest.mark.parametrize("encoding", DEPTHS)
def test_depth_is_the_same_in_every_encoding_and_unit(encoding: str) -> None:
    pixels, depth_scale = DEPTHS[encoding]
    depth = depth_from_message(message(encoding.partition(" ")[0], pixels), "/depth", depth_scale)
    expected = np.where(METRES > 0, METRES, np.nan)
    np.testing.assert_allclose(depth, expected, atol=0.0006)


def test_values_that_overflowed_16_bits_are_unknown() -> None:
    pixels = np.full((HEIGHT, WIDTH), 65535, np.uint16)
    assert np.isnan(depth_from_message(message("16UC1", pixels), "/depth", 0.0001)).all()


def png(image: NDArray[Any]) -> bytes:
    return cv2.imencode(".png", image)[1].tobytes()


def tiff(image: NDArray[Any]) -> bytes:
    return cv2.imencode(".tiff", image)[1].tobytes()


COMPRESSED_DEPTHS: dict[str, tuple[str, bytes]] = {
    "compressedDepth": ("16UC1; compressedDepth png", bytes(12) + png(units(1000))),
    "compressedDepth of old": ("16UC1; compressedDepth", bytes(12) + png(units(1000))),
    "compressedDepth without its head": ("16UC1; compressedDepth png", png(units(1000))),
    "compressed": ("16UC1; png compressed ", png(units(1000))),
    "png": ("png", png(units(1000))),
    "png that is compressedDepth": ("png", bytes(12) + png(units(1000))),
    "TIFF of floats": ("32FC1; tiff compressed ", tiff(METRES.astype(np.float32))),
}


@pytest.mark.parametrize("name", COMPRESSED_DEPTHS)
def test_compressed_depth_is_recognised_by_its_bytes(name: str) -> None:
    text, data = COMPRESSED_DEPTHS[name]
    compressed = CompressedImage(HEAD, text, np.frombuffer(data, np.uint8))
    depth = depth_from_message(compressed, "/depth")
    np.testing.assert_allclose(depth, np.where(METRES > 0, METRES, np.nan), atol=0.0006)


@pytest.mark.parametrize(
    ("text", "extension"),
    [
        ("jpeg", ".jpg"),
        ("rgb8; jpeg compressed bgr8", ".jpg"),
        ("bgr8; png compressed bgr8", ".png"),
        ("webp", ".webp"),
        ("rgb8; tiff compressed ", ".tiff"),
        # what it is called is no matter
        ("jpeg", ".png"),
        ("", ".webp"),
    ],
)
def test_compressed_colour_is_recognised_by_its_bytes(text: str, extension: str) -> None:
    data = cv2.imencode(extension, repeated(B, G, R))[1].tobytes()
    image = color_from_message(CompressedImage(HEAD, text, np.frombuffer(data, np.uint8)), "/color")
    np.testing.assert_allclose(image.reshape(-1, 3), [[R, G, B]] * image[..., 0].size, 0, 3)


@pytest.mark.parametrize("extension", [".webp", ".tiff"])
def test_a_truncated_compressed_image_is_refused(extension: str) -> None:
    noise = np.random.default_rng(0).integers(0, 256, (HEIGHT, WIDTH, 3), np.uint8)
    data = cv2.imencode(extension, noise)[1].tobytes()
    read: Callable[[bytes], object] = lambda part: color_from_message(  # noqa: E731
        CompressedImage(HEAD, "", np.frombuffer(part, np.uint8)), "/color"
    )
    read(data)
    for kept in (20, len(data) // 3, len(data) - 200):
        with pytest.raises(InputError, match=r"^/color: "):
            read(data[:kept])

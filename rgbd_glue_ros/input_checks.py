"""What arrays must be to be a frame: each fault is one line that says what to do about it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from rgbd_glue_ros.errors import InputError

if TYPE_CHECKING:
    from rgbd_glue_ros.types import CameraIntrinsics, RgbdFrame


def check_intrinsics(camera: CameraIntrinsics) -> None:
    """Refuses a camera that can see nothing.

    Raises:
        InputError: a size is negative, a focal length not above zero, or a number not finite.
    """
    for name in ("width", "height"):
        if getattr(camera, name) < 0:
            raise _fault(camera, name, f"is {getattr(camera, name)}", "give the size in pixels")
    for name in ("fx", "fy"):
        value = getattr(camera, name)
        if not 0 < value < math.inf:
            raise _fault(camera, name, f"is {value}", "give the focal length in pixels")
    for name in ("cx", "cy"):
        if not math.isfinite(getattr(camera, name)):
            raise _fault(camera, name, f"is {getattr(camera, name)}", "give pixels")


def check_frame(frame: RgbdFrame) -> None:
    """Refuses images that are of another type or shape than they are taken for.

    Depth of another unit has the right type: the odometry's estimate says so.

    Raises:
        InputError: they are.
    """
    stamp: object = frame.stamp_ns
    if not isinstance(stamp, (int, np.integer)):
        remedy = "give whole nanoseconds, as round(seconds * 1e9)"
        raise _fault(frame, "stamp_ns", f"is {stamp!r}", remedy)
    color, depth = frame.color, frame.depth
    if not _is_array(color, np.uint8) or color.shape[2:] not in {(), (3,)} or color.ndim < 2:
        remedy = "give uint8, [H, W, 3] RGB or [H, W] grey"
        raise _fault(frame, "color", f"is {_described(color)}", remedy)
    if not _is_array(depth, np.float32) or depth.ndim != 2:
        remedy = "give float32 [H, W], metres, NaN where unknown"
        if isinstance(depth, np.ndarray) and depth.dtype.kind in "iu":
            remedy += (
                "; of millimetres that is np.where(d > 0, d / 1000, np.nan).astype(np.float32)"
            )
        raise _fault(frame, "depth", f"is {_described(depth)}", remedy)
    if depth.shape != color.shape[:2]:
        cause = f"is {_described(depth)}, but color is {_described(color)}"
        raise _fault(frame, "depth", cause, "give depth registered to color, pixel for pixel")
    camera = frame.intrinsics
    if (camera.height, camera.width) not in {depth.shape, (0, 0)}:
        cause = f"are of {camera.width}x{camera.height}, but the images {_size(depth)}"
        raise _fault(frame, "intrinsics", cause, "give those of these images, as by scaled(w, h)")


def _is_array(value: Any, dtype: type) -> bool:
    return isinstance(value, np.ndarray) and value.dtype == dtype


def _described(value: Any) -> str:
    if not isinstance(value, np.ndarray):
        return f"a {type(value).__name__}"
    return f"{value.dtype} {list(value.shape)}"


def _size(image: Any) -> str:
    return f"{image.shape[1]}x{image.shape[0]}"


def _fault(what: object, name: str, cause: str, remedy: str) -> InputError:
    return InputError(f"{type(what).__name__}.{name}", cause, remedy)

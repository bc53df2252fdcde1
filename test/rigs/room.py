"""Pictures of the ray-cast room, without noise or blur, a quarter as large as the bundled ones."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
from raycast_room.motion import hand_held
from raycast_room.render import measure, render

from rgbd_glue_ros.geometry import se3, views
from rgbd_glue_ros.geometry.reduction import reduced
from rgbd_glue_ros.types import CameraIntrinsics, Float32, Float64, RgbdFrame, UInt8, View
from rigs.stored_room import stored_living_room

CAMERA = CameraIntrinsics(320, 240, 262.5, 262.5, 159.5, 119.5)
# of a source and a target: 0.3 s of the hand-held motion are 11 cm and 2 degrees
TIMES = 0.0, 0.3


def true_pose(time_s: float) -> Float64:
    """T_world_camera at a time of the hand-held motion, which comes back after 3.5 s."""
    return hand_held(time_s).matrix


def true_transform() -> Float64:
    """T_target_source of what the camera sees at ``TIMES``."""
    return se3.inverse(true_pose(TIMES[1])) @ true_pose(TIMES[0])


def true_depth(T_world_camera: Float64) -> Float32:
    """Exact depth from any pose."""
    return measure(stored_living_room(), T_world_camera, 0.0, CAMERA)[0].astype(np.float32)


@lru_cache(maxsize=64)
def _picture(time_s: float) -> tuple[UInt8, Float32]:
    return render(stored_living_room(), true_pose(time_s), CAMERA)


def room_frame(time_s: float) -> RgbdFrame:
    """What the camera sees at a time; each is rendered once."""
    color, depth = _picture(time_s)
    return RgbdFrame(round(time_s * 1e9), color.copy(), depth.copy(), CAMERA)


@lru_cache(maxsize=64)
def panned_frame(radians: float) -> RgbdFrame:
    """What the camera sees after turning to the right from where its motion starts."""
    T = true_pose(0.0) @ se3.exp(np.array([0, 0, 0, 0, radians, 0]))
    color, depth = render(stored_living_room(), T, CAMERA)
    return RgbdFrame(0, color, depth, CAMERA)


def room_view(time_s: float) -> View:
    """The same, prepared for registration."""
    frame = room_frame(time_s)
    return View(views.grey(frame.color), frame.depth, CAMERA)


def small_room_view(time_s: float) -> View:
    """The same of half the width: the largest network takes a part of a second."""
    frame = reduced(room_frame(time_s), CAMERA.width // 2)
    return View(views.grey(frame.color), frame.depth, frame.intrinsics)


_BAND = 4


def rolling_frame(time_s: float, readout_time: float, depth_latency: float) -> RgbdFrame:
    """A frame whose rows are read one after the other, and whose depth is older than its colour."""
    color, depth = _rolling_picture(time_s, readout_time, depth_latency)
    return RgbdFrame(round(time_s * 1e9), color.copy(), depth.copy(), CAMERA)


@lru_cache(maxsize=64)
def _rolling_picture(
    time_s: float, readout_time: float, depth_latency: float
) -> tuple[UInt8, Float32]:
    bands = [
        _band(top, time_s + readout_time * ((top + _BAND / 2) / CAMERA.height - 0.5), depth_latency)
        for top in range(0, CAMERA.height, _BAND)
    ]
    colors, depths = zip(*bands, strict=True)
    return np.concatenate(colors), np.concatenate(depths)


def _band(top: int, time_s: float, depth_latency: float) -> tuple[UInt8, Float32]:
    """Colour and depth of a few rows."""
    rows = replace(CAMERA, height=_BAND, cy=CAMERA.cy - top)
    color, depth = render(stored_living_room(), true_pose(time_s), rows)
    if depth_latency == 0:
        return color, depth
    return color, render(stored_living_room(), true_pose(time_s - depth_latency), rows)[1]


def true_twist(time_s: float) -> Float64:
    """Velocity of the camera (linear, angular) in its optical frame, m/s and rad/s."""
    half = 1e-3
    T = se3.inverse(true_pose(time_s - half)) @ true_pose(time_s + half)
    return se3.log(T) / (2 * half)


def turned_frame(yaw: float, stamp_ns: int) -> RgbdFrame:
    """What the camera sees from where it began, turned to the right by an angle (rad)."""
    return view_after(se3.exp(np.array([0, 0, 0, 0, yaw, 0])), stamp_ns)


def view_after(T_first_camera: Float64, stamp_ns: int) -> RgbdFrame:
    """What the camera sees after a motion [4, 4] from where it began; each is rendered once."""
    color, depth = _picture_from((true_pose(0.0) @ T_first_camera).tobytes())
    return RgbdFrame(stamp_ns, color.copy(), depth.copy(), CAMERA)


@lru_cache(maxsize=64)
def _picture_from(pose: bytes) -> tuple[UInt8, Float32]:
    T_world_camera = np.frombuffer(pose).reshape(4, 4).copy()
    return render(stored_living_room(), T_world_camera, CAMERA)

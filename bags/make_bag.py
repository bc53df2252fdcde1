"""Makes the bundled recording, bit for bit the same every time: ``python bags/make_bag.py``."""

from __future__ import annotations

import argparse
import os
import struct
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from raycast_room.living_room import living_room
from raycast_room.motion import LOOP_S, hand_held
from raycast_room.sensor import photograph
from tqdm import tqdm

from rgbd_glue_ros.messages.fields import DEPTH_UNITS_PER_METRE, CompressedImage, Header
from rgbd_glue_ros.messages.making import compressed_color_image
from rgbd_glue_ros.recordings.bag.writer import COMPRESSED, BagWriter
from rgbd_glue_ros.types import NANOSECONDS, CameraIntrinsics, Float32, Float64, RgbdFrame

FOLDER = Path(__file__).resolve().parent / "living_room"
OPENCV = "4.13.0"  # another version decodes to the same pixels, but may write other bytes

RATE_HZ = 30
FRAME_COUNT = round(LOOP_S * RATE_HZ)
START_NS = 1_767_225_600 * NANOSECONDS  # 2026-01-01
CAMERA = CameraIntrinsics(width=640, height=480, fx=525.0, fy=525.0, cx=319.5, cy=239.5)

JPEG_QUALITY = 64  # the bag stays below 8 MB


def stamp_ns(index: int) -> int:
    """The stamp of a frame: the middle of its exposure."""
    return START_NS + index * NANOSECONDS // RATE_HZ


def time_s(index: int) -> float:
    """The time of a frame since the first, as ``hand_held`` takes it."""
    return (stamp_ns(index) - START_NS) / NANOSECONDS


def true_pose(index: int) -> Float64:
    """T_world_camera of a frame, [4, 4]."""
    return hand_held(time_s(index)).matrix


def make_frame(index: int) -> RgbdFrame:
    """A frame of the recording, before its colour goes through JPEG; needs none before it."""
    color, units = photograph(living_room(), hand_held, time_s(index), CAMERA, seed=index)
    depth = units.astype(np.float32) / np.float32(DEPTH_UNITS_PER_METRE)
    depth[units == 0] = np.nan
    return RgbdFrame(stamp_ns(index), color, depth, CAMERA)


def make_bag(folder: Path) -> None:
    """Writes the recording into a new folder."""
    living_room()  # before the threads, which would each make it
    with open_writer(folder) as writer, ThreadPoolExecutor(os.cpu_count()) as pool:
        frames = pool.map(lambda index: writer.encode(make_frame(index)), range(FRAME_COUNT))
        for index, frame in enumerate(tqdm(frames, total=FRAME_COUNT, unit="frame")):
            writer.write(frame)
            writer.write_pose(frame.stamp_ns, true_pose(index))


def open_writer(folder: Path) -> BagWriter:
    """A writer with this recording's compression."""
    color = partial(compressed_color_image, quality=JPEG_QUALITY)
    return BagWriter(folder, replace(COMPRESSED, color=color, depth=_compressed_depth))


def _compressed_depth(depth: Float32, head: Header) -> CompressedImage:
    """As ``compressed_depth_image``, but a fifth smaller.

    Depth from whole steps of disparity takes few values: PNG's filters, made for smooth images,
    would hide that.
    """
    units: NDArray[np.uint16] = np.nan_to_num(np.rint(depth * DEPTH_UNITS_PER_METRE)).astype(
        np.uint16
    )
    _, png = cv2.imencode(
        ".png",
        units,
        [
            *(cv2.IMWRITE_PNG_COMPRESSION, 9),
            *(cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_DEFAULT),
            *(cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_NONE),
        ],
    )
    data = struct.pack("<iff", 0, 0.0, 0.0) + png.tobytes()
    return CompressedImage(head, "16UC1; compressedDepth png", np.frombuffer(data, np.uint8))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", nargs="?", type=Path, default=FOLDER, help="new, of the bag")
    make_bag(parser.parse_args().folder)

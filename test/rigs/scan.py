"""Scans as ScanNet publishes them: a sensor stream, and the folder of its export."""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from rgbd_glue_ros.messages.image_codecs import encode_jpeg
from rgbd_glue_ros.types import UInt8

# colour about twice as large as depth, and not quite of its shape, as in ScanNet
COLOR, DEPTH = (130, 97), (64, 48)
K_COLOR = np.diag([117.0, 117.0, 1, 1])
K_DEPTH = np.array([[57.8, 0, 31.5, 0], [0, 57.9, 23.5, 0], [0, 0, 1, 0], [0, 0, 0, 1]])


@dataclass(frozen=True)
class Scan:
    """What a .sens file says; the fields in the order of the file, as ScanNet publishes it."""

    frames: int = 5
    version: int = 4
    sensor: bytes = b"StructureSensor"
    color_compression: int = 2
    depth_compression: int = 1
    color_size: tuple[int, int] = COLOR
    depth_size: tuple[int, int] = DEPTH
    depth_shift: float = 1000.0
    announced: int | None = None
    lost: tuple[int, ...] = ()
    depth_data: dict[int, bytes] = field(default_factory=dict)

    def header(self) -> bytes:
        matrices = np.stack([K_COLOR, np.eye(4), K_DEPTH, np.eye(4)]).astype("<f4")
        announced = self.frames if self.announced is None else self.announced
        return b"".join(
            [
                struct.pack("<I", self.version),
                struct.pack("<Q", len(self.sensor)) + self.sensor,
                matrices.tobytes(),
                struct.pack("<ii", self.color_compression, self.depth_compression),
                struct.pack("<IIII", *self.color_size, *self.depth_size),
                struct.pack("<f", self.depth_shift),
                struct.pack("<Q", announced),
            ]
        )

    def pose(self, i: int) -> NDArray[np.float32]:
        pose = np.eye(4, dtype="<f4")
        pose[0, 3] = i / 8
        return np.full((4, 4), -np.inf, "<f4") if i in self.lost else pose

    def color(self, i: int) -> bytes:
        width, height = COLOR
        image: UInt8 = np.full((height, width, 3), (0, 40 * i, 200), np.uint8)
        return encode_jpeg(image)

    def depth(self, i: int) -> NDArray[np.uint16]:
        width, height = DEPTH
        image = np.full((height, width), 1500 + i, "<u2")
        image[0, 0] = 0
        return image

    def frame(self, i: int) -> bytes:
        color = self.color(i)
        plain = self.depth(i).tobytes()
        depth = plain if self.depth_compression == 0 else zlib.compress(plain)
        depth = self.depth_data.get(i, depth)
        stamps_and_sizes = struct.pack("<QQQQ", 0, 0, len(color), len(depth))
        return self.pose(i).tobytes() + stamps_and_sizes + color + depth

    def write(self, path: Path) -> Path:
        path.write_bytes(self.header() + b"".join(self.frame(i) for i in range(self.frames)))
        return path

    def export(self, folder: Path) -> Path:
        """The folder that ScanNet's own reader makes of the file."""
        for part in ("color", "depth", "pose", "intrinsic"):
            (folder / part).mkdir(parents=True)
        for i in range(self.frames):
            (folder / f"color/{i}.jpg").write_bytes(self.color(i))
            cv2.imwrite(str(folder / f"depth/{i}.png"), self.depth(i))
            np.savetxt(folder / f"pose/{i}.txt", self.pose(i), fmt="%f")
        np.savetxt(folder / "intrinsic/intrinsic_color.txt", K_COLOR, fmt="%f")
        np.savetxt(folder / "intrinsic/intrinsic_depth.txt", K_DEPTH, fmt="%f")
        return folder

"""Folders as data sets, scanners and exporters leave them, each with a few small frames."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.types import CameraIntrinsics

CAMERA = CameraIntrinsics(64, 48, 60.0, 61.0, 31.5, 23.5)
FRAMES = 4
START_NS = 1_305_031_453_000_000_000
PERIOD_NS = 100_000_000
POSES = np.stack([se3.exp(np.array([0.1 * i, 0.2, 0.3, 0, 0.1 * i, 0])) for i in range(FRAMES)])

# What macOS keeps of a file beside it, on disks of other systems
APPLE_DOUBLE = b"\0\5\x16\7\0\2\0\0Mac OS X        " + bytes(4000)


def stamp_s(i: int) -> str:
    return f"{(START_NS + i * PERIOD_NS) / 1e9:.6f}"


def metres(i: int) -> float:
    return 1.0 + i / 2


def write(path: Path, image: NDArray[Any]) -> str:
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.suffix == ".npy":
        np.save(path, image)
    else:
        assert cv2.imwrite(str(path), image)
    return path.name


def color(i: int, size: tuple[int, int] = (64, 48)) -> NDArray[Any]:
    return np.full((size[1], size[0], 3), (10 * i, 20, 200), np.uint8)


def depth(i: int, units: float, size: tuple[int, int] = (64, 48)) -> NDArray[Any]:
    return np.full((size[1], size[0]), round(metres(i) * units), np.uint16)


def images(
    folder: Path,
    color_name: str,
    depth_name: str,
    units: float = 1000,
    color_size: tuple[int, int] = (64, 48),
) -> None:
    """Frames whose names hold {i} or {ns} or {s}."""
    for i in range(FRAMES):
        words = {"i": i, "s": stamp_s(i), "ns": START_NS + i * PERIOD_NS, "us": i * 33333}
        write(folder / color_name.format(**words), color(i, color_size))
        write(folder / depth_name.format(**words), depth(i, units))


def text(path: Path, *lines: object) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")


def numbers(values: NDArray[Any]) -> str:
    return " ".join(str(v) for v in values.ravel())


def tum_lines(first: int = 0) -> list[str]:
    return [
        f"{stamp_s(i)} {numbers(T[:3, 3])} {numbers(se3.quaternion(T))}"
        for i, T in enumerate(POSES)
        if i >= first
    ]


K = "60 0 31.5\n0 61 23.5\n0 0 1"


def replica(folder: Path) -> None:
    images(folder, "results/frame{i:06d}.jpg", "results/depth{i:06d}.png", 6553.5)
    text(folder / "traj.txt", *(numbers(T) for T in POSES))
    camera = {"w": 64, "h": 48, "fx": 60, "fy": 61, "cx": 31.5, "cy": 23.5, "scale": 6553.5}
    text(folder.parent / "cam_params.json", json.dumps({"camera": camera}))


def lists(folder: Path, color_list: str, depth_list: str, units: float) -> None:
    color_name, depth_name = color_list.removesuffix(".txt"), depth_list.removesuffix(".txt")
    images(folder, color_name + "/{s}.png", depth_name + "/{s}.png", units)
    for name in (color_name, depth_name):
        rows = (f"{stamp_s(i)} {name}/{stamp_s(i)}.png" for i in range(FRAMES))
        text(folder / f"{name}.txt", "# timestamp filename", *rows)
    text(folder / "groundtruth.txt", "timestamp tx ty tz qx qy qz qw", *tum_lines())


def openloris_as_packed(folder: Path) -> None:
    """With the sensors of the robot, and another camera among them."""
    lists(folder, "color.txt", "aligned_depth.txt", 1000)
    camera = "   width: 64\n   height: 48\n   intrinsics: !!opencv-matrix\n      rows: 1\n"
    camera += "      cols: 4\n      dt: d\n      data: [ {}, 31.5, {}, 23.5 ]\n"
    text(
        folder / "sensors.yaml",
        "%YAML:1.0\n---\nd400_color_optical_frame:\n" + camera.format(60.0, 61.0),
        "d400_depth_optical_frame:\n" + camera.format(40.0, 40.0),
    )
    text(folder / "trans_matrix.yaml", "%YAML:1.0\n---\ntrans_matrix:\n   - parent_frame: base")


def arkit_scenes(folder: Path) -> None:
    """Numbers in names are that of the scan, and seconds since the phone was started."""
    for i in range(FRAMES):
        name = f"41069021_{305.377 + i / 10:.3f}"
        write(folder / f"lowres_wide/{name}.png", color(i))
        write(folder / f"lowres_depth/{name}.png", depth(i, 1000))
        write(folder / f"confidence/{name}.png", np.zeros((48, 64), np.uint8))
        text(folder / f"lowres_wide_intrinsics/{name}.pincam", "64 48 60 61 31.5 23.5")
        text(folder / f"poses/{name}.txt", *map(numbers, POSES[i]))


def eth3d(folder: Path) -> None:
    lists(folder, "rgb.txt", "depth.txt", 5000)
    text(folder / "calibration.txt", "60 61 31.5 23.5")


def openloris(folder: Path) -> None:
    lists(folder, "color.txt", "aligned_depth.txt", 1000)
    text(folder / "K.txt", K)


def tum_with_faults(folder: Path) -> None:
    """Lists with a byte-order mark, names, commas and columns more."""
    lists(folder, "rgb.txt", "depth.txt", 5000)
    rows = (f"{stamp_s(i)},rgb/{stamp_s(i)}.png,7" for i in range(FRAMES))
    text(folder / "rgb.txt", "\ufefftimestamp,filename,exposure", *rows, "", "1305")
    text(folder / "K.txt", K)


def names_with_blanks(folder: Path) -> None:
    """With blanks or quotes, in lists of stamps and files."""
    images(folder, "rgb/an image {s}.png", "depth/{s}.png", 5000)
    rows = [f"{stamp_s(i)} rgb/an image {stamp_s(i)}.png" for i in range(FRAMES)]
    text(folder / "rgb.txt", "# timestamp filename", *rows)
    rows = [f'{stamp_s(i)} "depth/{stamp_s(i)}.png"' for i in range(FRAMES)]
    text(folder / "depth.txt", "# timestamp filename", *rows)
    text(folder / "groundtruth.txt", "timestamp tx ty tz qx qy qz qw", *tum_lines())
    text(folder / "K.txt", K)


def association(folder: Path, depth_first: bool) -> None:
    images(folder, "rgb/{s}.png", "depth/{s}.png", 5000)
    rows = []
    for i in range(FRAMES):
        both = [f"{stamp_s(i)} {kind}/{stamp_s(i)}.png" for kind in ("rgb", "depth")]
        rows.append(" ".join(reversed(both) if depth_first else both))
    text(folder / "associations.txt", *rows)
    text(folder / "groundtruth.txt", *tum_lines())
    text(
        folder / "TUM1.yaml",
        "%YAML:1.0\nCamera.fx: 60.0\nCamera.fy: 61.0\nCamera.cx: 31.5\nCamera.cy: 23.5",
        "Camera.width: 64\nCamera.height: 48\nDepthMapFactor: 5000.0",
    )


def numbered_association(folder: Path) -> None:
    """As people write one for their own camera, in millimetres."""
    images(folder, "rgb/{i}.png", "depth/{i}.png")
    text(folder / "associated.txt", *(f"{i} depth/{i}.png {i} rgb/{i}.png" for i in range(FRAMES)))
    fx_fy = {"fx": 60, "fy": 61, "cx": 31.5, "cy": 23.5, "w": 64, "h": 48, "depth_scale": 1000}
    text(folder / "camera.yaml", json.dumps(fx_fy))
    text(folder / "poses.txt", *(numbers(T[:3]) for T in POSES))


def open3d(folder: Path) -> None:
    images(folder, "color/{i:05d}.jpg", "depth/{i:05d}.png")
    matrix = [60, 0, 0, 0, 61, 0, 31.5, 23.5, 1]
    camera = {"width": 64, "height": 48, "intrinsic_matrix": matrix}
    text(folder / "camera_intrinsic.json", json.dumps(camera))
    blocks = (f"{i} {i} {i + 1}\n" + "\n".join(map(numbers, T)) for i, T in enumerate(POSES))
    text(folder / "trajectory.log", *blocks)


def sun3d(folder: Path) -> None:
    images(folder, "image/{i:07d}-{us:012d}.jpg", "depth/{i:07d}-{us:012d}.png")
    for path in (folder / "depth").iterdir():
        units = np.asarray(cv2.imread(str(path), cv2.IMREAD_UNCHANGED), np.uint16)
        write(path, ((units << 3) | (units >> 13)).astype(np.uint16))
    text(folder / "intrinsics.txt", K)
    text(folder / "extrinsics/20140817205214.txt", *(numbers(r) for T in POSES for r in T[:3]))


def azure(folder: Path) -> None:
    """Two exporters: depth as floats of metres, colour twice as large."""
    images(folder, "color/{ns}.png", "depth/{ns}.png", color_size=(128, 96))
    for i, path in enumerate(sorted((folder / "depth").iterdir())):
        path.unlink()
        write(path.with_suffix(".tiff"), np.full((48, 64), metres(i), np.float32))
    text(folder / "K.txt", "120 0 63.5\n0 122 47.5\n0 0 1")
    text(folder / "gt.txt", *tum_lines())


def record3d(folder: Path) -> None:
    images(folder, "rgb/{i}.jpg", "depth/{i}.png")
    for i in range(FRAMES):
        (folder / f"depth/{i}.png").unlink()
        write(folder / f"depth/{i}.npy", np.full((48, 64), metres(i), np.float32))
    write(folder / "confidence/0.png", np.zeros((48, 64), np.uint8))
    columns = [60, 0, 0, 0, 61, 0, 31.5, 23.5, 1]
    text(folder / "metadata.json", json.dumps({"K": columns, "w": 64, "h": 48, "fps": 30}))
    for i, T in enumerate(POSES):
        text(folder / f"pose/{i}.txt", *map(numbers, T))


def kitti_truth(folder: Path) -> None:
    images(folder, "images/{i:04d}.png", "depth_aligned/{i:04d}.png")
    images(folder, "images/{i:04d}.png", "depth_raw/{i:04d}.png", 7)
    text(folder / "K.txt", K)
    text(folder / "poses.txt", *(numbers(T[:3]) for T in POSES))


def redwood(folder: Path) -> None:
    """Named by number and microseconds, with the pose of each frame in a log."""
    images(folder, "rgb/{i:05d}.jpg", "depth/{i:05d}.png")
    matrix = [60, 0, 0, 0, 61, 0, 31.5, 23.5, 1]
    camera = {"width": 64, "height": 48, "intrinsic_matrix": matrix, "depth_scale": 1000.0}
    text(folder / "intrinsic.json", json.dumps(camera))
    blocks = (f"{i} {i} {i + 1}\n" + "\n".join(map(numbers, T)) for i, T in enumerate(POSES))
    text(folder / "scene/trajectory.log", *blocks)
    (folder / "scene/trajectory.log").rename(folder / "trajectory.log")


def bonn(folder: Path) -> None:
    """As the data set is packed; its camera is told here, whose images are small."""
    lists(folder, "rgb.txt", "depth.txt", 5000)
    listed = (folder / "rgb.txt").read_text()
    text(folder / "rgb.txt", "# color images", "# file: 'rgbd_bonn_balloon.bag'", listed)
    text(folder / "K.txt", K)


def nyu_in_pnm(folder: Path) -> None:
    """Projected and saved under the names that the data set has."""
    folder.mkdir(parents=True)
    for i in range(FRAMES):
        write(folder / f"r-{stamp_s(i)}-{2754192016 + 7 * i}.ppm", color(i))
        write(folder / f"d-{stamp_s(i)}-{2734937519 + 9 * i}.pgm", depth(i, 1000))
    text(folder / "K.txt", K)
    text(folder / "groundtruth.txt", *tum_lines())


def nyu_synced(folder: Path) -> None:
    """As the raw data set is passed on for learning: both in one folder, projected."""
    folder.mkdir(parents=True)
    for i in range(FRAMES):
        write(folder / f"rgb_{i:05d}.jpg", color(i))
        write(folder / f"sync_depth_{i:05d}.png", depth(i, 1000))
    text(folder / "K.txt", K)
    text(folder / "poses.txt", *(numbers(T[:3]) for T in POSES))


def rendered(folder: Path) -> None:
    """Depth in EXR files, as renderers leave it: metres, in three equal channels."""
    os.environ.setdefault("OPENCV_IO_ENABLE_OPENEXR", "1")  # to write them
    images(folder, "rgb/{i:04d}.png", "depth/{i:04d}.png")
    for i in range(FRAMES):
        (folder / f"depth/{i:04d}.png").unlink()
        write(folder / f"depth/{i:04d}.exr", np.full((48, 64, 3), metres(i), np.float32))
    text(folder / "K.txt", K)
    text(folder / "poses.txt", *(numbers(T) for T in POSES))


def stray_scanner(folder: Path) -> None:
    """A video of the phone, twice as large as depth, which begins one frame later."""
    images(folder, "depth/{i:06d}.png", "depth/{i:06d}.png")
    video = cv2.VideoWriter(str(folder / "rgb.mp4"), cv2.VideoWriter.fourcc(*"mp4v"), 60, (128, 96))
    for i in range(FRAMES + 1):
        video.write(np.asarray(color(i, (128, 96)), np.uint8))
    video.release()
    for i in range(FRAMES):
        write(folder / f"confidence/{i:06d}.png", np.zeros((48, 64), np.uint8))
    text(folder / "camera_matrix.csv", "120, 0, 63.5", "0, 122, 47.5", "0, 0, 1")
    rows = (
        f"{i / 60 + 100}, {i:06d}, {', '.join(map(str, [*T[:3, 3], *se3.quaternion(T)]))}"
        for i, T in enumerate(POSES)
    )
    text(folder / "odometry.csv", "timestamp, frame, x, y, z, qx, qy, qz, qw", *rows)


LAYOUTS: dict[str, Callable[[Path], None]] = {
    "Replica as NICE-SLAM has it": replica,
    "ETH3D": eth3d,
    "OpenLORIS": openloris,
    "OpenLORIS with its sensors": openloris_as_packed,
    "ARKitScenes": arkit_scenes,
    "lists with faults": tum_with_faults,
    "names with blanks": names_with_blanks,
    "association, colour first": lambda folder: association(folder, False),
    "association, depth first": lambda folder: association(folder, True),
    "association of numbers, in millimetres": numbered_association,
    "Open3D and Redwood": open3d,
    "SUN3D": sun3d,
    "Azure Kinect, stamps for names": azure,
    "Record3D": record3d,
    "Redwood": redwood,
    "Bonn": bonn,
    "NYU in PPM and PGM": nyu_in_pnm,
    "NYU synced": nyu_synced,
    "a renderer's EXR": rendered,
    "Stray Scanner": stray_scanner,
    "poses of KITTI, two kinds of depth": kitti_truth,
}

"""Damages small recordings and files at random, and gives them to what reads them.

The same seed and number give the same damage.
"""

from __future__ import annotations

import io
import logging
import resource
import shutil
import signal
import sys
import tarfile
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import FrameType

import cv2
import numpy as np
import yaml
from numpy.typing import NDArray
from rosbags.rosbag2 import CompressionMode, StoragePlugin

from rgbd_glue_ros.cli.main import main
from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.live.camera_presets import load_camera
from rgbd_glue_ros.parameters import Config, NodeConfig, load_yaml, share_directory, to_yaml
from rgbd_glue_ros.recordings.fetch.archive import unpack
from rgbd_glue_ros.slam.map_file import SavedMap, read_map, write_map
from rgbd_glue_ros.slam.packed_view import packed
from rgbd_glue_ros.trajectories.pose_graph import read_graph, write_graph
from rgbd_glue_ros.trajectories.tum import write_tum
from rgbd_glue_ros.types import Trajectory, UInt8, View
from rigs.bags import make_frames, recorded, write_rosbag1, write_rosbag2
from rigs.data_sets import CALIBRATION, write_data_set
from rigs.layouts import LAYOUTS
from rigs.pose_graphs import random_graph
from rigs.scan import Scan

MOST_S = 30
MOST_MB = 1500
OK, BAD_INPUT = 0, 2

# What numbers, names and values may become in texts
_WORDS = [
    *(b"nan", b"inf", b"-1", b"0", b"1e308", b"1e999990", b"9" * 40, b"-" + b"9" * 20, b"0x1p3"),
    *(b"../../../etc/passwd", b"/dev/zero", b"\0", b"\x1b[2J", b"\xff\xfe", b"*a", b"&a [", b"-0"),
    *(b"{}", b"[]", b"null", b"true", b"!!python/object:os.system", b"%YAML 9.9\n---", b"\r", b"#"),
    *(b"", b" ", b",", b";", "９".encode(), b"a" * 5000, b".5", b"1_0", b"0:0:0", b"[" * 300),
]
_NUMBERS = [0, 1, 127, 255, 2**15, 2**16 - 1, 2**31 - 1, 2**31, 2**32 - 1, 2**63 - 1, 2**64 - 1]


class TooLongError(BaseException):
    """It did not end in its time; nothing catches this by chance."""


@dataclass(frozen=True)
class Kind:
    """A whole file or folder, and what reads it.

    Attributes:
        path: of what is whole.
        read: reads it with a folder to write to, and returns an exit code.
    """

    path: Path
    read: Callable[[Path, Path], int]


@dataclass(frozen=True)
class Outcome:
    """What came of damage.

    Attributes:
        damage: what was done to which kind.
        code: the exit code; None where it raised or was too slow.
        said: on standard error.
        fault: what is wrong with that; "" if nothing is.
    """

    damage: str
    code: int | None
    said: str
    fault: str


def kinds(folder: Path) -> dict[str, Kind]:
    """Whole recordings and files of every kind, made in a folder."""
    frames = make_frames(3)
    found: dict[str, Kind] = {}

    def place(name: str, file: str = "recording") -> Path:
        path = folder / name.replace(" ", "_") / file
        path.parent.mkdir(parents=True)
        return path

    for plugin in StoragePlugin:
        for mode in CompressionMode:
            if plugin is StoragePlugin.MCAP or mode is not CompressionMode.STORAGE:
                name = f"{plugin.name} {mode.name}"
                bag = write_rosbag2(place(name), recorded(frames), plugin, mode)
                found[name] = Kind(bag, _convert)
    for compression in ("", "BZ2", "LZ4"):
        name = f"ROS 1 {compression}"
        file = write_rosbag1(place(name, "recording.bag"), recorded(frames), compression)
        found[name] = Kind(file, _convert)
    found["sens"] = Kind(Scan(frames=3).write(place("sens", "scan.sens")), _convert)
    found["ScanNet"] = Kind(Scan(frames=3).export(place("ScanNet")), _convert)
    for name, make in _FOLDERS.items():
        found[name] = Kind(make(place(name)), _convert)
    for name, lay_out in LAYOUTS.items():
        folder_of_layout = place(name)
        lay_out(folder_of_layout)
        found[name] = Kind(folder_of_layout, _convert)
    tum = place("TUM")
    calibration = write_data_set(tum, 3)
    found["TUM"] = Kind(tum, _convert)
    texts = {
        "ROS": yaml.safe_dump(CALIBRATION),
        "matrix": "300 0 159.5\n0 300 119.5\n0 0 1\n",
        "JSON": '{"width": 320, "height": 240, "fx": 300, "fy": 300, "cx": 159.5, "cy": 119.5}',
        "OpenCV": "%YAML:1.0\n---\nimage_width: 320\nimage_height: 240\ncamera_matrix: "
        "!!opencv-matrix\n  {rows: 3, cols: 3, dt: d, data: [300, 0, 159, 0, 300, 119, 0, 0, 1]}\n",
    }
    assert calibration.is_file()
    for form, text in texts.items():
        path = place(f"calibration {form}", "camera.yaml")
        path.write_text(text)
        found[f"calibration {form}"] = Kind(path, partial(_with_calibration, tum))
    found |= _texts(place)
    found |= _archives(place)
    return found


def _texts(place: Callable[[str, str], Path]) -> dict[str, Kind]:
    poses = np.tile(np.eye(4), (30, 1, 1))
    trajectory = place("trajectory", "trajectory.txt")
    write_tum(trajectory, Trajectory(np.arange(1, 31, dtype=np.int64) * 10**8, poses))
    graph = place("graph", "keyframes.g2o")
    write_graph(graph, random_graph(1, 5))
    saved = place("map", "room.rgbdmap")
    views = [View(f.color[..., 0].copy(), f.depth, f.intrinsics) for f in make_frames(5)]
    write_map(saved, SavedMap(random_graph(1, 5), tuple(map(packed, views))))
    parameters = place("parameters", "params.yaml")
    parameters.write_text(to_yaml(Config()))
    camera = place("camera preset", "camera.yaml")
    preset = sorted((share_directory() / "config" / "cameras").glob("*.yaml"))[0]
    camera.write_bytes(preset.read_bytes())
    assert NodeConfig()
    return {
        "trajectory": Kind(trajectory, lambda path, _: _main("evaluate", path, path, "--json")),
        "map": Kind(saved, lambda path, _: _call(read_map, path)),
        "graph": Kind(graph, lambda path, _: _call(read_graph, path)),
        "parameters": Kind(parameters, lambda path, _: _call(load_yaml, path, Config())),
        "camera preset": Kind(camera, lambda path, _: _call(load_camera, str(path))),
    }


def _archives(place: Callable[[str, str], Path]) -> dict[str, Kind]:
    zipped, tarred = place("zip", "set.zip"), place("tar", "set.tgz")
    with zipfile.ZipFile(zipped, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("a/b.txt", b"text" * 100)
        inner = io.BytesIO()
        with zipfile.ZipFile(inner, "w") as other:
            other.writestr("d.txt", b"text")
        archive.writestr("a/c.zip", inner.getvalue())
    with tarfile.open(tarred, "w:gz") as archive_file:
        for name in ("a" * 150, "b/c"):
            member = tarfile.TarInfo(name)
            member.size = 400
            archive_file.addfile(member, io.BytesIO(b"text" * 100))
    return {
        "zip": Kind(zipped, lambda path, out: _call(unpack, path, out / "unpacked")),
        "tar": Kind(tarred, lambda path, out: _call(unpack, path, out / "unpacked")),
    }


def _image(i: int) -> tuple[UInt8, NDArray[np.uint16]]:
    frame = make_frames(i + 1)[i]
    depth = np.nan_to_num(1000 * frame.depth).astype(np.uint16)
    return frame.color, depth


def _seven_scenes(folder: Path) -> Path:
    folder.mkdir()
    for i in range(3):
        color, depth = (np.asarray(cv2.resize(image, (640, 480))) for image in _image(i))
        cv2.imwrite(str(folder / f"frame-{i:06d}.color.jpg"), color)
        cv2.imwrite(str(folder / f"frame-{i:06d}.depth.png"), depth)
        np.savetxt(folder / f"frame-{i:06d}.pose.txt", np.eye(4))
    (folder / "camera-intrinsics.txt").write_text("585 0 320\n0 585 240\n0 0 1\n")
    return folder


def _icl(folder: Path) -> Path:
    for part in ("rgb", "depth"):
        (folder / part).mkdir(parents=True)
    lines, truth = "", ""
    for i in range(3):
        color, depth = (np.asarray(cv2.resize(image, (640, 480))) for image in _image(i))
        cv2.imwrite(str(folder / f"rgb/{i}.png"), color)
        cv2.imwrite(str(folder / f"depth/{i}.png"), depth)
        lines += f"{i} depth/{i}.png {i} rgb/{i}.png\n"
        truth += f"{i} 0 0 {i / 10} 0 0 0 1\n"
    (folder / "associations.txt").write_text(lines)
    (folder / "traj.gt.freiburg").write_text(truth)
    return folder


def _arrays(folder: Path) -> Path:
    for part in ("color", "depth"):
        (folder / part).mkdir(parents=True)
    for i in range(3):
        color, depth = _image(i)
        np.save(folder / f"color/{i}.npy", color)
        np.save(folder / f"depth/{i}.npy", depth.astype(np.float32) / 1000)
    (folder / "K.txt").write_text("60 0 31.5\n0 61 23.5\n0 0 1\n")
    return folder


def _association(folder: Path) -> Path:
    """With images and truth in other forms than those of data sets."""
    for part in ("rgb", "depth"):
        (folder / part).mkdir(parents=True)
    lines = ""
    for i in range(3):
        color, depth = _image(i)
        cv2.imwrite(str(folder / f"rgb/{i}.ppm"), color)
        cv2.imwrite(str(folder / f"depth/{i}.tiff"), depth)
        lines += f"{i + 1}.5 rgb/{i}.ppm {i + 1}.51 depth/{i}.tiff\n"
    (folder / "associations.txt").write_text(lines)
    (folder / "poses.txt").write_text(3 * "1 0 0 0 0 1 0 0 0 0 1 0\n")
    (folder / "K.txt").write_text("60 0 31.5\n0 61 23.5\n0 0 1\n")
    return folder


_FOLDERS = {
    "7-Scenes": _seven_scenes,
    "ICL": _icl,
    "arrays": _arrays,
    "association": _association,
}


def _main(*words: object) -> int:
    return main([*map(str, words), "--debug"])


def _convert(path: Path, out: Path) -> int:
    return _main("convert", path, out / "converted")


def _with_calibration(recording: Path, path: Path, out: Path) -> int:
    return _main("convert", recording, out / "converted", "--calibration", path)


def _call(function: Callable[..., object], *arguments: object) -> int:
    try:
        function(*arguments)
    except InputError as error:
        sys.stderr.write(f"rgbd-glue: {error}\n")
        return BAD_INPUT
    return OK


def damaged(path: Path, random: np.random.Generator) -> str:
    """Damages a file, or some of a folder's, once or a few times; what was done."""
    files = sorted(p for p in path.rglob("*") if p.is_file()) if path.is_dir() else [path]
    done = []
    for _ in range(random.integers(1, 4)):
        file = files[random.integers(len(files))]
        name, change = _CHANGES[random.integers(len(_CHANGES))]
        file.write_bytes(bytes(change(bytearray(file.read_bytes()), random)))
        done.append(f"{name} in {file.name}")
    return ", ".join(done)


def _at(data: bytearray, random: np.random.Generator) -> int:
    """Somewhere; beginnings and ends, which hold headers and indices, more often."""
    place = random.integers(3)
    size = len(data)
    if place == 0:
        return int(random.integers(min(size, 400) + 1))
    return (
        max(0, size - int(random.integers(400))) if place == 1 else int(random.integers(size + 1))
    )


def _cut(data: bytearray, random: np.random.Generator) -> bytearray:
    return data[: _at(data, random)]


def _flip(data: bytearray, random: np.random.Generator) -> bytearray:
    for _ in range(random.integers(1, 9)):
        if data:
            data[min(_at(data, random), len(data) - 1)] ^= 1 << int(random.integers(8))
    return data


def _noise(data: bytearray, random: np.random.Generator) -> bytearray:
    start = _at(data, random)
    data[start : start + 16] = random.bytes(int(random.integers(1, 64)))
    return data


def _number(data: bytearray, random: np.random.Generator) -> bytearray:
    start, size = _at(data, random), int(random.choice([1, 2, 4, 8]))
    value = _NUMBERS[random.integers(len(_NUMBERS))] % 256**size
    data[start : start + size] = value.to_bytes(size, "little" if random.integers(4) else "big")
    return data


def _word(data: bytearray, random: np.random.Generator) -> bytearray:
    words = bytes(data).split(b" ")
    words[random.integers(len(words))] = _WORDS[random.integers(len(_WORDS))]
    return bytearray(b" ".join(words))


def _insert(data: bytearray, random: np.random.Generator) -> bytearray:
    start = _at(data, random)
    data[start:start] = _WORDS[random.integers(len(_WORDS))]
    return data


def _line(data: bytearray, random: np.random.Generator) -> bytearray:
    lines = bytes(data).split(b"\n")
    i, j = random.integers(len(lines), size=2)
    lines[i] = lines[j]
    return bytearray(b"\n".join(lines))


def _repeat(data: bytearray, random: np.random.Generator) -> bytearray:
    start = _at(data, random)
    part = data[start : start + int(random.integers(1, 4000))]
    data[start:start] = part * int(random.integers(1, 50))
    return data


def _remove(data: bytearray, random: np.random.Generator) -> bytearray:
    start = _at(data, random)
    del data[start : start + int(random.integers(1, 64))]
    return data


_CHANGES: list[tuple[str, Callable[[bytearray, np.random.Generator], bytearray]]] = [
    *(("a cut", _cut), ("flipped bits", _flip), ("noise", _noise), ("a number", _number)),
    *(("a word", _word), ("an insertion", _insert), ("a line twice", _line)),
    *(("a part repeated", _repeat), ("a part removed", _remove)),
]


def tried(kind: str, whole: Kind, folder: Path, random: np.random.Generator) -> Outcome:
    """Damages a copy of what is whole in a folder of its own, and reads it."""
    folder.mkdir()
    copy = folder / whole.path.name
    (shutil.copytree if whole.path.is_dir() else shutil.copyfile)(whole.path, copy)
    damage = f"{kind}: {damaged(copy, random)}"
    heard = io.StringIO()
    code: int | None = None
    fault = ""
    before = _memory_mb()
    try:
        with _heard(heard), _limited():
            code = whole.read(copy, folder)
    except TooLongError:
        fault = f"takes longer than {MOST_S} s"
    except BaseException as error:  # noqa: BLE001 - whatever it raises is a fault
        fault = f"raises {error!r}"
    said = heard.getvalue()
    if _memory_mb() - before > MOST_MB:
        fault = fault or f"takes more than {MOST_MB} MB"
    return Outcome(damage, code, said, fault or _wrong(code, said))


def _wrong(code: int | None, said: str) -> str:
    errors = [line for line in said.splitlines() if line.startswith("rgbd-glue: ")]
    if code not in (OK, BAD_INPUT):
        return f"ends with code {code}"
    if len(errors) > 1 or not all(line.isprintable() for line in errors):
        return f"says {errors}"
    return ""


@contextmanager
def _heard(stream: io.StringIO) -> Iterator[None]:
    """Standard output and error go there, and tracebacks from the log."""
    handler = logging.StreamHandler(stream)
    logging.getLogger().addHandler(handler)
    logging.disable(logging.WARNING)
    try:
        with redirect_stdout(io.StringIO()), redirect_stderr(stream):
            yield
    finally:
        logging.disable(logging.NOTSET)
        logging.getLogger().removeHandler(handler)


@contextmanager
def _limited() -> Iterator[None]:
    def end(_number: int, _frame: FrameType | None) -> None:
        raise TooLongError

    before = signal.signal(signal.SIGALRM, end)
    signal.alarm(MOST_S)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def _memory_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024

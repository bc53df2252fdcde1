"""Files that input names may be anything: none of them is waited for, and none is read for ever."""

from __future__ import annotations

import errno
import os
import re
import struct
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from rigs.paths import ROOT

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.files.bounded_yaml import document
from rgbd_glue_ros.files.reading import inside, open_file, read_bytes
from rgbd_glue_ros.parameters import Config, load_yaml
from rgbd_glue_ros.recordings import open_recording, read_calibration
from rgbd_glue_ros.recordings.image_sequence import read_image
from rgbd_glue_ros.recordings.sens import SensSequence
from rgbd_glue_ros.trajectories.tum import read_tum


def pipe(folder: Path) -> Path:
    os.mkfifo(folder / "pipe")
    return folder / "pipe"


def link_to_zeros(folder: Path) -> Path:
    (folder / "zeros.png").symlink_to("/dev/zero")
    return folder / "zeros.png"


PLACES: dict[str, Callable[[Path], Path]] = {
    "a pipe that nobody writes to": pipe,
    "a device that never ends": lambda _: Path("/dev/zero"),
    "a link to one": link_to_zeros,
    "a folder": lambda folder: folder,
    "a name with a zero in it": lambda folder: folder / "a\0b",
    "nothing": lambda folder: folder / "nothing",
}
READERS: dict[str, Callable[[Path], object]] = {
    "trajectory": read_tum,
    "calibration": read_calibration,
    "parameters": lambda path: load_yaml(path, Config()),
    "image": read_image,
    "sensor stream": SensSequence,
}


def test_of_a_file_that_may_not_be_read_the_permission_is_asked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> int:
        # no bits of the file would do: the superuser may read it all the same
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))

    monkeypatch.setattr(os, "open", refuse)
    with pytest.raises(InputError, match=r"\(Permission denied\); give read permission for the"):
        open_file(tmp_path / "room.rgbdmap")


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("reader", READERS)
def test_what_is_no_regular_file_is_refused_at_once(
    reader: str, place: str, tmp_path: Path
) -> None:
    path = PLACES[place](tmp_path)
    with pytest.raises(InputError, match=r"is not a regular file|cannot be read"):
        READERS[reader](path)


def test_a_file_larger_than_it_may_be_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "sparse"
    with path.open("wb") as file:
        file.truncate(2**40)
    with pytest.raises(InputError, match="more than 1000 bytes"):
        read_bytes(path, 1000)
    with pytest.raises(InputError, match="more than 268435456 bytes"):
        read_tum(path)


@pytest.mark.parametrize(
    "name", ["/etc/passwd", "../../etc/passwd", "rgb/../../x.png", "..", "a\0b"]
)
def test_a_list_names_nothing_outside_of_its_folder(name: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="is outside it"):
        inside(tmp_path, name)


def test_a_link_leads_out_of_a_folder_and_dots_within_it_do_not(tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / "0.png").write_bytes(b"image")
    folder = tmp_path / "folder"
    folder.mkdir()
    (folder / "rgb").symlink_to("../elsewhere")
    for name in ("rgb/0.png", "depth/../rgb/0.png", str(folder / "rgb/0.png")):
        assert read_bytes(inside(folder, name), 10) == b"image"


def test_a_recording_that_lists_a_device_is_refused(tmp_path: Path) -> None:
    (tmp_path / "rgb.txt").write_text("1.0 /dev/zero.png\n")
    (tmp_path / "depth.txt").write_text("1.0 depth/0.png\n")
    with pytest.raises(InputError, match=r"/dev/zero\.png"):
        open_recording(tmp_path)


BOMBS = {
    "aliases of aliases": "a0: &a0 [x, x]\n"
    + "".join(f"a{i}: &a{i} [*a{i - 1}, *a{i - 1}]\n" for i in range(1, 30)),
    "merged mappings": "a0: &a0 {x: 1}\n"
    + "".join(f"a{i}: &a{i} {{<<: [*a{i - 1}, *a{i - 1}]}}\n" for i in range(1, 30)),
    "an alias in itself": "a: &a [*a]",
    "deep lists": "[" * 100_000,
    "deep mappings": "{a: " * 100_000,
    "a number of a million digits": f"a: {'9' * 900_000}",
    "a date that is none": "a: 2001-99-99",
    "two million characters": "a" * 2_000_000,
}


@pytest.mark.parametrize("bomb", BOMBS)
def test_yaml_that_stands_for_more_than_it_holds_is_refused(bomb: str, tmp_path: Path) -> None:
    path = tmp_path / "camera.yaml"
    path.write_text(BOMBS[bomb])
    with pytest.raises(yaml.YAMLError):
        document(BOMBS[bomb])
    with pytest.raises(InputError):
        read_calibration(path)


def test_a_name_that_is_given_twice_is_refused_with_both_lines() -> None:
    for text, said in {
        "a: 1\nb: 2\na: 3": "line 3: a is also given in line 1",
        "x:\n  - {b: 1, c: 2,\n     b: 1}": "line 3: b is also given in line 2",
    }.items():
        with pytest.raises(yaml.YAMLError, match=said):
            document(text)
    # what is merged may be given anew, and one name in two places
    merged = "a: &a {x: 1, y: 2}\nb: &b {<<: *a, y: 3}\nc: {<<: *b, x: 4}"
    assert document(merged)["c"] == {"x": 4, "y": 3}


def test_aliases_of_a_few_values_are_read() -> None:
    assert document("a: &a [1, 2]\nb: *a\nc: {d: *a}") == {
        "a": [1, 2],
        "b": [1, 2],
        "c": {"d": [1, 2]},
    }


@pytest.mark.parametrize(
    "header",
    [
        "{'descr': '<u2', 'fortran_order': False, 'shape': (1000000, 1000000), }",
        "{'descr': '|O', 'fortran_order': False, 'shape': (1, 1), }",
        "{'descr': '<u2', 'fortran_order': False, 'shape': (-1, 4), }",
    ],
)
def test_an_array_that_claims_more_than_its_file_holds_is_refused(
    header: str, tmp_path: Path
) -> None:
    path = tmp_path / "depth.npy"
    path.write_bytes(b"\x93NUMPY\1\0" + struct.pack("<H", len(header)) + header.encode() + bytes(8))
    with pytest.raises(InputError, match="holds no array"):
        read_image(path)


def test_a_sensor_stream_of_zeros_has_no_frames(tmp_path: Path) -> None:
    head = struct.pack("<IQ", 4, 0)
    numbers = [0.0] * 32 + [500, 0, 320, 0, 0, 500, 240, 0, 0, 0, 1, 0, 0, 0, 0, 1] + [0.0] * 16
    head += struct.pack("<64f2i4IfQ", *numbers, 2, 1, 640, 480, 640, 480, 1000.0, 2**60)
    path = tmp_path / "zeros.sens"
    with path.open("wb") as file:
        file.write(head)
        file.truncate(2**34)
    with pytest.raises(InputError, match="holds no complete frame"):
        SensSequence(path)


def test_a_file_that_is_read_is_closed(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"x")
    before = len(os.listdir("/proc/self/fd"))  # noqa: PTH208 - descriptors are no files
    for _ in range(3):
        with pytest.raises(InputError):
            open_file(tmp_path)
        read_bytes(tmp_path / "file", 1)
    assert len(os.listdir("/proc/self/fd")) == before  # noqa: PTH208


@pytest.mark.parametrize(
    "content", ["#EXTM3U\n#EXTINF:1,\n/etc/passwd\n", "ffconcat version 1.0\n"]
)
def test_a_list_of_videos_is_no_video(content: str, tmp_path: Path) -> None:
    """FFmpeg would open what it names, also on the network."""
    (tmp_path / "depth").mkdir()
    assert cv2.imwrite(str(tmp_path / "depth/000000.png"), np.ones((48, 64), np.uint16))
    (tmp_path / "camera_matrix.csv").write_text("60, 0, 31.5\n0, 61, 23.5\n0, 0, 1\n")
    (tmp_path / "rgb.mp4").write_text(content)
    with pytest.raises(InputError, match=r"rgb\.mp4: is not an MP4 video"):
        open_recording(tmp_path)


STAND_INS = {
    "a pointer": b"version https://git-lfs.github.com/spec/v1\noid sha256:4d7a214614\nsize 12345\n",
    "a page": b"\n<!DOCTYPE html><html><head><title>Virus scan warning</title></head></html>",
    "a page after a mark": b"\xef\xbb\xbf<HTML>\n<body>Please log in</body></HTML>",
    "an error": b'<?xml version="1.0" encoding="UTF-8"?>\n<Error><Code>AccessDenied</Code></Error>',
}
STAND_IN_SAID = (
    r"is a (pointer of Git LFS|web page) in place of the file; download the file again, from a "
    r"clone by: git lfs pull$"
)


@pytest.mark.parametrize("kind", STAND_INS)
@pytest.mark.parametrize(
    "name",
    ["run.bag", "run.mcap", "run.db3", "run", "scan.sens", "folder/run_0.mcap", "set/rgb.zip"],
)
def test_what_was_downloaded_in_place_of_a_recording_is_said(
    kind: str, name: str, tmp_path: Path
) -> None:
    path = tmp_path / name
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(STAND_INS[kind])
    with pytest.raises(InputError, match=STAND_IN_SAID) as error:
        open_recording(path.parent if name.startswith("folder") else path)
    assert error.value.where == str(path)


@pytest.mark.parametrize("kind", STAND_INS)
def test_what_was_downloaded_in_place_of_images_videos_and_texts_is_said(
    kind: str, tmp_path: Path
) -> None:
    for i in range(3):
        for place in ("rgb", "depth"):
            (tmp_path / place).mkdir(exist_ok=True)
            (tmp_path / f"{place}/{i}.png").write_bytes(STAND_INS[kind])
    (tmp_path / "K.txt").write_text("60 0 31.5\n0 61 23.5\n0 0 1\n")
    with pytest.raises(InputError, match=rf"rgb/0\.png: {STAND_IN_SAID}"):
        open_recording(tmp_path)
    (tmp_path / "poses.txt").write_bytes(STAND_INS[kind])
    for read in (read_tum, read_calibration):
        with pytest.raises(InputError, match=rf"poses\.txt: {STAND_IN_SAID}"):
            read(tmp_path / "poses.txt")
    scan = tmp_path / "scan"
    (scan / "depth").mkdir(parents=True)
    assert cv2.imwrite(str(scan / "depth/000000.png"), np.ones((48, 64), np.uint16))
    (scan / "camera_matrix.csv").write_text("60, 0, 31.5\n0, 61, 23.5\n0, 0, 1\n")
    (scan / "rgb.mp4").write_bytes(STAND_INS[kind])
    with pytest.raises(InputError, match=rf"rgb\.mp4: {STAND_IN_SAID}"):
        open_recording(scan)


# What reads files of its own, or of the system, and none that input names
_OWN = {"code_cache.py", "download.py", "fetch.py", "weights.py", "writer.py", "map_file.py"}
_READS = re.compile(r"\.read_text\(|\.read_bytes\(|safe_load|loadtxt|imread\(|np\.load\(")


def test_what_input_names_is_read_by_the_one_reader() -> None:
    package = ROOT / "rgbd_glue_ros"
    found = {
        path.name
        for part in (
            "parameters",
            "messages",
            "evaluation",
            "recordings",
            "live",
            "slam",
            "features",
        )
        for path in (package / part).rglob("*.py")
        if path.name not in _OWN and _READS.search(path.read_text())
    }
    assert not found

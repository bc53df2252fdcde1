"""A folder of recordings stands for all of them, and a split for those that it names."""

from __future__ import annotations

from pathlib import Path

import pytest

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.recordings import open_recording, recordings, split
from rgbd_glue_ros.recordings.collection import SPLITS


def touch(path: Path) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(b"")
    return path


@pytest.fixture
def scenes(tmp_path: Path) -> Path:
    """The folders of 3DMatch: scenes of sequences, with the camera beside these."""
    for scene in ("7-scenes-chess", "7-scenes-redkitchen", "sun3d-hotel_uc-scan3"):
        touch(tmp_path / scene / "camera-intrinsics.txt")
        for sequence in ("seq-01", "seq-02"):
            touch(tmp_path / scene / sequence / "frame-000000.color.png")
    return tmp_path


def test_a_recording_stands_for_itself_and_a_folder_for_those_below(scenes: Path) -> None:
    one = scenes / "7-scenes-chess" / "seq-02"
    assert recordings([one]) == [one]
    assert recordings([scenes / "7-scenes-chess"]) == [one.with_name("seq-01"), one]
    assert len(recordings([scenes])) == 6
    assert recordings([one, scenes / "7-scenes-chess"]) == [one, one.with_name("seq-01")]


def test_streams_bags_and_folders_are_found_and_other_files_are_not(tmp_path: Path) -> None:
    stream = touch(tmp_path / "scans" / "scene0707_00" / "scene0707_00.sens")
    touch(tmp_path / "scans" / "scene0707_00" / "scene0707_00.txt")
    tum = touch(tmp_path / "tum" / "fr1" / "rgb.txt").parent
    touch(tum / "depth.txt")
    bag = touch(tmp_path / "bags" / "desk" / "desk_0.mcap").parent
    touch(tmp_path / "notes" / "text.txt")
    touch(tmp_path / ".cache" / "desk_0.mcap")
    assert recordings([tmp_path]) == [bag, stream.parent, tum]


def test_what_holds_no_recording_is_left_for_the_opener_to_refuse(tmp_path: Path) -> None:
    (path,) = recordings([tmp_path])
    with pytest.raises(InputError, match="is not a recording in a known format"):
        open_recording(path)


def test_a_split_restricts_them_by_scene_scan_or_sequence(scenes: Path) -> None:
    kitchen = scenes / "7-scenes-redkitchen"
    test = recordings([scenes], split("3dmatch-test"))
    assert {path.parent for path in test} == {kitchen, scenes / "sun3d-hotel_uc-scan3"}
    assert recordings([scenes], frozenset({"7-scenes-redkitchen/seq-02"})) == [kitchen / "seq-02"]
    stream = touch(scenes / "scene0707_00.sens")
    touch(scenes / "scene0706_00.sens")
    assert recordings([scenes], split("scannet-v2-test")) == [stream]


def test_the_official_splits_have_the_size_that_is_published() -> None:
    sizes = {name: len(names) for name, names in SPLITS.items()}
    assert sizes == {"3dmatch-test": 8, "7-scenes-test": 18, "scannet-v2-test": 100}


def test_a_split_may_be_a_file_of_names(scenes: Path) -> None:
    names = scenes / "names.txt"
    names.write_text("7-scenes-chess\n\n  unknown \n")
    assert split(str(names)) == {"7-scenes-chess", "unknown"}
    assert {p.parent.name for p in recordings([scenes], split(str(names)))} == {"7-scenes-chess"}


def test_names_that_are_nowhere_and_splits_that_are_none_are_refused(scenes: Path) -> None:
    with pytest.raises(InputError, match="names none of the 6 recordings"):
        recordings([scenes], frozenset({"seq"}))
    with pytest.raises(InputError, match="one of 3dmatch-test"):
        split("3dmatch")
    with pytest.raises(InputError, match="holds no names"):
        split(str(touch(scenes / "empty.txt")))

"""Saving a map never costs another one."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest
from rigs.maps import map_of

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.files.writing import write_whole
from rgbd_glue_ros.slam.map_file import read_map
from rgbd_glue_ros.slam.map_saving import MapSaving


def sizes(folder: Path) -> dict[str, int]:
    """Numbers of keyframes of all maps in a folder, by the names of their files."""
    return {path.name: len(read_map(path)) for path in folder.iterdir()}


def test_the_file_of_another_map_is_kept_beside_the_new_one_and_that_is_said(
    tmp_path: Path,
) -> None:
    room, before, after = tmp_path / "room.rgbdmap", MapSaving(), MapSaving()
    assert before.save(room, map_of(4)) == f"{room}: 4 keyframes"
    said = after.save(room, map_of(2))
    assert said == (
        f"{room}: 2 keyframes; the file that was there, of another map, is kept as {room}.bak"
    )
    assert sizes(tmp_path) == {"room.rgbdmap": 2, "room.rgbdmap.bak": 4}


def test_a_map_that_is_saved_again_replaces_its_own_file_and_leaves_the_kept_one(
    tmp_path: Path,
) -> None:
    room, saving = tmp_path / "room.rgbdmap", MapSaving()
    MapSaving().save(room, map_of(4))
    saving.save(room, map_of(1))
    assert saving.save(room, map_of(2)) == f"{room}: 2 keyframes"
    assert sizes(tmp_path) == {"room.rgbdmap": 2, "room.rgbdmap.bak": 4}


def test_what_another_node_wrote_meanwhile_is_kept(tmp_path: Path) -> None:
    room, saving, other = tmp_path / "room.rgbdmap", MapSaving(), MapSaving()
    saving.save(room, map_of(1))
    other.save(room, map_of(5))
    assert f"kept as {room}.bak" in saving.save(room, map_of(2))
    assert sizes(tmp_path) == {"room.rgbdmap": 2, "room.rgbdmap.bak": 5}


def test_without_links_the_replaced_file_is_renamed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> None:
        raise OSError(errno.EPERM, "no links on this file system")

    monkeypatch.setattr(os, "link", refuse)
    file, kept = tmp_path / "file", tmp_path / "kept"
    for content in ("first", "second", "third"):
        write_whole(file, content, kept)
    assert (file.read_text(), kept.read_text()) == ("third", "second")
    assert sorted(tmp_path.iterdir()) == [file, kept]


def test_what_cannot_be_written_costs_neither_the_file_nor_the_one_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fill(_: int) -> None:
        raise OSError(errno.ENOSPC, "the disk is full")

    file, kept = tmp_path / "file", tmp_path / "kept"
    file.write_text("first")
    kept.write_text("earlier")
    monkeypatch.setattr(os, "fsync", fill)
    with pytest.raises(InputError, match="the disk is full"):
        write_whole(file, "second", kept)
    assert (file.read_text(), kept.read_text()) == ("first", "earlier")
    assert sorted(tmp_path.iterdir()) == [file, kept]

"""Paths as users write them, and texts that are none."""

from __future__ import annotations

from pathlib import Path

import pytest

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.files.user_paths import expanded, file_to_write


def test_a_tilde_is_the_home_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    assert expanded("~/room.rgbdmap", "map_file") == tmp_path / "room.rgbdmap"


def test_the_home_of_nobody_is_refused_by_its_name() -> None:
    with pytest.raises(InputError, match=r"^map_file: ~nobodyhere has no home folder; give the wh"):
        expanded("~nobodyhere/room.rgbdmap", "map_file")


@pytest.mark.parametrize("text", ["", "/", ".", "a\0b"])
def test_a_text_that_names_no_file_is_refused(text: str) -> None:
    with pytest.raises(InputError, match=r"^graph_file: .*names no file; give the path of a file"):
        file_to_write(text, "graph_file")


def test_the_folders_of_a_file_are_made_and_what_is_in_their_place_is_told(tmp_path: Path) -> None:
    path = tmp_path / "new" / "folder" / "graph.g2o"
    assert file_to_write(str(path), "graph_file") == path
    assert path.parent.is_dir()
    path.write_text("a file")
    with pytest.raises(InputError, match=r"the folder of .* cannot be created \(Not a directory\)"):
        file_to_write(str(path / "inside" / "graph.g2o"), "graph_file")

"""Files that are whole or as they were."""

from __future__ import annotations

import resource
from pathlib import Path

import pytest

from rgbd_glue_ros.whole_files import write_whole


def test_a_text_that_does_not_fit_on_the_disk_leaves_the_file_as_it_was(tmp_path: Path) -> None:
    path = tmp_path / "metrics.json"
    write_whole(path, "before\n")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, hard))
    try:
        with pytest.raises(OSError, match="File too large"):
            write_whole(path, "after\n" * 10_000)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert path.read_text() == "before\n"
    assert [file.name for file in tmp_path.iterdir()] == ["metrics.json"]
    write_whole(path, "after\n")
    assert path.read_text() == "after\n"

"""Compiled code that an older version left behind is not met by a newer one."""

from __future__ import annotations

import os
from pathlib import Path

from rgbd_glue_ros.compiled import forget_stale_code


def test_an_index_older_than_a_source_beside_it_goes_and_a_newer_one_stays(tmp_path: Path) -> None:
    indices = {}
    for name, age_s in (("old", 20), ("new", 0)):
        cache = tmp_path / name / "__pycache__"
        cache.mkdir(parents=True)
        source, indices[name] = tmp_path / name / "kernel.py", cache / "kernel.add-1.py311.nbi"
        for path, modified in ((source, 1_000_010), (indices[name], 1_000_020 - age_s)):
            path.touch()
            os.utime(path, (modified, modified))
    forget_stale_code(tmp_path)
    assert not indices["old"].exists()
    assert indices["new"].exists()

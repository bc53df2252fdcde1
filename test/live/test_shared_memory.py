"""The shared memory that the DDS profile takes."""

from __future__ import annotations

from rgbd_glue_ros.live.shared_memory import SHARED_MEMORY, explain_shared_memory
from rgbd_glue_ros.parameters import profiles_file

MB = 2**20


def test_too_little_shared_memory_of_a_container_is_reported_with_the_remedy() -> None:
    profiles = profiles_file().read_text(encoding="utf-8")
    line = explain_shared_memory(profiles, 63 * MB)
    assert line is not None
    assert f"{SHARED_MEMORY} holds 63 MB" in line
    assert "needs 32 MB" in line
    assert "--shm-size=" in line
    assert explain_shared_memory(profiles, 256 * MB) is None
    assert explain_shared_memory("", 0) is None

"""ICL-NUIM as published: numbered frames, and a truth that is the mirror image of the pictures."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from rigs.geometry import random_transform, room_points

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.recordings import open_recording
from rgbd_glue_ros.recordings.icl_nuim import CAMERA, mirrored


def write(folder: Path, numbers: tuple[int, ...] = (1, 2, 10), first_pose: int = 2) -> Path:
    """The office: images from 1 on, poses from 2 on."""
    for part in ("rgb", "depth"):
        (folder / part).mkdir(parents=True)
    for i in numbers:
        cv2.imwrite(str(folder / f"rgb/{i}.png"), np.full((480, 640, 3), 9, np.uint8))
        cv2.imwrite(str(folder / f"depth/{i}.png"), np.full((480, 640), 5000 * i, np.uint16))
    lines = [f"{i} depth/{i}.png {i} rgb/{i}.png\n" for i in numbers]
    (folder / "associations.txt").write_text("".join(lines))
    poses = [f"{i} {0.1 * i} 1 -2.5 0 0 0 1\n" for i in numbers if i >= first_pose]
    (folder / "traj0.gt.freiburg").write_text("".join(poses))
    return folder


def test_numbered_frames_are_a_thirtieth_of_a_second_apart(tmp_path: Path) -> None:
    with open_recording(write(tmp_path / "traj0_frei_png")) as sequence:
        frames = list(sequence)
        truth = sequence.ground_truth
    assert [frame.stamp_ns for frame in frames] == [66666666, 100000000, 366666666]
    assert [frame.depth[0, 0] for frame in frames] == [1.0, 2.0, 10.0]
    assert frames[0].intrinsics == CAMERA
    assert truth is not None
    assert list(truth.stamps_ns) == [100000000, 366666666]
    np.testing.assert_allclose(truth.poses[0][:3, 3], [0.2, -1, -2.5])


def test_mirrored_poses_map_mirrored_points_as_the_poses_map_the_points() -> None:
    rng = np.random.default_rng(0)
    T, points = random_transform(rng), room_points(rng, 5)
    flip = np.array([1.0, -1.0, 1.0])
    (M,) = mirrored(T[None])
    np.testing.assert_allclose(se3.transform(M, points * flip), se3.transform(T, points) * flip)
    assert np.linalg.det(M[:3, :3]) == pytest.approx(1.0)


def test_lines_that_are_no_frame_are_skipped_and_either_image_may_come_first(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    folder = write(tmp_path / "traj0_frei_png")
    lines = ["# comment", "1 rgb/1.png 1 depth/1.png", "2 depth/2.png", "", "a b c d"]
    (folder / "associations.txt").write_text("\n".join([*lines, "10 rgb/10.png 10 depth/10.png 7"]))
    with open_recording(folder) as sequence:
        assert [frame.depth[0, 0] for frame in sequence] == [1.0, 10.0]
    assert "2 lines name no image and were skipped" in caplog.text
    (folder / "associations.txt").write_text("")
    with pytest.raises(InputError, match="holds no lines of stamp, file, stamp, file"):
        open_recording(folder)

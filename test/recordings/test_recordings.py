"""Every kind of data set is found out and read; what is wrong with one is said."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from rgbd_glue_ros.cli.main import main
from rgbd_glue_ros.errors import BAD_INPUT, InputError
from rgbd_glue_ros.recordings import (
    Topics,
    imu_of,
    open_recording,
    read_calibration,
    refuse_recording,
)
from rgbd_glue_ros.recordings.folder.lists import read_association
from rgbd_glue_ros.recordings.left_out import LeftOut, left_out_of
from rgbd_glue_ros.types import CameraIntrinsics, UInt8

CAMERA = CameraIntrinsics(64, 48, 60.0, 61.0, 31.5, 23.5)
RED, BLUE = (255, 0, 0), (0, 0, 255)


def write_color(path: Path, rgb: tuple[int, int, int]) -> None:
    image: UInt8 = np.full((48, 64, 3), rgb[::-1], np.uint8)
    assert cv2.imwrite(str(path), image)


def write_depth(path: Path, units: int) -> None:
    depth = np.full((48, 64), units, np.uint16)
    depth[0, :2] = (0, 65535)
    assert cv2.imwrite(str(path), depth)


def write_tum_folder(folder: Path, frames: int = 3) -> Path:
    """Frames 0.1 s apart, depth 5 ms after colour, a metre more each."""
    (folder / "rgb").mkdir(parents=True)
    (folder / "depth").mkdir()
    color, depth = ["# color images"], ["# depth maps"]
    for i in range(frames):
        write_color(folder / f"rgb/{i}.png", RED)
        write_depth(folder / f"depth/{i}.png", 5000 * (i % 10 + 1))
        color.append(f"{1305031453 + i / 10:.6f} rgb/{i}.png")
        depth.append(f"{1305031453 + i / 10 + 0.005:.6f} depth/{i}.png")
    (folder / "rgb.txt").write_text("\n".join(color) + "\n")
    (folder / "depth.txt").write_text("\n".join(depth) + "\n")
    (folder / "groundtruth.txt").write_text("1305031453.0 1 2 3 0 0 0 1\n")
    return folder


def write_seven_scenes_folder(folder: Path, numbers: tuple[int, ...] = (0, 1, 3)) -> Path:
    folder.mkdir(parents=True)
    for i in numbers:
        write_color(folder / f"frame-{i:06d}.color.png", BLUE)
        write_depth(folder / f"frame-{i:06d}.depth.png", 1500)
        np.savetxt(folder / f"frame-{i:06d}.pose.txt", np.diag([1.0, 1, 1, 1]))
    return folder


def test_a_tum_folder_gives_rgb_metres_and_the_stamps_of_its_colour_images(tmp_path: Path) -> None:
    with open_recording(write_tum_folder(tmp_path / "desk"), calibration=CAMERA) as sequence:
        frames = list(sequence)
        assert sequence.name == "desk"
        assert sequence.frame_count == 3
        assert sequence.ground_truth is not None
        np.testing.assert_array_equal(sequence.ground_truth.poses[0][:3, 3], [1, 2, 3])
    stamps = [1305031453_000000000 + i * 100_000_000 for i in range(3)]
    assert [frame.stamp_ns for frame in frames] == stamps
    assert (frames[0].color == RED).all()
    assert [frame.depth[1, 1] for frame in frames] == [1.0, 2.0, 3.0]
    assert np.isnan(frames[0].depth[0, 0])
    assert np.isnan(frames[0].depth[0, 1])
    assert frames[0].intrinsics == CAMERA


def test_a_sequence_can_be_iterated_again_and_left_in_the_middle(tmp_path: Path) -> None:
    with open_recording(write_tum_folder(tmp_path, 20), calibration=CAMERA) as sequence:
        next(iter(sequence))
        assert len(list(sequence)) == 20


def test_colour_and_depth_are_paired_one_to_one(tmp_path: Path) -> None:
    folder = write_tum_folder(tmp_path / "desk")
    # two colour images 10 ms apart, and only one depth image near both
    (folder / "rgb.txt").write_text("1.000 rgb/0.png\n1.010 rgb/1.png\n2.0 rgb/2.png\n")
    (folder / "depth.txt").write_text("1.008 depth/0.png\n2.021 depth/1.png\n")
    frames = list(open_recording(folder, calibration=CAMERA))
    assert [frame.stamp_ns for frame in frames] == [1_010_000_000]


def test_lines_that_repeat_a_stamp_are_skipped_counted_and_said(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    folder = write_tum_folder(tmp_path / "freiburg1", frames=4)
    for name in ("rgb.txt", "depth.txt"):
        lines = (folder / name).read_text().splitlines()
        (folder / name).write_text("".join(f"{line}\n" * 2 for line in lines))
    with open_recording(folder, calibration=CAMERA) as sequence:
        assert sequence.frame_count == 4
        stamps = [frame.stamp_ns for frame in sequence]
        left_out = left_out_of(sequence)
    assert stamps == sorted(set(stamps))
    assert left_out == LeftOut({"color": 4, "depth": 4}, {"color": 0, "depth": 0}, duplicates=4)
    assert caplog.text.count("images that repeat a stamp and were left out: 4") == 1


def test_an_association_that_lists_a_frame_twice_gives_it_once(tmp_path: Path) -> None:
    folder = write_tum_folder(tmp_path / "freiburg1", frames=4)
    rows = [f"{i}.0 rgb/{i}.png {i}.0 depth/{i}.png\n" for i in (0, 1, 1, 2, 3)]
    (folder / "associations.txt").write_text("".join(rows))
    found = read_association(folder / "associations.txt")
    assert [pair.color.name for pair in found.pairs] == ["0.png", "1.png", "2.png", "3.png"]
    assert found.left_out.duplicates == 1


def test_listed_images_without_a_partner_are_counted_and_told_from_a_tenth_on(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    folder = write_tum_folder(tmp_path / "freiburg1", frames=30)
    lines = (folder / "depth.txt").read_text().splitlines(keepends=True)
    for missing, is_said in ((2, False), (4, True)):
        (folder / "depth.txt").write_text("".join(lines[:10] + lines[10 + missing :]))
        caplog.clear()
        with open_recording(folder, calibration=CAMERA) as sequence:
            assert len(list(sequence)) == 30 - missing
            left_out = left_out_of(sequence)
        assert left_out.unpaired == {"color": missing, "depth": 0}
        said = f"{missing} of 30 color images have no partner near their stamp"
        assert (said in caplog.text) == is_said
    assert "the longest time without a frame is 0.50 s" in caplog.text


@pytest.mark.parametrize(
    ("name", "fx"),
    [
        ("rgbd_dataset_freiburg1_desk", 525.0),
        ("rgbd_dataset_freiburg3_structure_notexture_far", 535.4),
        ("icl_nuim_office_kt0", 481.2),
        ("living_room_traj2_frei_png", 481.2),
    ],
)
def test_a_tum_folders_name_tells_its_camera(tmp_path: Path, name: str, fx: float) -> None:
    sequence = open_recording(write_tum_folder(tmp_path / name))
    with pytest.raises(InputError, match="is 64x48, but the camera is 640x480"):
        next(iter(sequence))
    for file in (tmp_path / name).glob("*/*.png"):
        image = cv2.imread(str(file), cv2.IMREAD_UNCHANGED)
        cv2.imwrite(str(file), cv2.resize(image, (640, 480), interpolation=cv2.INTER_NEAREST))
    assert next(iter(sequence)).intrinsics.fx == fx


@pytest.mark.parametrize("name", ["fr1_desk", "my-freiburg1.bag", "FREIBURG1", "Living Room kt2"])
def test_a_camera_taken_by_name_is_logged_with_the_words_that_named_it(
    tmp_path: Path, name: str, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level("INFO")
    open_recording(write_tum_folder(tmp_path / name)).close()
    (said,) = [record.getMessage() for record in caplog.records]
    assert "no file describes its camera; taking that of" in said
    assert ("living_room_kt" if "kt2" in name else "freiburg1") in said
    assert "--calibration" in said


@pytest.mark.parametrize(
    "name", ["vehicle_run", "bicycle", "article", "fr12_desk", "xfreiburg1", "living_room", "aicl"]
)
def test_the_letters_of_a_data_set_inside_of_another_word_are_no_camera(
    tmp_path: Path, name: str
) -> None:
    with pytest.raises(InputError, match="no file there describes its camera"):
        open_recording(write_tum_folder(tmp_path / name))


def test_a_kinects_accelerometer_tells_which_way_is_up(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    folder = write_tum_folder(tmp_path / "freiburg1")
    assert imu_of(open_recording(folder)) is None
    # of the first line of freiburg1_desk, whose camera looks down by 43 degrees
    (folder / "accelerometer.txt").write_text(
        "# accelerometer data\n1305031449.564825 -0.083818 7.244229 -6.657506\n1305031449.6 x y\n"
    )
    imu = imu_of(open_recording(folder))
    assert imu is not None
    np.testing.assert_array_equal(imu.stamps_ns, [1305031449564825000])
    np.testing.assert_allclose(imu.linear_acceleration, [[0.083818, -7.244229, -6.657506]])
    assert np.isnan(imu.angular_velocity).all()
    assert "1 line holds no acceleration" in caplog.text


def test_a_tum_folder_of_an_unknown_camera_wants_a_calibration(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="--calibration"):
        open_recording(write_tum_folder(tmp_path / "kitchen"))


@pytest.mark.parametrize("missing", ["rgb.txt", "depth.txt"])
def test_a_tum_folder_without_one_of_its_lists_names_it(tmp_path: Path, missing: str) -> None:
    folder = write_tum_folder(tmp_path / "freiburg1")
    (folder / "groundtruth.txt").write_text("1305031453 0 0 0 0 0 0 1\n")
    (folder / missing).unlink()
    with pytest.raises(InputError, match=f"{missing}: cannot be read"):
        open_recording(folder)


def test_folders_of_images_of_any_name_are_read_where_they_are_named(tmp_path: Path) -> None:
    folder = write_tum_folder(tmp_path / "room")
    for old, new in (("rgb", "cam0"), ("depth", "tof")):
        (folder / f"{old}.txt").unlink()
        (folder / old).rename(folder / new)
    with open_recording(folder, Topics(color="cam0", depth="tof"), CAMERA) as recording:
        assert len(list(recording)) == 3


def test_a_device_is_no_recording() -> None:
    with pytest.raises(InputError, match="is not a regular file"):
        open_recording("/dev/zero")


def test_the_folder_of_a_recording_takes_no_results(tmp_path: Path) -> None:
    folder = write_tum_folder(tmp_path / "freiburg1")
    (folder / "trajectory.txt").write_text("somebody's\n")
    for command in ("replay", "pairs"):
        assert main([command, str(folder), "-o", str(folder)]) == BAD_INPUT
    assert (folder / "trajectory.txt").read_text() == "somebody's\n"
    with pytest.raises(InputError, match="is a recording; give another folder for the results"):
        refuse_recording(folder)


def test_lists_without_a_pair_and_without_an_image_are_refused(tmp_path: Path) -> None:
    folder = write_tum_folder(tmp_path / "desk")
    (folder / "depth.txt").write_text("5.0 depth/0.png\n")
    with pytest.raises(InputError, match="no colour and depth images are within"):
        open_recording(folder, calibration=CAMERA)
    (folder / "depth.txt").write_text("depth/1.png\ndepth/2.png\n")
    with pytest.raises(InputError, match="no lines of a stamp and a file"):
        open_recording(folder, calibration=CAMERA)


def test_a_damaged_image_is_skipped_named_and_counted(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    folder = write_tum_folder(tmp_path / "desk", 12)
    damaged = folder / "depth/7.png"
    damaged.write_bytes(damaged.read_bytes()[:-40])
    (folder / "rgb/2.png").unlink()
    assert len(list(open_recording(folder, calibration=CAMERA))) == 10
    assert "7.png: damaged image" in caplog.text
    assert "2 frames skipped of 12" in caplog.text
    with pytest.raises(InputError, match=r"7\.png: damaged image"):
        list(open_recording(folder, calibration=CAMERA).select([7]))


def test_where_no_image_can_be_used_the_first_is_named(tmp_path: Path) -> None:
    folder = write_tum_folder(tmp_path / "desk", 2)
    for i in range(2):
        write_color(folder / f"depth/{i}.png", RED)
    with pytest.raises(InputError, match=r"0\.png: is uint8 .*, not a depth image"):
        next(iter(open_recording(folder, calibration=CAMERA)))
    (folder / "rgb/0.png").unlink()
    with pytest.raises(InputError, match=r"0\.png: cannot be read"):
        next(iter(open_recording(folder, calibration=CAMERA)))


def test_a_grey_colour_image_stays_grey_and_transparency_is_dropped(tmp_path: Path) -> None:
    folder = write_tum_folder(tmp_path / "desk", 2)
    cv2.imwrite(str(folder / "rgb/0.png"), np.full((48, 64), 7, np.uint8))
    cv2.imwrite(str(folder / "rgb/1.png"), np.full((48, 64, 4), (255, 0, 0, 9), np.uint8))
    grey, blue = open_recording(folder, calibration=CAMERA)
    assert grey.color.shape == (48, 64)
    assert (blue.color == BLUE).all()


def test_seven_scenes_has_millimetres_two_invalid_values_and_thirty_frames_a_second(
    tmp_path: Path,
) -> None:
    folder = write_seven_scenes_folder(tmp_path / "seq-01")
    with open_recording(folder, calibration=CAMERA) as sequence:
        frames = list(sequence)
        assert sequence.ground_truth is not None
        assert len(sequence.ground_truth) == 3
    # a missing frame leaves its time free
    assert [frame.stamp_ns for frame in frames] == [33333333, 66666666, 133333333]
    assert (frames[0].color == BLUE).all()
    assert frames[0].depth[1, 1] == 1.5
    assert np.isnan(frames[0].depth[0, :2]).all()


def test_seven_scenes_camera_is_beside_the_frames_or_above_or_that_of_the_scene(
    tmp_path: Path,
) -> None:
    folder = write_seven_scenes_folder(tmp_path / "heads" / "seq-01")
    expected = "is 64x48, but the camera is 640x480"
    with pytest.raises(InputError, match=expected):
        next(iter(open_recording(folder)))
    write_seven_scenes_folder(tmp_path / "kitchen" / "seq-01")
    with pytest.raises(InputError, match=r"camera-intrinsics\.txt"):
        open_recording(tmp_path / "kitchen" / "seq-01")
    np.savetxt(tmp_path / "kitchen" / "camera-intrinsics.txt", np.diag([585.0, 585, 1]))
    with pytest.raises(InputError, match=expected):
        next(iter(open_recording(tmp_path / "kitchen" / "seq-01")))


def test_a_pose_that_is_not_finite_is_not_known_and_one_of_other_size_is_refused(
    tmp_path: Path,
) -> None:
    folder = write_seven_scenes_folder(tmp_path / "seq-01")
    (folder / "frame-000001.pose.txt").write_text(" ".join(["-inf"] * 16))
    truth = open_recording(folder, calibration=CAMERA).ground_truth
    assert truth is not None
    assert list(truth.stamps_ns) == [33333333, 133333333]
    (folder / "frame-000001.pose.txt").write_text("1 2 3")
    with pytest.raises(InputError, match=r"frame-000001\.pose\.txt: is not a 4x4 matrix"):
        open_recording(folder, calibration=CAMERA)


def test_of_seven_scenes_a_frame_without_depth_is_left_out_and_without_any_it_is_refused(
    tmp_path: Path,
) -> None:
    folder = write_seven_scenes_folder(tmp_path / "seq-01")
    (folder / "frame-000001.depth.png").unlink()
    (folder / "frame-000003.color.png").unlink()
    with open_recording(folder, calibration=CAMERA) as sequence:
        assert [frame.stamp_ns for frame in sequence] == [33333333]
        assert left_out_of(sequence).unpaired == {"color": 1, "depth": 1}
        assert sequence.ground_truth is not None
        assert list(sequence.ground_truth.stamps_ns) == [33333333]
    (folder / "frame-000000.depth.png").unlink()
    with pytest.raises(InputError, match=r"seq-01: has no colour image with depth beside it"):
        open_recording(folder, calibration=CAMERA)


def test_a_sequence_of_a_scene_is_named_with_it(tmp_path: Path) -> None:
    folder = write_seven_scenes_folder(tmp_path / "heads" / "seq-01")
    assert open_recording(folder, calibration=CAMERA).name == "heads/seq-01"


def test_chosen_frames_are_those_of_their_numbers_and_no_other_file_is_opened(
    tmp_path: Path,
) -> None:
    folder = write_tum_folder(tmp_path / "desk", 8)
    (folder / "depth/3.png").write_bytes(b"damaged")
    with open_recording(folder, calibration=CAMERA) as sequence:
        frames = list(sequence.select([1, 4, 7, 20]))
    assert [frame.depth[1, 1] for frame in frames] == [2.0, 5.0, 8.0]


@pytest.mark.parametrize(("factor", "is_said"), [(1000.0, True), (5000.0, False), (1.0, False)])
def test_a_factor_of_depth_in_a_file_that_is_not_the_layouts_is_logged_with_the_file(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, factor: float, is_said: bool
) -> None:
    caplog.set_level("INFO")
    folder = write_tum_folder(tmp_path / "desk")
    text = f"Camera.fx: 60\nCamera.fy: 60\nCamera.cx: 32\nCamera.cy: 24\nDepthMapFactor: {factor}"
    (folder / "mine.yaml").write_text(f"%YAML:1.0\n{text}\nCamera.width: 64\nCamera.height: 48\n")
    for calibration in (None, read_calibration(folder / "mine.yaml")):
        caplog.clear()
        with open_recording(folder, calibration=calibration):
            said = f"units of 1/1000 m by the factor in {folder / 'mine.yaml'}, and not of 1/5000 m"
            assert (said in caplog.text) is is_said


def test_a_path_that_does_not_exist_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="does not exist"):
        open_recording(tmp_path / "none")


CALIBRATION = {
    "image_width": 640,
    "image_height": 480,
    "camera_matrix": {"rows": 3, "cols": 3, "data": [600, 0, 320, 0, 601, 240, 0, 0, 1]},
    "distortion_model": "plumb_bob",
    "distortion_coefficients": {"rows": 1, "cols": 5, "data": [0.1, 0, 0, 0, 0]},
}


def test_a_calibration_is_read_as_camera_calibration_and_as_ros2_topic_echo_write_it(
    tmp_path: Path,
) -> None:
    expected = CameraIntrinsics(640, 480, 600, 601, 320, 240, (0.1, 0, 0, 0, 0))
    path = tmp_path / "camera.json"
    path.write_text(json.dumps(CALIBRATION))
    assert read_calibration(path).intrinsics == expected
    path.write_text(
        "width: 640\nheight: 480\ndistortion_model: plumb_bob\nd: [0.1, 0, 0, 0, 0]\n"
        "k: [600, 0, 320, 0, 601, 240, 0, 0, 1]\n---\n"
    )
    assert read_calibration(path).intrinsics == expected


@pytest.mark.parametrize(
    ("changes", "cause"),
    [
        ({"camera_matrix": {"data": [0] * 9}}, "not calibrated"),
        ({"camera_matrix": {"data": [1, 2]}}, "not a camera calibration"),
        ({"distortion_model": "wobbly"}, "wobbly"),
        ({"image_width": None}, "not a camera calibration"),
    ],
)
def test_a_calibration_that_is_no_pinhole_camera_is_refused(
    tmp_path: Path, changes: dict[str, object], cause: str
) -> None:
    path = tmp_path / "camera.yaml"
    path.write_text(json.dumps({**CALIBRATION, **changes}))
    with pytest.raises(InputError, match=cause) as error:
        read_calibration(path)
    assert str(path) in str(error.value)


@pytest.mark.parametrize("content", ["", "text", "{", "[1, 2]", "a: 1"])
def test_a_file_that_is_no_calibration_is_refused(tmp_path: Path, content: str) -> None:
    path = tmp_path / "camera.yaml"
    path.write_text(content)
    with pytest.raises(InputError):
        read_calibration(path)


@pytest.mark.parametrize(
    ("name", "frames", "true_poses", "fx"),
    [
        ("rgbd_dataset_freiburg1_desk", 573, 2335, 525.0),
        ("rgbd_dataset_freiburg3_structure_notexture_far", 250, 2729, 535.4),
        ("icl_nuim_office_kt0", 101, 100, 481.2),
        ("7scenes_sample", 200, 200, 585.0),
    ],
)
def test_real_sequences_are_read(
    shared_data: Path, name: str, frames: int, true_poses: int, fx: float
) -> None:
    with open_recording(shared_data / name) as sequence:
        assert sequence.frame_count == frames
        assert sequence.ground_truth is not None
        assert len(sequence.ground_truth) == true_poses
        frame = next(iter(sequence))
    assert frame.intrinsics.fx == fx
    assert frame.color.shape == (480, 640, 3)
    assert 0.3 < np.nanmedian(frame.depth) < 4.0


@pytest.mark.parametrize(
    "K",
    [
        "0 0 320 0 585 240 0 0 1",
        "-585 0 320 0 585 240 0 0 1",
        "nan 0 320 0 585 240 0 0 1",
        "585 0 320 0 1e999 240 0 0 1",
        "585 0 0 0 585 0 320 240 1",
        "585 9 320 0 585 240 0 0 1",
        "585 0 1e9 0 585 240 0 0 1",
        "1e9 0 320 0 1e9 240 0 0 1",
    ],
)
def test_a_camera_matrix_that_is_none_is_named_by_its_file(K: str, tmp_path: Path) -> None:
    for kind in ("color", "depth"):
        (tmp_path / f"frame-000000.{kind}.png").write_bytes(b"")
    (tmp_path / "camera-intrinsics.txt").write_text(K)
    with pytest.raises(InputError, match=r"camera-intrinsics\.txt: .*K"):
        open_recording(tmp_path)

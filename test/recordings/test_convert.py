from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from raycast_room.imu import BMI055, simulated_imu
from rigs.bags import CAMERA, CODECS, assert_same_frame, make_frames, recorded, write_rosbag2
from rigs.disks import full_after
from rigs.room import room_frame, true_pose

from rgbd_glue_ros.cli.main import main
from rgbd_glue_ros.closing import Closing
from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.experiments.replay.replay import replay
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.parameters import load_preset
from rgbd_glue_ros.recordings import imu_of, open_recording
from rgbd_glue_ros.recordings.convert import convert
from rgbd_glue_ros.recordings.recording import selected
from rgbd_glue_ros.types import ImuSamples, RgbdFrame, Trajectory

FRAMES = make_frames(12)
TRUTH = Trajectory(
    # more often than the frames, starting before and ending after them, not in order
    np.array([FRAMES[0].stamp_ns + t * 10_000_000 for t in (3, -1, 0, 9, 40)], np.int64),
    np.stack([se3.exp(0.1 * i * np.ones(6)) for i in range(5)]),
)


@dataclass(frozen=True)
class Listed(Closing):
    """A sequence in memory, which may end in an error."""

    frames: list[RgbdFrame]
    error: BaseException | None = None
    ground_truth: Trajectory | None = TRUTH
    name: str = "listed"
    imu: ImuSamples | None = None

    @property
    def frame_count(self) -> int:
        return len(self.frames)

    def __iter__(self) -> Iterator[RgbdFrame]:
        yield from self.frames
        if self.error is not None:
            raise self.error

    def select(self, indices: Iterable[int]) -> Iterator[RgbdFrame]:
        return selected(self, indices)

    def close(self) -> None: ...


def same(frames: Iterator[RgbdFrame], originals: list[RgbdFrame], codec: str = "raw") -> None:
    for frame, original in zip(frames, originals, strict=True):
        assert_same_frame(replace(frame, frame_id="camera_optical"), original, CODECS[codec])


@pytest.mark.parametrize("codec", CODECS)
def test_a_recording_becomes_a_bag_with_its_frames_and_true_poses(
    codec: str, tmp_path: Path
) -> None:
    convert(Listed(FRAMES), tmp_path / "bag", compressed=codec == "compressed")
    with open_recording(tmp_path / "bag") as bag:
        same(iter(bag), FRAMES, codec)
        truth = bag.ground_truth
    assert truth is not None
    order = np.argsort(TRUTH.stamps_ns)
    assert truth.stamps_ns.tolist() == TRUTH.stamps_ns[order].tolist()
    assert truth.poses == pytest.approx(TRUTH.poses[order], abs=1e-12)


def test_a_bag_becomes_a_folder_and_that_the_same_bag_again(tmp_path: Path) -> None:
    convert(Listed(FRAMES), tmp_path / "bag", compressed=False)
    with open_recording(tmp_path / "bag") as bag:
        convert(bag, tmp_path / "folder", compressed=False)
    with open_recording(tmp_path / "folder") as folder:
        same(iter(folder), FRAMES)
        assert folder.ground_truth is not None
        assert folder.ground_truth.poses[0] == pytest.approx(TRUTH.poses[1], abs=1e-12)
        convert(folder, tmp_path / "again" / "bag", compressed=False)
    with open_recording(tmp_path / "again" / "bag") as bag:
        same(iter(bag), FRAMES)


def test_a_bag_becomes_a_folder_also_if_its_images_are_reduced(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source, target = tmp_path / "bag", tmp_path / "folder"
    convert(Listed(FRAMES), source, compressed=False)
    words = ["convert", str(source), str(target), "--set", "max_width=32"]
    assert main([*words, "--topics-like", "oak_d"]) == 2
    assert "is a bag, which becomes a folder of images" in capsys.readouterr().err
    assert main(words) == 0
    assert "topics" not in capsys.readouterr().out
    assert (target / "rgb.txt").is_file()
    with open_recording(target) as folder:
        assert {frame.color.shape[1] for frame in folder} == {32}


IMU = ImuSamples(
    # more often than the frames, starting before and ending after them
    FRAMES[0].stamp_ns + np.arange(-5, 50, dtype=np.int64) * 10_000_001,
    np.random.default_rng(0).normal(size=(55, 3)),
    np.random.default_rng(1).normal(size=(55, 3)),
)
ACCELEROMETER = replace(IMU, angular_velocity=np.full((55, 3), np.nan))


def assert_samples(got: ImuSamples | None, wanted: ImuSamples) -> None:
    assert got is not None
    for name in ("stamps_ns", "angular_velocity", "linear_acceleration"):
        np.testing.assert_array_equal(getattr(got, name), getattr(wanted, name))


@pytest.mark.parametrize("frame_id", ["", "camera_optical"])
@pytest.mark.parametrize("imu", [IMU, ACCELEROMETER], ids=["imu", "accelerometer"])
def test_the_samples_of_an_imu_are_in_the_bag(
    imu: ImuSamples, frame_id: str, tmp_path: Path
) -> None:
    frames = [replace(frame, frame_id=frame_id) for frame in FRAMES]
    convert(Listed(frames, imu=imu), tmp_path / "bag", compressed=False)
    with open_recording(tmp_path / "bag") as bag:
        same(iter(bag), FRAMES)
        assert_samples(imu_of(bag), imu)


@pytest.mark.parametrize(("imu", "is_lost"), [(IMU, True), (ACCELEROMETER, False)])
def test_a_folder_holds_the_accelerations_and_that_the_rest_is_lost_is_said(
    imu: ImuSamples, is_lost: bool, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    unknown = imu.linear_acceleration.copy()
    unknown[3] = np.nan
    source = Listed(FRAMES, imu=replace(imu, linear_acceleration=unknown))
    convert(source, tmp_path / "bag", compressed=False)
    with open_recording(tmp_path / "bag") as bag:
        convert(bag, tmp_path / "folder", compressed=False)
    kept = np.arange(len(imu)) != 3
    with open_recording(tmp_path / "folder") as folder:
        same(iter(folder), FRAMES)
        expected = ImuSamples(*(values[kept] for values in vars(ACCELEROMETER).values()))
        assert_samples(imu_of(folder), expected)
    assert ("no place for the angular velocities" in caplog.text) == is_lost


def test_without_an_imu_none_is_written(tmp_path: Path) -> None:
    convert(Listed(FRAMES), tmp_path / "bag", compressed=False)
    with open_recording(tmp_path / "bag") as bag:
        assert imu_of(bag) is None
        convert(bag, tmp_path / "folder", compressed=False)
    assert not (tmp_path / "folder" / "accelerometer.txt").exists()


@pytest.mark.slow
def test_a_recording_with_an_imu_replays_alike_as_a_bag(tmp_path: Path) -> None:
    frames = [room_frame(i / 10) for i in range(9)]
    frames = [replace(frame, stamp_ns=frame.stamp_ns + 10**9) for frame in frames]
    samples = simulated_imu(true_pose, 0.0, 1.0, BMI055)
    source = Listed(
        frames, ground_truth=None, imu=replace(samples, stamps_ns=samples.stamps_ns + 10**9)
    )
    convert(source, tmp_path / "bag", compressed=False)
    before = replay(source, load_preset("live"), tmp_path / "before")
    with open_recording(tmp_path / "bag") as bag:
        after = replay(bag, load_preset("live"), tmp_path / "after")
    assert before.imu is not None
    assert after.imu is not None
    np.testing.assert_array_equal(after.trajectory.poses, before.trajectory.poses)
    np.testing.assert_array_equal(after.imu.bias, before.imu.bias)


def test_distortion_survives_the_way_through_a_folder(tmp_path: Path) -> None:
    for count in (5, 8):
        camera = replace(CAMERA, distortion=tuple(0.01 * i for i in range(1, count + 1)))
        frames = [replace(FRAMES[0], intrinsics=camera)]
        bag = write_rosbag2(tmp_path / f"bag{count}", recorded(frames))
        with open_recording(bag) as source:
            convert(source, tmp_path / f"folder{count}", compressed=False)
        with open_recording(tmp_path / f"folder{count}") as folder:
            assert [frame.intrinsics for frame in folder] == [camera]


def far(frame: RgbdFrame, metres: float, columns: int) -> RgbdFrame:
    depth = frame.depth.copy()
    depth[:, :columns] = metres
    return replace(frame, depth=depth)


def converted(frames: list[RgbdFrame], folder: Path) -> list[RgbdFrame]:
    """The frames as a bag of floats, from it as a folder, and read from that."""
    convert(Listed(frames), folder / "bag", compressed=False)
    with open_recording(folder / "bag") as bag:
        convert(bag, folder / "tum", compressed=False)
    assert {path.name for path in folder.iterdir()} == {"bag", "tum"}
    with open_recording(folder / "tum") as recording:
        return list(recording)


def test_depth_beyond_tums_unit_is_written_in_millimetres_and_that_is_said(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    frames = [*FRAMES[:9], *(far(frame, 40.0 + i, 8) for i, frame in enumerate(FRAMES[9:]))]
    got = converted(frames, tmp_path)
    assert (tmp_path / "tum/depth.txt").read_text().startswith("# depth scale: 1000\n")
    assert "tum: depth goes beyond 13.1 m, where TUM's unit of 1/5000 m ends" in caplog.text
    assert "left out" not in caplog.text
    same(iter(got), frames)


@pytest.mark.parametrize(
    ("metres", "columns", "scale", "said"),
    [
        (12.0, 64, None, None),
        (14.0, 0, None, None),
        (14.0, 1, None, r"0\.0\d+ % of its depth is beyond 13\.1 m"),
        (70.0, 16, "# depth scale: 1000", r"2\.3 % of its depth is beyond 65\.5 m"),
    ],
)
def test_of_depth_that_the_unit_does_not_reach_the_share_is_said(
    metres: float,
    columns: int,
    scale: str | None,
    said: str | None,
    tmp_path: Path,
    caplog: pytest.LogCaptureFixture,
) -> None:
    """Of single pixels the unit stays TUM's."""
    frames = [*FRAMES]
    frames[3] = far(frames[3], metres, columns)
    if columns == 1:
        frames[3].depth[1:, 0] = frames[4].depth[1:, 0]
    got = converted(frames, tmp_path)
    first, *_ = (tmp_path / "tum/depth.txt").read_text().splitlines()
    assert first == scale if scale else first.endswith(".png")
    is_lost = frames[3].depth > (65.5 if scale else 13.1)
    np.testing.assert_array_equal(np.isnan(got[3].depth), np.isnan(frames[3].depth) | is_lost)
    if said is None:
        assert not caplog.text
    else:
        assert re.search(said, caplog.text)


def test_grey_images_stay_grey_in_a_bag(tmp_path: Path) -> None:
    grey = [replace(f, color=np.ascontiguousarray(f.color[..., 0])) for f in FRAMES]
    convert(Listed(grey), tmp_path / "bag", compressed=False)
    with open_recording(tmp_path / "bag") as bag:
        same(iter(bag), grey)


@pytest.mark.parametrize("error", [InputError("x", "is truncated", "copy it"), KeyboardInterrupt()])
def test_what_was_converted_before_an_error_or_an_interrupt_is_kept(
    error: BaseException, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with pytest.raises(type(error)):
        convert(Listed(FRAMES, error), tmp_path / "bag", compressed=False)
    is_interrupt = isinstance(error, KeyboardInterrupt)
    assert (f"written so far are in {tmp_path / 'bag'}" in caplog.text) == is_interrupt
    assert [path.name for path in tmp_path.iterdir()] == ["bag"]
    with open_recording(tmp_path / "bag") as bag:
        stamps = [frame.stamp_ns for frame in bag]
    assert len(stamps) >= len(FRAMES) - 5
    assert stamps == [frame.stamp_ns for frame in FRAMES[: len(stamps)]]


def test_a_folder_holds_no_half_of_a_frame_when_interrupted(tmp_path: Path) -> None:
    bag = write_rosbag2(tmp_path / "bag", recorded(FRAMES))
    data = (bag / "bag.mcap").read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(data[: len(data) // 2])
    with open_recording(cut) as source, pytest.raises(InputError, match="truncated"):
        convert(source, tmp_path / "folder", compressed=False)
    with open_recording(tmp_path / "folder") as folder:
        same(iter(folder), FRAMES[: folder.frame_count])
        assert folder.frame_count >= 3


def test_an_existing_target_is_refused_before_anything_is_read(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="exists already; give a new folder"):
        convert(Listed([], RuntimeError("was read")), tmp_path, compressed=False)


def test_a_source_without_a_frame_leaves_nothing_behind(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="holds no frames"):
        convert(Listed([]), tmp_path / "bag", compressed=False)
    assert list(tmp_path.iterdir()) == []


def test_a_real_sequence_comes_back_from_a_raw_bag_bit_for_bit(
    shared_data: Path, tmp_path: Path
) -> None:
    with open_recording(shared_data / "rgbd_dataset_freiburg1_desk") as source:
        few = Listed([f for f, _ in zip(source, range(10), strict=False)])
        convert(few, tmp_path / "bag", compressed=False)
    with open_recording(tmp_path / "bag") as bag:
        same(iter(bag), [replace(f, frame_id="camera_optical") for f in few.frames])


def test_on_a_full_disk_the_frames_before_can_be_read_and_it_is_said(tmp_path: Path) -> None:
    frames = make_frames(90)
    said = r"File too large.*free some space.*it holds what was written before: remove it first"
    with full_after(1_500_000), pytest.raises(InputError, match=said):
        convert(Listed(frames), tmp_path / "bag", compressed=False)
    assert [path.name for path in tmp_path.iterdir()] == ["bag"]
    found: list[int] = []
    with open_recording(tmp_path / "bag") as bag, pytest.raises(InputError, match="truncated"):
        found.extend(frame.stamp_ns for frame in bag)
    assert found == [frame.stamp_ns for frame in frames[: len(found)]]
    assert len(found) > 30

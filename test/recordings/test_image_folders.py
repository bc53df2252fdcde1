"""Folders as data sets, scanners and exporters leave them; of others is said what is missing."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from rigs.layouts import (
    APPLE_DOUBLE,
    CAMERA,
    FRAMES,
    LAYOUTS,
    POSES,
    K,
    color,
    depth,
    eth3d,
    images,
    lists,
    metres,
    numbers,
    stamp_s,
    stray_scanner,
    text,
    tum_lines,
    write,
)

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.parameters import InputConfig
from rgbd_glue_ros.recordings import Topics, open_recording, recordings
from rgbd_glue_ros.recordings.calibration import read_calibration
from rgbd_glue_ros.recordings.left_out import left_out_of
from rgbd_glue_ros.types import CameraIntrinsics


@pytest.mark.parametrize("layout", LAYOUTS)
def test_every_layout_gives_its_frames_camera_depth_and_poses(layout: str, tmp_path: Path) -> None:
    folder = tmp_path / "sequence"
    LAYOUTS[layout](folder)
    with open_recording(folder) as recording:
        frames = list(recording)
        truth = recording.ground_truth
    assert len(frames) == FRAMES
    assert np.all(np.diff([frame.stamp_ns for frame in frames]) > 0)
    camera = frames[0].intrinsics
    np.testing.assert_allclose(camera.matrix, CAMERA.matrix, atol=0.26)
    assert (camera.width, camera.height) == (64, 48)
    for i, frame in enumerate(frames):
        assert frame.color.shape == (48, 64, 3)
        # the third channel of OpenCV's, but for what compression costs
        assert abs(int(frame.color[24, 32, 0]) - 200) < 8
        assert frame.depth[24, 32] == pytest.approx(metres(i), abs=2e-3)
        assert frame.depth_delay_ns == 0
    assert truth is not None
    np.testing.assert_allclose(truth.poses, POSES, atol=1e-6)
    np.testing.assert_allclose(truth.stamps_ns, [frame.stamp_ns for frame in frames], atol=1000)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_what_macos_leaves_beside_every_file_changes_nothing(
    layout: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    folder = tmp_path / "sequence"
    LAYOUTS[layout](folder)
    with open_recording(folder) as recording:
        original, truth = list(recording), recording.ground_truth
    said = caplog.messages[:]
    caplog.clear()
    for path in [*tmp_path.rglob("*")]:
        path.with_name(f"._{path.name}").write_bytes(APPLE_DOUBLE)
    with open_recording(folder) as recording:
        frames, same_truth = list(recording), recording.ground_truth
    assert recordings([tmp_path]) == [folder]
    assert caplog.messages == said
    assert [frame.stamp_ns for frame in frames] == [frame.stamp_ns for frame in original]
    assert all(map(np.array_equal, [f.depth for f in frames], [f.depth for f in original]))
    assert truth is not None
    assert same_truth is not None
    np.testing.assert_array_equal(same_truth.poses, truth.poses)


def test_a_list_that_names_a_known_bag_tells_its_camera(tmp_path: Path) -> None:
    lists(tmp_path / "mine", "rgb.txt", "depth.txt", 5000)
    listed = (tmp_path / "mine/rgb.txt").read_text()
    bag = "# color images\n# file: 'rgbd_dataset_freiburg3_structure_notexture_far.bag'\n"
    (tmp_path / "mine/rgb.txt").write_text(bag + listed)
    with pytest.raises(InputError, match="camera is 640x480"):
        next(iter(open_recording(tmp_path / "mine")))


def two_depths(folder: Path) -> None:
    for side in ("a", "b"):
        images(folder, "rgb/{i}.png", f"depth_{side}/{{i}}.png")


def not_calibrated(folder: Path) -> None:
    images(folder, "rgb/{i}.png", "depth/{i}.png")


def strange_numbers(folder: Path) -> None:
    images(folder, "rgb/{i}.png", "depth/1000{i}.png")
    (folder / "rgb/0.png").unlink()


AMBIGUOUS: dict[str, tuple[Callable[[Path], None], str]] = {
    "two depth cameras": (
        two_depths,
        r"depth_a/#\.png \(4\), depth_b/#\.png \(4\); give one of them \(--depth-topic NAME\)",
    ),
    "no calibration": (
        not_calibrated,
        r"describes its camera; give the calibration \(--calibration FILE\)",
    ),
    "numbers that do not meet": (strange_numbers, "list them in associations.txt"),
}


@pytest.mark.parametrize("case", AMBIGUOUS)
def test_what_is_ambiguous_or_missing_is_said_with_what_to_type(case: str, tmp_path: Path) -> None:
    make, said = AMBIGUOUS[case]
    make(tmp_path / "mine")
    with pytest.raises(InputError, match=said):
        open_recording(tmp_path / "mine")


def test_the_images_to_take_can_be_named(tmp_path: Path) -> None:
    for side, units in (("a", 1000), ("b", 2000)):
        images(tmp_path, "rgb/{i}.png", f"depth_{side}/{{i}}.png", units)
    topics = Topics(depth="depth_b")
    frame = next(iter(open_recording(tmp_path, topics, CAMERA)))
    assert frame.depth[0, 0] == 2.0


def test_a_folder_of_recordings_is_none_itself(tmp_path: Path) -> None:
    for name in ("one", "two"):
        eth3d(tmp_path / "data" / name)
        images(tmp_path / "plain" / name, "color_{i}.png", "depth_{i}.png")
    found = recordings([tmp_path])
    assert [path.relative_to(tmp_path).as_posix() for path in found] == [
        "data/one",
        "data/two",
        "plain/one",
        "plain/two",
    ]


def test_depth_of_another_camera_in_a_folder_is_registered_by_its_calibration(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """It is half a metre behind, and sees half as far to the side in more pixels."""
    images(tmp_path, "color/{i}.png", "depth/{i}.png", color_size=(64, 48))
    for i in range(FRAMES):
        write(tmp_path / f"depth/{i}.png", depth(i, 1000, (100, 60)))
    other = CameraIntrinsics(100, 60, 200.0, 200.0, 49.5, 29.5)
    inputs = InputConfig(depth_camera_pose="0 0 -0.5 0 0 0")
    for recording, nearer in (
        (open_recording(tmp_path, None, CAMERA, inputs, other), 0.5),
        (open_recording(tmp_path, None, CAMERA, None, other), 0.0),
    ):
        frame = list(recording)[2]
        assert frame.depth[24, 32] == pytest.approx(metres(2) - nearer, abs=1e-5)
        assert np.isnan(frame.depth[:, 0]).all()
    assert "--set depth_camera_pose=" in caplog.text


ORB_SLAM = """%YAML:1.0
Camera1.fx: 60.0
Camera1.fy: 61.0
Camera1.cx: 31.5
Camera1.cy: 23.5
Camera.width: 64
Camera.height: 48
RGBD.DepthMapFactor: {}
"""


@pytest.mark.parametrize(
    ("factor", "ending", "unit_m", "is_said"),
    [
        (1000.0, ".png", 0.001, False),
        (5000.0, ".png", 0.0002, False),
        # what ORB-SLAM3 gives cameras whose depth comes as floats of metres
        (1.0, ".tiff", 1.0, False),
        (1.0, ".png", 0.0002, True),
    ],
)
def test_a_calibration_tells_the_unit_of_depth_wherever_it_lies(
    factor: float,
    ending: str,
    unit_m: float,
    is_said: bool,
    tmp_path: Path,
    caplog: pytest.LogCaptureFixture,
) -> None:
    folder, file = tmp_path / "mine", tmp_path / "camera.yaml"
    lists(folder, "rgb.txt", "depth.txt", 1 / unit_m)
    text(file, ORB_SLAM.format(factor))
    if ending == ".tiff":
        for i, path in enumerate(sorted((folder / "depth").iterdir())):
            write(path.with_suffix(ending), np.full((48, 64), metres(i), np.float32))
        listed = (folder / "depth.txt").read_text()
        (folder / "depth.txt").write_text(listed.replace(".png", ending))
    given = next(iter(open_recording(folder, None, read_calibration(file))))
    assert given.depth[0, 0] == pytest.approx(metres(0), abs=1e-5)
    file.rename(folder / "camera.yaml")
    found = next(iter(open_recording(folder)))
    assert found.depth[0, 0] == pytest.approx(metres(0), abs=1e-5)
    assert ("if it is another, give --depth-scale" in caplog.text) is is_said


@pytest.mark.parametrize("names", [("rgb", "depth"), ("color", "aligned_depth")])
def test_a_comment_of_the_list_tells_the_unit_of_depth(
    names: tuple[str, str], tmp_path: Path
) -> None:
    folder = tmp_path / "mine"
    lists(folder, f"{names[0]}.txt", f"{names[1]}.txt", 2000)
    text(folder / "K.txt", K)
    depth_list = folder / f"{names[1]}.txt"
    listed = depth_list.read_text()
    for comment in ("# depth maps, scale: 2000", "# depth_scale = 0.0005", "#depth factor 2000.0"):
        text(depth_list, comment, listed)
        frame = next(iter(open_recording(folder)))
        assert frame.depth[0, 0] == pytest.approx(metres(0), abs=1e-5)


def only_colour(folder: Path) -> None:
    images(folder, "rgb/{i}.png", "rgb/{i}.png")


def only_a_colour_list(folder: Path) -> None:
    text(folder / "rgb.txt", "1.0 rgb/1.png")


def unnumbered(folder: Path) -> None:
    for name in ("door", "table"):
        write(folder / f"rgb/{name}.png", color(0))
        write(folder / f"depth/{name}.png", depth(0, 1000))


def without_its_video(folder: Path) -> None:
    stray_scanner(folder)
    (folder / "rgb.mp4").unlink()


def without_its_storage(folder: Path) -> None:
    text(folder / "notes.txt", "a bag was here")
    text(folder / "metadata.yml", "rosbag2_bagfile_information:")


def archive(folder: Path) -> None:
    folder.parent.mkdir(parents=True, exist_ok=True)
    folder.write_bytes(b"PK\x03\x04" + bytes(100))


def nyu_raw(folder: Path) -> None:
    """Disparities, 2047 where there is none, their bytes in the other order than PGM has."""
    folder.mkdir()
    for i in range(FRAMES):
        disparity = np.full((48, 64), 700, np.uint16)
        disparity[:5] = 2047
        write(folder / f"r-{stamp_s(i)}-{2754192016 + i}.ppm", color(i))
        write(folder / f"d-{stamp_s(i)}-{2734937519 + i}.pgm", disparity.byteswap())
    text(folder / "K.txt", K)


def nested(folder: Path) -> None:
    for i in range(5):
        text(folder / f"day{i}/rgb.txt", "1.0 rgb/1.png")
        text(folder / f"day{i}/depth.txt", "1.0 depth/1.png")


UNKNOWN: dict[str, tuple[Callable[[Path], None], str]] = {
    "colour alone": (only_colour, "a folder of images, but depth/* is missing; restore depth/*"),
    "one list": (only_a_colour_list, "most like TUM RGB-D, but depth.txt is missing"),
    "no numbers": (unnumbered, "its images have no numbers that show which belong together"),
    "a scan without its video": (without_its_video, "Stray Scanner, but rgb.mp4 is missing"),
    "something else": (without_its_storage, "it holds metadata.yml, notes.txt; give a bag, or"),
    "nothing": (Path.mkdir, "known format: it is empty; give the folder of one"),
    "an archive": (archive, "is a zip archive; unpack it"),
    "raw NYU": (nyu_raw, "holds disparities of a Kinect, as NYU Depth dumps them"),
    "recordings": (nested, "day0, day1, day2 and others, which are; give one of them"),
}


@pytest.mark.parametrize("case", UNKNOWN)
def test_what_is_no_recording_is_told_what_it_lacks(case: str, tmp_path: Path) -> None:
    make, said = UNKNOWN[case]
    make(tmp_path / "mine")
    with pytest.raises(InputError) as error:
        open_recording(tmp_path / "mine")
    assert said in str(error.value)
    assert "\n" not in str(error.value)


def test_an_archive_of_record3d_is_told_what_to_export(tmp_path: Path) -> None:
    archive(tmp_path / "scan.r3d")
    with pytest.raises(InputError, match=r"Record3D.*; export EXR \+ RGB"):
        open_recording(tmp_path / "scan.r3d")


@pytest.mark.parametrize("has_truth", [True, False])
def test_a_tum_data_set_whose_lists_are_lost_is_read_once_its_unit_is_told(
    has_truth: bool, tmp_path: Path
) -> None:
    """Of images alone, so named by many, it is not TUM's that they are."""
    folder = tmp_path / "set"
    images(folder, "rgb/{s}.png", "depth/{s}.png", 5000)
    text(folder / "K.txt", K)
    if not has_truth:
        with open_recording(folder) as recording:
            assert np.nanmedian(next(iter(recording)).depth) == pytest.approx(5 * metres(0))
        return
    text(folder / "groundtruth.txt", *tum_lines())
    with pytest.raises(InputError, match=r"lacks rgb\.txt and depth\.txt .*depth_scale=0\.0002"):
        open_recording(folder)
    with open_recording(folder, inputs=InputConfig(depth_scale=0.0002)) as recording:
        assert np.nanmedian(next(iter(recording)).depth) == pytest.approx(metres(0))
        assert recording.ground_truth is not None


def test_a_calibration_of_images_of_another_shape_is_named_by_its_file(tmp_path: Path) -> None:
    folder = tmp_path / "set"
    images(folder, "rgb/{s}.png", "depth/{s}.png")
    text(folder / "camera_info.yaml", "width: 64", "height: 20", "fx: 60", "cx: 31.5", "cy: 9.5")
    with pytest.raises(InputError, match=r"camera_info\.yaml: has 64x20 pixels, but .* 64x48"):
        open_recording(folder)


def taken(i: int) -> datetime:
    """By tenths of a second, across a full second and a full minute."""
    return datetime(2011, 5, 10, 12, 44, 59, 800_000) + timedelta(seconds=i / 10)


NAMES_OF_TIMES: dict[str, Callable[[int], str]] = {
    "seconds_nanoseconds": lambda i: f"{1305031499 + (8 + i) // 10}_{(8 + i) % 10 * 10**8:09d}",
    "seconds-nanoseconds": lambda i: f"{1305031499 + (8 + i) // 10}-{(8 + i) % 10 * 10**8:09d}",
    "nanoseconds without zeros": lambda i: (
        f"{1305031499 + (8 + i) // 10}_{(8 + i) % 10 * 10**8}_left"
    ),
    "seconds_microseconds": lambda i: f"{1305031499 + (8 + i) // 10}_{(8 + i) % 10 * 10**5:06d}",
    "a camera's number, and seconds": lambda i: (
        f"cam1_{1305031499 + (8 + i) // 10}_{(8 + i) % 10 * 10**8:09d}"
    ),
    "date and milliseconds": lambda i: f"{taken(i):%Y%m%d_%H%M%S}_{100 * ((8 + i) % 10):03d}",
    "date with dashes": lambda i: f"{taken(i):%Y-%m-%d-%H-%M-%S-%f}",
    "of a phone": lambda i: f"PXL_{taken(i):%Y%m%d_%H%M%S}{100 * ((8 + i) % 10):03d}_640x480",
    "ISO 8601": lambda i: taken(i).isoformat(),
    "a date, and its number": lambda i: f"{i:05d}_{taken(i):%Y%m%d_%H%M%S_%f}",
}


@pytest.mark.parametrize("kind", NAMES_OF_TIMES)
def test_times_in_the_names_of_images_are_their_stamps(kind: str, tmp_path: Path) -> None:
    name = NAMES_OF_TIMES[kind]
    for i in range(FRAMES):
        write(tmp_path / f"rgb/{name(i)}.png", color(i))
        write(tmp_path / f"depth/{name(i)}.png", depth(i, 1000))
    frames = list(open_recording(tmp_path, calibration=CAMERA))
    assert [frame.depth[0, 0] for frame in frames] == [metres(i) for i in range(FRAMES)]
    assert [frame.stamp_ns for frame in frames] == [
        1_305_031_499_800_000_000 + i * 100_000_000 for i in range(FRAMES)
    ]


NUMBERS_BESIDE_TIMES: dict[str, Callable[[int], str]] = {
    "of a run that began then": lambda i: f"20110510_124459_{i:05d}",
    "of a run that began in that second": lambda i: f"1305031499_{i:04d}",
    "with the second of each": lambda i: f"{taken(5 * i):%Y%m%d_%H%M%S}_{i:05d}",
    "of a run, with a word between": lambda i: f"20110510_124459_run_{i:05d}",
    "in front of the start of a run": lambda i: f"{i:05d}_2011-05-10-12-44-59-100",
    "with the second of each, and a word": lambda i: f"{taken(5 * i):%Y%m%d_%H%M%S}_f{i:05d}",
    "beside seconds of a run": lambda i: f"run1305031499_1_{i:05d}",
    "of a day": lambda i: f"20110510_{i:06d}",
    "of thirteen hours": lambda i: f"20110510_13{i:04d}99",
}


@pytest.mark.parametrize("kind", NUMBERS_BESIDE_TIMES)
def test_the_number_of_a_frame_beside_a_time_is_no_fraction_of_a_second(
    kind: str, tmp_path: Path
) -> None:
    name = NUMBERS_BESIDE_TIMES[kind]
    for i in range(FRAMES):
        write(tmp_path / f"rgb/{name(i)}.png", color(i))
        write(tmp_path / f"depth/{name(i)}.png", depth(i, 1000))
    frames = list(open_recording(tmp_path, calibration=CAMERA))
    steps = np.diff([frame.stamp_ns for frame in frames])
    assert [frame.depth[0, 0] for frame in frames] == [metres(i) for i in range(FRAMES)]
    step = 100 if kind == "of thirteen hours" else 1
    np.testing.assert_allclose(steps, step * 1e9 / 30, atol=1)


@pytest.mark.parametrize(
    ("color_name", "depth_name"),
    [
        ("rgb/{:05d}_640x480.png", "depth/{:05d}_640x480.png"),
        ("rgb/frame_{:05d}_cam1.png", "depth/frame_{:05d}_cam1.png"),
        ("color_{:04d}.png", "depth_{:04d}_mm16.png"),
        ("2023_01_15_{}_color.png", "2023_01_15_{}_depth.png"),
    ],
)
def test_the_number_that_differs_from_file_to_file_is_the_frames(
    color_name: str, depth_name: str, tmp_path: Path
) -> None:
    for i in range(FRAMES):
        write(tmp_path / color_name.format(i + 1), color(i))
        write(tmp_path / depth_name.format(i + 1), depth(i, 1000))
        text(tmp_path / f"pose/{i + 1}.txt", numbers(POSES[i]))
    (tmp_path / "pose/2.txt").unlink()
    with open_recording(tmp_path, calibration=CAMERA) as recording:
        frames = list(recording)
        truth = recording.ground_truth
    assert [frame.depth[0, 0] for frame in frames] == [metres(i) for i in range(FRAMES)]
    assert [frame.stamp_ns for frame in frames] == [
        (i + 2) * 1_000_000_000 // 30 for i in range(FRAMES)
    ]
    assert truth is not None
    np.testing.assert_allclose(truth.poses, POSES[[0, 2, 3]], atol=1e-6)


def test_cameras_told_by_a_number_in_one_folder_are_apart(tmp_path: Path) -> None:
    for side in (1, 2):
        images(tmp_path, f"rgb_{side}_{{i}}_48.png", f"depth_{side}_{{i}}_48.png", 1000 * side)
    frame = next(iter(open_recording(tmp_path, Topics("rgb_1", "depth_2"), CAMERA)))
    assert frame.depth[0, 0] == 2.0
    with pytest.raises(InputError, match=r"depth_1_#_48\.png \(4\), depth_2_#_48\.png \(4\); give"):
        open_recording(tmp_path, calibration=CAMERA)


@pytest.mark.timeout(30)
def test_thousands_of_kinds_of_images_are_refused_at_once_and_shortly(tmp_path: Path) -> None:
    for place in ("rgb", "depth"):
        (tmp_path / place).mkdir()
        for i in range(2000):
            name = "".join(chr(ord("a") + int(digit)) for digit in f"{i:04d}")
            (tmp_path / place / f"{name}1.png").touch()
    with pytest.raises(InputError, match=r"2000 kinds of .* and 1994 others; give") as error:
        open_recording(tmp_path)
    assert len(str(error.value)) < 500


def numbered_apart(folder: Path, colors: Iterable[int], depths: Iterable[int]) -> Path:
    for i in colors:
        write(folder / f"rgb/{i:05d}.png", color(0))
    for i in depths:
        write(folder / f"depth/{i:05d}.png", depth(0, 1000))
    return folder


@pytest.mark.parametrize(("colors", "depths"), [(20, 10), (10, 20), (24, 16)])
def test_images_of_two_rates_that_are_numbered_apart_are_not_paired_by_number(
    colors: int, depths: int, tmp_path: Path
) -> None:
    folder = numbered_apart(tmp_path, range(colors), range(depths))
    last = min(colors, depths) - 1
    said = rf"(1\.5|2) times as many .* associations\.txt .*, or, .* after {last}$"
    with pytest.raises(InputError, match=said) as error:
        open_recording(folder, calibration=CAMERA)
    assert "\n" not in str(error.value)
    for place, first in (("rgb", depths), ("depth", colors)):
        for i in range(first, 30):
            (folder / f"{place}/{i:05d}.png").unlink(missing_ok=True)
    assert len(list(open_recording(folder, calibration=CAMERA))) == last + 1


@pytest.mark.parametrize(
    ("depths", "count"),
    [
        (range(16), 16),
        (range(0, 20, 2), 10),
        ([*range(4), *range(10, 20)], 14),
        (range(10, 20), 10),
    ],
    ids=["the last four", "every second", "some in between", "the first half"],
)
def test_images_whose_partner_is_missing_are_left_out_and_counted(
    depths: Iterable[int], count: int, tmp_path: Path
) -> None:
    recording = open_recording(numbered_apart(tmp_path, range(20), depths), calibration=CAMERA)
    assert len(list(recording)) == count
    assert left_out_of(recording).unpaired == {"color": 20 - count, "depth": 0}


@pytest.mark.parametrize("kind", [np.uint16, np.int32, np.int64, np.float64])
def test_depth_in_arrays_of_any_number_is_read(kind: type[np.generic], tmp_path: Path) -> None:
    unit = 1 if kind is np.float64 else 1000
    for i in range(FRAMES):
        write(tmp_path / f"rgb/{i}.png", color(i))
        write(tmp_path / f"depth/{i}.npy", (np.full((48, 64), metres(i)) * unit).astype(kind))
    frames = list(open_recording(tmp_path, calibration=CAMERA))
    assert [frame.depth[0, 0] for frame in frames] == [metres(i) for i in range(FRAMES)]


@pytest.mark.parametrize("kind", [np.uint8, np.int8, np.bool_, np.complex64])
def test_arrays_that_are_no_depth_are_refused(kind: type[np.generic], tmp_path: Path) -> None:
    for i in range(FRAMES):
        write(tmp_path / f"rgb/{i}.png", color(i))
        write(tmp_path / f"depth/{i}.npy", np.ones((48, 64), kind))
    with pytest.raises(InputError, match=r"depth/0\.npy: is \w+ of shape \(48, 64\), not a depth"):
        next(iter(open_recording(tmp_path, calibration=CAMERA)))


INFRARED = {
    "ir": ("ir/{i}.png", ()),
    "infrared": ("infrared/{i}.png", ()),
    "of a pair": ("infra1/{i}.png", ("infra2/{i}.png",)),
    "left and right": ("ir_left/{i}.png", ("ir_right/{i}.png", "thermal/{i}.png")),
    "with depth in one folder": ("ir_{i}.png", ()),
}


@pytest.mark.parametrize("kind", INFRARED)
def test_infrared_images_are_used_if_there_are_none_of_colour(kind: str, tmp_path: Path) -> None:
    infrared, others = INFRARED[kind]
    images(tmp_path, infrared, "depth_{i}.png" if "/" not in infrared else "depth/{i}.png")
    for i in range(FRAMES):
        for name in (infrared, *others):
            grey = 100 + i if name == infrared else 0
            write(tmp_path / name.format(i=i), np.full((48, 64), grey, np.uint8))
    frames = list(open_recording(tmp_path, calibration=CAMERA))
    assert [frame.color[0, 0] for frame in frames] == [100, 101, 102, 103]
    for i in range(FRAMES):
        write(tmp_path / f"photo/{i}.png", color(i))
    (frame, *_) = open_recording(tmp_path, calibration=CAMERA)
    assert frame.color.shape == (48, 64, 3)


BUNDLE_FUSION = """m_colorWidth = {size[0]}
m_colorHeight = {size[1]}
m_depthWidth = 64
m_depthHeight = 48
m_depthShift = {units}
m_calibrationColorIntrinsic = {size[0]} 0 31.5 0 0 {size[1]} 23.5 0 0 0 1 0 0 0 0 1\x20
m_calibrationDepthIntrinsic = 60 0 31.5 0 0 61 23.5 0 0 0 1 0 0 0 0 1\x20
"""


@pytest.mark.parametrize(
    ("name", "ending", "size", "units"),
    [("info", "png", (64, 48), 1000), ("_info", "pgm", (129, 97), 5000)],
    ids=["BundleFusion", "ScanNet's reader"],
)
def test_a_folder_of_bundle_fusion_holds_its_camera(
    name: str, ending: str, size: tuple[int, int], units: int, tmp_path: Path
) -> None:
    folder = tmp_path / "apt0"
    names = ("frame-{i:06d}.color.jpg", f"frame-{{i:06d}}.depth.{ending}")
    images(folder, *names, units=units, color_size=size)
    for i, T in enumerate(POSES):
        text(folder / f"frame-{i:06d}.pose.txt", *map(numbers, T))
    text(folder / f"{name}.txt", BUNDLE_FUSION.format(size=size, units=units))
    with open_recording(folder) as recording:
        frames = list(recording)
        truth = recording.ground_truth
    assert [frame.depth[0, 0] for frame in frames] == [metres(i) for i in range(FRAMES)]
    assert {frame.intrinsics for frame in frames} == {CAMERA}
    assert frames[0].color.shape == (48, 64, 3)
    assert truth is not None
    np.testing.assert_allclose(truth.poses, POSES, atol=1e-6)


def test_lists_of_windows_are_read(tmp_path: Path) -> None:
    lists(tmp_path / "lists", "rgb.txt", "depth.txt", 5000)
    images(tmp_path / "associated", "rgb/{s}.png", "depth/{s}.png", 5000)
    rows = (f"{t} rgb/{t}.png {t} depth/{t}.png" for t in map(stamp_s, range(FRAMES)))
    text(tmp_path / "associated/associations.txt", *rows)
    for folder in (tmp_path / "lists", tmp_path / "associated"):
        for path in folder.glob("*.txt"):
            listed = path.read_text().replace("/", "\\").replace("\n", "\r\n")
            path.write_bytes(listed.encode())
        frames = list(open_recording(folder, calibration=CAMERA))
        assert [frame.depth[0, 0] for frame in frames] == [metres(i) for i in range(FRAMES)]


def test_a_list_of_windows_names_nothing_outside_of_its_folder(tmp_path: Path) -> None:
    folder = tmp_path / "mine"
    lists(folder, "rgb.txt", "depth.txt", 5000)
    text(folder / "depth.txt", *(rf"{stamp_s(i)} ..\depth\{i}.png" for i in range(FRAMES)))
    with pytest.raises(InputError, match="outside"):
        open_recording(folder, calibration=CAMERA)


@pytest.mark.parametrize(
    ("bits", "brightest"), [(10, 1000), (12, 3000), (16, 65535), (8, 200)], ids=str
)
@pytest.mark.parametrize("ending", ["png", "npy"])
def test_infrared_of_16_bits_is_scaled_by_the_bits_that_it_uses(
    bits: int, brightest: int, ending: str, tmp_path: Path
) -> None:
    """By one range in every frame, whichever of them are read, and hot pixels do not count."""
    images(tmp_path, "ir/{i}.png", "depth/{i}.png")
    ramp = np.linspace(0, 1, 64)[None] * np.ones((48, 1))
    for i in range(FRAMES):
        (tmp_path / f"ir/{i}.png").unlink()
        view = np.rint(ramp * brightest * (i + 1) / FRAMES).astype(np.uint16)
        view[0, 0] = 65535
        write(tmp_path / f"ir/{i}.{ending}", view)
    with open_recording(tmp_path, calibration=CAMERA) as recording:
        frames = list(recording)
        (alone,) = open_recording(tmp_path, calibration=CAMERA).select([1])
    white = 2**bits - 1
    for i, frame in enumerate(frames):
        expected = np.rint(ramp * brightest * (i + 1) / FRAMES) * 255 / white
        assert frame.color.dtype == np.uint8
        np.testing.assert_allclose(frame.color[1:], expected[1:], atol=0.51)
        assert frame.color[0, 0] == 255
    np.testing.assert_array_equal(alone.color, frames[1].color)


def test_colour_of_16_bits_keeps_its_colours(tmp_path: Path) -> None:
    images(tmp_path, "rgb/{i}.png", "depth/{i}.png")
    original = [frame.color for frame in open_recording(tmp_path, calibration=CAMERA)]
    for i in range(FRAMES):
        write(tmp_path / f"rgb/{i}.png", color(i).astype(np.uint16) * 257)
    frames = open_recording(tmp_path, calibration=CAMERA)
    assert all(map(np.array_equal, [frame.color for frame in frames], original))

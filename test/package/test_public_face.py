"""What programs import: there, loaded when it is used, and strict about what it is given."""

from __future__ import annotations

import inspect
import os
import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from importlib import metadata
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from rigs.bag_frames import write_small_bag
from rigs.bags import make_frames, recorded, write_rosbag2
from rigs.paths import ROOT

import rgbd_glue_ros
from rgbd_glue_ros import CameraIntrinsics, InputError, RgbdFrame, Trajectory, read_tum, types

CAMERA = CameraIntrinsics(32, 24, 30.0, 30.0, 15.5, 11.5)
COLOR = np.zeros((24, 32, 3), np.uint8)
DEPTH = np.full((24, 32), 2.0, np.float32)
EXAMPLES = ROOT / "examples"
BAG = ROOT / "bags" / "living_room"


def example(name: str, *words: object, cwd: Path = ROOT) -> str:
    """What an example prints."""
    done = subprocess.run(
        [sys.executable, EXAMPLES / name, *map(str, words)],
        cwd=cwd,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_package_alone_loads_nothing_and_every_name_of_it_is_there() -> None:
    program = "import sys, rgbd_glue_ros; print(sorted({'numpy', 'cv2'} & set(sys.modules)))"
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert done.stdout == "[]\n"
    for name in rgbd_glue_ros.__all__:
        assert getattr(rgbd_glue_ros, name).__doc__, f"{name} has no docstring"
    assert rgbd_glue_ros.Trajectory is types.Trajectory
    assert dir(rgbd_glue_ros) == sorted(rgbd_glue_ros.__all__)
    with pytest.raises(AttributeError, match="no attribute 'Odometri'"):
        _ = rgbd_glue_ros.Odometri


def types_in(function: Callable[..., Any]) -> set[type]:
    """The classes of the package that a function's annotations name."""
    names = re.findall(r"\w+", " ".join(map(str, function.__annotations__.values())))
    known = [vars(inspect.getmodule(function)).get(name) for name in names]
    return {t for t in known if inspect.isclass(t) and t.__module__.startswith("rgbd_glue_ros")}


def test_whatever_a_public_name_takes_or_gives_is_public() -> None:
    # for the rest of the package: a shared registration, and what maps are made of
    internal = {"__init__ of Odometry": {"Glue"}, "newest_keyframe of Odometry": {"NewestKeyframe"}}
    public = {getattr(rgbd_glue_ros, name) for name in rgbd_glue_ros.__all__}
    for thing in public:
        members = vars(thing) if inspect.isclass(thing) else {}
        functions = {name: inspect.unwrap(getattr(m, "fget", m)) for name, m in members.items()}
        functions = {name: f for name, f in functions.items() if inspect.isfunction(f)}
        if inspect.isfunction(thing):
            functions = {thing.__name__: thing}
        for name, function in functions.items():
            if name.startswith("_") and name != "__init__":
                continue
            # the sections of a configuration are set by with_values, and read by their names
            if thing is rgbd_glue_ros.Config:
                continue
            hidden = {t.__name__ for t in types_in(function) - public}
            assert hidden <= internal.get(f"{name} of {thing.__name__}", set()), (thing, name)


def test_frames_are_compared_by_identity_and_can_be_kept_in_sets() -> None:
    frame, other = RgbdFrame(0, COLOR, DEPTH, CAMERA), RgbdFrame(0, COLOR, DEPTH, CAMERA)
    assert frame == frame  # noqa: PLR0124 - that is what is tested
    assert frame != other
    assert len({frame, other, frame}) == 2


def test_a_matrix_in_place_of_intrinsics_is_refused_with_what_to_give() -> None:
    with pytest.raises(
        InputError, match=r"intrinsics: are .*\[3, 3\]; give CameraIntrinsics\(width"
    ):
        RgbdFrame(0, COLOR, DEPTH, CAMERA.matrix)  # type: ignore[arg-type]


def test_odometry_needs_no_configuration() -> None:
    with rgbd_glue_ros.Odometry() as odometry:
        assert odometry.learnt_config().features == rgbd_glue_ros.load_preset("live").features


def test_arrays_that_are_a_frame_are_taken_in_colour_and_grey() -> None:
    for color in (COLOR, COLOR[:, :, 0]):
        assert RgbdFrame(0, color, DEPTH, CAMERA).color is color


@pytest.mark.parametrize(
    ("changes", "where", "says"),
    [
        ({"depth": np.full((24, 32), 2000, np.uint16)}, "depth", "d / 1000"),
        ({"depth": DEPTH.astype(np.float64)}, "depth", "is float64 [24, 32]; give float32"),
        ({"depth": DEPTH[:, :, None]}, "depth", "is float32 [24, 32, 1]; give float32 [H, W]"),
        ({"depth": DEPTH[:12]}, "depth", "give depth registered to color"),
        ({"depth": DEPTH.tolist()}, "depth", "is a list"),
        ({"color": COLOR / 255}, "color", "is float64 [24, 32, 3]; give uint8"),
        ({"color": np.zeros((24, 32, 4), np.uint8)}, "color", "[H, W, 3] RGB or [H, W] grey"),
        ({"color": np.zeros(24, np.uint8)}, "color", "is uint8 [24]"),
        ({"stamp_ns": 1.5}, "stamp_ns", "is 1.5; give whole nanoseconds"),
        ({"intrinsics": CAMERA.scaled(64, 48)}, "intrinsics", "64x48, but the images 32x24"),
    ],
)
def test_what_is_no_frame_is_refused_with_what_to_give(
    changes: dict[str, object], where: str, says: str
) -> None:
    with pytest.raises(InputError) as refused:
        replace(RgbdFrame(0, COLOR, DEPTH, CAMERA), **changes)  # type: ignore[arg-type]
    assert refused.value.where == f"RgbdFrame.{where}"
    assert says in str(refused.value)


def test_depth_that_is_known_nowhere_is_depth() -> None:
    RgbdFrame(0, COLOR, np.full((24, 32), np.nan, np.float32), CAMERA)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("fx", 0.0),
        ("fy", -1.0),
        ("fx", np.nan),
        ("fx", "525"),
        ("cx", np.inf),
        ("width", -1),
        ("width", np.nan),
        ("height", np.inf),
        ("distortion", (0.1, np.nan, 0.0, 0.0)),
        ("distortion", ("k1", "k2", "p1", "p2")),
    ],
)
def test_a_camera_that_sees_nothing_is_refused(name: str, value: Any) -> None:
    with pytest.raises(InputError, match=rf"^CameraIntrinsics\.{name}: is "):
        replace(CAMERA, **{name: value})


def test_numbers_of_numpy_become_those_of_python() -> None:
    camera = CameraIntrinsics(*np.array([32, 24, 30, 30, 15.5, 11.5], np.float32))
    assert camera == CAMERA
    stamped = RgbdFrame(np.uint64(5), COLOR, DEPTH, camera)
    kinds = [type(n) for n in (camera.width, camera.height, camera.fx, camera.cy, stamped.stamp_ns)]
    assert kinds == [int, int, float, float, int]


@pytest.mark.parametrize("make", [list, np.array, lambda k: np.array([k])])
def test_a_lens_is_taken_as_opencv_gives_it(make: Callable[[Any], Any]) -> None:
    coefficients = (0.1, 0.0, 0.0, 0.0, 0.0)
    lensed = replace(CAMERA, distortion=make(coefficients))
    assert lensed == replace(CAMERA, distortion=coefficients)
    assert hash(lensed) == hash(replace(CAMERA, distortion=coefficients))


@pytest.mark.parametrize(
    ("stamps_ns", "poses", "where"),
    [
        ([0], np.eye(4)[np.newaxis], "stamps_ns"),
        (np.zeros(2, np.int64), np.eye(4)[np.newaxis], "poses"),
        (np.zeros(1, np.int64), np.full((1, 4, 4), np.nan), "poses"),
        (np.zeros(1, np.int64), np.zeros((1, 4, 4)), "poses"),
        (np.zeros(2, np.int64), np.stack([np.eye(4), np.diag([1.0, 1, -1, 1])]), "poses"),
        (np.zeros(1, np.int64), 2 * np.eye(4)[np.newaxis], "poses"),
    ],
)
def test_a_trajectory_that_is_none_is_refused(stamps_ns: Any, poses: Any, where: str) -> None:
    with pytest.raises(InputError, match=rf"^Trajectory\.{where}: is "):
        Trajectory(stamps_ns, poses)


def test_a_masked_array_is_refused_with_what_to_give_in_its_place() -> None:
    depth = np.ma.masked_array(np.ones((4, 6), np.float32), np.eye(4, 6) > 0)
    color = np.zeros((4, 6, 3), np.uint8)
    with pytest.raises(InputError, match=r"is a masked array, float32 .*depth.filled\(np.nan\)"):
        RgbdFrame(0, color, depth, CameraIntrinsics(6, 4, 5.0, 5.0, 3.0, 2.0))


CONFIG = rgbd_glue_ros.load_preset("live")


def wrong(value: object) -> Any:
    """An argument of another class than the annotation says."""
    return value


@pytest.mark.parametrize(
    ("call", "told"),
    [
        (
            lambda _: rgbd_glue_ros.Odometry(wrong("live")),
            "Odometry.config: is of class str, not Config; give load_preset('live')",
        ),
        (
            lambda f: rgbd_glue_ros.register(f, f, wrong("live")),
            "register.config: is of class str, not Config; give load_preset('paper')",
        ),
        (
            lambda _: rgbd_glue_ros.register(wrong(COLOR), wrong(DEPTH)),
            "register.source: is of class ndarray, not RgbdFrame; give RgbdFrame(",
        ),
        (
            lambda _: replace(CAMERA, lens=wrong("plumb_bob")),
            "lens: is of class str, not LensModel; give LensModel('plumb_bob')",
        ),
        (lambda _: replace(CAMERA, width=wrong(640.5)), "CameraIntrinsics.width: is 640.5"),
        (
            lambda _: replace(CAMERA, width=0, height=0).scaled(3, 2),
            "CameraIntrinsics.scaled: the size of the image is not known",
        ),
        (
            lambda _: rgbd_glue_ros.open_recording(wrong(None)),
            "path: is of class NoneType, not str or Path; give a bag",
        ),
        (
            lambda _: rgbd_glue_ros.with_values(CONFIG, wrong(["glue.k"])),
            "changes: is of class list, not Mapping; give {'glue.k': 3.0}",
        ),
    ],
)
def test_an_argument_of_another_class_is_refused_with_what_to_give(
    call: Callable[[Any], Any], told: str
) -> None:
    with pytest.raises(InputError, match=re.escape(told)):
        call(RgbdFrame(0, COLOR, DEPTH, CAMERA))


def test_an_odometry_takes_frames_and_samples_and_no_arrays() -> None:
    with rgbd_glue_ros.Odometry() as odometry:
        with pytest.raises(InputError, match=r"frame: is of class ndarray, not RgbdFrame;"):
            odometry.process(wrong(COLOR))
        with pytest.raises(InputError, match=r"samples: is of class ndarray, not ImuSamples"):
            odometry.add_imu(wrong(DEPTH))


def test_numbers_of_numpy_are_taken_as_parameters() -> None:
    changes = {"features.keypoints": np.int64(500), "glue.k": np.float64(3.0)}
    config = rgbd_glue_ros.with_values(CONFIG, changes)
    assert (config.features.keypoints, config.glue.k) == (500, 3.0)


@pytest.mark.slow
@pytest.mark.every_python
def test_the_example_in_the_readme_runs_as_it_stands(tmp_path: Path) -> None:
    (program,) = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)
    write_rosbag2(tmp_path / "recording", recorded(make_frames(3)))
    done = subprocess.run(
        [sys.executable, "-c", program],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("name", ["bag_to_trajectory.py", "own_visual_feature.py"])
def test_an_example_without_its_arguments_says_how_it_is_used(name: str) -> None:
    done = subprocess.run(
        [sys.executable, str(EXAMPLES / name)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 1
    assert done.stderr.startswith(f"usage: python examples/{name} RECORDING")
    assert done.stderr.count("\n") == 1


def test_the_version_is_that_of_the_installed_package() -> None:
    try:
        installed = metadata.version("rgbd_glue_ros")
    except metadata.PackageNotFoundError:
        installed = ""
    assert rgbd_glue_ros.__version__ == installed


def test_a_comparison_with_ground_truth_is_written_in_one_short_line() -> None:
    poses = np.tile(np.eye(4), (4, 1, 1))
    poses[:, 0, 3] = range(4)
    trajectory = Trajectory(np.arange(4, dtype=np.int64) * 10**9, poses)
    said = repr(rgbd_glue_ros.evaluate(trajectory, trajectory))
    assert said.startswith("Evaluation(4 poses, Ape(rmse_m=")
    assert len(said) < 250


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.py")), ids=lambda path: path.stem)
def test_an_example_is_short(path: Path) -> None:
    assert len(path.read_text(encoding="utf-8").splitlines()) < 40


@pytest.mark.slow
def test_the_example_of_arrays_finds_how_the_camera_moved() -> None:
    found, truth, _ = example("arrays_to_pose.py").splitlines()
    np.testing.assert_allclose(
        [float(word) for word in found.split()[2:5]],
        [float(word) for word in truth.split()[2:5]],
        atol=0.001,
    )


@pytest.mark.slow
def test_the_example_of_a_bag_leaves_a_trajectory_and_a_picture(tmp_path: Path) -> None:
    example("bag_to_trajectory.py", write_small_bag(tmp_path / "bag", 20), tmp_path / "out")
    trajectory: Trajectory = read_tum(tmp_path / "out" / "trajectory.txt")
    assert len(trajectory) == 20
    picture = cv2.imread(str(tmp_path / "out" / "path.png"))
    assert picture is not None
    assert (picture != 255).any()


@pytest.mark.slow
def test_the_example_of_a_feature_of_ones_own_tracks_with_it(tmp_path: Path) -> None:
    bag = write_small_bag(tmp_path / "bag", 20)
    assert example("own_visual_feature.py", bag).count("'tracking'") == 20


def test_a_feature_cannot_take_the_name_of_another() -> None:
    with pytest.raises(InputError, match="visual feature 'orb': exists already"):
        rgbd_glue_ros.add_visual_feature("orb", lambda _: None)  # type: ignore[arg-type,return-value]


def test_beside_a_clone_that_bears_its_name_the_package_is_imported_and_not_the_folder(
    tmp_path: Path,
) -> None:
    (tmp_path / "rgbd_glue_ros").symlink_to(ROOT)
    program = "from rgbd_glue_ros import Odometry; print(Odometry.__name__)"
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert (done.stdout, done.stderr) == ("Odometry\n", "")

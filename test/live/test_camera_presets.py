from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest
from rigs.bags import (
    COLOR,
    DEPTH,
    INFO,
    assert_same_frame,
    make_frames,
    recorded,
    write_rosbag2,
)
from rigs.data_sets import write_data_set
from rigs.paths import ROOT

from rgbd_glue_ros import parameters as config
from rgbd_glue_ros.cli.main import main
from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.live.camera_presets import camera_names, load_camera, remappings
from rgbd_glue_ros.messages.images import is_rectified
from rgbd_glue_ros.recordings import open_recording
from rgbd_glue_ros.recordings.bag.recording import BagRecording

FOLDER = ROOT / "config" / "cameras"
PAGE = ROOT / "docs" / "first_camera.md"


def test_the_common_cameras_have_presets() -> None:
    assert camera_names() == [
        "azure_kinect",
        "gazebo",
        "kinect_v1",
        "kinect_v2",
        "oak_d",
        "orbbec_astra",
        "orbbec_femto",
        "orbbec_gemini",
        "realsense_d400",
        "realsense_l515",
        "zed",
    ]


@pytest.mark.parametrize("name", camera_names())
def test_a_preset_names_the_driver_and_all_subscribed_topics(name: str) -> None:
    camera = load_camera(name)
    assert {"color", "depth", "camera_info"} <= set(camera.topics)
    assert all(topic.startswith("/") for topic in camera.topics.values())
    text = (FOLDER / f"{name}.yaml").read_text(encoding="utf-8")
    assert "#   ros2 " in text, "say how the driver is started"


@pytest.mark.parametrize("name", camera_names())
def test_colour_and_depth_of_a_preset_are_both_rectified_or_both_not(name: str) -> None:
    topics = load_camera(name).topics
    assert is_rectified(topics["color"]) == is_rectified(topics["depth"])


@pytest.mark.parametrize("name", camera_names())
def test_images_of_cameras_that_may_be_wider_than_640_are_reduced(name: str) -> None:
    are_small = name in {"kinect_v1", "orbbec_astra"}
    assert load_camera(name).parameters.get("max_width", 0) == (0 if are_small else 640)


@pytest.mark.parametrize("name", camera_names())
def test_a_bag_with_the_topics_of_a_preset_is_read_without_options(
    name: str, tmp_path: Path
) -> None:
    topics = load_camera(name).topics
    renamed = {COLOR: topics["color"], DEPTH: topics["depth"], INFO: topics["camera_info"]}
    frames = make_frames(2)
    messages = [replace(m, topic=renamed[m.topic]) for m in recorded(frames)]
    with open_recording(write_rosbag2(tmp_path / "bag", messages)) as recording:
        read = list(recording)
    assert len(read) == len(frames)
    for frame, original in zip(read, frames, strict=True):
        assert_same_frame(frame, original)


@pytest.fixture(scope="module")
def data_set(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A few frames of a data set, and their calibration."""
    folder = tmp_path_factory.mktemp("data") / "poster"
    return folder, write_data_set(folder, 2)


@pytest.mark.parametrize("name", camera_names())
def test_a_recording_is_converted_to_a_bag_with_the_topics_of_a_preset(
    name: str, data_set: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source, calibration = data_set
    words = ["convert", str(source), str(tmp_path / "bag"), "--calibration", str(calibration)]
    assert main([*words, "--topics-like", name]) == 0
    topics = load_camera(name).topics
    named = [topics["color"], topics["depth"], topics["camera_info"]]
    said = capsys.readouterr().out
    assert f"topics   {', '.join(named)}\n" in said
    assert f"play it  rgbd-glue play {tmp_path / 'bag'} --camera {name}\n" in said
    with open_recording(tmp_path / "bag") as bag:
        assert isinstance(bag, BagRecording)
        assert [bag.topics.color, bag.topics.depth, bag.topics.info] == named
        assert len(list(bag)) == 2


def test_a_recording_is_converted_to_the_topics_of_the_preset_that_the_help_calls_the_default(
    data_set: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source, calibration = data_set
    words = ["convert", str(source), str(tmp_path / "bag"), "--calibration", str(calibration)]
    assert main(words) == 0
    topics = load_camera("realsense_d400").topics
    named = [topics["color"], topics["depth"], topics["camera_info"]]
    assert f"topics   {', '.join(named)}\n" in capsys.readouterr().out
    with pytest.raises(SystemExit):
        main(["convert", "--help"])
    assert "(default: realsense_d400)" in " ".join(capsys.readouterr().out.split())


@pytest.mark.parametrize("name", ["bag.mcap", "bag.db3", "run.bag"])
def test_a_recording_is_not_converted_to_a_folder_with_the_name_of_a_file(
    name: str, data_set: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source, calibration = data_set
    target = tmp_path / name
    words = ["convert", str(source), str(target), "--calibration", str(calibration)]
    assert main(words) == 2
    suffix = name.rpartition(".")[2]
    assert f"give it a name without .{suffix}" in capsys.readouterr().err
    assert not target.exists()


def test_a_bag_is_not_converted_to_a_bag_of_other_topics(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = str(ROOT / "bags" / "living_room")
    assert main(["convert", bag, str(tmp_path / "out"), "--topics-like", "zed"]) == 2
    assert "--topics-like: " in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("name", camera_names())
def test_a_preset_is_in_the_documentation(name: str) -> None:
    assert f"| `{name}` |" in PAGE.read_text("utf-8")


@pytest.mark.parametrize("name", camera_names())
def test_a_driver_is_started_as_its_preset_says(name: str) -> None:
    preset = (FOLDER / f"{name}.yaml").read_text("utf-8")
    commands = re.findall(r"^#   (ros2 .+)$", preset, re.MULTILINE)
    documented = re.findall(r"^    (ros2 .+)$", PAGE.read_text("utf-8"), re.MULTILINE)
    assert commands
    assert set(commands) <= set(documented)


def test_an_unknown_camera_is_refused_with_the_known_names() -> None:
    with pytest.raises(InputError, match=r"camera 'd435': is not known; use one of azure_kinect,"):
        load_camera("d435")


@pytest.mark.parametrize("name", ["d400", "D400", "realsense_d40"])
def test_for_an_unknown_camera_a_similar_name_is_suggested(name: str) -> None:
    with pytest.raises(
        InputError, match=r"did you mean realsense_d400\? Otherwise use one of azure"
    ):
        load_camera(name)


@pytest.mark.parametrize(
    ("text", "cause"),
    [
        ("topics: {colour: /a}\nparameters: {}", "no such topics: {'colour'}"),
        ("/**: {ros__parameters: {glue.k: 3}}", r"is not a camera preset.*it holds /\*\*; give a"),
        ("{}", "it holds nothing"),
        ("topics: {}\nparameters: {camera.depth_mix: 1}", r"mine\.yaml: .*mean camera.depth_m"),
        ("topics: {}\nparameters: {camera.depth_max: far}", r"mine\.yaml: .*not of type float"),
    ],
)
def test_a_preset_with_a_misspelt_name_or_a_bad_value_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str, cause: str
) -> None:
    (tmp_path / "config" / "cameras").mkdir(parents=True)
    (tmp_path / "config" / "cameras" / "mine.yaml").write_text(text)
    monkeypatch.setattr(config, "share_directory", lambda: tmp_path)
    with pytest.raises(InputError, match=cause):
        load_camera("mine")


def test_given_topics_override_those_of_the_camera() -> None:
    camera = load_camera("azure_kinect")
    assert remappings(camera, {"color": "", "depth": "/mine"}) == [
        ("rgb/image", "/rgb/image_raw"),
        ("depth/image", "/mine"),
        ("rgb/camera_info", "/rgb/camera_info"),
    ]
    assert remappings(None, {"color": "", "depth_camera_info": "/info"}) == [
        ("depth/camera_info", "/info")
    ]

"""Every command that leaves results has its folder for itself."""

from __future__ import annotations

import importlib.util
import os
from datetime import datetime
from pathlib import Path

import pytest
from rigs.data_sets import write_data_set
from rigs.maps import map_of

from rgbd_glue_ros.cli.main import main
from rgbd_glue_ros.files.writing import ResultFolder
from rgbd_glue_ros.slam.map_file import write_map

OWN = [
    ("replay", "--cloud", "out/trajectory.txt"),
    ("replay", "--cloud", "out/report.html"),
    ("replay", "--cloud", "out/metrics.json/cloud.ply"),
    ("replay", "--cloud", "way/../link/params.yaml"),
    ("replay", "--rerun", "out/trajectory.txt"),
    ("replay", "--mcap", "out/keyframes.g2o"),
    ("map", "--save-map", "out/map.ply"),
    ("map", "--save-map", "out/odometry.txt"),
    ("map", "--rerun", "out/report.html"),
]


def skip_if_missing(command: str) -> None:
    """Skips the test of a command whose extra is not installed."""
    if command == "map" and importlib.util.find_spec("gtsam") is None:
        pytest.skip("GTSAM is not installed")


def prepare(command: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Works in a folder with the recording ``desk``."""
    skip_if_missing(command)
    monkeypatch.chdir(folder)
    write_data_set(folder / "desk", 2)


def refused(words: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    """The one line that a command ends with."""
    assert main(words) == 2
    (line,) = capsys.readouterr().err.splitlines()
    return line


@pytest.mark.parametrize(("command", "option", "place"), OWN)
def test_what_is_written_beside_results_takes_no_place_of_theirs(
    command: str,
    option: str,
    place: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    prepare(command, tmp_path, monkeypatch)
    for folder in ("out", "way"):
        Path(folder).mkdir()
    Path("link").symlink_to("out")
    Path("out/trajectory.txt").write_text("of an earlier run")
    line = refused([command, "desk", "-o", "out", option, place], capsys)
    cause = "is a result of this run itself; give another path"
    assert line == f"rgbd-glue: {option}: {place} {cause}"
    assert Path("out/trajectory.txt").read_text() == "of an earlier run"
    assert [path.name for path in Path("out").iterdir()] == ["trajectory.txt"]


@pytest.mark.parametrize("place", ["out", "."])
def test_what_is_written_beside_results_is_no_folder_of_theirs(
    place: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    write_data_set(tmp_path / "desk", 2)
    line = refused(["replay", "desk", "-o", "out", "--mcap", place], capsys)
    assert line.startswith(f"rgbd-glue: --mcap: {place} is a folder of the results; give a path")


def test_two_things_written_beside_results_are_not_the_same_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    write_data_set(tmp_path / "desk", 2)
    line = refused(["replay", "desk", "-o", "out", "--cloud", "x", "--mcap", "./x"], capsys)
    assert line == "rgbd-glue: --mcap: x is that of --cloud, too; give another path"


@pytest.mark.parametrize("name", ["cloud.pcd", "cloud.las"])
def test_a_cloud_of_another_format_than_that_of_its_name_is_refused(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    write_data_set(tmp_path / "desk", 2)
    line = refused(["replay", "desk", "-o", "out", "--cloud", name], capsys)
    assert line.endswith(
        f"--cloud: {name} is written as PLY, whatever its name; give a name that ends in .ply"
    )
    assert not Path("out").exists()


@pytest.mark.slow
def test_what_stays_of_an_earlier_run_beside_new_results_is_named(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    calibration = write_data_set(tmp_path / "desk", 3)
    out = tmp_path / "out"
    words = ["replay", str(tmp_path / "desk"), "-o", str(out), "--calibration", str(calibration)]
    clouds = ["--cloud", str(out / "c.ply")]
    assert main([*words, *clouds, "--mcap", str(out / "mcap")]) == 0
    assert not caplog.messages
    (out / "notes.txt").touch()
    assert main([*words, *clouds]) == 0
    (said,) = caplog.messages
    assert said == f"{out}: replacing the results of desk; of an earlier run there stay mcap/"
    caplog.clear()
    assert main(words) == 0
    assert caplog.messages[0].endswith("there stay c.ply, mcap/")


@pytest.mark.parametrize(("command", "option"), [("replay", "--cloud"), ("map", "--save-map")])
@pytest.mark.parametrize("place", ["desk", "/proc/file", "desk/rgb.txt/file", "x" * 300])
def test_where_no_file_can_be_written_that_is_said_before_the_first_frame(
    command: str,
    option: str,
    place: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    prepare(command, tmp_path, monkeypatch)
    line = refused([command, "desk", "-o", "out", option, place], capsys)
    assert line.startswith(f"rgbd-glue: {place}: ")
    assert line.endswith("; give another path")
    assert not Path("out").exists()


@pytest.mark.parametrize(("command", "option"), [("replay", "--cloud"), ("map", "--save-map")])
def test_a_read_only_file_is_not_replaced_and_that_is_said_before_the_first_frame(
    command: str,
    option: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    prepare(command, tmp_path, monkeypatch)
    place = Path("kept.ply")
    place.write_text("of another place")
    place.chmod(0o444)
    line = refused([command, "desk", "-o", "out", option, str(place)], capsys)
    cause = "is read-only; make it writable (chmod u+w), or give another path"
    assert line == f"rgbd-glue: kept.ply: {cause}"
    assert place.read_text() == "of another place"
    assert not Path("out").exists()


@pytest.mark.parametrize(
    ("is_map", "said"),
    [(True, "the map of 1 keyframe"), (False, "a file that is no map of this version")],
)
def test_a_map_that_is_replaced_is_named_with_its_keyframes_and_its_time_before_the_first_frame(
    is_map: bool,
    said: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    skip_if_missing("map")
    monkeypatch.chdir(tmp_path)
    write_data_set(tmp_path / "desk", 2)
    room = Path("room.rgbdmap")
    if is_map:
        write_map(room, map_of(1))
    else:
        room.write_text("notes")
    written = datetime(2026, 3, 4, 17, 5).astimezone()
    os.utime(room, (written.timestamp(),) * 2)
    with ResultFolder(Path("out"), ()):  # so that no frame is read
        assert main(["map", "desk", "-o", "out", "--save-map", str(room)]) == 2
    (record,) = caplog.records
    assert record.levelname == "WARNING"
    assert record.message == (
        f"room.rgbdmap: replacing {said}, written 2026-03-04 17:05, once this one is finished"
    )


@pytest.mark.parametrize("command", ["replay", "map", "pairs", "bench", "demo"])
def test_a_command_refuses_a_folder_that_another_run_writes_to(
    command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    skip_if_missing(command)
    write_data_set(tmp_path / "desk", 2)
    out = tmp_path / "out"
    with ResultFolder(out, ()):
        (out / "own").write_text("x")
        assert main([command, str(tmp_path / "desk"), "-o", str(out)]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert "out: another run is writing to it" in line
    assert [path.name for path in out.iterdir()] == ["own"]


@pytest.mark.parametrize(
    ("command", "option", "place"),
    [
        ("replay", "--mcap", "out/desk"),
        ("replay", "--mcap", "out"),
        ("replay", "--cloud", "out/desk"),
        ("map", "--save-map", "out/desk"),
    ],
)
def test_what_would_be_where_the_results_go_is_refused_before_any_work(
    command: str, option: str, place: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_data_set(tmp_path / "desk", 2)
    out = tmp_path / "out" / "desk"
    code = main(
        [command, str(tmp_path / "desk"), "-o", str(out), option, str(tmp_path / place)],
    )
    assert code == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert (
        f"{option}: {tmp_path / place} is a folder of the results; give a path of its own" in line
    )
    assert not out.parent.exists()

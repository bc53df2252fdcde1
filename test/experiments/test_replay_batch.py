"""Replays of many recordings: each has its folder, one that fails stops no other."""

from __future__ import annotations

import json
import logging
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import make_bag
import pytest
from rigs.opener import OpenerByName
from rigs.pan import CAMERA, Pan

from rgbd_glue_ros.cli import main as cli
from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.experiments.batch.opening import Opening
from rgbd_glue_ros.experiments.replay.batch import FIGURES, JOURNAL, TABLE, named, run_replays
from rgbd_glue_ros.experiments.replay.result_names import METRICS, REPORT, TRAJECTORY
from rgbd_glue_ros.parameters import Config, InputConfig
from rgbd_glue_ros.recordings import Calibration, Topics
from rgbd_glue_ros.types import RgbdFrame


def replayed(folder: Path, on_replayed: Any = lambda _: None, **pans: Pan) -> dict[str, Any]:
    paths = [folder.parent / "set" / name for name in pans]
    return run_replays(paths, OpenerByName(**pans), Config(), folder, on_replayed=on_replayed)


def test_recordings_are_named_by_their_paths_below_the_folder_of_all(tmp_path: Path) -> None:
    heads, stairs = tmp_path / "heads" / "seq-01", tmp_path / "stairs" / "seq-01"
    assert named([heads, stairs]) == {"heads/seq-01": heads, "stairs/seq-01": stairs}
    assert named([heads, heads.with_name("seq-02")]) == {
        "seq-01": heads,
        "seq-02": heads.with_name("seq-02"),
    }


def test_one_that_fails_is_reported_and_the_others_go_on(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    out = tmp_path / "out"
    figures = replayed(out, a=Pan(4), b=Pan(8, breaks_after=2), c=Pan(5))
    assert {name: f["frames"] for name, f in figures["recordings"].items()} == {"a": 4, "c": 5}
    assert "rgb/7.png: is damaged" in figures["problems"][0]
    assert "rgb/7.png: is damaged" in caplog.text
    assert json.loads((out / FIGURES).read_text()) == figures
    table = (out / TABLE).read_text()
    assert "| a | 4 |" in table
    assert "- rgb/7.png: is damaged" in table
    # what was done of it is there too
    for name in "abc":
        assert (out / name / REPORT).is_file()


@pytest.mark.slow
def test_a_run_that_broke_off_goes_on(tmp_path: Path) -> None:
    def interrupt(_: str) -> None:
        raise KeyboardInterrupt

    out = tmp_path / "out"
    with pytest.raises(KeyboardInterrupt):
        replayed(out, interrupt, a=Pan(4), b=Pan(4))
    assert list(json.loads((out / FIGURES).read_text())["recordings"]) == ["a"]
    more: list[str] = []
    figures = replayed(out, more.append, a=Pan(4), b=Pan(4))
    assert more == ["b"]
    assert list(figures["recordings"]) == ["a", "b"]
    # finished: the next run starts anew
    replayed(out, more.append, a=Pan(4), b=Pan(4))
    assert more == ["b", "a", "b"]


def interrupted_batch(out: Path, sources: list[Path], opening: Opening) -> None:
    def interrupt(_: str) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_replays(sources, opening, Config(), out, limit=2, on_replayed=interrupt)


def links(folder: Path) -> list[Path]:
    """Two recordings in a folder."""
    folder.mkdir()
    for name in "ab":
        (folder / name).symlink_to(make_bag.FOLDER)
    return [folder / name for name in "ab"]


@pytest.mark.slow
def test_other_recordings_of_the_same_names_do_not_continue_a_run(tmp_path: Path) -> None:
    out, opening = tmp_path / "out", Opening()
    interrupted_batch(out, links(tmp_path / "one"), opening)
    (tmp_path / "bag").mkdir()
    for file in make_bag.FOLDER.iterdir():
        (tmp_path / "bag" / file.name).symlink_to(file)
    others = [tmp_path / "two" / name for name in "ab"]
    others[0].parent.mkdir()
    for other in others:
        other.symlink_to(tmp_path / "bag")
    with pytest.raises(InputError, match="an interrupted run with other parameters or rec"):
        run_replays(others, opening, Config(), out, limit=2)


@pytest.mark.slow
@pytest.mark.parametrize(
    "other",
    [
        Opening(topics=Topics(imu="")),
        Opening(calibration=Calibration(CAMERA)),
        Opening(depth_calibration=Calibration(CAMERA)),
        Opening(inputs=InputConfig(depth_scale=1e-3)),
    ],
)
def test_recordings_opened_in_another_way_do_not_continue_a_run(
    tmp_path: Path, other: Opening
) -> None:
    out, sources = tmp_path / "out", links(tmp_path / "set")
    interrupted_batch(out, sources, Opening())
    with pytest.raises(InputError, match="an interrupted run with other parameters"):
        run_replays(sources, other, Config(), out, limit=2)


def test_a_calibration_counts_by_its_content() -> None:
    openings = [Opening(calibration=Calibration(CAMERA, source=name)) for name in ("a", "./a")]
    assert openings[0].as_json() == openings[1].as_json()


def test_when_none_can_be_replayed_the_first_cause_is_the_error(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no recording could be replayed .*is damaged"):
        replayed(tmp_path / "out", a=Pan(4, breaks_after=0), b=Pan(4, breaks_after=0))


@pytest.mark.slow
def test_the_command_gives_the_same_trajectories_in_this_process_and_on_workers(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("distributed")
    for name in ("one", "two"):
        (tmp_path / "bags" / name).parent.mkdir(exist_ok=True)
        (tmp_path / "bags" / name).symlink_to(make_bag.FOLDER)
    for out, arguments in (("serial", []), ("parallel", ["--workers", "2"])):
        command = ["replay", str(tmp_path / "bags"), "-o", str(tmp_path / out), "--limit", "8"]
        assert cli.main([*command, *arguments]) == 0
    assert "| recording |" in capsys.readouterr().out
    for name in ("one", "two"):
        texts = [(tmp_path / out / name / TRAJECTORY).read_text() for out in ("serial", "parallel")]
        assert texts[0] == texts[1]
        assert len(texts[0].splitlines()) == 9
        assert json.loads((tmp_path / "parallel" / name / METRICS).read_text())["frames"] == 8
    assert (tmp_path / "parallel" / JOURNAL).is_file()


@pytest.mark.slow
def test_after_the_rest_a_missing_recording_is_the_error_and_one_given_twice_is_said(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    caplog: pytest.LogCaptureFixture,
) -> None:
    links(tmp_path / "set")
    monkeypatch.chdir(tmp_path / "set")
    given = ["a", "./a", str(tmp_path / "set" / "a"), "nope"]
    assert cli.main(["replay", *given, "-o", "out", "--limit", "2"]) == 2
    said = capsys.readouterr()
    assert "| a | 2 |" in said.out
    assert "1 of 2 recordings: could not be replayed" in said.err
    assert "a: given more than once, taken once" in caplog.messages
    assert any(text.startswith("nope: does not exist") for text in caplog.messages)


def test_warnings_name_which_of_many_recordings_they_are_about(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    class Doubted(Pan):
        def __iter__(self) -> Iterator[RgbdFrame]:
            logging.getLogger("rgbd_glue_ros.recordings").warning("is %s", "dark")
            return super().__iter__()

    paths = [tmp_path / "set" / name for name in "ab"]
    run_replays(paths, OpenerByName(a=Doubted(3), b=Pan(3)), Config(), tmp_path / "out")
    assert caplog.messages == [f"{paths[0]}: is dark"]
    assert "<li>is dark</li>" in (tmp_path / "out" / "a" / REPORT).read_text(encoding="utf-8")


def test_a_given_truth_is_of_one_recording(tmp_path: Path) -> None:
    arguments = ["replay", str(make_bag.FOLDER), str(tmp_path), "-o", str(tmp_path / "out")]
    assert cli.main([*arguments, "--ground-truth", "truth.txt"]) == 2

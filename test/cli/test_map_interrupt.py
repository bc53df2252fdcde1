"""What ``map`` says of the map when it is interrupted."""

from __future__ import annotations

import signal
from pathlib import Path
from typing import Any

import pytest
from rigs.data_sets import write_data_set

from rgbd_glue_ros.cli.main import main

pytest.importorskip("gtsam", reason="GTSAM is not installed")

from rgbd_glue_ros.experiments.mapping import mapping

ALONE = "of the odometry alone: no loop is closed in odometry.txt, and there is no map"


@pytest.mark.parametrize(
    ("written", "save", "before", "said"),
    [
        (
            (),
            True,
            False,
            (
                "interrupted before the first frame was done; there are no results; "
                "the map was not saved in room"
            ),
        ),
        (
            ("metrics.json", "odometry.txt"),
            True,
            True,
            (
                f"interrupted; the results so far are in out, {ALONE}; the map was not saved in "
                "room, and the file that was there is unchanged"
            ),
        ),
        (
            ("metrics.json", "odometry.txt"),
            False,
            False,
            (
                f"interrupted; the results so far are in out, {ALONE}; no map was to be saved "
                "(--save-map)"
            ),
        ),
        (
            ("metrics.json", "odometry.txt", "trajectory.txt", "../room"),
            True,
            True,
            (
                "interrupted after the loops were closed; the results are in out; the map is "
                "saved in room"
            ),
        ),
        (
            ("metrics.json", "odometry.txt", "trajectory.txt"),
            True,
            False,
            (
                "interrupted after the loops were closed; the results are in out; the map was not "
                "saved in room"
            ),
        ),
    ],
)
def test_an_interrupted_map_is_said_to_be_saved_or_not(
    written: tuple[str, ...],
    save: bool,
    before: bool,
    said: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    def interrupt(*_: object, **__: Any) -> None:
        Path("out").mkdir()
        for name in written:
            file = Path("out", name)
            file.unlink(missing_ok=True)
            file.write_text("of this run")
        raise KeyboardInterrupt

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(mapping, "map_recording", interrupt)
    write_data_set(tmp_path / "desk", 2)
    if before:
        Path("room").write_text("of an earlier run")
    words = ["--save-map", "room"] if save else []
    assert main(["map", "desk", "-o", "out", *words]) == 128 + signal.SIGINT
    assert caplog.messages[-1] == said

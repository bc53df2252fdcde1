"""Every command that leaves results has its folder for itself."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest
from rigs.data_sets import write_data_set

from rgbd_glue_ros.cli.main import main
from rgbd_glue_ros.files.writing import ResultFolder


@pytest.mark.parametrize("command", ["replay", "map", "pairs", "bench", "demo"])
def test_a_command_refuses_a_folder_that_another_run_writes_to(
    command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    if command == "map" and importlib.util.find_spec("gtsam") is None:
        pytest.skip("GTSAM is not installed")
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
    assert f"{option} {tmp_path / place}: is where the results go (-o {out})" in line
    assert not out.parent.exists()

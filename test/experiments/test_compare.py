"""Runs of a recording are compared by what they left in their folders."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from rigs.pages import Page
from rigs.pan import Pan

from rgbd_glue_ros.cli.main import main
from rgbd_glue_ros.experiments.compare.comparison import (
    compare,
    differing_parameters,
    figures_table,
    parameters_text,
)
from rgbd_glue_ros.experiments.compare.finished_run import read_runs
from rgbd_glue_ros.experiments.compare.report import write_report
from rgbd_glue_ros.experiments.replay.replay import replay
from rgbd_glue_ros.experiments.replay.result_names import METRICS, PARAMETERS, REPORT, TRAJECTORY
from rgbd_glue_ros.parameters import Config, with_values

LENGTH = 40


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of runs: two of the same recording, one of another."""
    out = tmp_path_factory.mktemp("runs")
    replay(Pan(LENGTH), Config(), out / "before")
    replay(Pan(LENGTH), with_values(Config(), {"glue.k": 4.0, "seed": 3}), out / "after")
    replay(Pan(3, name="kitchen"), Config(), out / "kitchen")
    return out


def copied(run: Path, target: Path) -> Path:
    """A run of the same results, to be changed by a test."""
    target.mkdir()
    for name in (METRICS, PARAMETERS, TRAJECTORY):
        (target / name).write_bytes((run / name).read_bytes())
    return target


def with_figures(run: Path, **figures: object) -> Path:
    """The run with some of its figures replaced."""
    content = json.loads((run / METRICS).read_text())
    (run / METRICS).write_text(json.dumps({**content, **figures}))
    return run


def cells(table: str, title: str) -> list[str]:
    """The cells of a row."""
    (row,) = [line for line in table.splitlines() if line.startswith(f"| {title} ")]
    return [cell.strip() for cell in row.split("|")[2:-1]]


def test_figures_of_each_run_are_in_one_table_with_the_ratio_to_the_first(
    runs: Path, tmp_path: Path
) -> None:
    slower = copied(runs / "before", tmp_path / "slower")
    latency = {"p50": 30.0, "p95": 45.0}
    first = with_figures(
        copied(runs / "before", tmp_path / "first"), latency_ms=latency, peak_rss_mb=400.0
    )
    with_figures(slower, latency_ms={"p50": 60.0, "p95": 67.5}, peak_rss_mb=300.0, lost=2)
    table = figures_table(compare(read_runs([first, slower])))
    assert table.splitlines()[0].split() == ["|", "|", "first", "|", "slower", "|"]
    assert cells(table, "frames") == ["40", "40 (x 1.00)"]
    # there is no ratio to nothing
    assert cells(table, "lost") == ["0", "2"]
    assert cells(table, "latency, median (ms)") == ["30.0", "60.0 (x 2.00)"]
    assert cells(table, "latency, p95 (ms)") == ["45.0", "67.5 (x 1.50)"]
    assert cells(table, "memory, peak (MB)") == ["400", "300 (x 0.75)"]
    assert cells(table, "apart from the first, rmse (cm)") == ["–", "0.00"]
    for title in ("APE rmse (cm)", "drift, RPE rmse (cm/s)", "rotation drift, RPE rmse (°/s)"):
        assert cells(table, title)[1].endswith(" (x 1.00)")


def test_errors_of_a_run_without_ground_truth_are_a_dash(runs: Path, tmp_path: Path) -> None:
    blind = with_figures(copied(runs / "before", tmp_path / "blind"), ape=None, rpe=None)
    table = figures_table(compare(read_runs([runs / "before", blind])))
    assert cells(table, "APE rmse (cm)")[1] == "–"
    table = figures_table(compare(read_runs([blind, runs / "before"])))
    assert "(x" not in cells(table, "APE rmse (cm)")[1]


def test_only_parameters_that_differ_are_named_with_the_value_of_each_run(runs: Path) -> None:
    compared = read_runs([runs / "before", runs / "after"])
    text = parameters_text(compared)
    assert cells(text, "glue.k") == ["0.0", "4.0"]
    assert cells(text, "seed") == ["0", "3"]
    assert len(text.splitlines()) == 4


def test_runs_with_the_same_parameters_are_said_to_have_them(runs: Path, tmp_path: Path) -> None:
    again = copied(runs / "before", tmp_path / "again")
    assert parameters_text(read_runs([runs / "before", again])) == "No parameter differs."


def test_a_parameter_that_only_another_version_has_is_a_dash(runs: Path, tmp_path: Path) -> None:
    newer = copied(runs / "before", tmp_path / "newer")
    file = newer / PARAMETERS
    file.write_text(file.read_text() + "    of_the_future: 'yes'\n")
    compared = read_runs([runs / "before", newer])
    assert differing_parameters(compared) == {"of_the_future": [None, "yes"]}
    assert cells(parameters_text(compared), "of_the_future") == ["–", "yes"]


def test_versions_of_the_package_that_differ_are_named(runs: Path, tmp_path: Path) -> None:
    newer = with_figures(copied(runs / "before", tmp_path / "newer"), version="9.8.7")
    old = with_figures(copied(runs / "before", tmp_path / "old"), version=None)
    text = parameters_text(read_runs([newer, old]))
    assert "the versions of rgbd_glue_ros differ: newer 9.8.7, old not known" in text


def test_a_run_that_stores_no_parameters_is_compared_and_that_is_said(
    runs: Path, tmp_path: Path
) -> None:
    bare = copied(runs / "before", tmp_path / "bare")
    (bare / PARAMETERS).unlink()
    text = parameters_text(read_runs([runs / "before", bare]))
    assert text.startswith("Parameters cannot be compared.")
    assert "bare holds no params.yaml: its parameters are not known" in text


def test_the_page_has_every_trajectory_in_one_plot_and_fetches_nothing(
    runs: Path, tmp_path: Path
) -> None:
    comparison = compare(read_runs([runs / "before", runs / "after"]))
    report = write_report(comparison, tmp_path / "out", "rgbd-glue compare a b")
    source = report.read_text(encoding="utf-8")
    page = Page(source)
    assert page.open == []
    assert page.fetched == []
    assert "://" not in source
    (above,) = [f for f in source.split("<figure") if "From above" in f and "plan" in f]
    # a key and a line for each
    for name in ("before", "after"):
        assert f"</i>{name}</span>" in above
    assert "var(--c0)" in above
    assert "var(--c1)" in above
    assert "Distance of after from the first run, cm" in page.text
    assert "glue.k" in page.text
    assert "rgbd-glue compare a b" in page.text


def test_a_run_in_which_nothing_was_tracked_is_in_the_table_and_the_page(
    runs: Path, tmp_path: Path
) -> None:
    lost = with_figures(copied(runs / "before", tmp_path / "lost"), tracked=0, path_m=0, lost=40)
    (lost / TRAJECTORY).write_text("# timestamp tx ty tz qx qy qz qw\n")
    for order in ([runs / "before", lost], [lost, runs / "before"]):
        comparison = compare(read_runs(order))
        assert cells(figures_table(comparison), "apart from the first, rmse (cm)") == ["–", "–"]
        assert Page(write_report(comparison, tmp_path / "out").read_text()).open == []


def test_a_recording_under_another_name_is_known_by_its_stamps(runs: Path, tmp_path: Path) -> None:
    converted = with_figures(copied(runs / "before", tmp_path / "x"), sequence="pan_bag")
    comparison = compare(read_runs([runs / "before", converted]))
    assert comparison.apart[1] is not None


def refused(words: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    """The one line that the command ends with."""
    assert main(["compare", *words]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    return line.removeprefix("rgbd-glue: ")


def test_runs_of_different_recordings_are_refused_in_a_line(
    runs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(runs)
    elsewhen = copied(Path("kitchen"), tmp_path / "elsewhen")
    poses = (elsewhen / TRAJECTORY).read_text().splitlines()
    moved = [line if line.startswith("#") else f"9{line}" for line in poses]
    (elsewhen / TRAJECTORY).write_text("\n".join(moved))
    assert refused(["before", str(elsewhen)], capsys) == (
        f"{elsewhen}: is a run of kitchen, and before one of pan; compare runs of one recording"
    )


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ("absent", "absent: does not exist; give the output folder (-o) of rgbd-glue replay"),
        ("file", "file: is not a folder; give the output folder (-o) of rgbd-glue replay"),
        ("before", "before: is given twice; give each run once"),
        (".", ".: holds no results of a replay (metrics.json is missing); give the output folder"),
        ("many", "many: holds the replays of many recordings; give one of them, such as many/one"),
        ("no_json", "no_json/metrics.json: is no JSON (Expecting"),
        ("list", "list/metrics.json: holds no figures of a replay (no sequence); run rgbd-glue"),
        ("half", "half/metrics.json: holds no figures of a replay (no latency_ms); run rgbd-glue"),
        ("no_yaml", "no_yaml/params.yaml: is not a ROS parameter file"),
        ("no_poses", "no_poses/trajectory.txt: cannot be read"),
    ],
)
def test_what_is_no_run_is_refused_in_a_line_that_says_what_to_do(
    given: str,
    said: str,
    runs: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    copied(runs / "before", Path("before"))
    Path("file").touch()
    Path("many/one").mkdir(parents=True)
    for place in ("many/replays.json", "many/one/metrics.json"):
        Path(place).write_text("{}")
    for name, content in (("no_json", ""), ("list", "[]")):
        (copied(runs / "before", Path(name)) / METRICS).write_text(content)
    figures = {"sequence": "pan", "frames": 1, "tracked": 1, "lost": 0}
    (copied(runs / "before", Path("half")) / METRICS).write_text(json.dumps(figures))
    (copied(runs / "before", Path("no_yaml")) / PARAMETERS).write_text("[1, 2]")
    (copied(runs / "before", Path("no_poses")) / TRAJECTORY).unlink()
    assert refused(["before", given], capsys).startswith(said)


def test_the_report_does_not_replace_that_of_a_run(
    runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    own = copied(runs / "before", tmp_path / "own")
    (own / REPORT).write_text("of the run")
    line = refused([str(own), str(runs / "after"), "-o", str(own)], capsys)
    assert (
        line == f"{own}: holds a run, whose report.html would be replaced; give another folder (-o)"
    )
    assert (own / REPORT).read_text() == "of the run"


def test_the_command_prints_the_tables_and_writes_a_page_where_it_is_told_to(
    runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["compare", str(runs / "before"), str(runs / "after")]
    assert main(words) == 0
    printed = capsys.readouterr().out
    assert cells(printed, "tracked") == ["40", "40 (x 1.00)"]
    assert cells(printed, "glue.k") == ["0.0", "4.0"]
    assert "report" not in printed
    assert main([*words, "-o", str(tmp_path / "out")]) == 0
    assert capsys.readouterr().out == f"{printed}\nreport   {tmp_path / 'out' / REPORT}\n"
    assert [path.name for path in (tmp_path / "out").iterdir()] == [REPORT]

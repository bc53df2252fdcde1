"""The command line: what it prints, and one line and an exit code for everything that is wrong."""

from __future__ import annotations

import argparse
import json
import os
import shlex
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
import yaml
from rigs.data_sets import write_data_set
from rigs.paths import ROOT

from rgbd_glue_ros.cli import commands, params, parser
from rgbd_glue_ros.cli.main import main
from rgbd_glue_ros.cli.replay import summary
from rgbd_glue_ros.errors import MissingExtraError
from rgbd_glue_ros.trajectories.tum import read_tum, write_tum
from rgbd_glue_ros.types import Trajectory


def command(*arguments: object) -> list[str]:
    return [sys.executable, "-m", "rgbd_glue_ros", *map(str, arguments)]


def run(*arguments: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        command(*arguments), cwd=ROOT, capture_output=True, text=True, check=False
    )


@pytest.fixture
def printed(capfd: pytest.CaptureFixture[str]) -> Callable[..., str]:
    """What a command prints on stdout, in this process."""

    def run_here(*arguments: object) -> str:
        assert main([str(argument) for argument in arguments]) == 0
        return capfd.readouterr().out

    return run_here


def test_help_names_every_command_and_loads_nothing_heavy() -> None:
    program = (
        "import sys; from rgbd_glue_ros.cli.main import main\n"
        "try: main(['--help'])\n"
        "finally: assert not {'numpy', 'cv2', 'numba', 'rosbags'} & set(sys.modules)"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    for known in commands.COMMANDS:
        assert f"    {known.name} " in done.stdout


def test_without_a_command_all_are_listed_on_stderr_with_exit_code_2(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "100")  # a command a line
    with pytest.raises(SystemExit) as end:
        main([])
    assert end.value.code == 2
    said = capsys.readouterr()
    assert said.out == ""
    *lines, last = said.err.splitlines()
    for known in commands.COMMANDS:
        assert [known.name, *known.summary.split()] in [line.split() for line in lines]
    assert last == "rgbd-glue: give a COMMAND, such as `rgbd-glue demo`"


@pytest.mark.parametrize("name", [known.name for known in commands.COMMANDS])
def test_every_command_has_a_help(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as end:
        main([name, "--help"])
    assert end.value.code == 0
    assert f"rgbd-glue {name}" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["odometry", "-p", "frame_id:=x"], "follows --ros-args: --ros-args -p frame_id:=x; see"),
        (["mapping", "--params-file", "a b"], "--ros-args --params-file 'a b'; see"),
        (
            ["watch", "-r", "__ns:=/a"],
            "which follows --ros-args: --ros-args -r __ns:=/a; see rgbd-g",
        ),
        (["watch", "-o", "README.md"], "README.md: exists already; give a new file"),
        (["replay", "x", "-p", "y"], "-p: no such option"),
        (["fetch", "tum/fr1_dsk"], "did you mean tum/fr1_desk or "),
        (["fetch", "nonsense"], "not an available data set; give one listed by 'rgbd-glue fetch'"),
        (["weights", "check", "xfaet"], "did you mean xfeat? Otherwise use one of"),
        (["params", "--set", "features.visual=obr"], "did you mean orb? Otherwise give one of"),
        (["params", "--set", "features.visual=nosuchthing"], "is not known; give one of"),
        (["replay", "test", "-o", "out", "--ground-truth", "no.txt"], "directory); check the path"),
        (
            ["replay", "test", "-o", "out", "--calibration", "no.yaml"],
            ": no.yaml: cannot be read (No such file or directory); check the path",
        ),
        (["evaluate", "docs", "docs"], "docs: holds no trajectory (trajectory.txt, odometry.txt,"),
        (["dance"], "dance: no such command; see rgbd-glue --help"),
        (["relpay", "x"], "relpay: no such command, did you mean replay?"),
        (["--versoin"], "--versoin: no such option, did you mean --version?"),
        (["replay", "x", "--gruond-truth=y"], "--gruond-truth: no such option, did you mean --gro"),
        (["evaluate", "a", "b", "c"], "c: unexpected argument; see rgbd-glue evaluate --help"),
        (["evaluate", "a"], "REF"),
        (["evaluate", "absent.txt", "b"], "absent.txt: cannot be read"),
        (["params", "--preset", "dead"], "'dead'"),
        (["params", "--set", "glue.q=3"], "glue.k"),
        (["demo", "-o", "out", "--set", "max_widht=640"], "did you mean max_width?"),
        (["params", "--set", "odom_frame_id=map"], "--ros-args -p odom_frame_id:=VALUE"),
        (["params", "--set", "glue.k"], "name=value"),
        (["params", "--set", "glue.k=0.5"], "from 1 to 100"),
        (["replay", "absent", "-o", "out"], "absent: does not exist"),
        (["replay", "test", "-o", "out"], "a folder of colour images (rgb) beside one of depth"),
        (
            ["params", "--set", "max_width=4"],
            "give a whole number from 32 to 100000 (pixels), or 0",
        ),
        (["params", "glue.q"], "did you mean glue.k?"),
        (["params", "nosuch"], "nosuch: no such parameter; see `rgbd-glue params`"),
        (["odometry", "max_width:=640"], "with --ros-args -p max_width:=640, to other"),
        (["params", "node"], "node: no such parameter"),
        (["replay", "test", "-o", "out", "--limit", "0"], "'0'"),
        (["replay", "test", "-o", "out", "--limit", "many"], "'many'"),
        (["replay", "test", "-o", "out", "--limit", "9" * 20], "from 1 to 999999999"),
        (["replay", "test", "-o", "out", "--calibration", "README.md"], "README.md"),
        (["replay", "test", "-o", "out", "--ground-truth", "README.md"], "README.md:"),
        (["replay", ""], "SRC: is empty, give a path"),
        (["replay", "bags/living_room", "-o", "~nobodyhere/x"], "~nobodyhere has no home folder"),
    ],
)
def test_bad_input_is_one_line_on_stderr_and_exit_code_2(
    arguments: list[str],
    says: str,
    capfd: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(ROOT)
    try:
        code = main(arguments)
    except SystemExit as end:  # as argparse refuses
        code = int(end.code or 0)
    said = capfd.readouterr()
    assert code == 2
    assert said.out == ""
    (line,) = said.err.splitlines()
    assert line.startswith("rgbd-glue: ")
    assert says in line


@pytest.mark.parametrize("arguments", [["replay", "absent"], ["relpay", "absent"]])
def test_a_process_ends_with_that_line_and_code(arguments: list[str]) -> None:
    done = run(*arguments)
    assert (done.returncode, done.stdout) == (2, "")
    assert len(done.stderr.splitlines()) == 1


@pytest.fixture
def fail_with(monkeypatch: pytest.MonkeyPatch) -> Callable[[Exception], None]:
    """Adds a command ``fail`` that raises."""

    def add(error: Exception) -> None:
        def run(_: object) -> str:
            raise error

        module = ModuleType("rgbd_glue_ros.cli.fail")
        module.__dict__.update(add_arguments=lambda _: None, run=run)
        monkeypatch.setitem(sys.modules, module.__name__, module)
        monkeypatch.setattr(parser, "COMMANDS", (commands.Command("fail", "fails"),))

    return add


def test_a_failure_inside_is_one_line_and_exit_code_1(
    fail_with: Callable[[Exception], None], capsys: pytest.CaptureFixture[str]
) -> None:
    fail_with(RuntimeError("a\nb"))
    assert main(["fail"]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line == "rgbd-glue: failure inside: RuntimeError: a b; --debug shows where"


def test_debug_shows_where_an_error_arose(
    fail_with: Callable[[Exception], None], caplog: pytest.LogCaptureFixture
) -> None:
    fail_with(RuntimeError("inside"))
    assert main(["fail", "--debug"]) == 1
    assert "Traceback" in caplog.text


def test_a_missing_extra_is_named_with_exit_code_2(
    fail_with: Callable[[Exception], None], capsys: pytest.CaptureFixture[str]
) -> None:
    fail_with(MissingExtraError("Open3D", "open3d", "fpfh"))
    assert main(["fail"]) == 2
    assert "pip install 'open3d" in capsys.readouterr().err


def test_version_is_that_of_the_installed_package_or_says_that_there_is_none() -> None:
    done = run("--version")
    assert done.returncode == 0
    try:
        installed = version("rgbd_glue_ros")
    except PackageNotFoundError:
        installed = "(not installed)"
    assert done.stdout == f"rgbd-glue {installed}\n"


def test_parameters_are_printed_as_yaml_and_as_markdown_with_changes_applied(
    printed: Callable[..., str],
) -> None:
    given = printed("params", "--preset", "paper", "--set", "glue.k=3", "--set", "seed=5")
    tree = yaml.safe_load(given)["/**"]["ros__parameters"]
    assert tree["glue"]["k"] == 3.0
    assert tree["seed"] == 5
    assert "| `glue.k` |" in printed("params", "--markdown")
    assert "camera_axes: body" in printed("params", "--node")


def test_the_parameters_of_a_run_can_be_given_to_another(tmp_path: Path) -> None:
    before, again = tmp_path / "before", tmp_path / "again"
    changes = ["--set", "glue.k=4", "--set", "depth_scale=0.001"]
    bag = [str(ROOT / "bags" / "living_room"), "--limit", "3", "-o"]
    assert main(["replay", *bag, str(before), *changes]) == 0
    file = before / "params.yaml"
    assert main(["replay", *bag, str(again), "--preset", str(file)]) == 0
    assert (again / "params.yaml").read_text() == file.read_text()
    assert "k: 4.0" in file.read_text()


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("glue.k", "glue.k: 3.0\n  K of equation 4"),
        ("glue", "glue.confidence: 0.95"),
        ("features.visual", "Takes one of none, orb"),
        ("features.visual", "cannot change: the keyframes hold"),
        ("camera_axes", "camera_axes: body"),
        ("reset_countdown", "odometry.reset_countdown: 3"),
    ],
)
def test_a_parameter_is_explained_by_its_name_its_section_or_an_alias(
    name: str, says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["params", name, "--set", "glue.k=3"]) == 0
    assert says in capsys.readouterr().out


def test_a_tilde_is_the_home_folder_also_behind_an_equals_sign(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    for words in (["-o=~/x"], ["--output=~/x"], ["-o", "~/x"]):
        assert parser.parse(["replay", "~/bag", *words]).output == tmp_path / "x"
    assert parser.parse(["replay", "~/bag"]).recordings == [tmp_path / "bag"]


def test_a_reader_that_goes_away_is_no_error() -> None:
    process = subprocess.Popen(
        command("params"), cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    process.stdout.close()
    _, errors = process.communicate()
    assert errors == ""
    assert process.returncode == 128 + signal.SIGPIPE


def test_evaluate_prints_a_table_or_json(tmp_path: Path, printed: Callable[..., str]) -> None:
    poses = np.tile(np.eye(4), (40, 1, 1))
    poses[:, 0, 3] = 0.5 / 30 * np.arange(40)
    stamps = np.arange(40, dtype=np.int64) * 1_000_000_000 // 30
    write_tum(tmp_path / "truth.txt", Trajectory(stamps, poses))
    poses[:, 0, 3] *= 1.1
    write_tum(tmp_path / "estimate.txt", Trajectory(stamps, poses))
    table = printed("evaluate", tmp_path / "estimate.txt", tmp_path / "truth.txt")
    assert "translation  0.05000" in table
    for name, file in (("out", "trajectory.txt"), ("data", "groundtruth.txt")):
        (tmp_path / name).mkdir()
        source = "estimate.txt" if name == "out" else "truth.txt"
        (tmp_path / name / file).write_text((tmp_path / source).read_text())
    assert printed("evaluate", tmp_path / "out", tmp_path / "data") == table
    figures = json.loads(
        printed("evaluate", tmp_path / "estimate.txt", tmp_path / "truth.txt", "--json")
    )
    assert figures["poses"] == 40
    assert figures["rpe"]["trans_rmse_m"] == pytest.approx(0.05, abs=1e-6)
    assert set(figures["ape"]) == {"rmse_m", "mean_m", "median_m", "max_m"}


@pytest.mark.slow
@pytest.mark.every_python
def test_replay_prints_a_summary_and_where_the_report_is(tmp_path: Path) -> None:
    calibration = write_data_set(tmp_path / "poster", 12)
    out = tmp_path / "out"
    done = run(
        *("replay", tmp_path / "poster", "-o", out, "--calibration", calibration),
        *("--limit", 10, "--set", "features.keypoints=300"),
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    assert "frames   10, of which 10 tracked" in done.stdout
    assert str(out / "report.html") in done.stdout
    assert f"poses    {out / 'trajectory.txt'}\n" in done.stdout
    assert "keypoints: 300" in (out / "params.yaml").read_text()
    assert json.loads((out / "metrics.json").read_text())["ape"]["rmse_m"] < 0.02


@pytest.mark.slow
def test_a_converted_data_set_replays_to_the_same_trajectory(tmp_path: Path) -> None:
    calibration = write_data_set(tmp_path / "poster", 8)
    poster, bag = tmp_path / "poster", tmp_path / "bag"
    done = run("convert", poster, bag, "--calibration", calibration)
    assert (done.returncode, done.stderr) == (0, "")
    assert str(bag) in done.stdout
    for recording, out, camera in (
        (poster, "a", ["--calibration", str(calibration)]),
        (bag, "b", []),
    ):
        assert main(["replay", str(recording), "-o", str(tmp_path / out), *camera]) == 0
    lines = (tmp_path / "a" / "trajectory.txt").read_text().splitlines()
    assert len(lines) == 9
    assert (tmp_path / "b" / "trajectory.txt").read_text().splitlines() == lines


def test_the_summary_of_a_replay_says_what_was_wrong_with_its_frames() -> None:
    figures = {
        "frames": 60,
        "played": 60,
        "tracked": 60,
        "lost": 0,
        "keyframes": 6,
        "path_m": 0.94,
        "fps": 30.0,
        "latency_ms": {"p50": 20.0, "p95": 30.0},
        "longest_gap_s": 0.7,
        "restarts": 1,
        "duplicates": 2,
        "unpaired": {"color": 20, "depth": 0},
    }
    _, line, *_ = summary(figures).splitlines()
    assert line == (
        "input    1 restart as time went back, 2 duplicates left out, 20 color images unpaired; "
        "longest gap 0.70 s"
    )
    assert "APE      none: there is no ground truth\n" in summary(figures)
    few = {**figures, "no_ape": "only 1 poses"}
    assert "APE      none: only 1 poses\n" in summary(few)
    live = {**figures, "node_latency_ms": {}}
    assert "p95 30.0 ms, from publishing images until their pose is back\n" in summary(live)
    in_order = {**figures, "restarts": 0, "duplicates": 0, "unpaired": None}
    assert "input" not in summary(in_order)


@pytest.mark.slow
@pytest.mark.every_python
def test_ctrl_c_keeps_what_was_done(tmp_path: Path) -> None:
    calibration = write_data_set(tmp_path / "poster", 12)
    # a pipe in place of an image: who opens it for writing learns when the reader has come to it
    pipe = tmp_path / "poster" / "rgb" / "009.png"
    pipe.unlink()
    os.mkfifo(pipe)
    out = tmp_path / "out"
    arguments = ("replay", tmp_path / "poster", "-o", out, "--calibration", calibration)
    with subprocess.Popen(
        command(*arguments), cwd=ROOT, stderr=subprocess.PIPE, text=True
    ) as process:

        def interrupt() -> None:
            with pipe.open("wb"):
                process.send_signal(signal.SIGINT)

        threading.Thread(target=interrupt, daemon=True).start()
        _, errors = process.communicate()
    assert process.returncode == 128 + signal.SIGINT
    (line,) = errors.splitlines()
    assert f"interrupted; the results so far are in {out}" in line
    frames = json.loads((out / "metrics.json").read_text())["frames"]
    assert 4 <= frames <= 9
    assert len(read_tum(out / "trajectory.txt")) == frames


def test_an_interrupt_that_a_library_calls_an_error_is_one_all_the_same(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(_: argparse.Namespace) -> str:
        # what CPython makes of an exception that is set when a function has returned a result
        raise SystemError("returned a result with an exception set") from KeyboardInterrupt()

    monkeypatch.setattr(params, "run", interrupted)
    assert main(["params"]) == 128 + signal.SIGINT
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(
    ("line", "offered"),
    [
        ("rgbd-glue repl", "replay"),
        ("rgbd-glue replay --ground", "--ground-truth"),
        ("rgbd-glue params --set glue.filt", "glue.filter="),
        ("rgbd-glue params glue.filt", "glue.filter"),
        ("rgbd-glue odometry --camera oak", "oak_d"),
    ],
)
def test_a_shell_with_argcomplete_completes_commands_options_and_names(
    line: str, offered: str, tmp_path: Path
) -> None:
    pytest.importorskip("argcomplete")
    answer = tmp_path / "answer"
    asked = {
        "_ARGCOMPLETE": "1",
        "_ARGCOMPLETE_SUPPRESS_SPACE": "1",
        "_ARGCOMPLETE_STDOUT_FILENAME": str(answer),
        "COMP_LINE": line,
        "COMP_POINT": str(len(line)),
        "COMP_TYPE": "9",
    }
    subprocess.run(command(), cwd=ROOT, env={**os.environ, **asked}, check=True)
    assert answer.read_text().split("\v") == [offered]


def test_without_a_standard_output_the_work_is_done(tmp_path: Path) -> None:
    program = shlex.join(command("params"))
    assert subprocess.run(["sh", "-c", f"{program} >&-"], cwd=ROOT, check=False).returncode == 0


@pytest.mark.parametrize("name", ["play", "demo"])
def test_images_are_played_raw_unless_told_otherwise(name: str) -> None:
    assert not parser.parse([name, "recording"]).compressed
    assert not parser.parse([name, "recording", "--raw"]).compressed
    assert parser.parse([name, "recording", "--compressed"]).compressed


@pytest.mark.slow
def test_a_terminal_of_no_width_is_told_of_the_warm_up_and_then_of_the_frames(
    tmp_path: Path,
) -> None:
    terminal, process_side = os.openpty()  # its width is 0 until somebody sets one
    words = command("replay", "bags/living_room", "-o", str(tmp_path / "out"), "--limit", "3")
    subprocess.run(words, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=process_side, check=True)
    os.close(process_side)
    shown = os.read(terminal, 10_000).decode()
    os.close(terminal)
    before, _, after = shown.partition("warming up")
    assert "0/3" in before
    assert "3/3" in after
    assert "tracking" in after

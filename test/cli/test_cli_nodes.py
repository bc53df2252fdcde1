"""``odometry`` and ``mapping``: the nodes as executables, with help, faults, and cameras."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest
from rigs.paths import ROOT

from rgbd_glue_ros.cli.parser import split_ros_arguments
from rgbd_glue_ros.experiments.demo.node_process import ros_environment
from rgbd_glue_ros.parameters import Value

PROGRAM = (sys.executable, "-m", "rgbd_glue_ros")
NODES = ("odometry", "mapping")


def run(node: str, *words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*PROGRAM, node, *words], cwd=ROOT, capture_output=True, text=True, check=False
    )


@pytest.mark.parametrize(
    ("node", "example"),
    [("odometry", "-p frame_id:=base_link"), ("mapping", "-p map_file:=room.rgbdmap")],
)
def test_its_help_shows_how_ros_arguments_are_given(node: str, example: str) -> None:
    done = run(node, "--help")
    assert done.returncode == 0
    for way in (f"rgbd-glue {node}", f"  {node}", f"ros2 run rgbd_glue_ros {node}"):
        assert f"{way} [-h] [--debug] [--camera PRESET] [--ros-args ...]" in done.stdout
    own = {"odometry": "publish_tf", "mapping": "localize_only"}
    assert [name for name, word in own.items() if f"  {word} " in done.stdout] == [node]
    assert f"{node} --camera realsense_d400 --ros-args {example}" in done.stdout


@pytest.mark.parametrize("node", NODES)
@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--camara", "oak_d"], "--camara: no such option, did you mean --camera?"),
        (["rgb"], "rgb: unexpected argument"),
        (["--ros-args", "-p", "glue.k:=3", "--", "rgb"], "rgb: unexpected argument"),
        (
            ["--camera", "oak"],
            "camera 'oak': is not known; did you mean oak_d? Otherwise use one of",
        ),
        (["--camera", "absent.yaml"], "absent.yaml: cannot be read"),
    ],
)
def test_words_that_make_no_sense_end_it_with_one_line(
    node: str, words: list[str], says: str
) -> None:
    done = run(node, *words)
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert says in line


@pytest.mark.parametrize("node", NODES)
def test_without_ros_it_says_in_one_line_what_to_install(node: str) -> None:
    program = (
        "import sys\n"
        "sys.modules['rclpy'] = None\n"
        f"from rgbd_glue_ros.cli.{node} import main\n"
        "sys.exit(main())"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert "rclpy is not installed" in line
    assert "ros-jazzy-rclpy" in line


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("module", ["cli.main", "cli.node_command", "live.heap"])
@pytest.mark.parametrize("node", NODES)
def test_a_signal_while_it_is_being_loaded_ends_it_with_exit_code_0_and_no_word(
    node: str, module: str, number: signal.Signals
) -> None:
    program = (
        "import os, sys\n"
        "class Meanwhile:\n"
        "    def find_spec(self, name, *_):\n"
        f"        if name == 'rgbd_glue_ros.{module}':\n"
        f"            os.kill(os.getpid(), {int(number)})\n"
        "sys.meta_path.insert(0, Meanwhile())\n"
        f"from rgbd_glue_ros.cli.{node} import main\n"
        "sys.exit(main())"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


@pytest.mark.parametrize("node", ["node", "mapping"])
@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"max_width": "abc"}, "max_width: 'abc' is not of type int"),
        ({"max_width": 1.5}, "max_width: 1.5 is not of type int"),
        ({"camera.depth_max": "far"}, "camera.depth_max: 'far' is not of type float"),
    ],
)
def test_a_value_of_the_wrong_type_is_refused_whether_or_not_the_camera_sets_another(
    node: str,
    given: dict[str, object],
    says: str,
    ros_domain: int,
    capfd: pytest.CaptureFixture[str],
) -> None:
    pytest.importorskip("rclpy", reason="ROS is not installed")
    from rigs.refusal import refusal

    main = import_module(f"rgbd_glue_ros.node.{node}").main
    presets: tuple[dict[str, Value], ...] = ({}, {"max_width": 640, "camera.depth_max": 5.0})
    refusals = [refusal(main, ros_domain, capfd, given, preset) for preset in presets]
    assert says in refusals[0]
    assert refusals[0] == refusals[1]


def test_that_refusal_ends_the_command_of_a_node_with_the_file_of_a_camera(
    ros_domain: int, tmp_path: Path
) -> None:
    camera = tmp_path / "mine.yaml"
    camera.write_text("topics: {}\nparameters: {max_width: 640, camera.depth_max: 5.0}\n")
    given = ["--camera", str(camera), "--ros-args", "-p", "max_width:=abc"]
    done = subprocess.run(
        [*PROGRAM, "odometry", *given],
        cwd=ROOT,
        env={**os.environ, **ros_environment(ros_domain)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    (line,) = [line for line in done.stderr.splitlines() if "[FATAL]" in line]
    assert "max_width: 'abc' is not of type int" in line


def test_the_words_of_ros_may_come_in_groups_as_launch_gives_them() -> None:
    words = ["a", "--ros-args", "-p", "b:=1", "--", "c", "--ros-args", "-r", "d:=e"]
    assert split_ros_arguments(words) == (["a", "c"], ["-p", "b:=1", "-r", "d:=e"])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("node", "publishing"), [("odometry", "ours -> base"), ("mapping", "/map/path and map -> ours")]
)
def test_a_camera_gives_topics_and_parameters_and_ros_arguments_win(
    node: str, publishing: str, ros_domain: int, tmp_path: Path
) -> None:
    if node == "mapping":
        pytest.importorskip("tf2_msgs", reason="tf2_msgs is not installed")
        pytest.importorskip("gtsam", reason="GTSAM is not installed")
        pytest.importorskip("pyhbst", reason="pyHBST is not installed")
    camera = tmp_path / "mine.yaml"
    camera.write_text(
        "topics: {color: /mine/color, depth: /mine/depth}\n"
        "parameters: {odom_frame_id: from_preset, frame_id: base, camera_pose: 0 0 0 0 0 0}\n"
    )
    given = ["-r", "rgb/image:=/ours/color", "-p", "odom_frame_id:=ours"]
    with subprocess.Popen(
        [*PROGRAM, node, "--camera", str(camera), "--ros-args", *given],
        cwd=ROOT,
        env={**os.environ, **ros_environment(ros_domain)},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    ) as process:
        assert process.stdout is not None
        line = next(line for line in process.stdout if "Subscribed" in line)
        process.send_signal(signal.SIGINT)
        process.communicate()
    assert "Subscribed to /ours/color, /mine/depth, /rgb/camera_info" in line
    assert f"publishing {publishing}" in line
    assert process.returncode == 0

"""The demonstration, whole."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pytest

from rgbd_glue_ros.cli import demo as command
from rgbd_glue_ros.cli.main import main
from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.experiments.demo import demo as module
from rgbd_glue_ros.experiments.demo.demo import Progress, bundled_bag, demo
from rgbd_glue_ros.experiments.demo.node_process import private_domain
from rgbd_glue_ros.experiments.demo.played import PlayedBag
from rgbd_glue_ros.live import topics
from rgbd_glue_ros.parameters import InputConfig
from rgbd_glue_ros.trajectories.tum import read_tum
from rgbd_glue_ros.types import NANOSECONDS


def ignore(_: Progress) -> None:
    """Nobody watches."""


@pytest.fixture
def _ros() -> None:
    pytest.importorskip("rclpy", reason="ROS is not installed")


@pytest.mark.slow
@pytest.mark.every_python
@pytest.mark.usefixtures("_ros")
def test_the_demonstration_leaves_the_files_of_a_replay_with_the_errors_in_them(
    tmp_path: Path,
) -> None:
    seen: list[Progress] = []
    played = PlayedBag.load(bundled_bag())
    # as long as the recording: of what comes while the node has no processor none is overwritten
    given = {"glue.k": 4.0, "max_width": 320, "topic_queue_size": played.frame_count}
    result = demo(played, tmp_path, 1.0, seen.append, parameters=given)
    assert "k: 4.0" in (tmp_path / "params.yaml").read_text(encoding="utf-8")
    names = {path.name for path in tmp_path.iterdir()}
    graphs = {"keyframes.g2o", "keyframes_gtsam.g2o"}
    replays = {"trajectory.txt", "metrics.json", "params.yaml", "report.html", *graphs}
    assert names == replays | {"node.log"}
    figures = json.loads((tmp_path / "metrics.json").read_text(encoding="utf-8"))
    assert figures == result.figures
    assert figures["ape"]["rmse_m"] < 0.02
    assert figures["tracked"] == len(read_tum(tmp_path / "trajectory.txt")) > 0
    assert result.summary is not None
    assert "95 % by covariance" in (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "data:image/jpeg" in (tmp_path / "report.html").read_text(encoding="utf-8")
    assert figures["tracked"] == result.summary.tracked
    assert figures["frames"] + sum(figures["dropped"].values()) == figures["played"]
    assert 50 < figures["peak_rss_mb"] < 2000
    assert 0 < figures["node_latency_ms"]["p50"] < figures["latency_ms"]["p95"]
    assert seen[-1].played == seen[-1].frames == figures["played"]


@pytest.mark.slow
@pytest.mark.usefixtures("_ros")
def test_a_node_that_refuses_what_it_is_given_says_so_in_its_own_words(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "_parameters", lambda _: {"glue.k": "many"})
    with pytest.raises(InputError, match=r"^the node: glue.k: 'many'"):
        demo(PlayedBag.load(bundled_bag()), tmp_path, 1.0, ignore)


def shown(folder: Path, *words: str) -> int:
    """``rgbd-glue demo`` of a second of the bundled recording."""
    return main(["demo", str(bundled_bag()), "--duration", "1", "-o", str(folder), *words])


@pytest.mark.slow
@pytest.mark.usefixtures("_ros")
def test_the_unit_of_depth_is_taken_once_however_it_is_given(tmp_path: Path) -> None:
    """The recording is in millimetres, and played in metres."""
    for words in (["--set", "depth_scale=0.001"], ["--depth-scale", "1000"]):
        folder = tmp_path / words[0]
        assert shown(folder, *words) == 0
        assert json.loads((folder / "metrics.json").read_text())["ape"]["rmse_m"] < 0.02
        scale = float(words[-1].rpartition("=")[2])
        assert f"depth_scale: {scale}" in (folder / "params.yaml").read_text(encoding="utf-8")


@pytest.mark.slow
@pytest.mark.usefixtures("_ros")
def test_images_may_be_paired_by_receipt(tmp_path: Path) -> None:
    assert shown(tmp_path, "--set", "stamps=receipt") == 0
    assert json.loads((tmp_path / "metrics.json").read_text())["tracked"] > 0
    assert "stamps: receipt" in (tmp_path / "params.yaml").read_text(encoding="utf-8")


def test_parameters_of_pairing_are_applied_on_reading(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    played: list[tuple[dict[str, object], InputConfig]] = []

    def note(_: object, __: object, parameters: dict[str, object], inputs: InputConfig) -> str:
        played.append((parameters, inputs))
        return ""

    monkeypatch.setattr(command, "_play", note)
    given = {"approx_sync_max_interval": 0.05, "approx_sync": True, "max_width": 320}
    words = [word for item in given.items() for word in ("--set", "{}={}".format(*item))]
    assert main(["demo", str(bundled_bag()), *words, "-o", str(tmp_path)]) == 0
    assert played == [({"max_width": 320}, InputConfig(approx_sync_max_interval=0.05))]


def test_a_bag_as_it_is_cannot_be_paired_by_receipt(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="name the recording: rgbd-glue demo SRC --set stamps"):
        demo(PlayedBag.load(bundled_bag()), tmp_path, 1.0, ignore, parameters={"stamps": "receipt"})


@pytest.mark.usefixtures("_ros")
def test_a_pose_of_no_image_is_counted_and_left_out(ros_domain: int) -> None:
    from geometry_msgs.msg import PoseStamped
    from rigs.ros import PATIENCE_S, Rig

    from rgbd_glue_ros.experiments.demo.player import Player

    known, unknown = PoseStamped(), PoseStamped()
    unknown.header.stamp.sec = 7
    played = PlayedBag.load(bundled_bag())
    with Player(played, ros_domain) as player, Rig(ros_domain) as rig:
        publisher = rig.publisher(PoseStamped, topics.POSE)
        message = played.messages[0]
        player.publish(message)
        known.header.stamp.sec, known.header.stamp.nanosec = divmod(message.stamp_ns, NANOSECONDS)

        def are_received() -> bool:
            publisher.publish(unknown)
            publisher.publish(known)
            return bool(player.poses and player.unassigned)

        assert player.wait(are_received, PATIENCE_S)
    assert list(player.poses) == [message.stamp_ns]


@pytest.mark.slow
@pytest.mark.usefixtures("_ros")
def test_a_recording_without_a_pose_ends_in_the_nodes_words(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    assert shown(tmp_path, "--set", "camera.depth_max=0.5") == 2
    said = capfd.readouterr().err
    assert "the node gave no pose of it: No pose yet: " in said
    assert "0.1 to 0.5 m (camera.depth_min, camera.depth_max)" in said


def children(pid: int) -> list[int]:
    words = Path(f"/proc/{pid}/task/{pid}/children").read_text(encoding="ascii").split()
    return [int(word) for word in words]


@pytest.mark.slow
@pytest.mark.usefixtures("_ros")
def test_a_node_that_dies_is_said_and_what_it_did_is_kept(tmp_path: Path) -> None:
    # tests before this one may have left helpers of Python's own
    others = set(children(os.getpid()))

    def kill(progress: Progress) -> None:
        if progress.poses >= 2:
            (node,) = set(children(os.getpid())) - others
            os.kill(node, signal.SIGKILL)

    with pytest.raises(RuntimeError, match="the node ended: exit code -9"):
        demo(PlayedBag.load(bundled_bag()), tmp_path, 1.0, kill)
    assert len(read_tum(tmp_path / "trajectory.txt")) >= 2
    assert (tmp_path / "metrics.json").is_file()


def thread_count(pid: int) -> int:
    """Of a process; 0 after its end."""
    try:
        status = Path(f"/proc/{pid}/status").read_text(encoding="ascii")
    except (FileNotFoundError, ProcessLookupError):
        return 0
    return 0 if "State:\tZ" in status else int(status.partition("Threads:")[2].split()[0])


@pytest.mark.slow
@pytest.mark.usefixtures("_ros")
@pytest.mark.parametrize(
    ("how", "code"), [(signal.SIGTERM, 130), (signal.SIGINT, 130), (signal.SIGKILL, -9)]
)
def test_a_demonstration_that_is_ended_leaves_no_node_behind(
    tmp_path: Path, how: signal.Signals, code: int
) -> None:
    program = "import sys; from rgbd_glue_ros.cli.main import main; sys.exit(main())"
    command = [sys.executable, "-c", program, "demo", "-o", str(tmp_path)]
    deadline = time.monotonic() + 60
    # nothing tells of what a process does that is no child of this one: look now and then
    with subprocess.Popen(command) as process:
        nodes: list[int] = []
        while not any(thread_count(node) > 4 for node in nodes):  # DDS has several
            assert time.monotonic() < deadline
            time.sleep(0.01)
            nodes = children(process.pid)
        process.send_signal(how)
        assert process.wait() == code
    while any(map(thread_count, nodes)):
        assert time.monotonic() < deadline
        time.sleep(0.01)


@pytest.mark.slow
def test_without_ros_the_demonstration_names_the_extra_that_brings_it(tmp_path: Path) -> None:
    program = f"""
import sys

class Absent:
    @staticmethod
    def find_spec(name, path=None, target=None):
        if name == "rclpy":
            raise ModuleNotFoundError(name)

sys.meta_path.insert(0, Absent)
from rgbd_glue_ros.cli.main import main
sys.exit(main(["demo", "-o", {str(tmp_path)!r}]))
"""
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False
    )
    assert done.returncode == 2
    assert "pip install 'ros-jazzy" in done.stderr
    assert done.stderr.count("\n") == 1


@pytest.mark.parametrize("has_results", [False, True])
def test_an_interrupted_demonstration_says_what_it_has_left(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
    has_results: bool,
) -> None:
    def interrupted(*_: object) -> None:
        if has_results:
            (tmp_path / "metrics.json").touch()
        raise KeyboardInterrupt

    monkeypatch.setattr(module, "demo", interrupted)
    assert main(["demo", "-o", str(tmp_path)]) == 128 + signal.SIGINT
    (said,) = caplog.messages
    expected = f"the results so far are in {tmp_path}" if has_results else "there are no results"
    assert expected in said


def test_what_lies_in_place_of_a_domains_lock_is_left_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    with private_domain() as domain:
        pass
    lock = tmp_path / f"rgbd_glue_ros_domain_{domain}.lock"
    lock.unlink()
    lock.symlink_to(tmp_path / "not mine")
    with private_domain() as other:
        assert other != domain
    assert not (tmp_path / "not mine").exists()
    (tmp_path / f"rgbd_glue_ros_domain_{other}.lock").unlink()
    os.mkfifo(tmp_path / f"rgbd_glue_ros_domain_{other}.lock")
    with private_domain() as third:
        assert third not in {domain, other}

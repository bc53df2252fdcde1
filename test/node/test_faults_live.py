"""What the node does when the world around it goes wrong; docs/robustness.md lists it."""

from __future__ import annotations

import itertools
import os
import signal
import struct
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rigs.bag_frames import recorded_frames, true_poses

from rgbd_glue_ros.experiments.demo.demo import bundled_bag
from rgbd_glue_ros.experiments.demo.node_process import NodeProcess
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.live.frame_counts import Drop, Summary
from rgbd_glue_ros.live.monitor import NO_POSE_S
from rgbd_glue_ros.messages.poses import pose_from_message
from rgbd_glue_ros.messages.reading import stamp_ns
from rgbd_glue_ros.messages.synchronizer import Channel
from rgbd_glue_ros.types import NANOSECONDS

pytest.importorskip("rclpy", reason="ROS is not installed")

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.serialization import serialize_message
from rigs.faults import BREATH_MB, cpu_ms, node_in, rss_mb
from rigs.malformed import INFOS
from rigs.paths import ROOT
from rigs.ros import PATIENCE_S, Rig, corner_frame, frame_messages

from rgbd_glue_ros.experiments.demo.played import PlayedBag, PlayedMessage, Stream, transport
from rgbd_glue_ros.experiments.demo.player import Player

RIGS = ROOT / "test" / "rigs"
START_NS = 1_700_000_000 * NANOSECONDS
PERIOD_NS = NANOSECONDS // 30
# Small images take a quarter of the time, so that as many go through the node in a minute as of
# large ones in four.
SOAK_RATE = 3.0
SOAK_LOOPS = 21
# A leak of 15 kB a frame shows in the last third of the soak.
SOAK_BREATH_MB = 10
# A frame waits for the one in work and then for itself; a queue of frames would be far longer.
BOUND = 5
# What else the machine does may take half a core away for a second; a queue is there each time.
ATTEMPTS = 3


@contextmanager
def process(program: str, *arguments: object) -> Iterator[subprocess.Popen[str]]:
    """A program of this folder; killed in the end."""
    running = subprocess.Popen(
        [sys.executable, RIGS / program, *map(str, arguments)],
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "test")])},
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        yield running
    finally:
        running.kill()
        running.communicate()


@pytest.mark.slow
def test_a_killed_driver_that_restarts_with_another_reliability_is_received_again(
    ros_domain: int,
) -> None:
    with node_in(ros_domain) as node, Rig(ros_domain) as listener:
        for publisher in (listener.color, listener.depth, listener.info):
            listener.node.destroy_publisher(publisher)
        for reliability in ("RELIABLE", "BEST_EFFORT", "RELIABLE"):
            listener.poses.clear()
            with process("camera_process.py", ros_domain, reliability):
                listener.wait(lambda: len(listener.poses) > 3, f"poses of a {reliability} camera")
        # a killed one is counted for a while, and sends nothing
        assert not [line for line in node.lines if "messages mix" in line or "UNKNOWN" in line]


@pytest.mark.slow
def test_two_publishers_of_the_same_images_are_reported_and_each_stamp_gets_one_pose(
    ros_domain: int,
) -> None:
    with node_in(ros_domain) as node, Rig(ros_domain) as rig:
        rig.wait_until_matched()
        with Rig(ros_domain) as twin:
            twin.wait(twin.color.get_subscription_count, "the node's subscription")
            stamps = [START_NS + i * PERIOD_NS for i in range(10)]
            for stamp in stamps:
                twin.publish(corner_frame(stamp))
                rig.pose_of(corner_frame(stamp))
            line = node.wait_for_line("/rgb/image has 2 publishers", PATIENCE_S)
            assert "whose messages mix: /rig (sensor_msgs/msg/Image, reliable), /rig (sen" in line
        assert [stamp_ns(pose.header.stamp) for pose in rig.poses] == stamps


@pytest.mark.slow
@pytest.mark.parametrize("gap_s", [10, 3600])
def test_after_a_gap_in_time_during_motion_the_pose_continues_at_the_true_place(
    ros_domain: int, gap_s: int
) -> None:
    frames = [
        replace(f, stamp_ns=START_NS + i * PERIOD_NS) for i, f in enumerate(recorded_frames())
    ]
    moved = frames[:20]
    with node_in(ros_domain, camera_axes="optical"), Rig(ros_domain) as rig:
        rig.wait_until_matched()
        for frame in moved:
            rig.pose_of(frame)
        resumed = [
            replace(moved[-1], stamp_ns=moved[-1].stamp_ns + gap_s * NANOSECONDS + i * PERIOD_NS)
            for i in range(5)
        ]
        for frame in resumed:
            rig.publish(frame)
        pose = pose_from_message(rig.pose_at(resumed[-1].stamp_ns), "pose")
        apart = se3.inverse(true_poses()[len(moved) - 1]) @ pose
        assert np.linalg.norm(apart[:3, 3]) < 0.02
        assert se3.rotation_angle(apart) < 0.02


@pytest.mark.slow
def test_a_camera_unplugged_for_ten_seconds_is_reported_and_then_tracked_again(
    ros_domain: int,
) -> None:
    with node_in(ros_domain) as node:
        with Rig(ros_domain) as rig:
            rig.wait_until_matched()
            rig.pose_of(corner_frame(START_NS))
        assert "has no publisher" in node.wait_for_line("No frame for 5 s", PATIENCE_S)
        with Rig(ros_domain) as rig:
            rig.wait_until_matched()
            rig.publish(corner_frame(START_NS + 10 * NANOSECONDS))
            rig.pose_of(corner_frame(START_NS + 10 * NANOSECONDS + PERIOD_NS))


@pytest.mark.slow
def test_a_camera_whose_frames_are_all_refused_is_an_error_on_diagnostics(ros_domain: int) -> None:
    with node_in(ros_domain) as node, Rig(ros_domain) as rig:
        rig.wait_until_matched()
        rig.pose_of(corner_frame(START_NS))
        stamps = itertools.count(START_NS + PERIOD_NS, PERIOD_NS)

        def refused_status() -> DiagnosticStatus | None:
            broken = frame_messages(corner_frame(next(stamps)), is_compressed=False)
            INFOS["K and P of zeros"](broken, np.random.default_rng(0))
            rig.send(broken)
            rig.spin_for(0.05)
            statuses = (d.status[0] for d in rig.diagnostics[-1:])
            return next((s for s in statuses if s.level == DiagnosticStatus.ERROR), None)

        rig.wait(refused_status, "the error")
        status = refused_status()
        assert status is not None
        assert "the camera is not calibrated" in status.message
        values = {item.key: item.value for item in status.values}
        assert float(values["without_pose_s"]) > NO_POSE_S
        assert node.is_running


@pytest.mark.slow
def test_without_a_clock_simulated_time_stops_neither_poses_nor_diagnostics(
    ros_domain: int,
) -> None:
    with node_in(ros_domain, use_sim_time=True), Rig(ros_domain) as rig:
        rig.wait_until_matched()
        rig.pose_of(corner_frame(START_NS))
        rig.diagnostics.clear()
        rig.wait(lambda: rig.diagnostics, "diagnostics")


def there_and_back(recording: PlayedBag, passes: int) -> PlayedBag:
    """The recording forward and backward in turn, its time going on."""
    groups = [list(g) for _, g in itertools.groupby(recording.messages, lambda m: m.stamp_ns)]
    turns = [groups if i % 2 == 0 else groups[::-1] for i in range(passes)]
    messages = [
        _at(message, START_NS + i * PERIOD_NS)
        for i, group in enumerate(itertools.chain.from_iterable(turns))
        for message in group
    ]
    return replace(recording, messages=tuple(messages))


def _at(message: PlayedMessage, time_ns: int) -> PlayedMessage:
    # the stamp follows the four bytes that say how the message is encoded
    stamp = struct.pack("<iI", *divmod(time_ns, NANOSECONDS))
    data = message.data[:4] + stamp + message.data[12:]
    return replace(message, recorded_ns=time_ns, stamp_ns=time_ns, data=data)


def small_bag() -> PlayedBag:
    """The bundled recording in a quarter of its pixels, compressed as it is."""
    messages: list[PlayedMessage] = []
    types: dict[Stream, str] = {}
    for frame in recorded_frames():
        triple = frame_messages(frame, is_compressed=True)
        for channel, message in (
            (Channel.COLOR, triple.color),
            (Channel.DEPTH, triple.depth),
            (Channel.INFO, triple.info),
        ):
            types[channel] = f"sensor_msgs/msg/{type(message).__name__}"
            time_ns = frame.stamp_ns
            messages.append(PlayedMessage(channel, time_ns, time_ns, serialize_message(message)))
    return PlayedBag("small", types, tuple(messages), None, Path("small"))


@contextmanager
def playing(domain: int, recording: PlayedBag) -> Iterator[tuple[NodeProcess, Player]]:
    transports = {
        "image_transport": transport(recording, Channel.COLOR),
        "depth_transport": transport(recording, Channel.DEPTH),
    }
    with node_in(domain, **transports) as node, Player(recording, domain) as player:
        assert player.wait(player.is_matched, PATIENCE_S), node.lines
        yield node, player


def latencies_s(player: Player) -> list[float]:
    """From the publication of a frame's last message to its pose's arrival."""
    return [(t - player.published_ns[s]) / NANOSECONDS for s, t in player.arrived_ns.items()]


def settled_latency_s(player: Player) -> float:
    """The usual latency in the second half, when a queue would have grown long."""
    waits = latencies_s(player)
    return float(np.median(waits[len(waits) // 2 :]))


def next_summary(player: Player) -> Summary:
    before = player.summary
    assert player.wait(lambda: player.summary is not before, PATIENCE_S)
    assert player.summary is not None
    return player.summary


def pace_s(player: Player) -> float:
    """The usual time between two poses."""
    return float(np.median(np.diff(sorted(player.arrived_ns.values())))) / NANOSECONDS


def play_to_the_end(
    player: Player, recording: PlayedBag, rate: float, seen: Callable[[], None] = lambda: None
) -> None:
    """Plays the recording, ``seen`` after each message; waits for the pose of its last frame."""
    for _ in player.play(rate):
        seen()
    last = recording.messages[-1].stamp_ns
    assert player.wait(lambda: last in player.poses, PATIENCE_S), "the newest frame has no pose"


def is_answered_in_time(player: Player, recording: PlayedBag) -> bool:
    player.poses.clear()
    player.arrived_ns.clear()
    play_to_the_end(player, recording, 1.0)
    return settled_latency_s(player) < BOUND * pace_s(player)


@pytest.mark.slow
def test_at_120_frames_per_second_only_the_newest_are_processed_and_latency_does_not_grow(
    ros_domain: int,
) -> None:
    recording = there_and_back(PlayedBag.load(bundled_bag()), 4)
    with playing(ros_domain, recording) as (_, player):
        play_to_the_end(player, recording, 4.0)
        waits = latencies_s(player)
        sys.stdout.write(f"latency of {len(waits)} frames: {np.percentile(waits, [50, 95, 100])} s")
        assert settled_latency_s(player) < BOUND * pace_s(player)
        assert len(player.poses) < recording.frame_count
        assert next_summary(player).drops[Drop.SUPERSEDED] > 0


@pytest.mark.slow
def test_on_half_a_core_frames_are_dropped_and_the_latency_stays_bounded(ros_domain: int) -> None:
    recording = there_and_back(PlayedBag.load(bundled_bag()), 1)
    core = {min(os.sched_getaffinity(0))}
    with (
        playing(ros_domain, recording) as (node, player),
        process("rival_process.py") as rival,
    ):
        os.sched_setaffinity(rival.pid, core)
        for thread in Path(f"/proc/{node.pid}/task").iterdir():
            os.sched_setaffinity(int(thread.name), core)
        assert any(is_answered_in_time(player, recording) for _ in range(ATTEMPTS))
        assert next_summary(player).drops[Drop.SUPERSEDED] > 0


@pytest.mark.slow
def test_a_subscriber_that_never_reads_blocks_nothing(ros_domain: int) -> None:
    recording = there_and_back(PlayedBag.load(bundled_bag()), 2)
    with (
        playing(ros_domain, recording) as (node, player),
        process("deaf_process.py", ros_domain) as deaf,
    ):
        assert deaf.stdout
        waited_for = {"pose\n", "odom\n"}
        while waited_for:
            line = deaf.stdout.readline()
            assert line, "it has ended"
            waited_for.discard(line)  # either may be told twice
        deaf.send_signal(signal.SIGSTOP)
        memory: list[float] = []
        play_to_the_end(player, recording, 1.0, lambda: memory.append(rss_mb(node)))
        assert settled_latency_s(player) < BOUND * pace_s(player)
        half = len(memory) // 2
        assert max(memory[half:]) - max(memory[:half]) < BREATH_MB


@pytest.mark.slow
def test_a_looping_bag_needs_no_more_memory_or_time_as_it_continues(ros_domain: int) -> None:
    recording = small_bag()
    last_ns = recording.messages[-1].stamp_ns
    memory, latency, effort = [], [], []
    with playing(ros_domain, recording) as (node, player):
        for _ in range(SOAK_LOOPS):
            player.poses.clear()
            player.arrived_ns.clear()
            before_ms = cpu_ms(node)
            for _ in player.play(SOAK_RATE):
                pass
            player.wait(lambda: last_ns in player.poses, 1.0)
            assert player.arrived_ns
            memory.append(rss_mb(node))
            latency.append(1e3 * float(np.median(latencies_s(player))))
            effort.append((cpu_ms(node) - before_ms) / len(player.arrived_ns))
            sys.stdout.write(
                f"{memory[-1]:.1f} MB, {latency[-1]:.0f} ms, {len(player.poses)} poses, "
                f"{effort[-1]:.0f} ms of CPU a pose\n"
            )
    third = SOAK_LOOPS // 3
    assert max(memory[-third:]) - max(memory[: 2 * third]) < SOAK_BREATH_MB
    # the time that a pose takes of the processor: latency itself is what the machine leaves of it
    assert np.median(effort[-third:]) < 1.5 * np.median(effort[:third])

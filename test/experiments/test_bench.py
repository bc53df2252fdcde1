"""Benchmarks: what is measured, what it is compared with, and what is left when it breaks off."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from rigs.pages import Page
from rigs.room import room_frame, true_pose

from rgbd_glue_ros.cli import main as cli
from rgbd_glue_ros.closing import Closing
from rgbd_glue_ros.errors import InputError, MissingExtraError
from rgbd_glue_ros.experiments import bench
from rgbd_glue_ros.experiments.bench import FIGURES, REPORT, TABLES, Plan, live, run_bench
from rgbd_glue_ros.experiments.bench.contest import OURS, Contest, FrameToFrame
from rgbd_glue_ros.experiments.bench.degraded import DEGRADATIONS
from rgbd_glue_ros.experiments.bench.figures import losses, times
from rgbd_glue_ros.experiments.bench.floors import FLOORS, Floors
from rgbd_glue_ros.experiments.bench.live import Live
from rgbd_glue_ros.experiments.bench.memory import Memory, endless
from rgbd_glue_ros.experiments.bench.picture import PICTURE, picture
from rgbd_glue_ros.experiments.bench.report import to_markdown
from rgbd_glue_ros.experiments.bench.robustness import Robustness
from rgbd_glue_ros.experiments.peers import NoTransformError
from rgbd_glue_ros.experiments.report.machine import machine, resident_mb
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.parameters import CameraConfig, Config, load_preset, with_values
from rgbd_glue_ros.recordings.recording import selected
from rgbd_glue_ros.types import (
    NANOSECONDS,
    Float64,
    OdometryEstimate,
    RgbdFrame,
    TrackingState,
    Trajectory,
    View,
)

FRAMES, RATE_HZ = 12, 10


class Room(Closing):
    """A camera in the ray-cast room."""

    name = "room"
    frame_count = FRAMES
    ground_truth = Trajectory(
        np.arange(FRAMES) * NANOSECONDS // RATE_HZ,
        np.stack([true_pose(i / RATE_HZ) for i in range(FRAMES)]),
    )

    def __iter__(self) -> Iterator[RgbdFrame]:
        return (room_frame(i / RATE_HZ) for i in range(FRAMES))

    def select(self, indices: Iterable[int]) -> Iterator[RgbdFrame]:
        return selected(self, indices)

    def close(self) -> None:
        """Holds nothing."""


class Oracle:
    """A peer that knows the truth, but for the frames that it is told not to."""

    def __init__(self, *blind_s: float) -> None:
        self.blind_s = blind_s
        self.count = 0

    def prepare(self, view: View) -> float:
        time_s = self.count / RATE_HZ
        self.count += 1
        return time_s

    def register(self, source: float, target: float) -> Float64:
        if source in self.blind_s:
            raise NoTransformError("told not to")
        T: Float64 = se3.inverse(true_pose(target)) @ true_pose(source)
        return T


def ignore(_: object) -> None:
    """Nobody watches."""


def step() -> None:
    """Nobody counts."""


def contest(peers: dict[str, Any], patience_s: float = 60.0) -> dict[str, Any]:
    part = Contest(Room(), Config(), peers, patience_s, ignore)
    part.run(step)
    return part.figures()


@pytest.mark.slow
def test_a_peer_that_knows_every_transform_has_no_error() -> None:
    result = contest({"oracle": Oracle()})["contest"]["oracle"]
    assert result["frames"] == FRAMES
    assert result["lost"] == 0
    assert result["ape"]["max_m"] < 1e-9


def test_after_a_frame_without_a_transform_a_peer_goes_on_from_the_last_one_that_had() -> None:
    follower = FrameToFrame(Oracle(0.4, 0.5), CameraConfig())
    poses = [follower.process(room_frame(i / RATE_HZ)) for i in range(8)]
    assert [i for i, T in enumerate(poses) if T is None] == [4, 5]
    expected = se3.inverse(true_pose(0.0)) @ true_pose(0.7)
    assert poses[7] is not None
    np.testing.assert_allclose(poses[7], expected, atol=1e-12)


@pytest.mark.parametrize("unusable", [{0}, {4, 5}])
def test_a_frame_that_a_peer_cannot_prepare_has_no_pose(unusable: set[int]) -> None:
    class Choosy(Oracle):
        def prepare(self, view: View) -> float:
            time_s = super().prepare(view)
            if round(time_s * RATE_HZ) in unusable:
                raise NoTransformError("no depth")
            return time_s

    result = contest({"choosy": Choosy()})["contest"]
    assert result["choosy"]["lost"] == len(unusable)
    assert result["choosy"]["ape"]["max_m"] < 1e-9
    assert result[OURS]["frames"] == FRAMES


def test_a_peer_out_of_time_is_measured_on_the_frames_that_it_got_done() -> None:
    result = contest({"slow": Oracle()}, patience_s=1e-9)["contest"]
    assert result["slow"]["frames"] == 1
    assert result[OURS]["frames"] == FRAMES


def test_everybody_gets_each_frame_before_anybody_gets_the_next_and_all_take_turns() -> None:
    order: list[tuple[str, float]] = []

    class Noting(Oracle):
        def __init__(self, name: str) -> None:
            super().__init__()
            self.name = name

        def prepare(self, view: View) -> float:
            time_s = super().prepare(view)
            order.append((self.name, time_s))
            return time_s

    contest({"a": Noting("a"), "b": Noting("b")})
    assert [time_s for _, time_s in order] == sorted(time_s for _, time_s in order)
    assert {name for name, _ in order[::2]} == {"a", "b"}


def test_ours_is_measured_with_times_stages_errors_and_honesty() -> None:
    figures = contest({})
    ours = figures["contest"][OURS]
    assert 0 < ours["wall_ms"]["p50"] <= ours["wall_ms"]["p95"]
    assert ours["cpu_ms"]["p50"] > 0
    assert ours["ape"]["rmse_m"] < 0.02
    assert {"visual_features", "refinement"} <= set(figures["stages_ms"])
    assert figures["nees"]["count"] == FRAMES - 1


@pytest.fixture(scope="module")
def floors_ms() -> dict[str, float]:
    """The floor of each stage, of frames of the room."""
    floors = Floors(Config())
    for i in range(50):
        floors.show(room_frame(i % FRAMES / RATE_HZ))
    found: dict[str, float] = floors.figures()["floors_ms"]
    return found


@pytest.mark.parametrize("floor", FLOORS, ids=lambda f: f.stage)
def test_every_floor_belongs_to_a_stage_of_its_own_and_takes_some_time(
    floor: Any, floors_ms: dict[str, float]
) -> None:
    if floor.needs_open3d:
        pytest.importorskip("open3d")
    assert floors_ms[floor.stage] > 0
    assert [f.stage for f in FLOORS].count(floor.stage) == 1


def test_floors_of_orb_are_those_of_no_other_feature() -> None:
    floors = Floors(with_values(Config(), {"features.visual": "sift"}))
    for i in range(50):
        floors.show(room_frame(i % FRAMES / RATE_HZ))
    measured = floors.figures()["floors_ms"]
    assert "preparation" in measured
    assert not {"visual_features", "visual_matching", "ransac"} & set(measured)


def test_frames_that_show_nothing_have_no_floor() -> None:
    floors = Floors(Config())
    frame = room_frame(0.0)
    for _ in range(100):
        floors.show(replace(frame, color=np.zeros_like(frame.color)))
    assert floors.figures() == {"floors_ms": {}}


@pytest.mark.slow
def test_robustness_holds_losses_and_errors_of_every_degradation() -> None:
    part = Robustness(Room(), Config())
    counted = 0

    def count() -> None:
        nonlocal counted
        counted += 1

    part.run(count)
    figures = part.figures()["robustness"]
    assert list(figures) == [degradation.name for degradation in DEGRADATIONS]
    assert counted == sum(result["frames"] for result in figures.values()) <= part.frame_count
    assert all(result["lost"] == 0 for result in figures.values())


def estimate(time_s: float, state: TrackingState, is_new: bool = False) -> OdometryEstimate:
    posed = state is TrackingState.TRACKING
    return OdometryEstimate(
        round(time_s * NANOSECONDS),
        state,
        np.eye(4) if posed else None,
        twist=np.zeros(6) if posed and not is_new else None,
    )


def test_losses_count_frames_seconds_between_poses_and_new_starts() -> None:
    good, lost = TrackingState.TRACKING, TrackingState.LOST
    estimates = [
        estimate(0.0, TrackingState.INITIALIZING),
        estimate(0.1, good, is_new=True),
        estimate(0.2, good),
        estimate(0.3, lost),
        estimate(0.4, good),
        estimate(2.0, good),  # frames were dropped, but nothing was lost
        estimate(2.1, lost),
        estimate(2.5, lost),
        estimate(2.6, good, is_new=True),
    ]
    assert losses(estimates) == {
        "frames": 9,
        "lost": 4,
        "longest_without_pose_s": pytest.approx(0.6),
        "restarts": 1,
    }


def test_times_are_median_and_95th_percentile() -> None:
    assert times(list(range(101))) == {"p50": 50.0, "p95": 95.0}


def test_an_endless_recording_goes_on_at_the_same_pace() -> None:
    frames = list(islice(endless(Room()), 3 * FRAMES))
    gaps = np.diff([frame.stamp_ns for frame in frames])
    assert set(gaps) == {NANOSECONDS // RATE_HZ}
    np.testing.assert_array_equal(frames[FRAMES + 3].color, frames[3].color)


def test_memory_is_that_of_the_process_and_ends_after_as_many_frames_as_asked_for() -> None:
    before = resident_mb()
    part = Memory(Room(), Config(), frames=2 * FRAMES)
    part.run(step)
    memory = part.figures()["memory"]
    assert memory["frames"][-1] == 2 * FRAMES
    assert len(memory["frames"]) == len(memory["resident_mb"])
    assert all(0.5 * before < mb < before + 300 for mb in memory["resident_mb"])


@pytest.mark.parametrize(
    ("resident_mb", "growth"),
    [([100.0], "+0.0"), ([100.0, 101.0], "+1.0"), ([100.0, 100.0, 104.0, 104.5], "+4.5")],
)
def test_growth_is_between_halves_that_share_no_sample(
    tmp_path: Path, resident_mb: list[float], growth: str
) -> None:
    figures = run_bench([tmp_path], lambda _: Room(), plan(limit=3, peers=()), tmp_path)
    frames = list(range(50, 50 * len(resident_mb) + 1, 50))
    memory = {"recording": "room", "frames": frames, "resident_mb": resident_mb}
    assert f"that of the first {growth} MB" in to_markdown({**figures, "memory": memory})


def test_resident_memory_grows_by_what_is_allocated() -> None:
    before = resident_mb()
    block = np.ones(64 * 2**20, np.uint8)
    assert resident_mb() - before == pytest.approx(64, abs=8)
    del block


@pytest.mark.slow
def test_the_node_is_measured_over_dds() -> None:
    pytest.importorskip("rclpy", reason="ROS is not installed")
    part = Live(Room(), load_preset("live"))
    part.run(step)
    live = part.figures()["live"]
    assert live["frames"] + sum(live["dropped"].values()) == FRAMES
    assert 0 < live["node_latency_ms"]["p50"] <= live["latency_ms"]["p95"]
    assert live["ready_s"] > 0
    assert live["ape"]["rmse_m"] < 0.05


def test_the_node_has_the_parameters_of_the_plan(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    given: list[object] = []

    def note(*_: object, parameters: object) -> None:
        given.append(parameters)
        raise RuntimeError("noted")

    monkeypatch.setattr(live, "demo", note)
    live_preset = load_preset("live")
    for config in (live_preset, with_values(live_preset, {"features.visual": "sift"})):
        with pytest.raises(RuntimeError, match="noted"):
            Live(Room(), config).run(step)
    assert given == [{}, {"features.visual": "sift"}]


def test_the_machine_has_cores_and_the_versions_of_its_libraries() -> None:
    found = machine()
    assert found["cores"] >= 1
    assert found["versions"]["numpy"] == np.__version__


def plan(**settings: Any) -> Plan:
    return Plan(Config(), **{"peers": ("absent", "extra", "oracle"), **settings})


@pytest.fixture
def _peers(monkeypatch: pytest.MonkeyPatch) -> None:
    def absent() -> Oracle:
        raise InputError("absent", "is not here", "install another one")

    def extra() -> Oracle:
        raise MissingExtraError("extra", "bench", "the peer extra")

    peers = {"absent": absent, "extra": extra, "oracle": Oracle}
    monkeypatch.setattr(bench, "PEERS", peers)


@pytest.mark.usefixtures("_peers")
def test_a_benchmark_leaves_figures_tables_and_a_picture(tmp_path: Path) -> None:
    figures = run_bench([tmp_path], lambda _: Room(), plan(command="bench room"), tmp_path / "out")
    written = json.loads((tmp_path / "out" / FIGURES).read_text())
    assert written["sequences"] == figures["sequences"]
    page = (tmp_path / "out" / TABLES).read_text()
    assert "bench room" in page
    assert "| absent | not installed: install another one |" in page
    assert "| extra | not installed: pip install " in page
    assert "| extra | not installed: pip install (below) |" in page
    assert "\n\n```\npip install -e '.[bench]'\n```\n" in page
    assert "| oracle | 12 |" in page
    ET.fromstring((tmp_path / "out" / PICTURE).read_text())  # noqa: S314 - our own file
    report = Page((tmp_path / "out" / REPORT).read_text())
    assert (report.open, report.fetched) == ([], [])
    assert {"Error and time", "oracle", "bench room"} <= {text.strip() for text in report.text}


@pytest.mark.slow
@pytest.mark.usefixtures("_peers")
def test_a_limit_of_frames_holds_for_all_parts_of_the_benchmark(tmp_path: Path) -> None:
    wanted = plan(limit=5, memory_frames=7, robustness=True)
    figures = run_bench([tmp_path], lambda _: Room(), wanted, tmp_path)
    (content,) = figures["sequences"].values()
    assert content["contest"][OURS]["frames"] == 5
    assert content["robustness"]["no depth for 1 s"]["frames"] == 5
    assert figures["memory"]["frames"][-1] == 7


@pytest.mark.usefixtures("_peers")
def test_what_was_measured_before_an_interrupt_is_left(tmp_path: Path) -> None:
    counted = 0

    def interrupt() -> None:
        nonlocal counted
        counted += 1
        if counted == 8:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_bench([tmp_path], lambda _: Room(), plan(), tmp_path, on_frame=interrupt)
    figures = json.loads((tmp_path / FIGURES).read_text())
    assert figures["sequences"]["room"]["contest"][OURS]["frames"] == 8
    assert "| oracle | 8 |" in (tmp_path / TABLES).read_text()


@pytest.mark.usefixtures("_peers")
def test_a_recording_that_cannot_be_used_is_named_and_the_others_are_measured(
    tmp_path: Path,
) -> None:
    def opened(path: Path) -> Room:
        if path.name == "bad":
            raise InputError(path, "is no recording", "give another")
        return Room()

    sources = [tmp_path / "bad", tmp_path / "good"]
    figures = run_bench(sources, opened, plan(), tmp_path)
    assert list(figures["sequences"]) == ["room"]
    assert "is no recording" in (tmp_path / TABLES).read_text()
    with pytest.raises(InputError, match="is no recording"):
        run_bench(sources[:1], opened, plan(), tmp_path)


@pytest.mark.usefixtures("_peers")
def test_a_node_that_ends_is_reported_and_the_rest_is_measured(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def end(*_: object, **__: object) -> None:
        raise RuntimeError("the node ended: exit code -9")

    monkeypatch.setattr(live, "demo", end)
    wanted = plan(limit=3, live=True, robustness=True)
    figures = run_bench([tmp_path], lambda _: Room(), wanted, tmp_path / "out")
    assert figures["problems"] == ["room, first 3 frames, live: the node ended: exit code -9"]
    (content,) = figures["sequences"].values()
    assert content["robustness"]


@pytest.mark.usefixtures("_peers")
def test_recordings_of_the_same_name_are_told_apart(tmp_path: Path) -> None:
    figures = run_bench([tmp_path] * 2, lambda _: Room(), plan(limit=3), tmp_path)
    assert list(figures["sequences"]) == ["room, first 3 frames", "room, first 3 frames (2)"]


@pytest.mark.parametrize("spread", [0.0, 1e-5, 1e-3])
def test_labels_of_a_picture_lie_on_no_dot_and_on_no_other_label(spread: float) -> None:
    def result(ms: float, m: float) -> dict[str, Any]:
        return {"wall_ms": {"p50": ms}, "rpe": {"trans_rmse_m": m}}

    contestants = {f"peer {i}": result(100 + i, 0.02 + spread * i) for i in range(6)}
    drawn = picture({"room": {"contest": {OURS: result(20, 0.01), **contestants}}}, OURS)
    assert drawn is not None
    root = ET.fromstring(drawn)  # noqa: S314 - our own file
    places = [
        (float(text.get("x", "nan")), float(text.get("y", "nan")) - 3.5)
        for text in root.iter()
        if (text.text or "").startswith("peer")
    ]
    assert len(places) == 6
    for i, (x, y) in enumerate(places):
        for a, b in places[:i]:
            assert abs(x - a) >= 38 or abs(y - b) >= 10
        for dot in root.iter("{http://www.w3.org/2000/svg}circle"):
            a, b = (float(dot.get(name, "nan")) for name in ("cx", "cy"))
            assert abs(x - a) >= 19 or abs(y - b) >= 10


def test_without_times_or_errors_there_is_no_picture() -> None:
    assert picture({"room": {"contest": {OURS: {"frames": 1}}}}, OURS) is None


@pytest.mark.slow
def test_the_command_measures_the_bundled_recording_when_none_is_given(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    arguments = ["bench", "--limit", "8", "--peer", "small_gicp", "-o", str(tmp_path)]
    assert cli.main(arguments) == 0
    assert "rgbd-glue bench --limit 8" in capfd.readouterr().out
    assert "**rgbd_glue_ros** | 8 |" in (tmp_path / TABLES).read_text()


def test_an_unknown_peer_is_bad_input(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["bench", "--peer", "nobody", "-o", str(tmp_path)]) == 2
    said = capfd.readouterr().err
    assert said.count("\n") == 1
    assert "nobody" in said
    assert "small_gicp" in said

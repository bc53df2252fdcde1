"""What is logged for the Rerun viewer is what the odometry knew, read back by Rerun."""

from __future__ import annotations

import socket
import sys
import weakref
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from rigs.pan import CAMERA, HEIGHT, WALL_M, WIDTH, Pan
from rigs.rerun_reader import Rows, column, rows_of

from rgbd_glue_ros.errors import InputError, MissingExtraError
from rgbd_glue_ros.experiments.replay.outputs import FurtherOutputs
from rgbd_glue_ros.experiments.replay.replay import replay
from rgbd_glue_ros.experiments.replay.run_record import Run
from rgbd_glue_ros.experiments.replay.sinks import LeftOpen
from rgbd_glue_ros.live.extrinsics import T_BODY_OPTICAL
from rgbd_glue_ros.live.match_image import CREDIBLE, REJECTED, VISUAL
from rgbd_glue_ros.parameters import load_preset
from rgbd_glue_ros.types import (
    EdgeOrigin,
    Float64,
    OdometryEstimate,
    PoseGraph,
    PoseGraphEdge,
    TrackingState,
    Trajectory,
)
from rgbd_glue_ros.viz import layout, rerun_recording
from rgbd_glue_ros.viz.rerun_recording import RerunRecording

FRAMES = 20
RISE_M = 0.5
Logged = tuple[Path, Run, list[OdometryEstimate]]


@pytest.fixture(scope="module")
def needs_rerun() -> None:
    pytest.importorskip("rerun", reason="rerun-sdk is not installed (it needs numpy 2)")


@pytest.fixture(scope="module")
def logged(needs_rerun: None, tmp_path_factory: pytest.TempPathFactory) -> Logged:
    """A file with the replay of a pan, and after it a loop that lifts all of it."""
    folder = tmp_path_factory.mktemp("rerun")
    pan, file = Pan(FRAMES), folder / "out" / "pan.rrd"
    estimates: list[OdometryEstimate] = []
    with RerunRecording(str(file), pan.ground_truth) as recording:
        outputs = FurtherOutputs([LeftOpen(recording)])
        run = replay(pan, load_preset("live"), folder, on_frame=estimates.append, outputs=outputs)
        recording.correct(_lifted(run.trajectory), _with_a_loop(run.pose_graph))
    return file, run, estimates


def _lifted(trajectory: Trajectory) -> Trajectory:
    poses = trajectory.poses.copy()
    poses[:, 1, 3] -= RISE_M
    return replace(trajectory, poses=poses)


def _with_a_loop(graph: PoseGraph) -> PoseGraph:
    last = len(graph.keyframes) - 1
    loop = PoseGraphEdge(0, last, np.eye(4), np.eye(6), EdgeOrigin.LOOP)
    return PoseGraph(_lifted(graph.keyframes), (*graph.edges, loop))


@pytest.fixture(scope="module")
def rows(logged: Logged) -> Rows:
    return rows_of(logged[0])


def lines(rows: Rows, path: str) -> list[Float64]:
    return [np.array(strips) for strips in column(rows[f"/{path}"], ":strips")]


def test_the_images_of_every_frame_are_there(rows: Rows) -> None:
    colors = column(rows[f"/{layout.COLOR}"], ":blob")
    assert len(colors) == FRAMES
    truth = next(iter(Pan(FRAMES))).color.astype(int)
    shown = np.asarray(cv2.imdecode(np.array(colors[0][0], np.uint8), cv2.IMREAD_COLOR))
    assert np.abs(shown.astype(int) - truth).mean() < 4  # JPEG
    depths = column(rows[f"/{layout.DEPTH}"], ":buffer")
    assert len(depths) == FRAMES
    units = np.array(depths[0][0], np.uint8).view(np.uint16)
    np.testing.assert_array_equal(units, np.full(WIDTH * HEIGHT, 1000 * WALL_M))
    assert column(rows[f"/{layout.DEPTH}"], ":meter")[0] == [1000.0]


def test_the_camera_stands_where_the_odometry_has_it(rows: Rows, logged: Logged) -> None:
    _, run, _ = logged
    for path in (layout.CAMERA, layout.DEPTH_CAMERA):
        places = np.concatenate(column(rows[f"/{path}"], ":translation"))
        np.testing.assert_allclose(places, run.trajectory.poses[:, :3, 3], atol=1e-6)
        matrix = np.reshape(column(rows[f"/{path}"], ":image_from_camera")[0], (3, 3)).T
        # pixel centres lie between whole numbers in Rerun
        expected = np.diag([CAMERA.fx, CAMERA.fy, 1.0])
        expected[:2, 2] = CAMERA.cx + 0.5, CAMERA.cy + 0.5
        np.testing.assert_allclose(matrix, expected)
    (axes,) = column(rows[f"/{layout.ODOM}"], ":mat3x3")
    np.testing.assert_allclose(np.reshape(axes, (3, 3)).T, T_BODY_OPTICAL[:3, :3])


def test_trajectory_and_truth_are_lines(rows: Rows, logged: Logged) -> None:
    _, run, _ = logged
    way = run.trajectory.poses[:, :3, 3]
    pieces = np.concatenate(lines(rows, layout.TRAJECTORY))
    np.testing.assert_allclose(pieces, np.stack([way[:-1], way[1:]], axis=1), atol=1e-6)
    (corrected,) = lines(rows, layout.CORRECTED)
    np.testing.assert_allclose(corrected[0], way - [0, RISE_M, 0], atol=1e-6)
    (loop,) = lines(rows, layout.LOOPS)
    keyframes = run.pose_graph.keyframes.poses[[0, -1], :3, 3]
    np.testing.assert_allclose(loop[0], keyframes - [0, RISE_M, 0], atol=1e-6)
    # laid upon what is shown last
    (truth,) = lines(rows, layout.TRUTH)
    np.testing.assert_allclose(truth[0], way - [0, RISE_M, 0], atol=0.005)


def test_matches_are_lines_in_three_colours(rows: Rows, logged: Logged) -> None:
    _, run, _ = logged
    counted = {"visual": [f.visual_inliers for f in run.frames[1:]]}
    counted["credible"] = [f.credible for f in run.frames[1:]]
    for name, rgb in (("visual", VISUAL), ("credible", CREDIBLE), ("rejected", REJECTED)):
        path = f"{layout.MATCHES}/{name}"
        drawn = lines(rows, path)
        assert len(drawn) == FRAMES - 1
        red, green, blue = rgb
        expected = red << 24 | green << 16 | blue << 8 | 0xFF
        assert {color for colors in column(rows[f"/{path}"], ":colors") for color in colors} == {
            expected
        }
        plotted = [value for (value,) in column(rows[f"/{layout.COUNTS}/{name}"], ":scalars")]
        # more would hide the image
        assert [len(strips) for strips in drawn] == [
            -(-count // -(-count // 200)) if count else 0 for count in map(int, plotted)
        ]
        if name in counted:
            assert plotted == counted[name]
    # the poster is seen to move to the left, by whole pixels
    flow = np.concatenate(lines(rows, f"{layout.MATCHES}/visual"))
    moved = flow[:, 1] - flow[:, 0]
    assert np.median(moved[:, 0]) < -3
    assert np.abs(np.median(moved[:, 1])) < 0.5


def test_epsilon_and_covariance_are_those_of_the_estimates(rows: Rows, logged: Logged) -> None:
    _, run, estimates = logged
    epsilon_cm = np.ravel(column(rows[f"/{layout.EPSILON}"], ":scalars"))
    known = [e.registration.epsilon_m for e in estimates if e.registration is not None]
    np.testing.assert_allclose(epsilon_cm, [100 * m for m in known if np.isfinite(m)])
    assert len(epsilon_cm) > 0
    ellipsoids = rows[f"/{layout.COVARIANCE}"]
    sizes = np.concatenate(column(ellipsoids, ":half_sizes"))
    sigmas = np.array([frame.sigmas[:3] for frame in run.frames if frame.sigmas is not None])
    # the trace of a covariance is that of its ellipsoid: 95 % lie within sqrt(7.815) sigma
    np.testing.assert_allclose((sizes**2).sum(axis=1), 7.815 * (sigmas**2).sum(axis=1), rtol=1e-4)
    np.testing.assert_allclose(
        np.concatenate(column(ellipsoids, ":centers")), run.trajectory.poses[:, :3, 3], atol=1e-6
    )


def test_keyframes_have_a_frustum_and_a_cloud(rows: Rows, logged: Logged) -> None:
    _, run, _ = logged
    for number, T in enumerate(run.pose_graph.keyframes.poses):
        path = f"/{layout.KEYFRAMES}/{number}"
        before, after = np.concatenate(column(rows[path], ":translation"))
        np.testing.assert_allclose(before, T[:3, 3], atol=1e-6)
        np.testing.assert_allclose(after, T[:3, 3] - [0, RISE_M, 0], atol=1e-6)
        assert column(rows[f"{path}/eye"], ":resolution") == [[[WIDTH, HEIGHT]]]
        (points,) = column(rows[f"{path}/cloud"], ":positions")
        assert len(points) > 1000
        np.testing.assert_allclose(np.array(points)[:, 2], WALL_M, atol=1e-3)


def test_the_rerun_file_contains_its_layout(logged: Logged) -> None:
    chunk = pytest.importorskip("rerun.chunk", reason="this rerun-sdk has no such reader")
    reader = chunk.RrdReader(logged[0])
    (arrangement,) = reader.blueprints()
    text = " ".join(
        str(part.to_record_batch().to_pylist()) for part in reader.stream(store=arrangement)
    )
    for name in ("Scene", "Matches", "Depth", "Epsilon, cm", "Time per frame, ms", "State"):
        assert f"'{name}'" in text


class NoRerun:
    """Takes whatever is drawn, and keeps nothing of it."""

    def __getattr__(self, name: str) -> NoRerun:
        return self

    def __call__(self, *_: object, **__: object) -> NoRerun:
        return self


@pytest.mark.parametrize("has_truth", [False, True])
def test_poses_are_kept_only_to_align_the_truth(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, has_truth: bool
) -> None:
    monkeypatch.setattr(rerun_recording, "load_rerun", NoRerun)
    pan = Pan(3)
    kept: list[weakref.ref[Float64]] = []
    truth = pan.ground_truth if has_truth else None
    with RerunRecording(str(tmp_path / "pan.rrd"), truth) as recording:
        for frame in pan:
            estimate = OdometryEstimate(frame.stamp_ns, TrackingState.TRACKING, np.eye(4))
            assert estimate.T_odom_camera is not None
            kept.append(weakref.ref(estimate.T_odom_camera))
            recording.add(frame, estimate)
        del estimate
        assert [ref() is not None for ref in kept] == [has_truth] * 3


def test_a_file_that_cannot_be_written_is_refused(needs_rerun: None, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match="cannot be written"):
        RerunRecording(str(tmp_path / "file" / "pan.rrd"))


def test_an_address_where_nobody_listens_is_refused_at_once(needs_rerun: None) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))  # and does not listen
        address = f"rerun+http://127.0.0.1:{taken.getsockname()[1]}/proxy"
        with pytest.raises(InputError, match="no viewer responds there"):
            RerunRecording(address)


def test_a_viewer_that_has_ended_is_not_waited_for(
    needs_rerun: None, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr("rgbd_glue_ros.viz.rerun_recording._PATIENCE_S", 0.5)
    with socket.socket() as listening:
        listening.bind(("127.0.0.1", 0))
        listening.listen()
        port = listening.getsockname()[1]
        recording = RerunRecording(f"rerun+http://127.0.0.1:{port}/proxy")
    recording.close()
    assert "is incomplete" in caplog.text


def test_without_rerun_the_extra_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(MissingExtraError, match="rerun-sdk"):
        RerunRecording(str(tmp_path / "pan.rrd"))
    assert not (tmp_path / "pan.rrd").exists()

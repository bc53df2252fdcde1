"""``map`` leaves what a replay leaves, corrected, and the map."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import make_bag
import numpy as np
import pytest
from rigs.bag_frames import write_small_bag
from rigs.pan import Pan

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.experiments.mapping.mapping import UNCORRECTED, MapOutputs, map_recording
from rgbd_glue_ros.experiments.replay.replay import INTERRUPTED
from rgbd_glue_ros.live.extrinsics import T_BODY_OPTICAL
from rgbd_glue_ros.parameters import Config, load_preset, with_values
from rgbd_glue_ros.recordings import open_recording
from rgbd_glue_ros.recordings.first_frames import first_frames
from rgbd_glue_ros.slam.map_file import read_map
from rgbd_glue_ros.slam.optimiser import optimise
from rgbd_glue_ros.trajectories.pose_graph import read_graph
from rgbd_glue_ros.trajectories.tum import read_tum
from rgbd_glue_ros.types import EdgeOrigin, ImuSamples, OdometryEstimate

pytest.importorskip("gtsam", reason="GTSAM is not installed")
pytest.importorskip("pyhbst", reason="pyHBST is not installed")


# in a camera that looks down
UP = np.array([0.0, -np.cos(0.3), -np.sin(0.3)])


def config() -> Config:
    near = {"odometry.keyframe_translation": 0.06, "odometry.window": 2}
    return with_values(load_preset("live"), near)


@pytest.mark.every_python
@pytest.mark.slow
def test_a_recording_that_comes_back_is_mapped_with_its_loops(tmp_path: Path) -> None:
    seen: list[OdometryEstimate] = []
    bag, out = write_small_bag(tmp_path / "bag", make_bag.FRAME_COUNT), tmp_path / "out"
    with open_recording(bag) as recording:
        mapped = map_recording(recording, config(), out, on_frame=seen.append)
    assert len(seen) == make_bag.FRAME_COUNT
    assert {path.name for path in out.iterdir()} == {
        *("trajectory.txt", "odometry.txt", "metrics.json", "params.yaml", "report.html"),
        *("keyframes.g2o", "keyframes_gtsam.g2o", "map.ply"),
    }
    figures = json.loads((out / "metrics.json").read_text())
    assert figures == mapped.figures
    assert figures["loops"]["found"] > 0
    assert figures["loops"]["refused"] == 0
    assert figures["ape"]["rmse_m"] < 0.002
    assert figures["odometry"]["ape"]["rmse_m"] < 0.002
    assert figures["map_points"] > 10_000

    report = (out / "report.html").read_text(encoding="utf-8")
    assert "<h2>Map</h2>" in report
    assert report.count('class="map"') == 1
    for key in ("before loops", "loops", "estimate"):
        assert f"</i>{key}</span>" in report
    before = 100 * figures["odometry"]["ape"]["rmse_m"]
    assert f"position error, rmse (APE); of the odometry {before:.2f} cm" in report

    graph = read_graph(out / "keyframes.g2o")
    loops = sum(edge.origin is EdgeOrigin.LOOP for edge in graph.edges)
    assert loops == figures["loops"]["found"]
    trajectory, odometry = (read_tum(out / f"{n}.txt") for n in ("trajectory", "odometry"))
    np.testing.assert_array_equal(trajectory.stamps_ns, odometry.stamps_ns)
    # the graph's keyframes lie on the corrected trajectory
    rows = np.searchsorted(trajectory.stamps_ns, graph.keyframes.stamps_ns)
    np.testing.assert_allclose(trajectory.poses[rows], graph.keyframes.poses, atol=1e-9)


def test_a_recording_too_dark_for_a_keyframe_is_refused(tmp_path: Path) -> None:
    blind = with_values(config(), {"odometry.min_planes": 1_000_000})
    with (
        open_recording(make_bag.FOLDER) as recording,
        pytest.raises(InputError, match="none of its 3 frames was tracked"),
    ):
        map_recording(first_frames(recording, 3), blind, tmp_path)


def test_where_time_goes_back_the_longest_part_is_mapped(tmp_path: Path) -> None:
    pan = Pan(6, rounds=(20, 4))
    mapped = map_recording(pan, config(), tmp_path)
    figures = json.loads((tmp_path / "metrics.json").read_text())
    assert (figures["frames"], figures["played"], figures["restarts"]) == (20, 30, 2)
    assert figures["ape"]["rmse_m"] < 0.02
    assert len(mapped.optimum.graph.keyframes) == figures["keyframes"] > 2
    for name in ("trajectory", "odometry"):
        stamps = read_tum(tmp_path / f"{name}.txt").stamps_ns
        np.testing.assert_array_equal(stamps, pan.ground_truth.stamps_ns)


def test_a_saved_map_has_the_axes_of_the_node_with_z_up_if_the_camera_starts_level(
    tmp_path: Path,
) -> None:
    room = tmp_path / "room.rgbdmap"
    map_recording(Pan(6), config(), tmp_path / "out", outputs=MapOutputs(save_map=room))
    (first, *_) = read_map(room).graph.keyframes.poses
    np.testing.assert_allclose(first, T_BODY_OPTICAL, atol=1e-9)
    (start, *_) = read_tum(tmp_path / "out" / "trajectory.txt").poses
    np.testing.assert_allclose(start, np.eye(4), atol=1e-9)


@dataclass(frozen=True)
class TiltedPan(Pan):
    """A camera that looks down by 0.3 rad, with an accelerometer at rest."""

    @property
    def imu(self) -> ImuSamples:
        stamps = np.arange(0, 10**9, 5_000_000, dtype=np.int64)
        shape = len(stamps), 1
        return ImuSamples(stamps, np.zeros((len(stamps), 3)), np.tile(9.81 * UP, shape))


def test_a_saved_map_is_level_where_the_recording_has_an_accelerometer(tmp_path: Path) -> None:
    room = tmp_path / "room.rgbdmap"
    map_recording(TiltedPan(6), config(), tmp_path / "out", outputs=MapOutputs(save_map=room))
    (first, *_) = read_map(room).graph.keyframes.poses
    np.testing.assert_allclose(first[:3, :3] @ UP, [0.0, 0.0, 1.0], atol=1e-6)
    # and ahead is where the camera looks, as far as that is level
    np.testing.assert_allclose(first[:3, 2], [np.cos(0.3), 0.0, -np.sin(0.3)], atol=1e-6)


@pytest.mark.slow
def test_a_map_that_cannot_be_written_in_the_end_costs_no_other_result(tmp_path: Path) -> None:
    out, room = tmp_path / "out", tmp_path / "new" / "room.rgbdmap"

    def occupy(_: OdometryEstimate) -> None:
        assert room.parent.is_dir()
        room.mkdir(exist_ok=True)

    outputs = MapOutputs(save_map=room)
    with (
        open_recording(make_bag.FOLDER) as recording,
        pytest.raises(InputError, match="exists and is not a file"),
    ):
        map_recording(first_frames(recording, 30), config(), out, on_frame=occupy, outputs=outputs)
    figures = json.loads((out / "metrics.json").read_text())
    assert figures["map_points"] > 10_000
    assert figures["loops"]["found"] >= 0
    assert (out / "map.ply").stat().st_size > 15 * figures["map_points"]
    assert "<h2>Map</h2>" in (out / "report.html").read_text(encoding="utf-8")


def test_an_interrupted_map_has_no_path_under_the_name_of_the_corrected_one(
    tmp_path: Path,
) -> None:
    def interrupt(estimate: OdometryEstimate) -> None:
        if estimate.stamp_ns == stamps[3]:
            raise KeyboardInterrupt

    stamps = Pan(6).ground_truth.stamps_ns
    with pytest.raises(KeyboardInterrupt):
        map_recording(Pan(6), config(), tmp_path, on_frame=interrupt)
    assert len(read_tum(tmp_path / "odometry.txt")) == 4
    assert not (tmp_path / "trajectory.txt").exists()
    report = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert UNCORRECTED in report
    assert INTERRUPTED in report


@pytest.mark.slow
def test_a_map_that_does_not_show_the_place_leaves_the_odometry_and_says_so(
    tmp_path: Path,
) -> None:
    room, out = tmp_path / "room.rgbdmap", tmp_path / "out"
    with open_recording(make_bag.FOLDER) as recording:
        taken = first_frames(recording, 20)
        map_recording(taken, config(), tmp_path / "room", outputs=MapOutputs(save_map=room))
    assert UNCORRECTED not in (tmp_path / "room" / "report.html").read_text(encoding="utf-8")
    with pytest.raises(InputError, match=r"shows none of the places.*odometry alone \(odometry"):
        map_recording(Pan(6), config(), out, before=read_map(room))
    assert not (out / "trajectory.txt").exists()
    assert not (out / "map.ply").exists()
    report = (out / "report.html").read_text(encoding="utf-8")
    assert UNCORRECTED in report
    assert "There is no map:" in report


@pytest.mark.slow
def test_the_graph_of_a_continued_map_has_both_sessions_and_is_at_its_optimum(
    tmp_path: Path,
) -> None:
    room, out = tmp_path / "room.rgbdmap", tmp_path / "out"
    for before in (None, room):
        with open_recording(make_bag.FOLDER) as recording:
            map_recording(
                first_frames(recording, 20),
                config(),
                out,
                before=None if before is None else read_map(before),
                outputs=MapOutputs(save_map=room),
            )
    graph, both = read_graph(out / "keyframes.g2o"), read_map(room).graph
    start = len(both.keyframes) // 2
    np.testing.assert_array_equal(graph.keyframes.stamps_ns, both.keyframes.stamps_ns)
    np.testing.assert_array_equal(
        graph.keyframes.stamps_ns[:start], graph.keyframes.stamps_ns[start:]
    )
    assert any(edge.parent < start <= edge.child for edge in graph.edges)
    np.testing.assert_allclose(
        optimise(graph).graph.keyframes.poses, graph.keyframes.poses, atol=1e-4
    )


@pytest.mark.parametrize("name", ["map.ply", "trajectory.txt"])
def test_a_map_in_the_place_of_a_result_is_refused_before_the_first_frame(
    name: str, tmp_path: Path
) -> None:
    seen: list[OdometryEstimate] = []
    outputs = MapOutputs(save_map=tmp_path / name)
    with (
        open_recording(make_bag.FOLDER) as recording,
        pytest.raises(InputError, match="is a result of this run itself"),
    ):
        map_recording(recording, config(), tmp_path, on_frame=seen.append, outputs=outputs)
    assert not seen
    assert not list(tmp_path.iterdir())

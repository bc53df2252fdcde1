"""A replay leaves its results behind, however it ends."""

from __future__ import annotations

import json
import logging
import signal
from collections.abc import Iterator
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
from rigs.pan import Pan
from rigs.scenes import SCENES

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.experiments.replay.outputs import FurtherOutputs
from rgbd_glue_ros.experiments.replay.replay import INTERRUPTED, replay
from rgbd_glue_ros.experiments.replay.result_names import (
    KEYFRAMES,
    KEYFRAMES_GTSAM,
    METRICS,
    PARAMETERS,
    REPORT,
    TRAJECTORY,
)
from rgbd_glue_ros.experiments.replay.run_record import Provenance
from rgbd_glue_ros.parameters import Config, InputConfig, load_yaml, with_values
from rgbd_glue_ros.recordings.first_frames import first_frames
from rgbd_glue_ros.recordings.other_truth import with_ground_truth
from rgbd_glue_ros.trajectories.pose_graph import read_graph
from rgbd_glue_ros.trajectories.tum import read_tum
from rgbd_glue_ros.types import (
    OdometryEstimate,
    RgbdFrame,
    Trajectory,
)


def test_a_replay_leaves_trajectory_figures_parameters_pose_graph_and_report(
    tmp_path: Path,
) -> None:
    config = with_values(Config(), {"seed": 7})
    inputs = InputConfig(depth_scale=0.0002)
    replay(Pan(40), config, tmp_path / "out" / "pan", provenance=Provenance(inputs))
    folder = tmp_path / "out" / "pan"
    assert sorted(path.name for path in folder.iterdir()) == sorted(
        [TRAJECTORY, METRICS, PARAMETERS, REPORT, KEYFRAMES, KEYFRAMES_GTSAM]
    )
    figures = json.loads((folder / METRICS).read_text())
    assert set(figures) == {
        *("sequence", "played", "frames", "tracked", "lost", "keyframes", "fps", "latency_ms"),
        *("stages_ms", "peak_rss_mb", "path_m", "ape", "rpe", "edges"),
        *("restarts", "blind_restarts", "unseen_motion", "duplicates", "unpaired"),
        *("longest_gap_s", "version"),
    }
    assert set(figures["latency_ms"]) == {"p50", "p95", "p99", "max"}
    assert set(figures["ape"]) == {"rmse_m", "mean_m", "median_m", "max_m"}
    assert set(figures["rpe"]) == {"delta_s", "trans_rmse_m", "rot_rmse_deg"}
    assert figures["rpe"]["delta_s"] == 1.0
    assert figures["frames"] == figures["tracked"] == 40
    assert figures["ape"]["rmse_m"] < 0.02
    assert len(read_tum(folder / TRAJECTORY)) == 40
    graph = read_graph(folder / KEYFRAMES)
    assert len(graph.keyframes) == figures["keyframes"]
    assert len(graph.edges) == figures["keyframes"] - 1
    assert load_yaml(folder / PARAMETERS, Config()) == config
    assert load_yaml(folder / PARAMETERS, InputConfig()) == inputs


def test_the_truth_may_be_given_and_the_frames_limited(tmp_path: Path) -> None:
    sequence = Pan(10)
    truth = sequence.ground_truth
    moved = Trajectory(truth.stamps_ns, truth.poses.copy())
    moved.poses[:, 0, 3] *= 2
    run = replay(first_frames(with_ground_truth(sequence, moved), 6), Config(), tmp_path)
    figures = json.loads((tmp_path / METRICS).read_text())
    assert figures["frames"] == len(run.frames) == 6
    # the truth is twice as long: errors are half the distances to the middle, at the ends 3.75 cm
    assert figures["ape"]["max_m"] == pytest.approx(0.0375, abs=0.005)
    assert figures["rpe"] is None


def test_truth_of_another_time_is_said_and_the_rest_is_written(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    elsewhen = Trajectory(np.array([10**18]), np.eye(4)[None])
    replay(with_ground_truth(Pan(3), elsewhen), Config(), tmp_path)
    assert f"{Pan(3).name}: no error against ground truth: only 0 poses" in caplog.text
    figures = json.loads((tmp_path / METRICS).read_text())
    assert "ape" not in figures
    assert figures["no_ape"].startswith("only 0 poses are within")
    assert "and 3 are needed" in figures["no_ape"]


def test_results_of_another_recording_are_not_replaced_in_silence(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    replay(Pan(3), Config(), tmp_path)
    replay(Pan(3), Config(), tmp_path)
    assert not caplog.messages
    figures = json.loads((tmp_path / METRICS).read_text())
    (tmp_path / METRICS).write_text(json.dumps({**figures, "sequence": "kitchen"}))
    replay(Pan(3), Config(), tmp_path)
    assert "replacing the results of kitchen" in caplog.text


def test_an_interrupted_replay_keeps_what_was_done(tmp_path: Path) -> None:
    done: list[OdometryEstimate] = []

    def interrupt(estimate: OdometryEstimate) -> None:
        done.append(estimate)
        if len(done) == 5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        replay(Pan(20), Config(), tmp_path, on_frame=interrupt)
    assert json.loads((tmp_path / METRICS).read_text())["frames"] == 5
    assert len(read_tum(tmp_path / TRAJECTORY)) == 5
    assert (tmp_path / REPORT).stat().st_size > 1000
    assert INTERRUPTED in (tmp_path / REPORT).read_text(encoding="utf-8")


def test_what_is_warned_of_before_and_during_a_run_is_in_its_report_once(tmp_path: Path) -> None:
    def warn(_: OdometryEstimate) -> None:
        logging.getLogger("rgbd_glue_ros.recordings").warning("frame %d skipped", 7)
        logging.getLogger("another library").warning("not of the run")

    opening = Provenance(warnings=("the camera is of another size",))
    replay(Pan(3), Config(), tmp_path, on_frame=warn, provenance=opening)
    report = (tmp_path / REPORT).read_text(encoding="utf-8")
    box = report.partition('<div class="notes">')[2].partition("</div>")[0]
    assert box.count("<li>") == 2
    assert "<li>the camera is of another size</li><li>frame 7 skipped</li>" in box


def test_a_signal_in_the_middle_of_a_frame_waits_for_the_frame(tmp_path: Path) -> None:
    done: list[OdometryEstimate] = []

    class Interrupts:
        def add(self, _: RgbdFrame, __: OdometryEstimate) -> None:
            if len(done) == 4:
                signal.raise_signal(signal.SIGINT)

        def start_anew(self) -> None: ...

        def close(self) -> None: ...

    outputs = FurtherOutputs([Interrupts()])
    with pytest.raises(KeyboardInterrupt):
        replay(Pan(20), Config(), tmp_path, on_frame=done.append, outputs=outputs)
    assert len(done) == 5
    assert json.loads((tmp_path / METRICS).read_text())["frames"] == 5


def test_a_signal_while_results_are_written_waits_for_them(tmp_path: Path) -> None:
    finished = []

    class Interrupts:
        def add(self, _: RgbdFrame, __: OdometryEstimate) -> None: ...

        def start_anew(self) -> None: ...

        def close(self) -> None:
            signal.raise_signal(signal.SIGINT)
            finished.append(self)

    outputs = FurtherOutputs([Interrupts(), Interrupts()])
    with pytest.raises(KeyboardInterrupt):
        replay(Pan(3), Config(), tmp_path, outputs=outputs)
    assert len(finished) == 2
    assert (tmp_path / REPORT).is_file()


def test_where_time_goes_back_the_odometry_starts_anew_and_that_is_said(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    run = replay(Pan(12, rounds=(20, 14)), Config(), tmp_path)
    first, longest, last = run.parts
    assert [len(part.trajectory) for part in run.parts] == [12, 20, 14]
    np.testing.assert_array_equal(first.trajectory.poses, longest.trajectory.poses[:12])
    np.testing.assert_array_equal(last.trajectory.poses, longest.trajectory.poses[:14])
    figures = json.loads((tmp_path / METRICS).read_text())
    assert (figures["frames"], figures["tracked"], figures["restarts"]) == (46, 46, 2)
    ways = [part.trajectory.poses[-1, 0, 3] for part in run.parts]
    assert figures["path_m"] == pytest.approx(sum(ways), rel=0.05)
    assert figures["ape"]["rmse_m"] < 0.02
    assert len((tmp_path / TRAJECTORY).read_text().splitlines()) == 1 + 46
    assert len(read_tum(tmp_path / TRAJECTORY)) == 20
    graph = read_graph(tmp_path / KEYFRAMES)
    assert len(graph.keyframes) == sum(frame.is_keyframe for frame in longest.frames)
    assert len(graph.edges) == len(graph.keyframes) - 1
    (said,) = [message for message in caplog.messages if "time went back" in message]
    assert "Of 3 parts" in said
    assert "20 of 46 frames" in said


class Elsewhere(Pan):
    """After twelve frames, the camera is before another wall."""

    def __iter__(self) -> Iterator[RgbdFrame]:
        for number, frame in enumerate(super().__iter__()):
            mirrored = np.ascontiguousarray(frame.color[:, ::-1])
            other = replace(frame, color=mirrored, depth=frame.depth * np.float32(0.6))
            yield frame if number < 12 else other


class AtAWall(Pan):
    """A bare wall, which shows the distance to it alone."""

    def __iter__(self) -> Iterator[RgbdFrame]:
        return islice(SCENES["a bare wall"].noisy_frames(seed=0), self.frame_count)


def test_a_restart_at_the_last_pose_is_said_and_in_the_report(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    config = with_values(Config(), {"odometry.reset_countdown": 5, "odometry.reset_delay": 0.0})
    run = replay(Elsewhere(24), config, tmp_path)
    (restart,) = run.blind_restarts
    assert restart.stamp_ns == run.frames[16].stamp_ns
    assert json.loads((tmp_path / METRICS).read_text())["blind_restarts"] == 1
    (said,) = [message for message in caplog.messages if "not recognised" in message]
    assert "lost and not recognised again 1 time, the first time at 0.567 s" in said
    assert "the last pose, which may be 0.2 m off" in said
    report = (tmp_path / REPORT).read_text()
    assert said in report
    assert "restarts at the last pose, not recognised" in report


@pytest.mark.slow
def test_frames_that_do_not_show_the_motion_are_said_and_in_the_report(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    run = replay(AtAWall(20), Config(), tmp_path)
    assert 5 < len(run.unseen_motion) < 20
    assert json.loads((tmp_path / METRICS).read_text())["unseen_motion"] == len(run.unseen_motion)
    (said,) = [message for message in caplog.messages if "as at a bare wall" in message]
    assert f"{len(run.unseen_motion)} frames, the first at" in said
    report = (tmp_path / REPORT).read_text()
    assert said in report
    assert "frames that did not show all of the motion" in report


def test_frames_that_come_twice_are_left_out_and_counted(tmp_path: Path) -> None:
    replay(Pan(6, copies=2), Config(), tmp_path)
    figures = json.loads((tmp_path / METRICS).read_text())
    assert (figures["frames"], figures["duplicates"], figures["restarts"]) == (6, 6, 0)


def test_frames_before_a_damaged_one_are_replayed_and_that_is_said(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"rgb/7\.png: is damaged; .* 7 frames before"):
        replay(Pan(20, breaks_after=7), Config(), tmp_path)
    assert json.loads((tmp_path / METRICS).read_text())["frames"] == 7


def test_a_sequence_without_frames_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="holds no frames"):
        replay(Pan(0), Config(), tmp_path)


def test_a_folder_that_cannot_be_written_is_refused_before_any_work(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be written"):
        replay(Pan(3), Config(), tmp_path / "file" / "out")

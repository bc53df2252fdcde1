"""Pairs: the right frames meet, what is counted is counted right, and nothing done is lost."""

from __future__ import annotations

import json
import logging
import re
import shutil
import signal
import sys
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import make_bag
import numpy as np
import pytest
from rigs.geometry import room_points
from rigs.opener import OpenerByName
from rigs.room import CAMERA

from rgbd_glue_ros.cli import main as cli
from rgbd_glue_ros.closing import Closing
from rgbd_glue_ros.errors import BAD_INPUT, InputError
from rgbd_glue_ros.evaluation.registration_errors import RegistrationErrors
from rgbd_glue_ros.experiments.batch.opening import Opening
from rgbd_glue_ros.experiments.pairs import gallery, methods
from rgbd_glue_ros.experiments.pairs.evaluation import Inliers, PairResult
from rgbd_glue_ros.experiments.pairs.experiment import Experiment, run_pairs
from rgbd_glue_ros.experiments.pairs.figures import gap_figures
from rgbd_glue_ros.experiments.pairs.jobs import Results, Unposed, evaluate_pairs, pairs_of
from rgbd_glue_ros.experiments.pairs.methods import Described, GlueMethod, PairMethod, method_of
from rgbd_glue_ros.experiments.pairs.report import FIGURES, TABLES
from rgbd_glue_ros.experiments.pairs.results import GLUE
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.geometry.views import view_of
from rgbd_glue_ros.parameters import (
    CameraConfig,
    Config,
    FeaturesConfig,
    InputConfig,
    load_preset,
    values,
)
from rgbd_glue_ros.recordings import Recording
from rgbd_glue_ros.recordings.recording import selected
from rgbd_glue_ros.types import Correspondences, RegistrationResult, RgbdFrame, Trajectory, View

FRAMES = 12
FRAME_NS = 33_333_333
# no feature at all: every pair fails, and its errors are those of the identity
BLIND = Config(features=FeaturesConfig(visual="none", geometric="none"))


@dataclass(frozen=True)
class Walk(Closing):
    """Black frames of a camera whose i-th step is i cm long."""

    name: str = "walk"
    has_truth: bool = True
    unposed: tuple[int, ...] = ()
    breaks_after: int | None = None

    @property
    def frame_count(self) -> int:
        return FRAMES

    @property
    def ground_truth(self) -> Trajectory | None:
        if not self.has_truth:
            return None
        posed = np.array([i for i in range(FRAMES) if i not in self.unposed], np.int64)
        poses = np.tile(np.eye(4), (len(posed), 1, 1))
        poses[:, 0, 3] = [at_m(i) for i in posed]
        return Trajectory(FRAME_NS * (posed + 1), poses)

    def __iter__(self) -> Iterator[RgbdFrame]:
        size = CAMERA.height, CAMERA.width
        for i in range(FRAMES):
            if i == self.breaks_after:
                raise InputError("rgb/7.png", "is damaged", "restore it")
            depth = np.full(size, 2.0, np.float32)
            yield RgbdFrame(FRAME_NS * (i + 1), np.zeros(size, np.uint8), depth, CAMERA)

    def select(self, indices: Iterable[int]) -> Iterator[RgbdFrame]:
        return selected(self, indices)

    def close(self) -> None: ...


def at_m(index: int) -> float:
    """Where the walk is after ``index`` steps."""
    return 0.01 * index * (index + 1) / 2


def walked(experiment: Experiment, walk: Walk | None = None) -> dict[int, list[float]]:
    """The lengths of the ways between the frames of each pair, cm, by gap."""
    lengths: dict[int, list[float]] = {gap: [] for gap in experiment.gaps}
    for outcome in evaluated(experiment, {GLUE: GlueMethod(experiment.config)}, walk or Walk()):
        assert isinstance(outcome, dict)
        result = outcome[GLUE]
        lengths[result.source - result.target].append(result.errors.translation_cm)
    return lengths


def evaluated(
    experiment: Experiment, methods: Mapping[str, PairMethod], walk: Walk | None = None
) -> list[Results | Unposed | InputError]:
    pairs = pairs_of(FRAMES, experiment.gaps, experiment.every)
    return list(evaluate_pairs(walk or Walk(), pairs, methods, experiment.config.camera))


def results_of(experiment: Experiment, methods: Mapping[str, PairMethod]) -> list[Results]:
    return [outcome for outcome in evaluated(experiment, methods) if isinstance(outcome, dict)]


def ways(gap: int, starts: Iterable[int]) -> list[float]:
    return [100 * (at_m(start + gap) - at_m(start)) for start in starts]


# which frames are paired


def test_pairs_are_a_gap_apart_and_start_at_every_nth_frame() -> None:
    experiment = Experiment(BLIND, [3, 5], every=2)
    found = walked(experiment)
    assert found[3] == pytest.approx(ways(3, range(0, 9, 2)))
    assert found[5] == pytest.approx(ways(5, range(0, 7, 2)))


def test_without_every_a_pair_starts_where_the_last_one_ended() -> None:
    experiment = Experiment(BLIND, [3, 5])
    found = walked(experiment)
    assert found[3] == pytest.approx(ways(3, range(0, 9, 3)))
    assert found[5] == pytest.approx(ways(5, range(0, 7, 5)))


def test_frames_without_a_true_pose_are_left_out_and_counted(tmp_path: Path) -> None:
    experiment = Experiment(BLIND, [3], every=1)
    lengths: list[float] = []

    def measure(pair: Results) -> None:
        lengths.append(pair[GLUE].errors.translation_cm)

    walk = opened(Walk(unposed=(4,)))
    figures = run_pairs([Path("walk")], walk, experiment, tmp_path, on_pair=measure)
    starts = [start for start in range(9) if 4 not in {start, start + 3}]
    assert lengths == pytest.approx(ways(3, starts))
    assert figures["problems"] == ["walk: frames without ground truth, skipped: 1"]


@pytest.mark.slow
def test_a_frame_in_several_pairs_is_described_once() -> None:
    described: list[View] = []

    class Counting(GlueMethod):
        def describe(self, view: View) -> Described:
            described.append(view)
            return super().describe(view)

    methods = {GLUE: Counting(BLIND), "unfiltered": Counting(unfiltered(BLIND))}
    results = results_of(Experiment(BLIND, [2, 4], every=2), methods)
    assert len(results) == 5 + 4
    assert len(described) == len({id(view) for view in described}) == 6


def unfiltered(config: Config) -> Config:
    """Another method on the same features."""
    return replace(config, glue=replace(config.glue, filter=False))


# what is counted


def test_inliers_are_counted_under_the_truth() -> None:
    truth = se3.exp(np.array([0.1, -0.2, 0.3, 0.2, 0.1, -0.3]))
    source = room_points(np.random.default_rng(0), 5)
    off = np.array([[0, 0, 0], [0.024, 0, 0], [0, 0.026, 0], [0, 0, 0.07], [0.2, 0, 0]])
    matches = Correspondences(source, se3.transform(truth, source) + off, np.ones(5))
    assert Inliers.of(matches, truth) == Inliers(5, (4, 3, 2))


def result(
    before: Inliers, after: Inliers, epsilon_m: float = float("nan"), *, failed: bool = False
) -> PairResult:
    return PairResult(
        recording="walk",
        source=3,
        target=0,
        errors=RegistrationErrors(1.0, 2.0, 3.0, failed),
        visual=Inliers(10, (8, 6, 4)),
        before=before,
        after=after,
        filtered=bool(np.isfinite(epsilon_m)),
        epsilon_m=epsilon_m,
        seconds=0.5,
        stages_ms={"fit": 4.0},
    )


def test_figures_are_means_over_pairs_and_the_filter_counts_where_it_was_applied() -> None:
    figures = gap_figures(
        [
            result(Inliers(100, (40, 20, 10)), Inliers(50, (40, 20, 10)), epsilon_m=0.0999),
            result(Inliers(200, (20, 10, 0)), Inliers(200, (20, 10, 0)), failed=True),
        ]
    )
    assert (figures["pairs"], figures["failed"]) == (2, 1)
    assert figures["inlier_ratio"] == {
        "before": {"10": 25.0, "5": 12.5, "2.5": 5.0},
        "after": {"10": 45.0, "5": 22.5, "2.5": 10.0},
    }
    assert figures["inlier_amount"]["before"] == {"10": 30.0, "5": 15.0, "2.5": 5.0}
    assert figures["filter_recall"] == 50.0
    assert figures["epsilon_squared_m2"] == pytest.approx(0.00998001)
    assert figures["visual_matches"] == 10
    assert figures["geometric_matches"] == 150
    assert figures["seconds_per_pair"] == 0.5
    assert figures["stages_ms"] == {"fit": 4.0}
    assert figures["rotation_deg"]["accuracy"]["5"] == 50.0
    # table S3: visual matches by the threshold that they gave
    assert figures["epsilon_squared_ranges"][4] == {
        "above_m2": 0.008,
        "up_to_m2": 0.01,
        "pairs": 1,
        "visual_matches": 10,
        "visual_inlier_ratio": {"10": 80.0, "5": 60.0, "2.5": 40.0},
    }
    assert figures["epsilon_squared_ranges"][3]["pairs"] == 0


def test_a_threshold_that_no_visual_match_gave_is_in_no_range() -> None:
    matched = Inliers(100, (40, 20, 10))
    fallen_back = replace(result(matched, matched, epsilon_m=0.05), visual=Inliers(0, (0, 0, 0)))
    ranges = gap_figures([fallen_back])["epsilon_squared_ranges"]
    assert [row["pairs"] for row in ranges] == [0] * 5


def test_without_geometric_matches_there_is_no_inlier_ratio() -> None:
    nothing = Inliers(0, (0, 0, 0))
    figures = gap_figures([result(nothing, nothing)])
    assert figures["inlier_ratio"]["before"] == {"10": None, "5": None, "2.5": None}
    assert figures["epsilon_squared_m2"] is None


def test_an_interrupt_waits_for_the_pair_in_work() -> None:
    registered = []

    class Interrupted(GlueMethod):
        def register(self, source: Described, target: Described) -> RegistrationResult:
            signal.raise_signal(signal.SIGINT)
            result = super().register(source, target)
            registered.append(result)
            return result

    with pytest.raises(KeyboardInterrupt):
        results_of(Experiment(BLIND, [3]), {GLUE: Interrupted(BLIND)})
    assert len(registered) == 1


def test_seconds_are_those_of_both_frames_features_even_if_one_was_known() -> None:
    config = replace(Config(), features=FeaturesConfig(visual="orb", geometric="none"))
    for results in results_of(Experiment(config, [1], every=1), {GLUE: GlueMethod(config)}):
        found = results[GLUE]
        assert 1000 * found.seconds > found.stages_ms["visual_features"] > 0


def test_peers_are_measured_on_the_same_pairs(tmp_path: Path) -> None:
    pytest.importorskip("small_gicp")
    experiment = Experiment(BLIND, [3], others={"small_gicp": "small_gicp"})
    run_pairs([Path("walk")], opened(Walk()), experiment, tmp_path)
    figures = figures_in(tmp_path)
    gap = figures["others"]["small_gicp"]["gaps"]["3"]
    assert gap["pairs"] == figures["gaps"]["3"]["pairs"] == 3
    assert gap["failed"] == 0
    assert set(gap["stages_ms"]) == {"features", "registration"}
    assert "| 3 | small_gicp | 3 | 0 | 100.0 |" in (tmp_path / TABLES).read_text()


def test_a_method_is_created_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    created: list[Config] = []

    class Counted(GlueMethod):
        def __init__(self, config: Config) -> None:
            created.append(config)
            super().__init__(config)

    monkeypatch.setattr(methods, "GlueMethod", Counted)
    method_of.cache_clear()
    run_pairs([Path("walk")], opened(Walk()), Experiment(BLIND, [3]), tmp_path)
    method_of.cache_clear()
    assert created == [BLIND]


def test_a_peer_that_is_not_there_is_reported_and_the_rest_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "small_gicp", None)
    method_of.cache_clear()
    experiment = Experiment(BLIND, [3], others={"small_gicp": "small_gicp"})
    run_pairs([Path("walk")], opened(Walk()), experiment, tmp_path)
    figures = figures_in(tmp_path)
    assert figures["others"] == {}
    assert "small_gicp is not installed" in figures["problems"][0]


# what goes wrong


def opened(*walks: Walk) -> OpenerByName:
    return OpenerByName(**{walk.name: walk for walk in walks})


def figures_in(folder: Path) -> dict[str, Any]:
    content: dict[str, Any] = json.loads((folder / FIGURES).read_text())
    return content


def test_what_is_said_of_a_recording_each_time_it_is_opened_is_shown_once(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    said = "walk: no file describes its camera"
    times = []

    class Telling(OpenerByName):
        def __call__(self, path: Path, /) -> Recording:
            logging.getLogger("rgbd_glue_ros.recordings").warning(said)
            times.append(path)
            return super().__call__(path)

    run_pairs([Path("walk")], Telling(walk=Walk()), Experiment(BLIND, [3]), tmp_path)
    assert len(times) > 1
    assert caplog.messages.count(said) == 1


def test_pairs_without_a_transform_are_counted_as_failed(tmp_path: Path) -> None:
    run_pairs([Path("walk")], opened(Walk()), Experiment(BLIND, [3]), tmp_path)
    gap = figures_in(tmp_path)["gaps"]["3"]
    assert gap["pairs"] == gap["failed"] == 3
    assert gap["translation_cm"]["accuracy"] == {"5": 0.0, "10": 0.0, "25": 0.0}
    assert gap["translation_cm"]["mean"] == pytest.approx((6 + 15 + 24) / 3)


def test_a_pair_that_raises_is_reported_and_the_rest_goes_on(
    caplog: pytest.LogCaptureFixture,
) -> None:
    class Fragile(GlueMethod):
        def describe(self, view: View) -> Described:
            if len(caplog.records) == 0:
                raise RuntimeError("a library gave up")
            return super().describe(view)

    results = results_of(Experiment(BLIND, [3]), {GLUE: Fragile(BLIND)})
    assert len(results) == 3
    assert results[0][GLUE].errors.failed
    assert "walk, frames 0 and 3: RuntimeError: a library gave up" in caplog.text


def test_a_recording_that_cannot_be_used_is_reported_and_the_rest_goes_on(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    walks = Walk("untrue", has_truth=False), Walk("cut off", breaks_after=7), Walk("whole")
    experiment = Experiment(BLIND, [3])
    run_pairs([Path(walk.name) for walk in walks], opened(*walks), experiment, tmp_path)
    figures = figures_in(tmp_path)
    assert figures["sources"] == ["cut off", "whole"]
    gap = figures["gaps"]["3"]
    assert gap["pairs"] == 2 + 3
    assert "untrue: has no ground truth" in caplog.text
    assert "rgb/7.png: is damaged" in caplog.text
    assert "rgb/7.png: is damaged" in (tmp_path / TABLES).read_text()


def test_without_any_pair_the_first_cause_is_the_error(tmp_path: Path) -> None:
    walks = Walk("untrue", has_truth=False), Walk("whole")
    paths = [Path(walk.name) for walk in walks]
    with pytest.raises(InputError, match="untrue: has no ground truth"):
        run_pairs(paths, opened(*walks), Experiment(BLIND, [FRAMES]), tmp_path)
    with pytest.raises(InputError, match="--gap: no two frames with ground truth are 12 apart"):
        run_pairs(paths[1:], opened(*walks), Experiment(BLIND, [FRAMES]), tmp_path)


def test_a_folder_that_cannot_be_written_is_refused_before_any_work(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be written"):
        run_pairs([], opened(), Experiment(BLIND, [3]), tmp_path / "file" / "out")


def test_an_interrupted_experiment_keeps_the_pairs_done(tmp_path: Path) -> None:
    done: list[dict[str, PairResult]] = []

    def interrupt(pair: dict[str, PairResult]) -> None:
        done.append(pair)
        if len(done) == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_pairs(
            [Path("walk")], opened(Walk()), Experiment(BLIND, [3]), tmp_path, on_pair=interrupt
        )
    gap = figures_in(tmp_path)["gaps"]["3"]
    assert gap["pairs"] == 2


def interrupted_experiment(source: Path, opening: Opening, folder: Path) -> None:
    def interrupt(_: object) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_pairs([source], opening, Experiment(BLIND, [12]), folder, on_pair=interrupt)


def test_a_recording_opened_in_another_way_does_not_continue_an_experiment(tmp_path: Path) -> None:
    interrupted_experiment(make_bag.FOLDER, Opening(), tmp_path)
    other = Opening(inputs=InputConfig(depth_scale=1 / 5000))
    with pytest.raises(InputError, match="an interrupted run with other parameters"):
        run_pairs([make_bag.FOLDER], other, Experiment(BLIND, [12]), tmp_path)


def test_a_relative_path_means_another_recording_in_another_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folders = [tmp_path / "one", tmp_path / "two"]
    for folder in folders:
        shutil.copytree(make_bag.FOLDER, folder / "bag")
    monkeypatch.chdir(folders[0])
    interrupted_experiment(Path("bag"), Opening(), tmp_path / "out")
    done: list[int] = []

    def note(_: int, done_before: int) -> None:
        done.append(done_before)
        raise KeyboardInterrupt

    for folder in reversed(folders):
        monkeypatch.chdir(folder)
        with pytest.raises(KeyboardInterrupt):
            run_pairs(
                [Path("bag")],
                Opening(),
                Experiment(BLIND, [12]),
                tmp_path / "out",
                on_planned=note,
            )
    assert done == [0, 1]


def test_an_interrupt_while_pictures_are_made_waits_for_one_of_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[View] = []

    def view_interrupted(frame: RgbdFrame, camera: CameraConfig) -> View:
        signal.raise_signal(signal.SIGINT)
        seen.append(view_of(frame, camera))
        return seen[-1]

    monkeypatch.setattr(gallery, "view_of", view_interrupted)
    with pytest.raises(KeyboardInterrupt):
        run_pairs([Path("walk")], opened(Walk()), Experiment(BLIND, [3]), tmp_path)
    assert len(seen) == 2
    assert figures_in(tmp_path)["gaps"]["3"]["pairs"] == 3


# a real recording


@pytest.mark.every_python
@pytest.mark.slow
def test_the_command_registers_the_bundled_recording_by_the_papers_method(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["pairs", str(make_bag.FOLDER), "--gap", "20", "--every", "80", "-o", str(tmp_path)]
    assert cli.main(arguments) == 0
    assert "gap 20   2 pairs, 0 failed" in capsys.readouterr().out
    figures = figures_in(tmp_path)
    assert figures["parameters"] == values(load_preset("paper"))
    assert figures["features"] == {"visual": "sift", "geometric": "fpfh"}
    gap = figures["gaps"]["20"]
    assert set(gap) == {
        *("pairs", "failed", "rotation_deg", "translation_cm", "chamfer_mm", "inlier_ratio"),
        *("inlier_amount", "filter_recall", "epsilon_squared_m2", "visual_matches"),
        *("epsilon_squared_ranges", "geometric_matches", "seconds_per_pair", "stages_ms"),
    }
    assert set(gap["stages_ms"]) == {
        *("visual_features", "geometric_features", "visual_matching", "ransac"),
        *("geometric_matching", "fit"),
    }
    assert gap["rotation_deg"]["accuracy"] == {"5": 100.0, "10": 100.0, "45": 100.0}
    assert gap["translation_cm"]["mean"] < 2
    assert gap["filter_recall"] == 100.0
    # table 4: the filter keeps nearly all of the best inliers and few of the others
    before, after = gap["inlier_amount"]["before"], gap["inlier_amount"]["after"]
    assert after["2.5"] > 0.9 * before["2.5"]
    assert gap["inlier_ratio"]["after"]["10"] > 90 > gap["inlier_ratio"]["before"]["10"]
    row = (tmp_path / TABLES).read_text().split("| 20 | 2 | 0 |")[1].splitlines()[0]
    assert row.startswith(" 100.0 | 100.0 | 100.0 |")


@pytest.mark.slow
def test_the_command_fills_in_a_table_of_the_paper(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = str(make_bag.FOLDER)
    arguments = ["pairs", "--table", "S1", "--data", data, "--every", "70", "-o", str(tmp_path)]
    assert cli.main([*arguments, "--set", "features.voxel=0.05"]) == 0
    text = (tmp_path / "table_S1.md").read_text()
    assert capsys.readouterr().out.endswith(text)
    reason = r"are missing|is not installed|is not known"
    assert re.search(rf"\| Before Filtering, LightGlue \+ FCGF \| here: .+ ({reason})", text)
    assert text.count("| After Filtering, SIFT + FPFH | here | 1 |") == 2
    # the row is the configuration itself, which is not measured twice
    assert figures_in(tmp_path)["others"] == {}


def test_without_a_recording_it_is_said_what_to_name(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["pairs", "-o", "out"]) == BAD_INPUT
    assert "no recording is given; name a data set or a bag" in capsys.readouterr().err

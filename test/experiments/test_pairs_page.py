"""The report of pairs is one page that needs nothing else, and shows the worst pairs first."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import make_bag
import numpy as np
import pytest
from rigs.pages import Page

from rgbd_glue_ros.evaluation.registration_errors import RegistrationErrors
from rgbd_glue_ros.experiments.batch.opening import Opening
from rgbd_glue_ros.experiments.pairs.evaluation import Inliers, PairResult
from rgbd_glue_ros.experiments.pairs.experiment import Experiment, run_pairs
from rgbd_glue_ros.experiments.pairs.gallery import TYPICAL, WORST, chosen, severity
from rgbd_glue_ros.experiments.pairs.page import render
from rgbd_glue_ros.experiments.pairs.report import REPORT
from rgbd_glue_ros.experiments.pairs.results import GLUE, PairResults
from rgbd_glue_ros.parameters import Config, with_values


def result(number: int, error: float = 1.0, *, failed: bool = False) -> PairResult:
    return PairResult(
        recording="a <script> & more",
        source=20 * number + 20,
        target=20 * number,
        errors=RegistrationErrors(error, 2 * error, error, failed),
        visual=Inliers(100, (90, 80, 60)),
        before=Inliers(1000, (300, 200, 100)),
        after=Inliers(310, (290, 195, 99)),
        filtered=not failed,
        epsilon_m=float("nan") if failed else 0.05 + 0.04 * (number % 7) / 7,
        seconds=1.0,
        stages_ms={"visual_features": 80.0},
    )


def page_of(by_method: dict[str, list[PairResult]], config: Config | None = None) -> str:
    by_gap = {name: {20: results} for name, results in by_method.items()}
    results = PairResults(by_gap, ["a <script> & more"], [], {})
    config = config or Config()
    return render(results.figures(config, None), by_gap, config, [])


def test_the_page_is_well_formed_and_fetches_nothing_whatever_a_recording_is_called() -> None:
    rows = [result(i, float(i)) for i in range(9)] + [result(9, failed=True)]
    source = page_of({GLUE: rows, "small_gicp": rows})
    page = Page(source)
    assert page.open == []
    assert page.fetched == []
    assert "://" not in source
    assert "small gicp" in page.text
    assert "a <script> & more" in page.text


@pytest.mark.parametrize("failed", [True, False])
def test_a_single_pair_has_a_report(failed: bool) -> None:
    assert Page(page_of({GLUE: [result(0, failed=failed)]})).open == []


def test_a_curve_ends_at_the_share_of_pairs_that_have_a_transform() -> None:
    rows = [result(i) for i in range(3)] + [result(3, failed=True)]
    source = page_of({GLUE: rows})
    # a quarter below the top of 1000 units
    assert "1000.0 250.0" in source


def test_the_worst_come_first_and_those_without_a_transform_before_all() -> None:
    pairs = [(Path("x"), result(i, float(i))) for i in range(20)]
    pairs.append((Path("x"), result(20, 0.0, failed=True)))
    shown = [pair.errors.rotation_deg for _, pair in chosen(pairs)]
    assert shown[:WORST] == [0.0, 19.0, 18.0, 17.0, 16.0, 15.0]
    assert shown[WORST:] == [11.0, 10.0, 9.0]
    assert len(chosen(pairs[:4])) == 4
    assert len(chosen(pairs[:8])) == 8
    assert len({id(pair) for _, pair in chosen(pairs)}) == WORST + TYPICAL


def test_severity_is_the_worse_of_rotation_and_translation_by_their_thresholds() -> None:
    errors = RegistrationErrors(rotation_deg=10.0, translation_cm=5.0, chamfer_mm=0.0)
    assert severity(replace(result(0), errors=errors)) == 2.0


@pytest.mark.slow
def test_the_report_of_scannets_test_split_is_smaller_than_five_megabytes() -> None:
    rng = np.random.default_rng(0)
    rows = [result(i, float(e)) for i, e in enumerate(rng.lognormal(size=26_000))]
    assert len(page_of({GLUE: rows, "peer": rows})) < 1_000_000


@pytest.mark.slow
def test_a_run_leaves_a_report_with_pictures_of_its_pairs(tmp_path: Path) -> None:
    config = with_values(Config(), {"features.keypoints": 300})
    experiment = Experiment(config, [10], 30)
    figures = run_pairs([make_bag.FOLDER], Opening(), experiment, tmp_path)
    source = (tmp_path / REPORT).read_text()
    page = Page(source)
    assert page.open == []
    assert len(page.fetched) == 2 * figures["gaps"]["10"]["pairs"] > 0
    assert all(str(image).startswith("data:image/jpeg;base64,") for image in page.fetched)
    assert '<line class="geometric"' in source
    assert '<line class="visual"' in source
    assert "features.keypoints" in source

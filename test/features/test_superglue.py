"""SuperPoint and SuperGlue with made-up weights: the published ones are nobody's to pass on."""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rigs.room import room_view

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.features import superpoint, weights
from rgbd_glue_ros.features.layers import Weights
from rgbd_glue_ros.features.learned import LearnedFeature, LearnedKeypoints
from rgbd_glue_ros.features.superglue import SuperGlue, log_transport
from rgbd_glue_ros.features.superpoint import superpoint_keypoints
from rgbd_glue_ros.parameters import FeaturesConfig

torch: Any = pytest.importorskip("torch", reason="the extra 'learned' is not installed")
GENERATOR = torch.Generator()


def random(*shape: int) -> Any:
    """Numbers that keep what goes through a layer of about one size."""
    return torch.randn(shape, generator=GENERATOR) / max(1, math.prod(shape[1:])) ** 0.5


def superpoint_weights() -> Weights:
    GENERATOR.manual_seed(0)
    tensors = {}
    channels = 1
    for number, width in enumerate((64, 64, 128, 128), start=1):
        for half in "ab":
            tensors[f"conv{number}{half}.weight"] = random(width, channels, 3, 3)
            channels = width
    for head, width in (("P", 65), ("D", 256)):
        tensors[f"conv{head}a.weight"] = random(256, channels, 3, 3)
        tensors[f"conv{head}b.weight"] = random(width, 256, 1, 1)
    return Weights(tensors)


def superglue_weights(layers: int = 4) -> Weights:
    GENERATOR.manual_seed(1)
    tensors = {"bin_score": torch.tensor(1.0)}

    def pointwise(name: str, inner: int, outer: int) -> None:
        tensors[f"{name}.weight"], tensors[f"{name}.bias"] = random(outer, inner, 1), random(outer)

    def perceptron(name: str, *widths: int) -> None:
        for i in range(len(widths) - 1):
            pointwise(f"{name}.{3 * i}", widths[i], widths[i + 1])
            if i < len(widths) - 2:
                norm = f"{name}.{3 * i + 1}"
                tensors[f"{norm}.weight"] = torch.ones(widths[i + 1])
                tensors[f"{norm}.running_mean"] = random(widths[i + 1])
                tensors[f"{norm}.running_var"] = torch.ones(widths[i + 1])

    perceptron("kenc.encoder", 3, 32, 64, 128, 256, 256)
    for layer in range(layers):
        for part in ("merge", "proj.0", "proj.1", "proj.2"):
            pointwise(f"gnn.layers.{layer}.attn.{part}", 256, 256)
        perceptron(f"gnn.layers.{layer}.mlp", 512, 512, 256)
    pointwise("final_proj", 256, 256)
    return Weights(tensors)


@pytest.fixture(scope="module")
def feature() -> LearnedFeature:
    extractor, matcher = partial(superpoint_keypoints, least=0.0), SuperGlue(superglue_weights())
    device = torch.device("cpu")
    return LearnedFeature(extractor, superpoint_weights(), matcher, 0.0, 100, device)


def test_keypoints_lie_apart_and_away_from_the_border(feature: LearnedFeature) -> None:
    found = feature.extract(room_view(0.0))
    assert found.descriptors.shape == (100, 256)
    torch.testing.assert_close(found.descriptors.norm(dim=1), torch.ones(100))
    assert (torch.diff(found.scores) <= 0).all()
    uv = found.uv.numpy()
    assert ((uv >= 4) & (uv < np.array([320, 240]) - 4)).all()
    between = np.abs(uv[:, None] - uv).max(axis=2) + 100 * np.eye(len(uv))
    assert between.min() > 4


def test_matches_do_not_depend_on_the_order_of_keypoints(feature: LearnedFeature) -> None:
    source, target = (feature.extract(room_view(time)) for time in (0.0, 0.3))
    order = torch.randperm(100, generator=torch.Generator().manual_seed(2))
    shuffled = LearnedKeypoints(
        target.uv[order], target.descriptors[order], target.scores[order], 320, 240
    )
    with torch.inference_mode():
        plain, other = (feature.matcher(source, points) for points in (target, shuffled))
    assert plain.shape == (100, 100)
    torch.testing.assert_close(other, plain[:, order], atol=1e-3, rtol=1e-3)


def test_transport_sends_every_keypoint_to_one_place_or_the_bin() -> None:
    similarity = torch.tensor([[9.0, 0.0, 0.0], [0.0, 9.0, 0.0]])
    plan = log_transport(similarity, torch.tensor(1.0), steps=100).exp()
    torch.testing.assert_close(plan[:-1].sum(dim=1), torch.ones(2))
    torch.testing.assert_close(plan[:, :-1].sum(dim=0), torch.ones(3))
    torch.testing.assert_close(plan.sum(), torch.tensor(5.0))
    assert plan[:2].argmax(dim=1).tolist() == [0, 1]
    assert plan[:, 2].argmax() == 2


def test_the_terms_are_told_once_when_weights_are_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    weights._tell_terms.cache_clear()
    monkeypatch.setattr(weights, "check", lambda _: None)
    for name in ("superpoint_v1.pth", "superglue_indoor.pth"):
        torch.save({"bin_score": torch.ones(())}, tmp_path / name)
        weights.load(name, FeaturesConfig(weights=str(tmp_path)), "cpu")
    (record,) = caplog.records
    assert "non-commercial research only" in record.message


def test_a_lightglue_for_other_keypoints_is_refused_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(weights, "check", lambda _: None)
    torch.save({"conv1a.weight": torch.ones(1)}, tmp_path / "superpoint_v1.pth")
    torch.save({"input_proj.weight": torch.ones((4, 128))}, tmp_path / "superpoint_lightglue.pth")
    with pytest.raises(InputError, match="are not those of a LightGlue for SuperPoint"):
        superpoint.superpoint_lightglue(FeaturesConfig(weights=str(tmp_path), device="cpu"))

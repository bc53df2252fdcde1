"""Weights: found, asked for, and read without running what is in them."""

from __future__ import annotations

import importlib.util
import os
import pickle
from pathlib import Path

import pytest

from rgbd_glue_ros.errors import InputError, MissingExtraError
from rgbd_glue_ros.features import GEOMETRIC, VISUAL
from rgbd_glue_ros.features.checkpoint import read_tensors
from rgbd_glue_ros.features.weights import (
    FILES,
    check,
    learned_features,
    require,
    weights_folder,
)
from rgbd_glue_ros.parameters import (
    GEOMETRIC_FEATURES,
    LEARNED_VISUAL_FEATURES,
    VISUAL_FEATURES,
    FeaturesConfig,
)


class Harmful:
    """A pickle of it writes a file where it is read."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def __reduce__(self) -> tuple[object, tuple[object, ...]]:
        return Path.touch, (self._path,)


def test_every_file_is_for_features_that_there_are() -> None:
    for entry in FILES.values():
        assert {*entry.features} <= {*VISUAL_FEATURES, *GEOMETRIC_FEATURES}
        assert [bool(entry.url), bool(entry.wheel), bool(entry.page)].count(True) == 1
        assert len(entry.sha256) == (64 if entry.bytes else 0)
        assert entry.bytes or entry.page


def test_the_features_that_have_weights_are_those_that_are_called_learned() -> None:
    with_weights = {name for entry in FILES.values() for name in entry.features}
    assert with_weights & {*VISUAL_FEATURES} == {*LEARNED_VISUAL_FEATURES}
    assert {*VISUAL} == {*VISUAL_FEATURES}
    assert {*GEOMETRIC} == {*GEOMETRIC_FEATURES}


def test_learned_features_are_told_by_their_parameters() -> None:
    both = FeaturesConfig(visual="xfeat", geometric="minispinnet")
    assert learned_features(both) == ("features.visual:=xfeat", "features.geometric:=minispinnet")
    assert learned_features(FeaturesConfig(visual="orb", geometric="none")) == ()


def test_what_may_not_be_passed_on_is_never_brought_from_anywhere() -> None:
    limited = [entry for entry in FILES.values() if "Magic Leap" in entry.licence]
    assert {entry.file for entry in limited} == {"superpoint_v1.pth", "superglue_indoor.pth"}
    for entry in limited:
        assert entry.terms
        assert not entry.url
        assert not entry.wheel


def test_the_folder_is_the_one_given_or_else_the_users(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    assert weights_folder(FeaturesConfig()) == tmp_path / "rgbd_glue_ros" / "weights"
    assert weights_folder(FeaturesConfig(weights="~/mine")) == Path.home() / "mine"


def test_weights_that_are_missing_name_the_command_that_brings_them(tmp_path: Path) -> None:
    pytest.importorskip("torch")
    config = FeaturesConfig(visual="lightglue", weights=str(tmp_path))
    with pytest.raises(InputError, match=r"xfeat\.pt: are missing; run 'rgbd-glue weights bring"):
        require(config)


def test_without_torch_only_the_features_that_need_it_are_named(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(MissingExtraError, match=r"fcgf") as missing:
        require(FeaturesConfig(visual="orb", geometric="fcgf"))
    assert "orb" not in str(missing.value)


def test_hand_crafted_features_need_nothing(tmp_path: Path) -> None:
    require(FeaturesConfig(visual="sift", geometric="fpfh", weights=str(tmp_path)))


def test_code_in_a_file_is_not_run(tmp_path: Path) -> None:
    pytest.importorskip("torch")
    trap, path = tmp_path / "ran", tmp_path / "weights.pth"
    path.write_bytes(pickle.dumps(Harmful(trap), protocol=2))
    with pytest.raises(InputError, match="holds no weights"):
        read_tensors(path, "cpu")
    assert not trap.exists()


@pytest.mark.parametrize(
    "content", [b"", b"PK\x03\x04 cut short", b"no weights at all", b"hello\n"]
)
def test_what_is_no_checkpoint_is_told_in_one_line(content: bytes, tmp_path: Path) -> None:
    pytest.importorskip("torch")
    path = tmp_path / "weights.pth"
    path.write_bytes(content)
    with pytest.raises(InputError, match="holds no weights") as told:
        read_tensors(path, "cpu")
    assert "\n" not in str(told.value)


@pytest.mark.filterwarnings("error")
def test_a_pickle_of_another_protocol_is_refused_without_a_warning_of_torch(tmp_path: Path) -> None:
    pytest.importorskip("torch")
    path = tmp_path / "weights.pth"
    path.write_bytes(pickle.dumps({"layer": Harmful(tmp_path / "ran")}, protocol=4))
    with pytest.raises(InputError, match="holds no weights"):
        read_tensors(path, "cpu")


@pytest.mark.parametrize("kind", ["folder", "link to itself", "link to nowhere", "pipe"])
def test_what_lies_in_the_place_of_weights_and_is_no_file_is_not_called_missing(
    kind: str, tmp_path: Path
) -> None:
    place = tmp_path / "alike_t.pth"
    if kind == "folder":
        place.mkdir()
    elif kind == "pipe":
        os.mkfifo(place)
    else:
        place.symlink_to("alike_t.pth" if kind == "link to itself" else "nowhere")
    with pytest.raises(InputError, match=r"alike_t\.pth: is not a file; remove it"):
        check(place)


def test_a_checkpoint_that_is_no_table_of_tensors_is_refused(tmp_path: Path) -> None:
    torch = pytest.importorskip("torch")
    path = tmp_path / "weights.pth"
    torch.save({"epoch": 3}, path)
    with pytest.raises(InputError, match="no table of weights"):
        read_tensors(path, "cpu")

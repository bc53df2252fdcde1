"""Peers: each finds a small motion of a camera, in the direction that its caller expects."""

from __future__ import annotations

from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from rigs.room import CAMERA, room_view, true_pose

from rgbd_glue_ros.errors import InputError, MissingExtraError
from rgbd_glue_ros.evaluation.registration_errors import rotation_deg, translation_cm
from rgbd_glue_ros.experiments.peers import PEERS, NoTransformError, Peer, opencv_odometry
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.types import View

# from, to, and what the result may be off by: those from the identity are for small motions,
# global ones stop at what inliers of a few cm allow
SMALL = 0.3, 0.2, 1.0, 0.5
LARGE = 1.4, 1.2, 4.0, 1.5
GLOBAL = {"fpfh_ransac", "fpfh_fgr", "fpfh_sc2_pcr", "fpfh_mac"}


def made(name: str) -> Peer:
    try:
        return PEERS[name]()
    except (MissingExtraError, InputError) as error:
        pytest.skip(str(error))


@pytest.mark.slow
@pytest.mark.parametrize("name", PEERS)
def test_a_peer_finds_the_transform_from_source_to_target(name: str) -> None:
    peer = made(name)
    source_s, target_s, limit_cm, limit_deg = LARGE if name in GLOBAL else SMALL
    T = peer.register(peer.prepare(room_view(source_s)), peer.prepare(room_view(target_s)))
    truth = se3.inverse(true_pose(target_s)) @ true_pose(source_s)
    assert translation_cm(T, truth) < limit_cm < translation_cm(np.eye(4), truth)
    assert rotation_deg(T, truth) < limit_deg < rotation_deg(np.eye(4), truth)


@pytest.mark.slow
@pytest.mark.parametrize("name", PEERS)
def test_a_peer_gives_no_transform_of_frames_without_depth(name: str) -> None:
    peer = made(name)
    size = CAMERA.height, CAMERA.width
    blind = View(np.full(size, 128, np.uint8), np.full(size, np.nan, np.float32), CAMERA)
    with pytest.raises(NoTransformError):
        peer.register(peer.prepare(blind), peer.prepare(blind))


@pytest.mark.skipif(hasattr(cv2, "rgbd"), reason="OpenCV is here with its contributed modules")
def test_a_peer_whose_library_is_not_there_says_what_to_install() -> None:
    with pytest.raises(InputError, match="install the same release of opencv-contrib"):
        PEERS["opencv_rgbd"]()


def test_what_opencv_refuses_has_no_transform(monkeypatch: pytest.MonkeyPatch) -> None:
    class Refusing:
        def setCameraMatrix(self, matrix: object) -> None:
            """Takes any."""

        def compute(self, *_: object) -> tuple[bool, object]:
            raise cv2.error("too few points")

    modules = {"cv2.rgbd": SimpleNamespace(RgbdOdometry_create=Refusing)}
    monkeypatch.setattr(opencv_odometry, "import_module", modules.__getitem__)
    peer = PEERS["opencv_rgbd"]()
    prepared = peer.prepare(room_view(0.0))
    with pytest.raises(NoTransformError, match="OpenCV refuses the frames: too few points"):
        peer.register(prepared, prepared)

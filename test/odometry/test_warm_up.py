"""After the warm-up no real frame waits for a compiler."""

from __future__ import annotations

import subprocess
import sys

import pytest
from rigs.paths import ROOT

from rgbd_glue_ros.features import VISUAL
from rgbd_glue_ros.features.visual import VisualFeature
from rgbd_glue_ros.odometry.warm_up import warm_up
from rgbd_glue_ros.parameters import FeaturesConfig, load_preset
from rgbd_glue_ros.registration.glue import Glue

# In a process of its own, as other tests compile too.
PROGRAM = """
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from numba.core.dispatcher import Dispatcher

from rgbd_glue_ros.geometry.depth_registration import DepthCamera, registered
from rgbd_glue_ros.geometry.views import grey
from rgbd_glue_ros.geometry.reduction import reduced
from rgbd_glue_ros.parameters import load_preset
from rgbd_glue_ros.odometry.odometry import Odometry
from rgbd_glue_ros.recordings import open_recording
from rgbd_glue_ros.types import RgbdFrame
from rgbd_glue_ros.odometry.warm_up import warm_up


def compiled():
    functions = {
        f"{name}.{f.py_func.__name__}": f
        for name, module in [*sys.modules.items()] if name.startswith("rgbd_glue_ros.")
        for f in vars(module).values() if isinstance(f, Dispatcher)
    }
    return {name: len(f.signatures) for name, f in functions.items()}


def as_grey(frame):
    # a message's own memory cannot be written
    image = grey(frame.color)
    image.flags.writeable = False
    return replace(frame, color=image)


def as_a_wall(frame):
    bare = np.full_like(frame.color, 200)
    return replace(frame, color=bare, depth=np.full_like(frame.depth, 1.5))


def with_depth_of_its_own_camera(frame):
    depth_camera = DepthCamera(frame.intrinsics.scaled(320, 240), np.eye(4))
    depth = registered(frame.depth[::2, ::2].copy(), depth_camera, frame.intrinsics)
    return replace(frame, depth=depth)


config = load_preset("live")
warm_up(config)
before = compiled()
assert sum(before.values()) > 5, before
with open_recording(Path(sys.argv[1])) as sequence:
    frames = [frame for frame, _ in zip(sequence, range(8))]
delay = frames[1].stamp_ns - frames[0].stamp_ns
kinds = (
    (frames, 0),
    (frames, 320),
    ([as_grey(frame) for frame in frames], 0),
    ([as_a_wall(frame) for frame in frames], 0),
    ([with_depth_of_its_own_camera(frame) for frame in frames], 0),
)
for kind, width in kinds:
    odometry = Odometry(config)
    for frame in kind:
        odometry.process(replace(reduced(frame, width), depth_delay_ns=delay))
changed = {name: count for name, count in compiled().items() if count != before[name]}
print(*changed)
"""


@pytest.mark.slow
def test_after_the_warm_up_nothing_is_compiled_for_the_frames_of_a_bag() -> None:
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, ROOT / "bags" / "living_room"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == []


def test_the_warm_up_uses_the_given_features_and_creates_none(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    config, made = load_preset("live"), []
    make = VISUAL[config.features.visual]

    def counted(features: FeaturesConfig) -> VisualFeature:
        made.append(features)
        return make(features)

    monkeypatch.setitem(VISUAL, config.features.visual, counted)
    warm_up(config, Glue(config))
    assert made == [config.features]

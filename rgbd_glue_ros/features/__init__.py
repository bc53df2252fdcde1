"""The features that registration can use, by their names in the configuration."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.features.alike import Alike
from rgbd_glue_ros.features.aliked import aliked_lightglue
from rgbd_glue_ros.features.disk import disk_lightglue
from rgbd_glue_ros.features.fcgf import Fcgf
from rgbd_glue_ros.features.geometric import (
    GeometricFeature,
    GridFpfh,
    NoGeometricFeature,
    VoxelFpfh,
)
from rgbd_glue_ros.features.minispinnet import MiniSpinNet
from rgbd_glue_ros.features.superpoint import superpoint_lightglue, superpoint_superglue
from rgbd_glue_ros.features.visual import NoVisualFeature, VisualFeature, brisk, orb, sift
from rgbd_glue_ros.features.xfeat import xfeat_lighterglue
from rgbd_glue_ros.parameters import FeaturesConfig, add_choice

VISUAL: dict[str, Callable[[FeaturesConfig], VisualFeature]] = {
    "none": lambda _: NoVisualFeature(),
    "orb": orb,
    "sift": sift,
    "brisk": brisk,
    "alike": Alike,
    "alike_n": partial(Alike, file="alike_n.pth"),
    "xfeat": xfeat_lighterglue,
    "aliked_lightglue": aliked_lightglue,
    "disk_lightglue": disk_lightglue,
    "superpoint_lightglue": superpoint_lightglue,
    "superpoint_superglue": superpoint_superglue,
    # the best matcher with a free licence
    "lightglue": xfeat_lighterglue,
}

GEOMETRIC: dict[str, Callable[[FeaturesConfig], GeometricFeature]] = {
    "none": lambda _: NoGeometricFeature(),
    "fpfh": VoxelFpfh,
    "fpfh_grid": GridFpfh,
    "fcgf": Fcgf,
    "minispinnet": MiniSpinNet,
}


def add_visual_feature(name: str, make: Callable[[FeaturesConfig], VisualFeature]) -> None:
    """Adds a choice to ``features.visual``, in this process.

    Args:
        name: name of the feature.
        make: creates it from its parameters; called once for every registration or odometry.

    Raises:
        InputError: a feature of that name exists.
    """
    if name in VISUAL:
        raise InputError(f"visual feature {name!r}", "exists already", "give it another name")
    VISUAL[name] = make
    add_choice("features.visual", name)

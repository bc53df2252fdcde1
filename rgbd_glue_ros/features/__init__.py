"""The features that registration can use, by the name that the configuration calls them."""

from __future__ import annotations

from collections.abc import Callable

from rgbd_glue_ros.features.alike import Alike
from rgbd_glue_ros.features.geometric import (
    GeometricFeature,
    GridFpfh,
    NoGeometricFeature,
    VoxelFpfh,
)
from rgbd_glue_ros.features.minispinnet import MiniSpinNet
from rgbd_glue_ros.features.visual import NoVisualFeature, VisualFeature, brisk, orb, sift
from rgbd_glue_ros.features.xfeat import XFeat
from rgbd_glue_ros.parameters import FeaturesConfig

VISUAL: dict[str, Callable[[FeaturesConfig], VisualFeature]] = {
    "none": lambda _: NoVisualFeature(),
    "orb": orb,
    "sift": sift,
    "brisk": brisk,
    "alike": Alike,
    "xfeat": XFeat,
    # the best matcher whose licence lets anybody use it
    "lightglue": XFeat,
}

GEOMETRIC: dict[str, Callable[[FeaturesConfig], GeometricFeature]] = {
    "none": lambda _: NoGeometricFeature(),
    "fpfh": VoxelFpfh,
    "fpfh_grid": GridFpfh,
    "minispinnet": MiniSpinNet,
}

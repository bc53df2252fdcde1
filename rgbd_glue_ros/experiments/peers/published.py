"""Estimators of the paper's related work on the paper's own FPFH matches."""

from __future__ import annotations

from rgbd_glue_ros.experiments.peers.base import NoTransformError
from rgbd_glue_ros.experiments.peers.mac import mac, require_networkx
from rgbd_glue_ros.features.geometric import DescribedPoints, VoxelFpfh
from rgbd_glue_ros.parameters import FeaturesConfig
from rgbd_glue_ros.registration.sc2_pcr import sc2_pcr
from rgbd_glue_ros.types import Correspondences, Float64, View


class _FpfhMatches:
    def __init__(self) -> None:
        self._features = VoxelFpfh(FeaturesConfig())

    def prepare(self, view: View) -> DescribedPoints:
        """Points and features."""
        return self._features.extract(view)

    def _matches(self, source: DescribedPoints, target: DescribedPoints) -> Correspondences:
        return self._features.match(source, target, None)


class Sc2Pcr(_FpfhMatches):
    """SC2-PCR."""

    def register(self, source: DescribedPoints, target: DescribedPoints) -> Float64:
        """T_target_source."""
        T, _ = sc2_pcr(self._matches(source, target))
        if T is None:
            raise NoTransformError("too few matches")
        return T


class Mac(_FpfhMatches):
    """MAC."""

    def __init__(self) -> None:
        """Prepares the features.

        Raises:
            MissingExtraError: networkx is not installed.
        """
        require_networkx()
        super().__init__()

    def register(self, source: DescribedPoints, target: DescribedPoints) -> Float64:
        """T_target_source."""
        T = mac(self._matches(source, target))
        if T is None:
            raise NoTransformError("no three matches are compatible")
        return T

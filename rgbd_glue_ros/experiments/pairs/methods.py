"""Methods that register a pair: this package's with a configuration, or a peer by name."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Protocol

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.experiments.peers import PEERS, NoTransformError
from rgbd_glue_ros.parameters import Config
from rgbd_glue_ros.registration.frame_features import FrameFeatures
from rgbd_glue_ros.registration.glue import Glue
from rgbd_glue_ros.stopwatch import timed
from rgbd_glue_ros.types import (
    Correspondences,
    RegistrationResult,
    RegistrationStatus,
    View,
    stages,
)

Estimator = Config | str
"""The name of a method: a configuration of the paper's, or one of ``PEERS``."""

_NO_MATCHES = Correspondences.empty()
NO_RESULT = RegistrationResult(
    None,
    RegistrationStatus.TOO_FEW_CORRESPONDENCES,
    visual=_NO_MATCHES,
    visual_inliers=_NO_MATCHES,
    geometric=_NO_MATCHES,
    credible=_NO_MATCHES,
)
"""The matches of a failed registration, or of a peer, which returns none."""


@dataclass(frozen=True)
class Described:
    """A method's description of one frame.

    Attributes:
        features: in the method's own form.
        seconds: wall time to compute them.
        stages_ms: wall time of each part of that, milliseconds.
    """

    features: Any
    seconds: float
    stages_ms: dict[str, float]


class PairMethod(Protocol):
    """A method that registers two frames without further information."""

    @property
    def description(self) -> object:
        """Methods with equal descriptions describe frames identically, so this is done once."""

    def describe(self, view: View) -> Described:
        """The features of a frame."""

    def register(self, source: Described, target: Described) -> RegistrationResult:
        """T_target_source of two frames, or the reason why there is none."""


@lru_cache(maxsize=32)
def method_of(estimator: Estimator) -> PairMethod:
    """A method by name, created once per process: some load networks.

    Raises:
        InputError: there is no such peer, or its library is not available.
        MissingExtraError: a library of the method is not installed.
    """
    return GlueMethod(estimator) if isinstance(estimator, Config) else PeerMethod(estimator)


class GlueMethod:
    """The paper's method, without prior and refinement."""

    def __init__(self, config: Config) -> None:
        self._glue = Glue(config)
        self._second_thread = ThreadPoolExecutor(1)
        self._features = config.features

    @property
    def description(self) -> object:
        """The configuration of the features."""
        return self._features

    def describe(self, view: View) -> Described:
        """Visual and geometric features."""
        features, milliseconds = timed(self._extract, view)
        return Described(features, milliseconds / 1e3, features.stages_ms)

    def _extract(self, view: View) -> FrameFeatures:
        """Like ``Glue.extract``, with geometric features extracted by the second thread."""
        geometric = self._second_thread.submit(self._glue.extract_geometric, view)
        return self._glue.extract_visual(view, geometric.result).complete()

    def register(self, source: Described, target: Described) -> RegistrationResult:
        """Sections 3.1 to 3.3 of the paper."""
        return self._glue.register(source.features, target.features)


class PeerMethod:
    """One of ``PEERS``."""

    def __init__(self, name: str) -> None:
        if name not in PEERS:
            raise InputError(name, "is not a known peer", f"use one of {', '.join(PEERS)}")
        self._name = name
        self._peer = PEERS[name]()

    @property
    def description(self) -> object:
        """The peer."""
        return self._name

    def describe(self, view: View) -> Described:
        """The peer's prepared data."""
        features, milliseconds = timed(self._peer.prepare, view)
        return Described(features, milliseconds / 1e3, {stages.FEATURES: milliseconds})

    def register(self, source: Described, target: Described) -> RegistrationResult:
        """The peer's transform, without a covariance."""
        try:
            T, milliseconds = timed(self._peer.register, source.features, target.features)
        except NoTransformError:
            return NO_RESULT
        return RegistrationResult(
            T,
            RegistrationStatus.OK,
            visual=_NO_MATCHES,
            visual_inliers=_NO_MATCHES,
            geometric=_NO_MATCHES,
            credible=_NO_MATCHES,
            stages_ms={stages.REGISTRATION: milliseconds},
        )

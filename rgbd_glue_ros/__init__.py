"""Live RGB-D odometry with RGBD-Glue: visual correspondences guide geometric ones.

The public interface is here, and loaded when first used. Anything else may change.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rgbd_glue_ros.errors import InputError, MissingExtraError
    from rgbd_glue_ros.evaluation.trajectory_errors import Ape, Evaluation, Rpe, evaluate
    from rgbd_glue_ros.features import add_visual_feature
    from rgbd_glue_ros.features.visual import KeypointFeature, VisualFeature, VisualMatches
    from rgbd_glue_ros.odometry.odometry import Odometry
    from rgbd_glue_ros.parameters import (
        Config,
        FeaturesConfig,
        InputConfig,
        load_preset,
        load_yaml,
        with_values,
    )
    from rgbd_glue_ros.recordings import (
        Calibration,
        Recording,
        Topics,
        open_recording,
        read_calibration,
    )
    from rgbd_glue_ros.registration.frames import register
    from rgbd_glue_ros.trajectories.tum import read_tum, write_tum
    from rgbd_glue_ros.types import (
        CameraIntrinsics,
        Correspondences,
        DepthSummary,
        EdgeOrigin,
        ImuCalibration,
        ImuSamples,
        ImuUse,
        LensModel,
        OdometryEstimate,
        PoseGraphEdge,
        RegistrationResult,
        RegistrationStatus,
        RgbdFrame,
        TrackingState,
        Trajectory,
        View,
    )

_PLACES = {
    "errors": ("InputError", "MissingExtraError"),
    "evaluation.trajectory_errors": ("Ape", "Evaluation", "Rpe", "evaluate"),
    "features": ("add_visual_feature",),
    "features.visual": ("KeypointFeature", "VisualFeature", "VisualMatches"),
    "odometry.odometry": ("Odometry",),
    "parameters": (
        "Config",
        "FeaturesConfig",
        "InputConfig",
        "load_preset",
        "load_yaml",
        "with_values",
    ),
    "recordings": ("Calibration", "Recording", "Topics", "read_calibration", "open_recording"),
    "registration.frames": ("register",),
    "trajectories.tum": ("read_tum", "write_tum"),
    "types": (
        "CameraIntrinsics",
        "Correspondences",
        "DepthSummary",
        "EdgeOrigin",
        "ImuCalibration",
        "ImuSamples",
        "ImuUse",
        "LensModel",
        "OdometryEstimate",
        "PoseGraphEdge",
        "RegistrationResult",
        "RegistrationStatus",
        "RgbdFrame",
        "TrackingState",
        "Trajectory",
        "View",
    ),
}
"""The modules of the public names."""

__all__ = [
    "Ape",
    "Calibration",
    "CameraIntrinsics",
    "Config",
    "Correspondences",
    "DepthSummary",
    "EdgeOrigin",
    "Evaluation",
    "FeaturesConfig",
    "ImuCalibration",
    "ImuSamples",
    "ImuUse",
    "InputConfig",
    "InputError",
    "KeypointFeature",
    "LensModel",
    "MissingExtraError",
    "Odometry",
    "OdometryEstimate",
    "PoseGraphEdge",
    "Recording",
    "RegistrationResult",
    "RegistrationStatus",
    "RgbdFrame",
    "Rpe",
    "Topics",
    "TrackingState",
    "Trajectory",
    "View",
    "VisualFeature",
    "VisualMatches",
    "add_visual_feature",
    "evaluate",
    "load_preset",
    "load_yaml",
    "open_recording",
    "read_calibration",
    "read_tum",
    "register",
    "with_values",
    "write_tum",
]


def __getattr__(name: str) -> Any:
    """Loads a public name from its module; ``__version__`` is the installed one, "" for none."""
    if name == "__version__":
        return _version()
    for module, names in _PLACES.items():
        if name in names:
            return getattr(import_module(f"{__name__}.{module}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def _version() -> str:
    from importlib import metadata  # noqa: PLC0415 - takes longer to load than all else here

    try:
        return metadata.version(__name__)
    except metadata.PackageNotFoundError:
        return ""


def __dir__() -> list[str]:
    return [*__all__]

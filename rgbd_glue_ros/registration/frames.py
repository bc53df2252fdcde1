"""Registers two frames without any further information."""

from __future__ import annotations

from rgbd_glue_ros.geometry.views import view_of
from rgbd_glue_ros.parameters import Config, load_preset
from rgbd_glue_ros.registration.glue import Glue
from rgbd_glue_ros.types import RegistrationResult, RgbdFrame
from rgbd_glue_ros.types.checks import check_class


def register(
    source: RgbdFrame, target: RgbdFrame, config: Config | None = None
) -> RegistrationResult:
    """The transform between two frames by sections 3.1 to 3.3 of the paper.

    There is no prior and no refinement: these belong to the odometry, which knows more.

    Args:
        source: frame whose points the transform maps.
        target: frame that it maps them to.
        config: features and parameters; None takes the preset ``paper``.

    Returns:
        ``T_target_source`` [4, 4] in metres with its covariance, or the reason why there is none.

    Raises:
        InputError: a feature is not available, or an argument is of another class.
        MissingExtraError: a library of a feature is not installed.
    """
    for name, frame in (("source", source), ("target", target)):
        remedy = "RgbdFrame(stamp_ns, color, depth, intrinsics)"
        check_class(f"register.{name}", frame, RgbdFrame, remedy)
    config = load_preset("paper") if config is None else config
    check_class("register.config", config, Config, "load_preset('paper') or another")
    glue = Glue(config)
    return glue.register(
        glue.extract(view_of(source, config.camera)), glue.extract(view_of(target, config.camera))
    )

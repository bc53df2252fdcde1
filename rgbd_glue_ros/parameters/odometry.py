"""The parameters of keyframes, of the acceptance of poses, and of what follows a rejection."""

from __future__ import annotations

from dataclasses import dataclass

from rgbd_glue_ros.parameters.parameter import parameter


@dataclass(frozen=True)
class OdometryConfig:
    """Keyframes and tracking state."""

    keyframes: int = parameter(
        50,
        "Keyframes kept, at most: the window, and anchors, which are earlier ones used to find a "
        "lost camera and to correct drift.",
        minimum=1,
        maximum=1000,
        fixed="the stored keyframes were chosen by it",
    )
    window: int = parameter(
        5,
        "Latest keyframes that tracking chooses from. A step back to an older one would show as a "
        "jump of the drift since then.",
        minimum=1,
        maximum=1000,
        fixed="the stored keyframes were chosen by it",
    )
    keyframe_spacing: float = parameter(
        0.6,
        "A keyframe that leaves the window is discarded if it is nearer than this to an anchor, "
        "metres and radians added.",
        minimum=0.0,
        maximum=1000.0,
        fixed="the stored keyframes were chosen by it",
    )
    drift_radius: float = parameter(
        1.0,
        "A new keyframe is compared with the earliest anchors that are nearer than this, metres "
        "and radians added: what several agree on is drift, and is corrected. 0 compares with "
        "none.",
        minimum=0.0,
        maximum=1000.0,
    )
    drift_rate: float = parameter(
        0.01,
        "Drift is corrected by at most this fraction of the camera's motion, metres and radians "
        "added, so that the pose never jumps.",
        minimum=0.0,
        maximum=1.0,
    )
    own_parts: bool = parameter(
        True,
        "Whether surfaces that move with the camera, such as a gripper or a bumper in view, are "
        "detected and ignored.",
    )
    references: int = parameter(
        3, "Keyframes that a pose is refined against at once, at most.", minimum=1, maximum=10
    )
    keyframe_translation: float = parameter(
        0.25,
        "A frame this far from its keyframe becomes one.",
        unit="m",
        minimum=0.001,
        maximum=1000.0,
    )
    keyframe_rotation: float = parameter(
        0.25,
        "A frame turned this much from its keyframe becomes one.",
        unit="rad",
        minimum=0.001,
        maximum=1000.0,
    )
    keyframe_overlap: float = parameter(
        0.35,
        "A frame of which the keyframes show less than this fraction becomes one, however near it "
        "is.",
        minimum=0.0,
        maximum=1.0,
    )
    prior_radius: float = parameter(
        0.1,
        "Radius of the search around the motion prior if visual matches give no transform; "
        "0 registers without a prior.",
        unit="m",
        minimum=0.0,
        maximum=10.0,
    )
    surprise_translation: float = parameter(
        0.03,
        "Refinement finds a pose from a start this far away. If the registered pose is farther "
        "from the one refined from the prediction, it is refined too, and competes with it.",
        unit="m",
        minimum=0.0,
        maximum=1000.0,
    )
    surprise_rotation: float = parameter(
        0.03,
        "The same for the rotation between the two poses.",
        unit="rad",
        minimum=0.0,
        maximum=1000.0,
    )
    min_planes: int = parameter(
        50,
        "Planes that must be seen for their agreement to count; more after a frame without a pose.",
        minimum=1,
        maximum=1000000,
    )
    min_pixels: int = parameter(
        50,
        "Textured pixels that must be seen for their correlation to count; more after a frame "
        "without a pose.",
        minimum=1,
        maximum=1000000,
    )
    plane_agreement: float = parameter(
        0.5,
        "A pose is accepted if at least this fraction of the visible planes agrees with it; it is "
        "rejected, whatever the pixels say, below half of this.",
        minimum=0.0,
        maximum=1.0,
    )
    brightness_correlation: float = parameter(
        0.6,
        "A pose is also accepted if the brightness of model and image correlates at least this "
        "much, unless fewer of the visible planes agree with it than half of plane_agreement; "
        "after a frame without a pose, or a gap in time, the planes must agree too, and it has to "
        "be half-way from this to 1 if no visual matches agree.",
        minimum=-1.0,
        maximum=1.0,
    )
    timing_error: float = parameter(
        0.015,
        "Uncertainty of the time of an image, from rolling shutter, exposure and stamps, if it "
        "takes 26 ms to read, as with a Kinect, and in proportion otherwise; the covariance grows "
        "by the motion in this time.",
        unit="s",
        minimum=0.0,
        maximum=1.0,
    )
    scale_error: float = parameter(
        0.005,
        "Relative error of the camera's scale; the covariance grows by this fraction of the "
        "distance from the keyframe.",
        minimum=0.0,
        maximum=1.0,
    )
    relocalisation_attempts: int = parameter(
        3,
        "Keyframes tried per frame when tracking fails; while the camera is lost, all in turn.",
        minimum=0,
        maximum=100,
    )
    relocalisation_inliers: int = parameter(
        25,
        "Visual inliers that relocalisation needs: a wrong pose is worse than none.",
        minimum=3,
        maximum=100000,
    )
    reset_countdown: int = parameter(
        3,
        "Frames that show something but have no pose, after which a new keyframe starts at the "
        "last pose, if reset_delay has also passed; 0 waits for ever.",
        minimum=0,
        maximum=1000000,
    )
    reset_delay: float = parameter(
        1.0,
        "Time without a pose before a new keyframe starts at the last one. A slow camera has moved "
        "out of sight of its keyframes by then; a fast one may still return.",
        unit="s",
        minimum=0.0,
        maximum=1e6,
    )

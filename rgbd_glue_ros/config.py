"""Every parameter of the package, declared once: type, default, unit, range and meaning.

The YAML files in ``config/``, the command line, the ROS parameters and ``docs/parameters.md`` are
generated from these declarations or checked against them. A configuration is a frozen tree of
dataclasses; a parameter's dotted name (``glue.k``) is its path in that tree.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import Field, dataclass, field, fields, is_dataclass, replace
from pathlib import Path
from typing import Any, TypeVar, cast

import yaml

from rgbd_glue_ros.errors import InputError

Value = bool | int | float | str
C = TypeVar("C")

PACKAGE = "rgbd_glue_ros"


@dataclass(frozen=True)
class Parameter:
    """The declaration of one parameter.

    Attributes:
        name: dotted name.
        default: default value; its type is the parameter's type.
        description: what it means, one or two sentences.
        unit: SI unit or other unit; "" for a pure number or text.
        minimum: least allowed value, None if unbounded.
        maximum: greatest allowed value, None if unbounded.
        choices: allowed texts; empty if any text is.
    """

    name: str
    default: Value
    description: str
    unit: str = ""
    minimum: float | None = None
    maximum: float | None = None
    choices: tuple[str, ...] = ()

    @property
    def type(self) -> type:
        """bool, int, float or str."""
        return type(self.default)

    def convert(self, value: object) -> Value:
        """``value`` as this parameter's type.

        Raises:
            InputError: it is of another type, out of range, or not among the choices.
        """
        if self.type is float and isinstance(value, int) and not isinstance(value, bool):
            value = float(value)
        if self.type is float and isinstance(value, str):
            # YAML 1.1 takes 1e-3 for a text, as it has no dot
            with suppress(ValueError):
                value = float(value)
        if self.type is str and isinstance(value, bool):
            # YAML 1.1 reads none of our texts as a bool, but a user's "no" or "off" it does
            raise InputError(self.name, f"{value} is not a text", f"give {self.allowed}")
        if not isinstance(value, self.type) or (self.type is int and isinstance(value, bool)):
            raise InputError(
                self.name, f"{value!r} is no {self.type.__name__}", f"give {self.allowed}"
            )
        if isinstance(value, (int, float)) and not isinstance(value, bool):
            too_low = self.minimum is not None and not value >= self.minimum
            too_high = self.maximum is not None and not value <= self.maximum
            if too_low or too_high:
                raise InputError(self.name, f"{value} is out of range", f"give {self.allowed}")
        if self.choices and value not in self.choices:
            raise InputError(self.name, f"{value!r} is not known", f"give {self.allowed}")
        return cast(Value, value)

    @property
    def allowed(self) -> str:
        """What values are allowed, in words."""
        if self.choices:
            return "one of " + ", ".join(self.choices)
        words = {bool: "true or false", int: "a whole number", float: "a number", str: "a text"}
        text = words[self.type]
        if self.minimum is not None and self.maximum is not None:
            text += f" from {self.minimum:g} to {self.maximum:g}"
        elif self.minimum is not None:
            text += f" of at least {self.minimum:g}"
        elif self.maximum is not None:
            text += f" of at most {self.maximum:g}"
        return text + (f" ({self.unit})" if self.unit else "")


def _parameter(
    default: Value,
    description: str,
    *,
    unit: str = "",
    minimum: float | None = None,
    maximum: float | None = None,
    choices: tuple[str, ...] = (),
) -> Any:
    return field(
        default=default,
        metadata={
            "parameter": Parameter("", default, description, unit, minimum, maximum, choices)
        },
    )


VISUAL_FEATURES = ("none", "orb", "sift", "brisk")
FIT_METHODS = ("randomised", "procrustes", "ransac")
FALLBACK_METHODS = ("none", "sc2_pcr")
GEOMETRIC_FEATURES = ("none", "fpfh", "fpfh_grid")


@dataclass(frozen=True)
class CameraConfig:
    """How depth is read."""

    depth_min: float = _parameter(
        0.1, "Depth below this is taken as unknown.", unit="m", minimum=0.0
    )
    depth_max: float = _parameter(
        8.0, "Depth above this is taken as unknown.", unit="m", minimum=0.1
    )


@dataclass(frozen=True)
class FeaturesConfig:
    """What is extracted from a frame."""

    visual: str = _parameter(
        "orb", "Visual feature; none registers by geometry alone.", choices=VISUAL_FEATURES
    )
    geometric: str = _parameter(
        "fpfh_grid",
        "Geometric feature; none registers by visual correspondences alone.",
        choices=GEOMETRIC_FEATURES,
    )
    keypoints: int = _parameter(
        1000, "Visual keypoints kept per frame, at most.", minimum=10, maximum=20000
    )
    ratio: float = _parameter(
        0.8,
        "Lowe's ratio (equation 1): a visual match is kept when its nearest neighbour is nearer "
        "than this times the second nearest.",
        minimum=0.1,
        maximum=1.0,
    )
    voxel: float = _parameter(
        0.025, "Edge of the voxels that thin the cloud for fpfh.", unit="m", minimum=0.001
    )
    geometric_matches: int = _parameter(
        20000,
        "Geometric matches of fpfh, at most: of a cloud with more points than this, as many are "
        "matched, spread evenly, to all of the other cloud.",
        minimum=100,
    )
    grid_step: int = _parameter(
        12, "Spacing of the points of fpfh_grid.", unit="pixel", minimum=2, maximum=64
    )


@dataclass(frozen=True)
class GlueConfig:
    """Section 3 of the paper."""

    inlier_threshold: float = _parameter(
        0.05, "t_in: RANSAC's inlier threshold on 3D distance.", unit="m", minimum=0.001
    )
    k: float = _parameter(
        5.0,
        "K of equation 4: matches within K t_in are assumed inliers. The paper takes 3 for learned "
        "and 5 for hand-crafted features.",
        minimum=1.0,
        maximum=100.0,
    )
    confidence: float = _parameter(
        0.95,
        "Quantile of the chi-square distribution in equation 7.",
        minimum=0.5,
        maximum=0.9999,
    )
    min_visual: int = _parameter(
        6,
        "The filter is skipped when equation 4 assumes fewer visual inliers than this.",
        minimum=3,
    )
    min_credible: int = _parameter(
        10,
        "The filter is skipped when fewer geometric matches than this survive it.",
        minimum=3,
    )
    over_chance: float = _parameter(
        0.0,
        "The filter is skipped when fewer geometric matches survive it than this times those that "
        "would had points been matched at random; 0 does not ask. With a fallback, 2 tells most "
        "wrong transforms, but also right ones of small clouds.",
        minimum=0.0,
    )
    filter: bool = _parameter(
        True, "Whether the consistency filter (equation 8) is applied at all."
    )
    fallback: str = _parameter(
        "none",
        "What gives the rough transform where visual matches are too few for it or almost no "
        "geometric match agrees: none skips the filter as in the paper, sc2_pcr finds one from the "
        "geometric matches.",
        choices=FALLBACK_METHODS,
    )


@dataclass(frozen=True)
class RansacConfig:
    """The rough transform from visual correspondences (section 3.2)."""

    iterations: int = _parameter(1000, "Samples drawn, at most.", minimum=1, maximum=1000000)
    min_inliers: int = _parameter(
        6, "A transform that fewer visual matches than this agree with is not believed.", minimum=3
    )


@dataclass(frozen=True)
class FitConfig:
    """The fit to all credible correspondences (section 3.3)."""

    method: str = _parameter(
        "randomised",
        "Fit to the credible matches: randomised weighted Procrustes as in the paper, procrustes "
        "of all of them at once, or ransac.",
        choices=FIT_METHODS,
    )
    subsets: int = _parameter(
        10, "Random subsets of the randomised weighted Procrustes.", minimum=1
    )
    fraction: float = _parameter(
        0.2, "Part of the matches in each random subset.", minimum=0.01, maximum=1.0
    )


@dataclass(frozen=True)
class RefineConfig:
    """The joint refinement after the fit, beyond the paper."""

    iterations: int = _parameter(
        5,
        "Gauss-Newton steps at each level of the image pyramid, at most; 0 leaves the fit of the "
        "paper as it is.",
        minimum=0,
        maximum=100,
    )
    grid_step: int = _parameter(
        8, "Spacing of the planes in a keyframe.", unit="pixel", minimum=1, maximum=64
    )
    plane_cauchy: float = _parameter(
        2.0,
        "Plane distance, in its standard deviations, at which a plane's weight is halved.",
        minimum=0.01,
    )
    pixel_weight: float = _parameter(
        10.0,
        "Weight of a photometric residual beside a plane's, both by their standard deviations; 0 "
        "refines on planes alone.",
        minimum=0.0,
    )
    unregistered_weight: float = _parameter(
        1.0,
        "The same where depth turns out not to be registered to colour, if that is less: the depth "
        "of a pixel is then that of another one.",
        minimum=0.0,
    )
    pixel_cauchy: float = _parameter(
        2.0,
        "Photometric residual, in its standard deviations, at which a pixel's weight is halved.",
        minimum=0.01,
    )
    correlation: float = _parameter(
        1000.0,
        "Neighbouring residuals err alike: as many of them as this count as one in the covariance.",
        minimum=1.0,
    )


@dataclass(frozen=True)
class TimingConfig:
    """When the images are really taken; found out while the camera moves.

    Of cameras whose frame is called openni… (Kinect v1, Xtion) it is known.
    """

    depth_latency: float = _parameter(
        0.0,
        "How much later depth is stamped than colour of the same moment; a first guess, unless "
        "spread is 0.",
        unit="s",
        minimum=-0.05,
        maximum=0.05,
    )
    readout: float = _parameter(
        0.0,
        "From the first row of an image to the last: 0 for a global shutter, negative where the "
        "last row is read first; a first guess, unless spread is 0.",
        unit="s",
        minimum=-0.05,
        maximum=0.05,
    )
    spread: float = _parameter(
        0.01,
        "Standard deviation of these two first guesses; 0 keeps them as they are, for any camera.",
        unit="s",
        minimum=0.0,
    )
    drift: float = _parameter(
        0.0001, "How much they may change from frame to frame.", unit="s", minimum=0.0
    )
    correlation: float = _parameter(
        1000.0,
        "Neighbouring residuals err alike: as many of them as this count as one for the timing.",
        minimum=1.0,
    )


@dataclass(frozen=True)
class MotionConfig:
    """How the camera may move between frames."""

    acceleration: float = _parameter(
        3.0,
        "Standard deviation of the camera's acceleration. Great values take every pose as the "
        "images give it.",
        unit="m/s²",
        minimum=0.01,
    )
    angular_acceleration: float = _parameter(
        6.0,
        "Standard deviation of the camera's angular acceleration.",
        unit="rad/s²",
        minimum=0.01,
    )


@dataclass(frozen=True)
class OdometryConfig:
    """Keyframes and tracking state."""

    keyframes: int = _parameter(
        50,
        "Keyframes kept at most: the window, and anchors, which are earlier ones that serve to "
        "find a lost camera and to take drift out.",
        minimum=1,
        maximum=1000,
    )
    window: int = _parameter(
        5,
        "Latest keyframes that tracking chooses from. A step back to an older one would show as a "
        "jump of the drift since then.",
        minimum=1,
        maximum=1000,
    )
    keyframe_spacing: float = _parameter(
        0.6,
        "A keyframe that leaves the window is forgotten where it is nearer than this to an anchor, "
        "metres and radians added.",
        minimum=0.0,
    )
    drift_radius: float = _parameter(
        1.0,
        "A new keyframe is compared with the earliest anchor that is nearer than this, metres and "
        "radians added: what they disagree by is drift, and is taken out. 0 compares with none.",
        minimum=0.0,
    )
    drift_rate: float = _parameter(
        0.01,
        "Drift is taken out by this part of the camera's way at most, metres and radians added, so "
        "that the pose never jumps.",
        minimum=0.0,
        maximum=1.0,
    )
    references: int = _parameter(
        3, "Keyframes that a pose is refined against at once, at most.", minimum=1, maximum=10
    )
    keyframe_translation: float = _parameter(
        0.25, "A frame this far from its keyframe becomes one.", unit="m", minimum=0.001
    )
    keyframe_rotation: float = _parameter(
        0.25, "A frame turned this much from its keyframe becomes one.", unit="rad", minimum=0.001
    )
    prior_radius: float = _parameter(
        0.1,
        "Radius of the search around the motion prior where visual matches give no transform; "
        "0 registers without a prior.",
        unit="m",
        minimum=0.0,
    )
    surprise_translation: float = _parameter(
        0.03,
        "A pose this far from the motion prior competes with one refined from the prior.",
        unit="m",
        minimum=0.0,
    )
    surprise_rotation: float = _parameter(
        0.03,
        "A pose turned this much from the motion prior competes with one refined from the prior.",
        unit="rad",
        minimum=0.0,
    )
    min_planes: int = _parameter(
        200, "Planes that must be seen for their agreement to count.", minimum=1
    )
    min_pixels: int = _parameter(
        200, "Textured pixels that must be seen for their correlation to count.", minimum=1
    )
    plane_agreement: float = _parameter(
        0.5,
        "A pose is believed when at least this part of the planes seen agrees with it; it is "
        "refused, whatever the pixels say, below half of this.",
        minimum=0.0,
        maximum=1.0,
    )
    pixel_correlation: float = _parameter(
        0.6,
        "A pose is believed when the brightness of model and image correlates at least this much "
        "and no plane contradicts.",
        minimum=-1.0,
        maximum=1.0,
    )
    timing_error: float = _parameter(
        0.015,
        "What shutter, exposure and stamps leave unknown about the time of an image; the "
        "covariance grows by the way travelled in it.",
        unit="s",
        minimum=0.0,
        maximum=1.0,
    )
    scale_error: float = _parameter(
        0.005,
        "Relative error of the camera's scale; the covariance grows by this part of the distance "
        "from the keyframe.",
        minimum=0.0,
        maximum=1.0,
    )
    recovery_attempts: int = _parameter(
        3,
        "Keyframes tried per frame when tracking fails; while the camera is lost, all in turn.",
        minimum=0,
        maximum=100,
    )
    recovery_inliers: int = _parameter(
        25, "Visual inliers that recovery needs: a wrong one is worse than none.", minimum=3
    )
    reset_countdown: int = _parameter(
        30,
        "Frames that show something and have no pose, after which a new keyframe starts at the "
        "last pose; 0 waits for ever.",
        minimum=0,
    )


@dataclass(frozen=True)
class Config:
    """Everything the registration and the odometry depend on."""

    seed: int = _parameter(0, "Seed of every random choice.", minimum=0)
    camera: CameraConfig = field(default_factory=CameraConfig)
    features: FeaturesConfig = field(default_factory=FeaturesConfig)
    glue: GlueConfig = field(default_factory=GlueConfig)
    ransac: RansacConfig = field(default_factory=RansacConfig)
    fit: FitConfig = field(default_factory=FitConfig)
    refine: RefineConfig = field(default_factory=RefineConfig)
    timing: TimingConfig = field(default_factory=TimingConfig)
    motion: MotionConfig = field(default_factory=MotionConfig)
    odometry: OdometryConfig = field(default_factory=OdometryConfig)


@dataclass(frozen=True)
class NodeConfig:
    """What the ROS node alone has: frames, topics, transport."""

    preset: str = _parameter(
        "live", "Preset that the other parameters start from.", choices=("live", "paper")
    )
    frame_id: str = _parameter(
        "",
        "Robot frame whose pose is published, as base_link; empty for the camera's optical frame.",
    )
    odom_frame_id: str = _parameter("odom", "Fixed frame that poses are given in.")
    camera_pose: str = _parameter(
        "",
        "Pose of the camera in frame_id: 'x y z roll pitch yaw' (m, rad) or 'x y z qx qy qz qw'. "
        "Empty, it is looked up on TF once it is there.",
    )
    camera_axes: str = _parameter(
        "body",
        "Axes of the camera that camera_pose is given for: body has x forward, y left, z up (the "
        "camera_link of most drivers), optical has x right, y down, z forward. Without frame_id, "
        "odom starts with these axes at the camera.",
        choices=("body", "optical"),
    )
    publish_tf: bool = _parameter(
        True,
        "Whether odom_frame_id -> frame_id is broadcast on /tf. Without frame_id nothing is: the "
        "optical frame has its parent from the driver.",
    )
    wait_for_transform: float = _parameter(
        0.1, "How long a frame waits for a transform on TF.", unit="s", minimum=0.0, maximum=10.0
    )
    guess_frame_id: str = _parameter(
        "",
        "Fixed frame of another odometry, as of wheels: the motion guess_frame_id -> frame_id on "
        "TF between two frames is where the search starts. What is broadcast is then "
        "odom_frame_id -> guess_frame_id, since frame_id has its parent. Empty for none.",
    )
    image_transport: str = _parameter(
        "raw", "Transport of the colour image.", choices=("raw", "compressed")
    )
    depth_transport: str = _parameter(
        "raw", "Transport of the depth image.", choices=("raw", "compressedDepth")
    )
    depth_is_registered: bool = _parameter(
        False,
        "Depth is registered to colour whatever its frame says, and depth/camera_info of no "
        "interest. Without it, depth in another frame than colour is registered here or refused.",
    )
    depth_camera_pose: str = _parameter(
        "",
        "Pose of the depth camera in the colour camera, for depth that is not registered: "
        "'x y z roll pitch yaw' (m, rad) or 'x y z qx qy qz qw', between the optical frames.",
    )
    qos: int = _parameter(
        0,
        "Reliability of the image subscriptions: 0 as the publisher offers, 1 reliable, 2 best "
        "effort.",
        minimum=0,
        maximum=2,
    )
    qos_camera_info: int = _parameter(0, "The same for the camera info.", minimum=0, maximum=2)
    topic_queue_size: int = _parameter(
        10, "Messages of a topic that wait for the node, at most.", minimum=1, maximum=1000
    )
    sync_queue_size: int = _parameter(
        10, "Messages of a topic that wait for their partners, at most.", minimum=1, maximum=1000
    )
    approx_sync: bool = _parameter(
        True, "Whether stamps of colour and depth may differ; without it only equal ones pair."
    )
    approx_sync_max_interval: float = _parameter(
        0.02,
        "Stamps of colour and depth that are further apart than this do not belong together.",
        unit="s",
        minimum=0.0,
    )
    always_process_most_recent_frame: bool = _parameter(
        True,
        "Whether a frame that waits gives way to a newer one. Without it frames queue "
        "(sync_queue_size), and when the queue is full the subscriptions wait: nothing is dropped "
        "as long as topic_queue_size holds what comes meanwhile.",
    )
    max_update_rate: float = _parameter(
        0.0, "Frames that come faster than this are left out; 0 takes all.", unit="Hz", minimum=0.0
    )
    publish_null_when_lost: bool = _parameter(
        False,
        "Whether odom gets a message for a frame without a pose too: position, orientation "
        "quaternion and twist all zero, covariances 9999 on their diagonals, as rtabmap_odom does. "
        "Without it nothing is published for such a frame.",
    )
    path_poses: int = _parameter(
        1000,
        "Poses that path holds, at most; the oldest go. One is kept every path_period.",
        minimum=1,
        maximum=100000,
    )
    path_period: float = _parameter(
        0.5,
        "Time between poses of path, and between its messages, at least.",
        unit="s",
        minimum=0.0,
    )
    initial_pose: str = _parameter(
        "",
        "Pose in odom_frame_id that the odometry starts at, and starts anew at when it is reset: "
        "'x y z roll pitch yaw' (m, rad) or 'x y z qx qy qz qw'; empty for the origin.",
    )


USUAL_NAMES = {"reset_countdown": "odometry.reset_countdown"}
"""Names that users of rtabmap_odom know, and the parameters of the method that they stand for."""


FIXED = {
    "features": "the keyframes hold features of one kind",
    "timing": "what was learnt of the camera's times rests on it",
    "odometry.keyframes": "the room for keyframes is made at the start",
    "odometry.window": "the room for keyframes is made at the start",
    "odometry.keyframe_spacing": "the keyframes kept were chosen by it",
}
"""Parameters and sections of the method that cannot change while it runs, and why not."""

NODE_CHANGEABLE = ("max_update_rate", "publish_null_when_lost", "path_period", "initial_pose")
"""Parameters of the node that can change while it runs; ``initial_pose`` counts at a reset."""


def fixed_because(name: str) -> str | None:
    """Why a parameter (dotted name) cannot change while the node runs; None if it can."""
    if name in values(NodeConfig()):
        return None if name in NODE_CHANGEABLE else "it is read once, when the node starts"
    return FIXED.get(name) or FIXED.get(name.partition(".")[0])


def parameters(config: object, prefix: str = "") -> Iterator[Parameter]:
    """The declarations of all parameters of a configuration (class or instance), in order."""
    for item in fields(config):  # type: ignore[arg-type]
        if "parameter" in item.metadata:
            yield replace(item.metadata["parameter"], name=prefix + item.name)
        else:
            yield from parameters(_section_class(item), f"{prefix}{item.name}.")


def _section_class(item: Field[Any]) -> Any:
    return item.default_factory


def values(config: object) -> dict[str, Value]:
    """The dotted name and value of every parameter of a configuration, in order."""
    found: dict[str, Value] = {}
    for item in fields(config):  # type: ignore[arg-type]
        value = getattr(config, item.name)
        if is_dataclass(value):
            found.update({f"{item.name}.{name}": v for name, v in values(value).items()})
        else:
            found[item.name] = value
    return found


def with_values(config: C, changes: Mapping[str, object]) -> C:
    """The configuration with the parameters in ``changes`` (dotted names) set.

    Raises:
        InputError: an unknown name, or a value of the wrong type or out of range.
    """
    declared = {p.name: p for p in parameters(config)}
    converted = {}
    for name, value in changes.items():
        if name not in declared:
            raise unknown_parameter(name, declared)
        converted[name] = declared[name].convert(value)
    return _replaced(config, converted)


def unknown_parameter(name: str, declared: Iterable[str]) -> InputError:
    """The error of a name that is not declared; its remedy is the nearest name that is."""
    near = difflib.get_close_matches(name, declared, n=1, cutoff=0.4)
    hint = f"did you mean {near[0]}?" if near else "see `rgbd-glue params`"
    return InputError(name, "no such parameter", hint)


def _replaced(config: C, changes: Mapping[str, Value]) -> C:
    new: dict[str, Any] = {}
    for item in fields(config):  # type: ignore[arg-type]
        inside = {
            name.removeprefix(item.name + "."): value
            for name, value in changes.items()
            if name.startswith(item.name + ".")
        }
        if item.name in changes:
            new[item.name] = changes[item.name]
        elif inside:
            new[item.name] = _replaced(getattr(config, item.name), inside)
    return replace(config, **new)  # type: ignore[type-var]


def parse_assignment(text: str) -> tuple[str, object]:
    """``name=value`` as given to ``--set``; the value is read as YAML.

    Raises:
        InputError: there is no equals sign, or the value is not YAML.
    """
    name, equals, value = text.partition("=")
    if not equals or not name:
        raise InputError(f"--set {text}", "not of the form name=value", "as in --set glue.k=3")
    try:
        parsed = yaml.safe_load(value)
    except yaml.YAMLError as error:
        raise InputError(f"--set {text}", "the value is not YAML", "quote it") from error
    return name, "" if parsed is None else parsed


def share_directory() -> Path:
    """The folder that holds ``config/``, ``launch/`` and ``package.xml``: source tree or share.

    Raises:
        InputError: the package was copied without its data files.
    """
    here = Path(__file__).resolve()
    for parent in here.parents:
        for candidate in (parent, parent / "share" / PACKAGE):
            if (candidate / "package.xml").is_file() and (candidate / "config").is_dir():
                return candidate
    raise InputError(here.parent, "the package's data files are missing", "install it again")


def load_yaml(path: Path, base: C) -> C:
    """``base`` with the values of a ROS parameter file (``/**: ros__parameters: …``) set.

    Raises:
        InputError: the file cannot be read, is not such a file, or holds a bad value.
    """
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        reason = str(error).splitlines()[0]
        raise InputError(path, f"cannot be read ({reason})", "give a YAML file") from error
    try:
        ((_, node),) = content.items()
        tree = node["ros__parameters"]
        changes = dict(_flattened(tree))
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise InputError(
            path, "is no ROS parameter file", "it starts with '/**:' and 'ros__parameters:'"
        ) from error
    try:
        return with_values(base, changes)
    except InputError as error:
        raise InputError(f"{path}: {error.where}", error.cause, error.remedy) from error


def load_preset(name: str) -> Config:
    """The configuration of ``config/<name>.yaml``.

    Raises:
        InputError: there is no such preset.
    """
    folder = share_directory() / "config"
    path = folder / f"{name}.yaml"
    if not path.is_file():
        known = ", ".join(sorted(p.stem for p in folder.glob("*.yaml")))
        raise InputError(f"preset {name!r}", "does not exist", f"take one of {known}")
    return load_yaml(path, Config())


def _flattened(tree: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, object]]:
    for name, value in tree.items():
        if isinstance(value, Mapping):
            yield from _flattened(value, f"{prefix}{name}.")
        else:
            yield prefix + name, value


def to_yaml(config: object) -> str:
    """The configuration as a commented ROS parameter file, which ``load_yaml`` reads back."""
    lines = ["/**:", "  ros__parameters:"]
    current = values(config)
    sections: list[str] = []
    for parameter in parameters(config):
        *path, name = parameter.name.split(".")
        for depth, section in enumerate(path):
            if sections[: depth + 1] != path[: depth + 1]:
                lines.append("  " * (depth + 2) + f"{section}:")
        sections = path
        indent = "  " * (len(path) + 2)
        value = yaml.safe_dump(current[parameter.name], width=math.inf).splitlines()[0]
        lines.append(f"{indent}# {parameter.description} Takes {parameter.allowed}.")
        lines.append(f"{indent}{name}: {value}")
    return "\n".join(lines) + "\n"


def to_markdown(config: object) -> str:
    """The configuration as a Markdown table of all parameters."""
    current = values(config)
    rows = ["| parameter | value | unit | takes | meaning |", "|---|---|---|---|---|"]
    rows += [
        f"| `{p.name}` | `{current[p.name]}` | {p.unit} | {p.allowed} | {p.description} |"
        for p in parameters(config)
    ]
    return "\n".join(rows) + "\n"

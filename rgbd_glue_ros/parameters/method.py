"""The parameters of the method: what registration and odometry depend on."""

from __future__ import annotations

from dataclasses import dataclass

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.parameters.checks import K
from rgbd_glue_ros.parameters.odometry import OdometryConfig
from rgbd_glue_ros.parameters.parameter import parameter, section

LEARNED_VISUAL_FEATURES = (
    "alike",
    "alike_n",
    "xfeat",
    "aliked_lightglue",
    "disk_lightglue",
    "superpoint_lightglue",
    "superpoint_superglue",
    "lightglue",
)
VISUAL_FEATURES = ("none", "orb", "sift", "brisk", *LEARNED_VISUAL_FEATURES)
# K of equation 4 in the paper's experiments.
_K_LEARNED, _K_HAND_CRAFTED = 3.0, 5.0
DEVICES = ("auto", "cpu", "cuda")
FIT_METHODS = ("randomised", "procrustes", "ransac")
SC2_PCR = "sc2_pcr"
FALLBACK_METHODS = ("none", SC2_PCR)
GEOMETRIC_FEATURES = ("none", "fpfh", "fpfh_grid", "fcgf", "minispinnet")


@dataclass(frozen=True)
class CameraConfig:
    """How images are read."""

    depth_min: float = parameter(
        0.1, "Depth below this is taken as unknown.", unit="m", minimum=0.0, maximum=100.0
    )
    depth_max: float = parameter(
        8.0, "Depth above this is taken as unknown.", unit="m", minimum=0.1, maximum=1000.0
    )
    well_lit_gradient: float = parameter(
        20.0,
        "Steepness of edges in a well-lit image of 160 pixels. In the dark and in haze they are "
        "less steep, and grey-level limits shrink with them, as far as noise allows; 0 disables "
        "this.",
        unit="grey levels per pixel",
        minimum=0.0,
        maximum=255.0,
    )

    def __post_init__(self) -> None:
        """Refuses an empty range of depth.

        Raises:
            InputError: depth_min is not below depth_max.
        """
        if self.depth_min >= self.depth_max:
            raise InputError(
                "camera.depth_min",
                f"{self.depth_min:g} is not below camera.depth_max, {self.depth_max:g}",
                "leave room between them, for example 0.1 and 8",
            )


@dataclass(frozen=True)
class FeaturesConfig:
    """What is extracted from a frame."""

    visual: str = parameter(
        "orb", "Visual feature; none registers by geometry alone.", choices=VISUAL_FEATURES
    )
    geometric: str = parameter(
        "fpfh_grid",
        "Geometric feature; none registers by visual correspondences alone.",
        choices=GEOMETRIC_FEATURES,
    )
    keypoints: int = parameter(
        1000, "Visual keypoints kept per frame, at most.", minimum=10, maximum=20000
    )
    matcher_keypoints: int = parameter(
        1024,
        "Visual keypoints passed to a learned matcher, at most, however many may be kept; its time "
        "grows with their square.",
        minimum=10,
        maximum=20000,
    )
    ratio: float = parameter(
        0.8,
        "Lowe's ratio (equation 1): a visual match is kept if its nearest neighbour is nearer than "
        "this times the second nearest.",
        minimum=0.1,
        maximum=1.0,
    )
    voxel: float = parameter(
        0.025,
        "Edge of the voxels that thin the cloud for fpfh, fcgf and minispinnet.",
        unit="m",
        minimum=0.001,
        maximum=10.0,
    )
    geometric_matches: int = parameter(
        20000,
        "Geometric matches of fpfh and fcgf, at most: of a cloud with more points, this many, "
        "spread evenly, are matched to all of the other cloud.",
        minimum=100,
        maximum=1000000,
    )
    geometric_keypoints: int = parameter(
        1500,
        "Points that minispinnet describes, at most, spread evenly over the cloud; its time is "
        "proportional to them.",
        minimum=10,
        maximum=100000,
    )
    grid_step: int = parameter(
        12,
        "Spacing of the points of fpfh_grid in an image of 640x480 or less; larger ones get about "
        "as many.",
        unit="pixel",
        minimum=2,
        maximum=64,
    )
    device: str = parameter(
        "auto",
        "Where learned features are computed: auto uses a GPU if there is one.",
        choices=DEVICES,
    )
    weights: str = parameter(
        "",
        "Folder of the weights of learned features; empty for the one that 'rgbd-glue weights' "
        "fills.",
    )


@dataclass(frozen=True)
class GlueConfig:
    """Section 3 of the paper."""

    inlier_threshold: float = parameter(
        0.05,
        "t_in: RANSAC's inlier threshold on 3D distance.",
        unit="m",
        minimum=0.001,
        maximum=10.0,
    )
    k: float = parameter(
        0.0,
        "K of equation 4: matches within K t_in are assumed inliers. 0 takes the paper's: 3 if the "
        "visual feature is learned, 5 if it is hand-crafted.",
        minimum=0.0,
        maximum=100.0,
        check=K,
    )
    confidence: float = parameter(
        0.95,
        "Quantile of the chi-square distribution in equation 7.",
        minimum=0.5,
        maximum=0.9999,
    )
    min_visual: int = parameter(
        6,
        "The filter is skipped if equation 4 assumes fewer visual inliers than this; with fewer "
        "matches of both kinds there is no transform.",
        minimum=3,
        maximum=100000,
    )
    min_credible: int = parameter(
        10,
        "The filter is skipped if fewer geometric matches than this survive it.",
        minimum=3,
        maximum=100000,
    )
    over_chance: float = parameter(
        0.0,
        "The filter is skipped if fewer geometric matches survive it than this times those "
        "expected from random matches; 0 disables this. With a fallback, 2 detects most wrong "
        "transforms, but also correct ones of small clouds.",
        minimum=0.0,
        maximum=1000.0,
    )
    filter: bool = parameter(True, "Whether the consistency filter (equation 8) is applied at all.")
    fallback: str = parameter(
        "none",
        "Source of the rough transform if there are too few visual matches or almost no geometric "
        "match agrees: none skips the filter as in the paper, sc2_pcr finds one from the geometric "
        "matches.",
        choices=FALLBACK_METHODS,
    )


@dataclass(frozen=True)
class RansacConfig:
    """The rough transform from visual correspondences (section 3.2)."""

    iterations: int = parameter(1000, "Samples drawn, at most.", minimum=1, maximum=1000000)
    min_inliers: int = parameter(
        6,
        "A transform with fewer visual inliers than this is rejected.",
        minimum=3,
        maximum=100000,
    )


@dataclass(frozen=True)
class FitConfig:
    """The fit to all credible correspondences (section 3.3)."""

    method: str = parameter(
        "randomised",
        "Fit to the credible matches: randomised weighted Procrustes as in the paper, procrustes "
        "on all of them at once, or ransac.",
        choices=FIT_METHODS,
    )
    subsets: int = parameter(
        10, "Random subsets of the randomised weighted Procrustes.", minimum=1, maximum=10000
    )
    fraction: float = parameter(
        0.2, "Part of the matches in each random subset.", minimum=0.01, maximum=1.0
    )


@dataclass(frozen=True)
class RefineConfig:
    """The joint refinement after the fit, beyond the paper."""

    iterations: int = parameter(
        5,
        "Gauss-Newton steps at each level of the image pyramid, at most; 0 keeps the fit of the "
        "paper.",
        minimum=0,
        maximum=100,
    )
    grid_step: int = parameter(
        8,
        "Spacing of the planes in a keyframe of 640x480; images of other sizes get about as many.",
        unit="pixel",
        minimum=1,
        maximum=64,
    )
    plane_cauchy: float = parameter(
        2.0,
        "Plane distance, in its standard deviations, at which a plane's weight is halved.",
        minimum=0.01,
        maximum=1e6,
    )
    pixel_weight: float = parameter(
        10.0,
        "Weight of a photometric residual relative to a plane's, each divided by its standard "
        "deviation; up to twice as much in images smaller than 640x480, which have fewer of them; "
        "0 refines on planes alone.",
        minimum=0.0,
        maximum=1e6,
    )
    unregistered_weight: float = parameter(
        1.0,
        "pixel_weight, if this is less, once depth turns out not to be registered to colour: "
        "pixels then have the depth of other pixels.",
        minimum=0.0,
        maximum=1e6,
    )
    pixel_cauchy: float = parameter(
        2.0,
        "Photometric residual, in its standard deviations, at which a pixel's weight is halved.",
        minimum=0.01,
        maximum=1e6,
    )
    residuals_per_independent_one: float = parameter(
        1000.0,
        "Errors of neighbouring residuals are alike: this many count as one in the covariance.",
        minimum=1.0,
        maximum=1e9,
    )


@dataclass(frozen=True)
class TimeOffsetsConfig:
    """When depth and each row of an image are really taken; estimated while the camera moves.

    Both offsets are known for cameras whose frame is called openni… (Kinect v1, Xtion).
    """

    depth_latency: float = parameter(
        0.0,
        "How much later depth is stamped than colour of the same moment; a first guess, unless "
        "spread is 0.",
        unit="s",
        minimum=-0.05,
        maximum=0.05,
    )
    readout_time: float = parameter(
        0.0,
        "Time from the first row of an image to the last: 0 for a global shutter, negative if the "
        "last row is read first; a first guess, unless spread is 0.",
        unit="s",
        minimum=-0.05,
        maximum=0.05,
    )
    spread: float = parameter(
        0.02,
        "Standard deviation of these two first guesses; 0 keeps them fixed, for any camera.",
        unit="s",
        minimum=0.0,
        maximum=1.0,
    )
    drift: float = parameter(
        0.0001, "How much both may change from frame to frame.", unit="s", minimum=0.0, maximum=1.0
    )
    residuals_per_independent_one: float = parameter(
        1000.0,
        "Errors of neighbouring residuals are alike: this many count as one.",
        minimum=1.0,
        maximum=1e9,
    )


@dataclass(frozen=True)
class MotionConfig:
    """How the camera may move between frames."""

    acceleration: float = parameter(
        3.0,
        "Standard deviation of the camera's acceleration. Large values take every pose as the "
        "images give it.",
        unit="m/s²",
        minimum=0.01,
        maximum=1e6,
    )
    angular_acceleration: float = parameter(
        6.0,
        "Standard deviation of the camera's angular acceleration.",
        unit="rad/s²",
        minimum=0.01,
        maximum=1e6,
    )


@dataclass(frozen=True)
class Config:
    """Everything the registration and the odometry depend on."""

    seed: int = parameter(0, "Seed of every random choice.", minimum=0, maximum=2_000_000_000)
    camera: CameraConfig = section(CameraConfig)
    features: FeaturesConfig = section(
        FeaturesConfig, fixed="the keyframes hold features of one kind"
    )
    glue: GlueConfig = section(GlueConfig)
    ransac: RansacConfig = section(RansacConfig)
    fit: FitConfig = section(FitConfig)
    refine: RefineConfig = section(RefineConfig)
    time_offsets: TimeOffsetsConfig = section(
        TimeOffsetsConfig, fixed="the estimates of the camera's time offsets depend on it"
    )
    motion: MotionConfig = section(MotionConfig)
    odometry: OdometryConfig = section(OdometryConfig)

    @property
    def k(self) -> float:
        """K of equation 4: visual matches within K t_in of the rough transform are assumed inliers.

        This is the value in use: ``glue.k`` if it is not 0, otherwise the paper's, which is 3 if
        the visual feature is learned and 5 if it is hand-crafted.
        """
        is_learned = self.features.visual in LEARNED_VISUAL_FEATURES
        return self.glue.k or (_K_LEARNED if is_learned else _K_HAND_CRAFTED)

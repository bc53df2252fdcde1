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
_K_LEARNED, _K_HAND_CRAFTED = 3.0, 5.0
DEVICES = ("auto", "cpu", "cuda")
FIT_METHODS = ("randomised", "procrustes", "ransac")
FALLBACK_METHODS = ("none", "sc2_pcr")
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
        "How steep edges are in a well-lit image of 160 pixels. In the dark and in haze they are "
        "less, and limits on grey levels shrink with them, as far as noise lets; 0 leaves those.",
        unit="grey levels a pixel",
        minimum=0.0,
        maximum=255.0,
    )

    def __post_init__(self) -> None:
        """Refuses a range that holds nothing.

        Raises:
            InputError: it does.
        """
        if self.depth_min >= self.depth_max:
            raise InputError(
                "camera.depth_min",
                f"{self.depth_min:g} is not below camera.depth_max, {self.depth_max:g}",
                "leave room between them, as 0.1 and 8",
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
        "Visual keypoints that a learned matcher is given, at most, however many may be kept; its "
        "time grows with their square.",
        minimum=10,
        maximum=20000,
    )
    ratio: float = parameter(
        0.8,
        "Lowe's ratio (equation 1): a visual match is kept when its nearest neighbour is nearer "
        "than this times the second nearest.",
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
        "Geometric matches of fpfh and fcgf, at most: of a cloud with more points than this, as "
        "many are matched, spread evenly, to all of the other cloud.",
        minimum=100,
        maximum=1000000,
    )
    geometric_keypoints: int = parameter(
        1500,
        "Points that minispinnet describes, at most, spread evenly over the cloud; its time grows "
        "with them.",
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
        "Where learned features are computed: auto takes a GPU where there is one.",
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
        "K of equation 4: matches within K t_in are assumed inliers. 0 takes the paper's: 3 where "
        "the visual feature is learned, 5 where it is hand-crafted.",
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
        "The filter is skipped when equation 4 assumes fewer visual inliers than this.",
        minimum=3,
        maximum=100000,
    )
    min_credible: int = parameter(
        10,
        "The filter is skipped when fewer geometric matches than this survive it.",
        minimum=3,
        maximum=100000,
    )
    over_chance: float = parameter(
        0.0,
        "The filter is skipped when fewer geometric matches survive it than this times those that "
        "would had points been matched at random; 0 does not ask. With a fallback, 2 tells most "
        "wrong transforms, but also right ones of small clouds.",
        minimum=0.0,
        maximum=1000.0,
    )
    filter: bool = parameter(True, "Whether the consistency filter (equation 8) is applied at all.")
    fallback: str = parameter(
        "none",
        "What gives the rough transform where visual matches are too few for it or almost no "
        "geometric match agrees: none skips the filter as in the paper, sc2_pcr finds one from the "
        "geometric matches.",
        choices=FALLBACK_METHODS,
    )


@dataclass(frozen=True)
class RansacConfig:
    """The rough transform from visual correspondences (section 3.2)."""

    iterations: int = parameter(1000, "Samples drawn, at most.", minimum=1, maximum=1000000)
    min_inliers: int = parameter(
        6,
        "A transform that fewer visual matches than this agree with is not believed.",
        minimum=3,
        maximum=100000,
    )


@dataclass(frozen=True)
class FitConfig:
    """The fit to all credible correspondences (section 3.3)."""

    method: str = parameter(
        "randomised",
        "Fit to the credible matches: randomised weighted Procrustes as in the paper, procrustes "
        "of all of them at once, or ransac.",
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
        "Gauss-Newton steps at each level of the image pyramid, at most; 0 leaves the fit of the "
        "paper as it is.",
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
        "Weight of a photometric residual against a plane's, both by their standard deviations; 0 "
        "refines on planes alone.",
        minimum=0.0,
        maximum=1e6,
    )
    unregistered_weight: float = parameter(
        1.0,
        "The same where depth turns out not to be registered to colour, if that is less: the depth "
        "of a pixel is then that of another one.",
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
        "Neighbouring residuals err alike: this many of them count as one in the covariance.",
        minimum=1.0,
        maximum=1e9,
    )


@dataclass(frozen=True)
class TimeOffsetsConfig:
    """When depth and each row of an image are really taken; estimated while the camera moves.

    Of cameras whose frame is called openni… (Kinect v1, Xtion) both offsets are known.
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
        "From the first row of an image to the last: 0 for a global shutter, negative where the "
        "last row is read first; a first guess, unless spread is 0.",
        unit="s",
        minimum=-0.05,
        maximum=0.05,
    )
    spread: float = parameter(
        0.01,
        "Standard deviation of these two first guesses; 0 keeps them as they are, for any camera.",
        unit="s",
        minimum=0.0,
        maximum=1.0,
    )
    drift: float = parameter(
        0.0001, "How much they may change from frame to frame.", unit="s", minimum=0.0, maximum=1.0
    )
    residuals_per_independent_one: float = parameter(
        1000.0,
        "Neighbouring residuals err alike: this many of them count as one.",
        minimum=1.0,
        maximum=1e9,
    )


@dataclass(frozen=True)
class MotionConfig:
    """How the camera may move between frames."""

    acceleration: float = parameter(
        3.0,
        "Standard deviation of the camera's acceleration. Great values take every pose as the "
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
        TimeOffsetsConfig, fixed="what was learnt of the camera's time offsets rests on it"
    )
    motion: MotionConfig = section(MotionConfig)
    odometry: OdometryConfig = section(OdometryConfig)

    @property
    def k(self) -> float:
        """K of equation 4: what ``glue.k`` says, or the paper's for the visual feature."""
        is_learned = self.features.visual in LEARNED_VISUAL_FEATURES
        return self.glue.k or (_K_LEARNED if is_learned else _K_HAND_CRAFTED)

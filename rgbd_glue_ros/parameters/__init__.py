"""Every parameter, declared once: type, default, unit, range and meaning.

The YAML files in ``config/``, the command line, the ROS parameters and the tables in ``docs/`` are
generated from these declarations or checked against them.
"""

from __future__ import annotations

from rgbd_glue_ros.parameters.aliases import OLD_NAMES, USUAL_NAMES, by_current_names
from rgbd_glue_ros.parameters.checks import POSE
from rgbd_glue_ros.parameters.files import (
    explain,
    load_preset,
    load_yaml,
    parameter_values,
    parse_assignment,
    to_markdown,
    to_yaml,
)
from rgbd_glue_ros.parameters.inputs import (
    HEADER,
    READ_ONCE,
    RECEIPT,
    InputConfig,
    metres_per_unit,
)
from rgbd_glue_ros.parameters.method import (
    FALLBACK_METHODS,
    FIT_METHODS,
    GEOMETRIC_FEATURES,
    LEARNED_VISUAL_FEATURES,
    SC2_PCR,
    VISUAL_FEATURES,
    CameraConfig,
    Config,
    FeaturesConfig,
    FitConfig,
    GlueConfig,
    MotionConfig,
    RansacConfig,
    RefineConfig,
    TimeOffsetsConfig,
)
from rgbd_glue_ros.parameters.node import NodeConfig
from rgbd_glue_ros.parameters.odometry import OdometryConfig
from rgbd_glue_ros.parameters.package_data import (
    PACKAGE,
    PROFILES_VARIABLE,
    profiles_file,
    share_directory,
)
from rgbd_glue_ros.parameters.parameter import (
    Parameter,
    Value,
    add_choice,
    check_changes,
    parameters,
    unknown_parameter,
    values,
    with_values,
)

__all__ = [
    "FALLBACK_METHODS",
    "FIT_METHODS",
    "GEOMETRIC_FEATURES",
    "HEADER",
    "LEARNED_VISUAL_FEATURES",
    "OLD_NAMES",
    "PACKAGE",
    "POSE",
    "PROFILES_VARIABLE",
    "READ_ONCE",
    "RECEIPT",
    "SC2_PCR",
    "USUAL_NAMES",
    "VISUAL_FEATURES",
    "CameraConfig",
    "Config",
    "FeaturesConfig",
    "FitConfig",
    "GlueConfig",
    "InputConfig",
    "MotionConfig",
    "NodeConfig",
    "OdometryConfig",
    "Parameter",
    "RansacConfig",
    "RefineConfig",
    "TimeOffsetsConfig",
    "Value",
    "add_choice",
    "by_current_names",
    "check_changes",
    "explain",
    "load_preset",
    "load_yaml",
    "metres_per_unit",
    "parameter_values",
    "parameters",
    "parse_assignment",
    "profiles_file",
    "share_directory",
    "to_markdown",
    "to_yaml",
    "unknown_parameter",
    "values",
    "with_values",
]

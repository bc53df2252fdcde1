"""The parameters of ``config`` as parameters of a ROS node."""

from __future__ import annotations

import sys

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.node import Node

from rgbd_glue_ros import config as cfg


def declare_parameters(node: Node) -> tuple[cfg.NodeConfig, cfg.Config]:
    """Declares all parameters with the values that the node's overrides give them.

    Overrides are read before the declaration, which would refuse an int where a double is
    declared, take a misspelt name for nothing, and know no preset below them.

    Raises:
        InputError: a parameter has a value that it cannot have.
    """
    # rclpy has no other way to them
    overrides = node._parameter_overrides  # noqa: SLF001
    given = {cfg.USUAL_NAMES.get(name, name): item.value for name, item in overrides.items()}
    own = {p.name: p for p in cfg.parameters(cfg.NodeConfig())}
    method = {p.name: p for p in cfg.parameters(cfg.Config())}
    node_config = cfg.with_values(
        cfg.NodeConfig(), {name: value for name, value in given.items() if name in own}
    )
    odometry_config = cfg.with_values(
        cfg.load_preset(node_config.preset),
        {name: value for name, value in given.items() if name in method},
    )
    resolved = {**cfg.values(node_config), **cfg.values(odometry_config)}
    for parameter in [*own.values(), *method.values()]:
        node.declare_parameter(
            parameter.name,
            resolved[parameter.name],
            _descriptor(parameter),
            ignore_override=True,
        )
    for name in given:
        # rclpy declares some by itself, as use_sim_time
        if not node.has_parameter(name):
            node.get_logger().error(str(cfg.unknown_parameter(name, resolved)))
    return node_config, odometry_config


def _descriptor(parameter: cfg.Parameter) -> ParameterDescriptor:
    """The declaration of a parameter, as ROS tells it; all are read once, at the start."""
    descriptor = ParameterDescriptor(
        name=parameter.name,
        description=parameter.description,
        additional_constraints=f"Takes {parameter.allowed}.",
        read_only=True,
    )
    low, high = parameter.minimum, parameter.maximum
    if parameter.type is int and (low, high) != (None, None):
        descriptor.integer_range = [
            IntegerRange(
                from_value=-(2**63) if low is None else int(low),
                to_value=2**63 - 1 if high is None else int(high),
            )
        ]
    elif parameter.type is float and (low, high) != (None, None):
        descriptor.floating_point_range = [
            FloatingPointRange(
                from_value=-sys.float_info.max if low is None else float(low),
                to_value=sys.float_info.max if high is None else float(high),
            )
        ]
    return descriptor

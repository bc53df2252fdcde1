"""The package's parameters as parameters of a ROS node."""

from __future__ import annotations

from collections.abc import Callable, Container, Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.exceptions import ParameterNotDeclaredException
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter

from rgbd_glue_ros import parameters as cfg
from rgbd_glue_ros.errors import InputError

NO_CAMERA: Mapping[str, cfg.Value] = MappingProxyType({})
"""The values of no camera preset."""


def declare_parameters(
    node: Node, camera: Mapping[str, cfg.Value], changeable: Container[str] | None = None
) -> tuple[cfg.NodeConfig, cfg.Config]:
    """Declares all parameters, with the values of the presets and the node's overrides.

    Overrides are read before the declaration: rclpy would refuse an int for a double, ignore a
    misspelt name, and knows no presets.

    Args:
        node: the node that declares them.
        camera: values of a camera preset, which the node's overrides replace.
        changeable: names of the only parameters that may change while the node runs; None for all
            whose definition allows it.

    Raises:
        InputError: a parameter has an invalid value, or there is no such parameter.
    """
    # rclpy has no public access to them
    overrides = node._parameter_overrides  # noqa: SLF001
    given = {
        **camera,
        **cfg.by_current_names({name: item.value for name, item in overrides.items()}),
    }
    own = {p.name: p for p in cfg.parameters(cfg.NodeConfig())}
    method = {p.name: p for p in cfg.parameters(cfg.Config())}
    node_config = cfg.with_values(
        _defaults(node.get_namespace()),
        {name: value for name, value in given.items() if name in own},
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
            _descriptor(parameter, _why_fixed(parameter, changeable)),
            ignore_override=True,
        )
    for name in given:
        # rclpy declares some itself: use_sim_time, and qos_overrides with a topic's publisher
        if not node.has_parameter(name) and not name.startswith("qos_overrides."):
            raise cfg.unknown_parameter(name, resolved)
    return node_config, odometry_config


def _defaults(namespace: str) -> cfg.NodeConfig:
    """The defaults of a node in a namespace, which is in the names of the files that it writes.

    Otherwise robots with the same home folder would overwrite each other's.
    """
    defaults = cfg.NodeConfig()
    return replace(
        defaults,
        graph_file=_with_namespace(defaults.graph_file, namespace),
        save_map_file=_with_namespace(defaults.save_map_file, namespace),
    )


def _with_namespace(file: str, namespace: str) -> str:
    path = Path(file)
    return str(path.with_stem("_".join([path.stem, *filter(None, namespace.split("/"))])))


def follow_changes(
    node: Node,
    node_config: cfg.NodeConfig,
    config: cfg.Config,
    changed: Callable[[cfg.NodeConfig, cfg.Config], None],
    changeable: Container[str] | None = None,
) -> None:
    """Accepts changes of live parameters while the node runs; refuses others with the reason.

    Args:
        node: the node whose parameters ``declare_parameters`` has declared.
        node_config: current values of the node's parameters.
        config: current values of the method's parameters.
        changed: called with all values after some have changed.
        changeable: as for ``declare_parameters``.
    """
    changes = _Changes(node_config, config, changed, changeable)
    declared = [*cfg.values(node_config), *cfg.values(config)]

    def complete(parameters: list[RosParameter]) -> list[RosParameter]:
        for name in (p.name for p in parameters):
            if not node.has_parameter(name):
                raise _UnknownError(str(cfg.unknown_parameter(name, declared)))
        return [_as_declared(p, node.get_parameter(p.name)) for p in parameters]

    def say(parameters: list[RosParameter]) -> None:
        said = ", ".join(f"{p.name}: {p.value}" for p in parameters)
        node.get_logger().info(f"Changed: {said}")

    node.add_pre_set_parameters_callback(complete)
    node.add_on_set_parameters_callback(changes.check)
    node.add_post_set_parameters_callback(changes.take)
    node.add_post_set_parameters_callback(say)


class _UnknownError(ParameterNotDeclaredException):  # type: ignore[misc]
    """What rclpy's services answer with, but for its text, which does not name the parameter."""

    def __init__(self, text: str) -> None:
        super().__init__([])
        self._text = text

    def __str__(self) -> str:
        return self._text


def _as_declared(given: RosParameter, declared: RosParameter) -> RosParameter:
    """A given parameter, with a whole number as a float where that is meant."""
    types = given.type_, declared.type_
    if types == (RosParameter.Type.INTEGER, RosParameter.Type.DOUBLE):
        return RosParameter(given.name, RosParameter.Type.DOUBLE, float(given.value))
    return given


class _Changes:
    """The current values, and the callbacks that check and apply new ones."""

    def __init__(
        self,
        node_config: cfg.NodeConfig,
        config: cfg.Config,
        changed: Callable[[cfg.NodeConfig, cfg.Config], None],
        changeable: Container[str] | None,
    ) -> None:
        self._node_config = node_config
        self._config = config
        self._changed = changed
        self._fixed = {
            p.name: _why_fixed(p, changeable)
            for part in (node_config, config)
            for p in cfg.parameters(part)
        }

    def check(self, parameters: list[RosParameter]) -> SetParametersResult:
        """Whether all these parameters may take these values while the node runs."""
        for name in (p.name for p in parameters):
            if self._fixed.get(name):
                return SetParametersResult(
                    successful=False,
                    reason=f"{name} cannot change while the node runs: {self._fixed[name]}",
                )
        try:
            self._with(parameters)
        except InputError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def take(self, parameters: list[RosParameter]) -> None:
        """Applies these values, and passes all values on."""
        if any(p.name in self._fixed for p in parameters):
            self._node_config, self._config = self._with(parameters)
            self._changed(self._node_config, self._config)

    def _with(self, parameters: list[RosParameter]) -> tuple[cfg.NodeConfig, cfg.Config]:
        return (
            cfg.with_values(self._node_config, _values_for(self._node_config, parameters)),
            cfg.with_values(self._config, _values_for(self._config, parameters)),
        )


def _values_for(
    part: cfg.NodeConfig | cfg.Config, parameters: list[RosParameter]
) -> dict[str, object]:
    """The values of those parameters that ``part`` declares; ROS adds some of its own."""
    names = cfg.values(part)
    return {p.name: p.value for p in parameters if p.name in names}


def _why_fixed(parameter: cfg.Parameter, changeable: Container[str] | None) -> str:
    """Why a parameter cannot change while the node runs; "" if it can."""
    if changeable is None or parameter.name in changeable:
        return parameter.fixed
    return parameter.fixed or cfg.READ_ONCE


def _descriptor(parameter: cfg.Parameter, fixed: str) -> ParameterDescriptor:
    """The ROS descriptor of a parameter; ``fixed`` says why it cannot change, if it cannot."""
    descriptor = ParameterDescriptor(
        name=parameter.name,
        description=parameter.description,
        # another type is refused with the reason too
        dynamic_typing=True,
        # not read_only, with which ROS would refuse without giving the reason
        additional_constraints=f"Takes {parameter.allowed}."
        + (f" Cannot change while the node runs: {fixed}." if fixed else ""),
    )
    low, high = parameter.minimum, parameter.maximum
    # for an open range, tools would show a slider up to 1.8e308
    if low is not None and high is not None:
        if parameter.type is int:
            descriptor.integer_range = [IntegerRange(from_value=int(low), to_value=int(high))]
        else:
            descriptor.floating_point_range = [
                FloatingPointRange(from_value=float(low), to_value=float(high))
            ]
    return descriptor

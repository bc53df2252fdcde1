"""What the launch file uses of launch and launch_ros, which only ROS from apt has.

Names, arguments and refusals are those of the real ones; nothing is started.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import ModuleType
from typing import Any

import yaml


@dataclass
class LaunchContext:
    """The arguments of a launch, by name."""

    launch_configurations: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class LaunchConfiguration:
    """An argument's value, once there is a context."""

    variable_name: str

    def perform(self, context: LaunchContext) -> str:
        return context.launch_configurations[self.variable_name]


@dataclass(frozen=True)
class EnvironmentVariable:
    """The value of a variable of the environment."""

    name: str
    default_value: str | None = None


@dataclass(frozen=True)
class DeclareLaunchArgument:
    """An argument, with its default and the values it may have."""

    name: str
    default_value: str | None = None
    description: str | None = None
    choices: Sequence[str] | None = None

    def __post_init__(self) -> None:
        for value in (self.name, self.default_value or "", *(self.choices or [])):
            if not isinstance(value, str):
                raise TypeError(f"{self.name}: {value!r} is not text")

    def execute(self, context: LaunchContext) -> None:
        if self.name not in context.launch_configurations:
            if self.default_value is None:
                raise RuntimeError(f"{self.name} is required")
            context.launch_configurations[self.name] = self.default_value
        value = context.launch_configurations[self.name]
        if self.choices is not None and value not in self.choices:
            raise RuntimeError(f"{self.name}: {value!r} is none of {self.choices}")


@dataclass(frozen=True)
class SetEnvironmentVariable:
    """A variable for all that is started after it."""

    name: str
    value: str | EnvironmentVariable


@dataclass(frozen=True, kw_only=True)
class ExecuteProcess:
    """A program that is started."""

    cmd: Sequence[str]
    output: str = "log"


@dataclass(frozen=True, kw_only=True)
class OpaqueFunction:
    """What a function returns for a context."""

    function: Callable[[LaunchContext], Sequence[Any]]


@dataclass(frozen=True)
class LaunchDescription:
    """What is launched."""

    entities: Sequence[Any]

    def get_launch_arguments(self) -> list[DeclareLaunchArgument]:
        return [entity for entity in self.entities if isinstance(entity, DeclareLaunchArgument)]


@dataclass(frozen=True)
class ParameterValue:
    """A parameter that is given as text."""

    value: str
    value_type: type

    def evaluate(self, context: LaunchContext) -> object:
        value = self.value if self.value_type is str else yaml.safe_load(self.value)
        if self.value_type is float and isinstance(value, int):
            value = float(value)
        if type(value) is not self.value_type:
            raise ValueError(f"{self.value!r} is not of {self.value_type}")
        return value


@dataclass(frozen=True, kw_only=True)
class Node:
    """A node of a package."""

    executable: str
    package: str
    namespace: str = ""
    parameters: Sequence[str | Mapping[str, Any]] = ()
    remappings: Sequence[tuple[str, str]] = ()
    arguments: Sequence[str] = ()
    output: str = "log"

    def __post_init__(self) -> None:
        if {} in self.parameters:
            raise ValueError("ROS refuses a file without parameters")
        if not all(isinstance(part, (str, Mapping)) for part in self.parameters):
            raise TypeError("parameters are files and mappings")

    @property
    def node_package(self) -> str:
        return self.package

    @property
    def node_executable(self) -> str:
        return self.executable


def modules() -> dict[str, ModuleType]:
    """The modules by their names, for ``sys.modules``."""
    contents: dict[str, tuple[Any, ...]] = {
        "launch": (LaunchContext, LaunchDescription),
        "launch.actions": (
            DeclareLaunchArgument,
            ExecuteProcess,
            OpaqueFunction,
            SetEnvironmentVariable,
        ),
        "launch.substitutions": (EnvironmentVariable, LaunchConfiguration),
        "launch_ros": (),
        "launch_ros.actions": (Node,),
        "launch_ros.parameter_descriptions": (ParameterValue,),
    }
    made = {name: ModuleType(name) for name in contents}
    for name, members in contents.items():
        vars(made[name]).update({member.__name__: member for member in members})
        parent, _, child = name.rpartition(".")
        if parent:
            setattr(made[parent], child, made[name])
    return made

"""Parameters in files and on the command line: YAML, presets, ``name=value``, Markdown."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, TypeVar

import yaml

from rgbd_glue_ros.errors import InputError, located_in
from rgbd_glue_ros.files.bounded_yaml import document
from rgbd_glue_ros.files.reading import read_text
from rgbd_glue_ros.parameters.aliases import current_name
from rgbd_glue_ros.parameters.method import Config
from rgbd_glue_ros.parameters.node import NodeConfig
from rgbd_glue_ros.parameters.package_data import share_directory
from rgbd_glue_ros.parameters.parameter import parameters, unknown_parameter, values, with_values

C = TypeVar("C")


def parse_assignment(text: str) -> tuple[str, object]:
    """``name=value`` as given to ``--set``; the value is read as YAML.

    Raises:
        InputError: there is no equals sign, or the value is not YAML.
    """
    name, equals, value = text.partition("=")
    if not equals or not name:
        raise InputError(f"--set {text}", "not of the form name=value", "as in --set glue.k=3")
    try:
        parsed = document(value)
    except yaml.YAMLError as error:
        raise InputError(f"--set {text}", "the value is not YAML", "quote it") from error
    return name, "" if parsed is None else parsed


def load_yaml(path: str | Path, base: C) -> C:
    """``base`` with the values of a ROS parameter file (``/**: ros__parameters: …``) set.

    A file may contain parameters of both method and node: those not in ``base`` are ignored.

    Raises:
        InputError: the file cannot be read, is not such a file, or holds a bad value.
    """
    changes = parameter_values(path)
    of_others = {*values(Config()), *values(NodeConfig())} - {*values(base)}
    with located_in(path):
        return with_values(base, {k: v for k, v in changes.items() if k not in of_others})


def parameter_values(path: str | Path) -> dict[str, object]:
    """The values in a ROS parameter file by their dotted names, whatever version wrote it.

    Raises:
        InputError: the file cannot be read, or is not such a file.
    """
    try:
        content = document(read_text(Path(path)))
    except yaml.YAMLError as error:
        reason = str(error).splitlines()[0]
        raise InputError(path, f"cannot be read ({reason})", "give a YAML file") from error
    try:
        ((_, node),) = content.items()
        return dict(_flattened(node["ros__parameters"]))
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise InputError(
            path, "is not a ROS parameter file", "it starts with '/**:' and 'ros__parameters:'"
        ) from error


def load_preset(name: str) -> Config:
    """The configuration of ``config/<name>.yaml``.

    Raises:
        InputError: there is no such preset.
    """
    folder = share_directory() / "config"
    path = folder / f"{name}.yaml"
    if not path.is_file():
        known = ", ".join(sorted(p.stem for p in folder.glob("*.yaml")))
        raise InputError(f"preset {name!r}", "does not exist", f"use one of {known}")
    return load_yaml(path, Config())


def _flattened(tree: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, object]]:
    for name, value in tree.items():
        if isinstance(value, Mapping):
            yield from _flattened(value, f"{prefix}{name}.")
        else:
            yield prefix + name, value


def to_yaml(*configs: object) -> str:
    """Configurations as one commented ROS parameter file, which ``load_yaml`` reads back."""
    lines = [line for config in configs for line in _yaml_lines(config)]
    return "\n".join(["/**:", "  ros__parameters:", *lines]) + "\n"


def _yaml_lines(config: object) -> Iterator[str]:
    current = values(config)
    sections: list[str] = []
    for parameter in parameters(config):
        *path, name = parameter.name.split(".")
        for depth, section in enumerate(path):
            if sections[: depth + 1] != path[: depth + 1]:
                yield "  " * (depth + 2) + f"{section}:"
        sections = path
        indent = "  " * (len(path) + 2)
        value = _scalar(current[parameter.name])
        yield f"{indent}# {parameter.description} Takes {parameter.allowed}."
        yield f"{indent}{name}: {value}"


def to_markdown(config: object) -> str:
    """The configuration as a Markdown table of all parameters; *live*: while the node runs."""
    current = values(config)
    rows = ["| parameter | value | takes | live | meaning |", "|---|---|---|---|---|"]
    rows += [
        f"| `{p.name}` | `{current[p.name]}` | {p.allowed} | {'' if p.fixed else 'yes'} | "
        f"{p.description} |"
        for p in parameters(config)
    ]
    return "\n".join(rows) + "\n"


def explain(name: str, config: Config) -> str:
    """Describes a parameter, or all in a section, in a paragraph each.

    Args:
        name: of a parameter of the method or the node, or of a section such as ``glue``; or an
            alias.
        config: has the values of the method's parameters.

    Raises:
        InputError: no parameter or section has this name.
    """
    name = current_name(name)
    current = {**values(config), **values(NodeConfig())}
    declared = {p.name: p for part in (Config(), NodeConfig()) for p in parameters(part)}
    chosen = [p for p in declared.values() if name == p.name or p.name.startswith(f"{name}.")]
    if not chosen:
        raise unknown_parameter(name, declared)
    paragraphs = []
    for parameter in chosen:
        fixed = parameter.fixed
        paragraphs.append(
            f"{parameter.name}: {_scalar(current[parameter.name])}\n"
            f"  {parameter.description}\n"
            f"  Takes {parameter.allowed}; {_scalar(parameter.default)} unless a preset or you say "
            "otherwise.\n"
            f"  While the node runs it {f'cannot change: {fixed}' if fixed else 'can change'}.\n"
        )
    return "\n".join(paragraphs)


def _scalar(value: object) -> str:
    """A value in YAML notation."""
    return yaml.safe_dump(value, width=math.inf).splitlines()[0]

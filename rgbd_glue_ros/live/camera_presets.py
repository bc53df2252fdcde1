"""Camera presets (``config/cameras/``): the topics of their drivers, and parameters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import yaml

from rgbd_glue_ros import parameters as cfg
from rgbd_glue_ros.errors import InputError, located_in
from rgbd_glue_ros.files.bounded_yaml import document
from rgbd_glue_ros.files.reading import read_text
from rgbd_glue_ros.live import topics
from rgbd_glue_ros.messages.synchronizer import Channel

TOPIC_ARGUMENTS = {
    "color": topics.SUBSCRIBED[Channel.COLOR],
    "depth": topics.SUBSCRIBED[Channel.DEPTH],
    "camera_info": topics.SUBSCRIBED[Channel.INFO],
    "depth_camera_info": topics.DEPTH_INFO,
    "imu": topics.IMU,
}
"""Names of the topics in presets and the launch file -> their names in the node."""

_PARTS = frozenset({"topics", "parameters"})


@dataclass(frozen=True)
class Camera:
    """A camera and its driver.

    Attributes:
        topics: the driver's topics by the names in TOPIC_ARGUMENTS, without the transport.
        parameters: values of node parameters, by their dotted names.
    """

    topics: Mapping[str, str]
    parameters: Mapping[str, cfg.Value]


def camera_names() -> list[str]:
    """The names of all presets."""
    folder = cfg.share_directory() / "config" / "cameras"
    return sorted(path.stem for path in folder.glob("*.yaml"))


def load_camera(name: str) -> Camera:
    """Loads a preset by its name, or from a file (``.yaml``).

    Raises:
        InputError: there is no such preset, or the file is not a valid one.
    """
    path = Path(name)
    if path.suffix not in (".yaml", ".yml"):
        names = camera_names()
        if name not in names:
            raise InputError(
                f"camera {name!r}",
                "is not known",
                f"{_suggestion(name, names)}use one of {', '.join(names)}, or a file",
            )
        path = cfg.share_directory() / "config" / "cameras" / f"{name}.yaml"
    content = _content(path)
    unknown = set(content["topics"]) - set(TOPIC_ARGUMENTS)
    if unknown:
        raise InputError(path, f"no such topics: {unknown}", f"use {', '.join(TOPIC_ARGUMENTS)}")
    declared = {p.name: p for part in (cfg.NodeConfig, cfg.Config) for p in cfg.parameters(part())}
    parameters = {}
    with located_in(path):
        for parameter, value in cfg.by_current_names(content["parameters"]).items():
            if parameter not in declared:
                raise cfg.unknown_parameter(parameter, declared)
            parameters[parameter] = declared[parameter].convert(value)
    return Camera(content["topics"], parameters)


def _suggestion(name: str, names: list[str]) -> str:
    """Suggests presets with a similar name; "" if there is none."""
    near = [n for n in names if name and name.lower() in n] or get_close_matches(name, names)
    return f"did you mean {' or '.join(near)}? Otherwise " if near else ""


def _content(path: Path) -> dict[str, Any]:
    try:
        content = document(read_text(path))
        if not content.keys() & _PARTS or content.keys() - _PARTS:
            holds = ", ".join(map(str, content)) or "nothing"
            raise InputError(
                path,
                f"is not a camera preset, which has topics and parameters: it holds {holds}",
                "give a file like those in config/cameras; parameters alone are given by "
                "--ros-args --params-file",
            )
        return {part: {**content.get(part, {})} for part in _PARTS}
    except (yaml.YAMLError, AttributeError, TypeError) as error:
        raise InputError(
            path,
            f"is not a camera preset ({str(error).splitlines()[0]})",
            "give a file with topics and parameters, like those in config/cameras",
        ) from error


def remappings(camera: Camera | None, given: Mapping[str, str]) -> list[tuple[str, str]]:
    """The node's topics, and the names that they are remapped to.

    Args:
        camera: the preset whose topics are used; None for the node's own names.
        given: topics that override the preset's, by the names in TOPIC_ARGUMENTS; "" for none.
    """
    known = {**(camera.topics if camera else {}), **{k: v for k, v in given.items() if v}}
    return [(own, known[name]) for name, own in TOPIC_ARGUMENTS.items() if name in known]

"""The common part of commands that run a node: its arguments, and those of ROS."""

from __future__ import annotations

import argparse
import logging
import os
import sys
from collections.abc import Mapping
from importlib import import_module
from typing import TYPE_CHECKING, Any

from rgbd_glue_ros.cli import arguments
from rgbd_glue_ros.errors import MissingExtraError

if TYPE_CHECKING:
    from rgbd_glue_ros.live.camera_presets import Camera

_EPILOG = """\
ROS arguments, as for every node, follow --ros-args:
  -r rgb/image:=/camera/color    take a topic ({topics})
  -p NAME:=VALUE                 set a parameter (`rgbd-glue params`, `rgbd-glue params --node`)
  --params-file FILE             set those in a file

Parameters of this node that are often set:
{parameters}

For example:
  {example}
"""


def add_node_arguments(
    parser: argparse.ArgumentParser, topics: str, parameters: Mapping[str, str], example: str
) -> None:
    """A camera; ROS arguments are handled elsewhere.

    Args:
        parser: of the command.
        topics: that the node takes, for the help.
        parameters: those that are often set, with their meaning.
        example: of a command line.
    """
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    words = "[-h] [--debug] [--camera PRESET] [--ros-args ...]"
    executable = parser.prog.rpartition(" ")[2]
    parser.usage = (
        f"%(prog)s {words}\n"
        f"       {executable} {words}\n"
        f"       ros2 run rgbd_glue_ros {executable} {words}"
    )
    lines = "\n".join(f"  {name:<20} {meaning}" for name, meaning in parameters.items())
    parser.epilog = _EPILOG.format(topics=topics, parameters=lines, example=example)
    arguments.add_camera(parser, "topics and parameters of a camera, which ROS arguments override")


def run_node(args: argparse.Namespace, module: str) -> str:
    """Runs a node that takes a camera's images until SIGINT, SIGTERM or SIGHUP.

    Args:
        args: of the command.
        module: the node's; its ``main`` takes ROS arguments and the signals.
    """
    if not args.camera:
        return run_module(module, args.ros)
    from rgbd_glue_ros.live.camera_presets import load_camera

    camera = load_camera(args.camera)
    # of several values of a parameter, ROS takes one of another type than the last
    return run_module(module, ros_arguments(args.ros, camera), camera=camera.parameters)


def ros_arguments(given: list[str], camera: Camera) -> list[str]:
    """ROS arguments with the topics of a camera.

    Args:
        given: those of the command line, which override the camera's.
        camera: its preset.
    """
    from rgbd_glue_ros.live.camera_presets import remappings

    # of several remappings of a topic, the first counts
    mapped = [w for own, topic in remappings(camera, {}) for w in ("-r", f"{own}:={topic}")]
    return [*given, *mapped]


def run_module(module: str, ros: list[str], **options: Any) -> str:
    """Runs a node until SIGINT, SIGTERM or SIGHUP.

    Args:
        module: the node's; its ``main`` takes ROS arguments, the signals and the options.
        ros: ROS arguments.
        options: of the node.
    """
    from rgbd_glue_ros.live.end_signals import EndSignals
    from rgbd_glue_ros.live.heap import keep_freed_memory

    end_signals = EndSignals()
    keep_freed_memory()
    # ROS from PyPI does not set it, and without it rclpy finds no resources
    os.environ.setdefault("AMENT_PREFIX_PATH", sys.prefix)
    try:
        node = import_module(module)
    except ImportError as error:
        library = (error.name or "rclpy").split(".", maxsplit=1)[0]
        raise MissingExtraError(library, "ros", "the node") from error
    # the node has its own log
    logging.getLogger().handlers.clear()
    code = node.main(["--ros-args", *ros], end_signals, **options)
    if code:
        raise SystemExit(code)
    return ""

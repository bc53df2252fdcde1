"""The commands: a line here and a module of the same name, with two functions."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from importlib import import_module
from typing import Protocol, cast


class CommandModule(Protocol):
    """The interface of a command's module."""

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declares the command's arguments."""

    def run(self, args: argparse.Namespace) -> str:
        """Executes the command and returns what to print.

        Raises:
            InputError: the user can fix the problem.
            MissingExtraError: a library is not installed.
        """


@dataclass(frozen=True)
class Command:
    """A subcommand.

    Attributes:
        name: on the command line, and of the module in this folder.
        summary: one line for the help.
        is_ros_node: whether it also takes ROS arguments, in ``args.ros``.
    """

    name: str
    summary: str
    is_ros_node: bool = False

    @property
    def module(self) -> CommandModule:
        """Its module, loaded on first use."""
        return cast(CommandModule, import_module(f"{__package__}.{self.name}"))


COMMANDS = (
    Command("demo", "play the bundled bag, or a recording, to the node over DDS"),
    Command("odometry", "run the ROS node", is_ros_node=True),
    Command("mapping", "run the ROS node that closes loops of the odometry", is_ros_node=True),
    Command("watch", "show the odometry's pose and state as they come", is_ros_node=True),
    Command("play", "publish a recording on the topics of a camera", is_ros_node=True),
    Command("replay", "run the odometry over a recording"),
    Command("map", "close the loops of a recording and build a map"),
    Command("evaluate", "compare a trajectory with ground truth"),
    Command("compare", "say what differs between replays of a recording"),
    Command("convert", "convert a data set to a rosbag2, or a bag to a TUM RGB-D folder"),
    Command("pairs", "register pairs of frames as in the paper's experiments"),
    Command("fetch", "download public data sets"),
    Command("weights", "list, fetch and check the weights of learned features"),
    Command("bench", "measure speed and error and compare with others, in one run"),
    Command("params", "print parameters with unit, range and meaning"),
)

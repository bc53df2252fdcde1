"""Parses the command line; errors are reported in one line, after the help if nothing is given."""

from __future__ import annotations

import argparse
import difflib
import os
import re
import shlex
import sys
from collections.abc import Iterable, Sequence
from importlib import metadata
from typing import Any, NoReturn

from rgbd_glue_ros.cli.commands import COMMANDS
from rgbd_glue_ros.errors import BAD_INPUT
from rgbd_glue_ros.printable import printable

PROGRAM = "rgbd-glue"
_ROS_OPTIONS = ("-p", "--param", "-r", "--remap", "--params-file", "--log-level", "--enclave")
_ROS_PARAMETER = re.compile(r"\w[\w.]*:=")


class Parser(argparse.ArgumentParser):
    """Suggests a correction for an unknown word; argparse prints the usage instead."""

    def error(self, message: str) -> NoReturn:
        """Ends the process with one line."""
        text = printable(f"{PROGRAM}: {message}; see {self.prog} --help")
        self.exit(BAD_INPUT, f"{text}\n")

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """As in argparse, but an unknown word is an error of the command that it is given to.

        argparse would report it from the program's own parser, which does not know the options.
        """
        parsed, unknown = super().parse_known_args(args, namespace)
        if unknown:
            self.refuse(*unknown[:2])
        return parsed, unknown

    @property
    def options(self) -> list[str]:
        """The known options."""
        return [*self._option_string_actions]

    def refuse(self, word: str, following: str = "") -> NoReturn:
        """Ends the process with an explanation of an unknown word, maybe by the one after it."""
        command = self.get_default("command")
        if word in _ROS_OPTIONS and command is not None and command.is_ros_node:
            given = shlex.join(filter(None, ("--ros-args", word, following)))
            self.error(f"{word}: is an argument of ROS, which follows --ros-args: {given}")
        if _ROS_PARAMETER.match(word):
            self.error(
                f"{word}: give a parameter to the node with --ros-args -p {word}, to other "
                f"commands with --set {word.replace(':=', '=')}"
            )
        if not word.startswith("-"):
            self.error(f"{word}: unexpected argument")
        option = word.partition("=")[0]
        self.error(f"{option}: no such option{did_you_mean(option, self.options)}")


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """The known word most similar to ``word``, as a question; "" if there is none."""
    near = difflib.get_close_matches(word, [*known], n=1)
    return f", did you mean {near[0]}?" if near else ""


def parse(words: Sequence[str]) -> argparse.Namespace:
    """The parsed arguments; ``command`` is the command, and ``words`` the words.

    Ends the process if they are invalid, or if help or the version is requested.
    """
    parser = _program()
    known = {command.name: command for command in COMMANDS}
    name = next((word for word in words if not word.startswith("-")), None)
    if not words:
        _add_commands(parser, None)
        parser.print_help(sys.stderr)
        parser.exit(BAD_INPUT, f"\n{PROGRAM}: give a COMMAND, such as `{PROGRAM} demo`\n")
    if name is None and words[0] not in parser.options:
        parser.refuse(words[0])
    if name is not None and name not in known:
        parser.error(f"{name}: no such command{did_you_mean(name, known)}")
    _add_commands(parser, name)
    is_ros_node = name is not None and known[name].is_ros_node
    own, ros = split_ros_arguments(words) if is_ros_node else (words, [])
    args = parser.parse_args(own)
    args.words, args.ros = list(words), ros
    return args


def split_ros_arguments(words: Sequence[str]) -> tuple[list[str], list[str]]:
    """The words of a program and those of ROS, which are between ``--ros-args`` and ``--``."""
    own: list[str] = []
    ros: list[str] = []
    is_for_ros = False
    for word in words:
        if word == "--ros-args":
            is_for_ros = True
        elif word == "--" and is_for_ros:
            is_for_ros = False
        else:
            (ros if is_for_ros else own).append(word)
    return own, ros


def complete() -> None:
    """Answers a completion request of the shell and ends the process.

    argcomplete is optional: a shell only asks if its user has installed and set it up.
    """
    if "_ARGCOMPLETE" not in os.environ:
        return
    try:
        import argcomplete
    except ImportError:
        return
    parser = _program()
    _add_commands(parser, None, all_arguments=True)
    argcomplete.autocomplete(parser)


def _program() -> Parser:
    parser = Parser(
        PROGRAM, description="RGB-D odometry with RGBD-Glue: replay, evaluate, convert, measure."
    )
    parser.add_argument("--version", action=_Version, nargs=0, help="show the version and exit")
    return parser


def _add_commands(parser: Parser, chosen: str | None, *, all_arguments: bool = False) -> None:
    """Adds the commands, and the arguments of the chosen one only: the others are not loaded."""
    common = Parser(add_help=False)
    common.add_argument("--debug", action="store_true", help="show where an error occurred")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for command in COMMANDS:
        child = commands.add_parser(
            command.name,
            help=command.summary,
            description=command.summary[0].upper() + command.summary[1:] + ".",
            parents=[common],
        )
        child.set_defaults(command=command)
        if all_arguments or command.name == chosen:
            command.module.add_arguments(child)


class _Version(argparse.Action):
    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> NoReturn:
        try:
            version = metadata.version("rgbd_glue_ros")
        except metadata.PackageNotFoundError:
            version = "(not installed)"
        sys.stdout.write(f"{PROGRAM} {version}\n")
        parser.exit()

"""Remappings that change nothing, as no topic has their name: ROS applies none and says nothing."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from difflib import get_close_matches

from rgbd_glue_ros.live import topics

_BEGIN, _END = "--ros-args", "--"
_REMAP = {"-r", "--remap"}
_SCHEME = re.compile(r"rostopic://|rosservice://")
_RULE = re.compile(r"(?:(?P<node>\w+):)?(?P<name>[^:]+):=(?P<to>.+)")


def explain_misspelt(arguments: Sequence[str], node: str) -> list[str]:
    """Warnings of remapped names that are nearly those of topics, and of none.

    Others may be meant for other nodes: a launch file gives its rules to all nodes of a group.
    Only relative names are looked at, since whatever another rule leads to may be remapped again.

    Args:
        arguments: of the process, with those of ROS.
        node: name of the node; rules for others are left alone.
    """
    return [
        f"{rule}: there is no topic {name!r}, so nothing is remapped; did you mean {near[0]}?"
        for rule in _rules(arguments)
        if (name := _relative_name(rule, node)) and name not in topics.NAMES
        if (near := get_close_matches(name, topics.NAMES, n=1))
    ]


def _rules(arguments: Sequence[str]) -> Iterator[str]:
    """What follows ``-r`` among the arguments of ROS."""
    is_of_ros = False
    before = ""
    for word in arguments:
        if word in (_BEGIN, _END):
            is_of_ros = word == _BEGIN
        elif is_of_ros and before in _REMAP:
            yield word
        before = word


def _relative_name(rule: str, node: str) -> str:
    """The relative topic that a rule remaps for a node; "" if it remaps something else."""
    found = _RULE.fullmatch(_SCHEME.sub("", rule))
    if found is None or found["node"] not in (None, node):
        return ""
    name = found["name"]
    # absolute and private names, and __ns and __node
    return "" if name.startswith(("/", "~", "__")) else name

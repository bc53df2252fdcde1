"""Which topics of a bag hold colour, depth, camera info and ground truth."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.messages.camera_info import INFO_TYPES
from rgbd_glue_ros.messages.images import IMAGE_TYPES, base_name, is_rectified
from rgbd_glue_ros.messages.poses import POSE_TYPES
from rgbd_glue_ros.recordings.bag.file import RecordedTopic

_Rule = Callable[[RecordedTopic], bool]


@dataclass(frozen=True)
class Topics:
    """Names of topics; None where it is to be found out.

    Attributes:
        color: images of colour or grey.
        depth: depth images registered to them.
        info: camera info of the colour images.
        ground_truth: true poses T_world_camera of the optical frame.
    """

    color: str | None = None
    depth: str | None = None
    info: str | None = None
    ground_truth: str | None = None


def find_color(topics: Mapping[str, RecordedTopic], wanted: str | None, bag: Path) -> str:
    """The topic of the colour images.

    Raises:
        InputError: there is none, or more than one; lists what there is.
    """
    images = _of_types(topics, IMAGE_TYPES)
    return _chosen(
        "colour",
        wanted,
        _best(
            [t for t in images if not _named(r"depth|infra|thermal|(^|[/_])ir([/_]|$)")(t)],
            _named(r"rgb|colou?r"),
            # what was computed from other images has lost some of them
            lambda t: not is_rectified(t.name),
            # image_color, not image_mono beside it
            lambda t: re.search(r"rgb|colou?r", base_name(t.name).rpartition("/")[2]) is not None,
            _is_raw,
        ),
        images,
        topics,
        bag,
    )


def find_depth(topics: Mapping[str, RecordedTopic], wanted: str | None, bag: Path) -> str:
    """The topic of the depth images; those registered to colour come first.

    Raises:
        InputError: there is none, or more than one; lists what there is.
    """
    images = _of_types(topics, IMAGE_TYPES)
    return _chosen(
        "depth",
        wanted,
        _best([t for t in images if _named("depth")(t)], _named("align|regist|_to_"), _is_raw),
        images,
        topics,
        bag,
    )


def find_info(
    topics: Mapping[str, RecordedTopic], wanted: str | None, color: str, bag: Path
) -> str:
    """The topic of the camera info beside the colour images.

    Raises:
        InputError: there is none, or more than one; lists what there is.
    """
    infos = _of_types(topics, INFO_TYPES)
    namespace = base_name(color).rpartition("/")[0]
    return _chosen(
        "camera info",
        wanted,
        _best(infos, lambda t: t.name.rpartition("/")[0] == namespace, _named(r"rgb|colou?r")),
        infos,
        topics,
        bag,
    )


def find_ground_truth(
    topics: Mapping[str, RecordedTopic], wanted: str | None, bag: Path
) -> str | None:
    """The topic of true poses, None if none is named like that.

    Raises:
        InputError: the wanted one is not there, or there is more than one.
    """
    poses = _of_types(topics, POSE_TYPES)
    named = [t for t in poses if _named(r"truth|mocap|vicon|vrpn|optitrack|(^|/)gt(/|_|$)")(t)]
    if wanted is None and not named:
        return None
    return _chosen("ground truth", wanted, named, poses, topics, bag)


def _chosen(
    what: str,
    wanted: str | None,
    found: list[RecordedTopic],
    possible: list[RecordedTopic],
    topics: Mapping[str, RecordedTopic],
    bag: Path,
) -> str:
    if wanted is not None:
        name = "/" + wanted.lstrip("/")
        found = _best([t for t in possible if base_name(t.name) == base_name(name)], _is_raw)
        found = [t for t in possible if t.name == name] or found
    if len(found) == 1:
        return found[0].name
    have = ", ".join(f"{t.name} ({t.type}, {t.message_count})" for t in topics.values())
    if found:
        cause = f"{len(found)} topics may be {what}: {', '.join(t.name for t in found)}"
    else:
        cause = f"there is no topic {wanted} of {what}" if wanted else f"no topic of {what} found"
    raise InputError(bag, cause, f"give one of its topics, which are {have}")


def _best(topics: list[RecordedTopic], *rules: _Rule) -> list[RecordedTopic]:
    """Those that meet the rules, each asked in turn and passed over when none meets it."""
    for rule in rules:
        topics = [t for t in topics if rule(t)] or topics
    return topics


def _named(pattern: str) -> _Rule:
    found = re.compile(pattern, re.IGNORECASE)
    return lambda topic: found.search(topic.name) is not None


def _is_raw(topic: RecordedTopic) -> bool:
    return topic.name == base_name(topic.name)


def _of_types(topics: Mapping[str, RecordedTopic], types: Iterable[str]) -> list[RecordedTopic]:
    return [topic for topic in topics.values() if topic.type.rpartition("/")[2] in types]

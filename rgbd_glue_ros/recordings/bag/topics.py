"""Finds the topics of colour, depth, camera info and ground truth in a bag."""

from __future__ import annotations

import logging
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.messages.camera_info import INFO_TYPES
from rgbd_glue_ros.messages.images import (
    IMAGE_TYPES,
    base_name,
    is_named_registered,
    is_rectified,
)
from rgbd_glue_ros.messages.imu import IMU_TYPES
from rgbd_glue_ros.messages.poses import POSE_TYPES
from rgbd_glue_ros.recordings.bag.file import RecordedTopic

logger = logging.getLogger(__name__)

_Rule = Callable[[RecordedTopic], bool]

_VIDEO = "republish it as raw or compressed (ros2 run image_transport republish), and record that"
# Other forms of images, and what converts them to images
_OTHER_FORMS: Mapping[str, tuple[tuple[str, ...], str]] = {
    "PointCloud2": (
        ("depth",),
        "make depth images of it (rtabmap_util's pointcloud_to_depthimage), and record them",
    ),
    "DisparityImage": (
        ("depth",),
        "make depth images of it (rtabmap_util's disparity_to_depth), and record them",
    ),
    "FFMPEGPacket": (("colour", "depth"), _VIDEO),
    "Packet": (("colour",), _VIDEO),  # of theora_image_transport
    "CompressedVideo": (("colour",), _VIDEO),
    "RGBD": (("colour", "depth"), "record the images and camera infos beside it"),  # RealSense
    "RGBDImage": (("colour", "depth"), "split it (rtabmap_util's rgbd_split), and record that"),
}

# Images of Foxglove's schemas, in ROS, JSON or protobuf
_FOXGLOVE = re.compile(r"foxglove.*(CompressedImage|RawImage)$", re.IGNORECASE)

_PACKAGES = {"sensor_msgs", "geometry_msgs", "nav_msgs"}

EncodingOf = Callable[[str], str]
"""Returns the encoding of the first image of a topic."""


@dataclass(frozen=True)
class Topics:
    """Names of topics; None if to be detected.

    Attributes:
        color: images of colour or grey.
        depth: depth images, registered to them or not.
        info: camera info of the colour images.
        ground_truth: true poses T_world_camera of the optical frame.
        depth_info: camera info of the depth images, if they are not registered.
        imu: samples of an inertial sensor; "" if none is to be used.
    """

    color: str | None = None
    depth: str | None = None
    info: str | None = None
    ground_truth: str | None = None
    depth_info: str | None = None
    imu: str | None = None


def find_color(
    topics: Mapping[str, RecordedTopic],
    wanted: str | None,
    bag: Path,
    encoding: EncodingOf = lambda _: "",
    near: str = "",
) -> str:
    """The topic of the colour images beside depth; of infrared ones if there are no others.

    Args:
        topics: of the bag.
        wanted: topic to use; None detects it.
        bag: for errors.
        encoding: returns that of a topic's images, in case names are not clear.
        near: a topic of the same camera, "" if none is known.

    Raises:
        InputError: there is none, or more than one; lists what there is.
    """
    images = _of_types(topics, IMAGE_TYPES)
    found = [] if wanted is not None else _colors(images, encoding, near)
    return _chosen("colour", ["--color-topic TOPIC"], wanted, found, images, topics, bag)


def _colors(images: list[RecordedTopic], encoding: EncodingOf, near: str) -> list[RecordedTopic]:
    """The colour images of each camera that has depth too, or of all if there is no depth."""
    depths = [near] if near else [t.name for t in _depths(images, encoding, "")]
    no_depth = [
        t
        for t in images
        if not (_is_named_depth(t) or _named("thermal")(t) or _is_depth(encoding(t.name)))
    ]
    found = []
    for of_device in _by_camera(no_depth, depths, parts=1):
        # names tell images of one camera apart, and not one camera from another
        for of_camera in _by_camera(_best(of_device, _is_not_rectified), depths):
            found += _best(
                of_camera,
                lambda t: not _is_infrared(t),
                _named(r"rgb|colou?r"),
                # image_color, not image_mono beside it
                lambda t: re.search(r"rgb|colou?r", _last_part(t.name)) is not None,
                # of a pair of cameras, depth is in the view of the left one
                lambda t: not _named(r"right|infra2")(t),
                _named(r"(^|/)rgb(/|$)"),
            )
    return found


def _by_camera(
    colors: list[RecordedTopic], depths: list[str], parts: int | None = None
) -> list[list[RecordedTopic]]:
    """Colour images with depth in their namespace, by that namespace.

    Depth belongs to the colour images that share most leading parts of its namespace.

    Args:
        colors: topics of colour images.
        depths: topics of depth images; if there are none, all colour images are in one list.
        parts: how many leading parts of the namespace count; None counts all.
    """
    shared = {t.name: [_shared_parts(t.name, _camera_of(d)) for d in depths] for t in colors}
    most = [max(counts) for counts in zip(*shared.values(), strict=True)]
    cameras: dict[tuple[str, ...], list[RecordedTopic]] = {}
    for topic in colors:
        own = [n for n, best in zip(shared[topic.name], most, strict=True) if n == best]
        if own or not depths:
            key = topic.name.strip("/").split("/")[: max(own, default=0)]
            cameras.setdefault(tuple(key[:parts]), []).append(topic)
    return list(cameras.values())


def _camera_of(depth: str) -> str:
    """The namespace of a depth topic's camera: without what names its images."""
    *folders, _ = depth.strip("/").split("/")
    return "/".join(takewhile(lambda part: "depth" not in part.lower(), folders))


def find_depth(
    topics: Mapping[str, RecordedTopic],
    wanted: str | None,
    bag: Path,
    encoding: EncodingOf = lambda _: "",
    near: str = "",
) -> str:
    """The topic of the depth images near colour; those registered to it come first.

    Args:
        topics: of the bag, as in ``find_color``.
        wanted: as in ``find_color``.
        bag: as in ``find_color``.
        encoding: as in ``find_color``.
        near: topic of the colour images, "" if it is not known.

    Raises:
        InputError: there is none, or more than one; lists what there is.
    """
    images = _of_types(topics, IMAGE_TYPES)
    found = [] if wanted is not None else _depths(images, encoding, near)
    found = _best(
        _nearest(found, near),
        lambda t: is_named_registered(t.name),
        lambda t: not _named("confidence")(t),
        # of a raw and a rectified image the one that fits colour; of those computed from it the raw
        lambda t: is_rectified(t.name) == is_rectified(near),
        lambda t: _last_part(t.name) == "image_raw",
    )
    return _chosen("depth", ["--depth-topic TOPIC"], wanted, found, images, topics, bag)


def _depths(images: list[RecordedTopic], encoding: EncodingOf, near: str) -> list[RecordedTopic]:
    """The depth images by name, or if there are none by encoding.

    Colour registered to depth, or the confidence of depth, is named depth and encoded otherwise.
    """
    named = [t for t in images if _is_named_depth(t)]
    others = [t for t in images if t.name != near and not _is_infrared(t)]
    return (
        [t for t in named if not _is_of_8_bits(encoding(t.name))]
        or [t for t in others if _is_depth(encoding(t.name))]
        or named
    )


def find_info(
    topics: Mapping[str, RecordedTopic], wanted: str | None, color: str, bag: Path
) -> str:
    """The topic of the camera info beside the colour images.

    Raises:
        InputError: there is none, or more than one; lists what there is.
    """
    infos = _of_types(topics, INFO_TYPES)
    found = _best(_nearest(infos, color), _named(r"rgb|colou?r"))
    options = "--info-topic TOPIC", "--calibration FILE"
    return _chosen("camera info", options, wanted, found, infos, topics, bag)


def find_depth_info(
    topics: Mapping[str, RecordedTopic], wanted: str | None, bag: Path
) -> str | None:
    """The given topic of the depth camera's info; None if it was not given.

    Raises:
        InputError: the topic does not exist; lists those that do.
    """
    if wanted is None:
        return None
    infos = _of_types(topics, INFO_TYPES)
    options = "--depth-info-topic TOPIC", "--depth-calibration FILE"
    return _chosen("the depth camera's info", options, wanted, [], infos, topics, bag)


def find_ground_truth(
    topics: Mapping[str, RecordedTopic], wanted: str | None, bag: Path
) -> str | None:
    """The topic of ground-truth poses, None if none has such a name.

    Raises:
        InputError: the wanted topic does not exist, or there is more than one.
    """
    poses = _of_types(topics, POSE_TYPES)
    named = [t for t in poses if _named(r"truth|mocap|vicon|vrpn|optitrack|(^|/)gt(/|_|$)")(t)]
    if wanted is None and not named:
        return None
    return _chosen("ground truth", ["--truth-topic TOPIC"], wanted, named, poses, topics, bag)


def find_imu(
    topics: Mapping[str, RecordedTopic], wanted: str | None, color: str, bag: Path
) -> str | None:
    """The topic of an IMU; None if there is none, or, which is logged, several and none was given.

    Args:
        topics: of the bag.
        wanted: topic to use; None detects it, "" uses none.
        color: topic of the colour images: the IMU of the same device comes first.
        bag: for errors.

    Raises:
        InputError: the wanted topic does not exist.
    """
    sensors = _of_types(topics, IMU_TYPES)
    if wanted == "" or not (sensors or wanted):
        return None
    if wanted is not None:
        return _chosen("an IMU", ["--imu-topic TOPIC"], wanted, [], sensors, topics, bag)
    nearest = _nearest(sensors, color)
    if len(nearest) > 1:
        names = ", ".join(topic.name for topic in nearest)
        logger.warning("%s: ignored, since only one IMU is used: give one (--imu-topic)", names)
        return None
    return nearest[0].name


def _chosen(
    what: str,
    options: Sequence[str],
    wanted: str | None,
    found: list[RecordedTopic],
    possible: list[RecordedTopic],
    topics: Mapping[str, RecordedTopic],
    bag: Path,
) -> str:
    """The topic of a kind: the wanted one, or the only one found.

    Args:
        what: the kind.
        options: the one that gives its topic, and those that replace it.
        wanted: as given by the user; None to take what was found.
        found: topics that are probably of this kind.
        possible: topics whose type is right.
        topics: of the bag.
        bag: for errors.

    Raises:
        InputError: there is no such topic, or more than one.
    """
    option = ", or ".join(options)
    if wanted is not None:
        name = "/" + wanted.lstrip("/")
        found = _best(
            [t for t in possible if "/" + base_name(t.name).lstrip("/") == base_name(name)]
        )
        found = [t for t in possible if "/" + t.name.lstrip("/") == name] or found
    # one base name is one image, whatever the transports
    if len({base_name(t.name) for t in found}) == 1:
        return _best(found, _is_raw, _named("compressedDepth$"))[0].name
    if found:
        cause = f"{len(found)} topics may be {what}: {', '.join(t.name for t in found)}"
        raise InputError(bag, cause, f"give one of them ({option})")
    offered = possible or topics.values()
    have = ", ".join(f"{t.name} ({t.type}, {t.message_count})" for t in offered)
    cause = f"there is no topic {wanted} of {what}" if wanted else f"no topic of {what} found"
    if possible:
        remedy = f"give one of its topics ({option}), which are {have}"
    else:
        instead = f"give {' or '.join(options[1:])}" if options[1:] else "record one"
        remedy = f"{instead}; the bag has only {have or 'empty topics'}"
    raise InputError(bag, cause, "; ".join([*_in_another_form(what, topics), remedy]))


def _in_another_form(what: str, topics: Mapping[str, RecordedTopic]) -> list[str]:
    """The remedy if images exist in another form."""
    for topic in topics.values():
        if _FOXGLOVE.search(topic.type) and what in {"colour", "depth"}:
            told = (
                "images of Foxglove's schemas are not read: record or convert them as sensor_msgs"
            )
            return [f"{topic.name} is {topic.type}, and {told}/msg/Image or CompressedImage"]
        kinds, remedy = _OTHER_FORMS.get(topic.type.rpartition("/")[2], ((), ""))
        if what in kinds:
            return [f"{topic.name} holds it as {topic.type}: {remedy}"]
    return []


def _nearest(topics: list[RecordedTopic], name: str) -> list[RecordedTopic]:
    """The topics whose names share most leading parts with another topic's."""
    shared = [_shared_parts(t.name, name) for t in topics]
    most = max(shared, default=0)
    return [t for t, count in zip(topics, shared, strict=True) if count == most]


def _shared_parts(first: str, second: str) -> int:
    parts = zip(first.strip("/").split("/"), second.strip("/").split("/"), strict=False)
    return sum(1 for _ in takewhile(lambda both: both[0] == both[1], parts))


def _last_part(name: str) -> str:
    return base_name(name).rpartition("/")[2]


def _is_not_rectified(topic: RecordedTopic) -> bool:
    """Whether images are as the camera took them; those computed from others may be fewer."""
    return not is_rectified(topic.name)


def _is_named_depth(topic: RecordedTopic) -> bool:
    return _named("depth")(topic)


def _is_infrared(topic: RecordedTopic) -> bool:
    return _named(r"infra|thermal|(^|[/_])ir([/_]|$)")(topic)


def _is_depth(encoding: str) -> bool:
    """Whether images of an encoding can only be depth."""
    return re.match(r"16[US]C1|32FC1|64FC1|z16", encoding, re.IGNORECASE) is not None


def _is_of_8_bits(encoding: str) -> bool:
    """Whether images of an encoding can only be colour, grey or flags."""
    of_8_bits = "(rgb|bgr)a?|mono8|8[US]C|bayer|yuv|yuy|uyvy|nv|.*jpe?g"
    return re.match(of_8_bits, encoding, re.IGNORECASE) is not None


def _best(topics: list[RecordedTopic], *rules: _Rule) -> list[RecordedTopic]:
    """The topics that meet the rules, applied in turn; a rule that none meets is skipped."""
    for rule in rules:
        topics = [t for t in topics if rule(t)] or topics
    return topics


def _named(pattern: str) -> _Rule:
    found = re.compile(pattern, re.IGNORECASE)
    return lambda topic: found.search(topic.name) is not None


def _is_raw(topic: RecordedTopic) -> bool:
    return topic.name == base_name(topic.name)


def _of_types(topics: Mapping[str, RecordedTopic], types: Iterable[str]) -> list[RecordedTopic]:
    """The topics of some standard types; other packages have types of the same name."""
    return [
        topic
        for topic in topics.values()
        if topic.type.rpartition("/")[2] in types and topic.type.split("/")[0] in _PACKAGES
    ]

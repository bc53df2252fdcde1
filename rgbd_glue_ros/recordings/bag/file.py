"""A bag as topics and messages in order, whatever its format and state.

Intact ones are read with rosbags, damaged ones with ``salvage``.
"""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from copy import copy
from dataclasses import dataclass
from heapq import merge
from operator import itemgetter
from pathlib import Path
from typing import Any

import yaml
from rosbags.interfaces import Connection, ConnectionExtRosbag2, Qos
from rosbags.rosbag1 import Reader as Rosbag1Reader
from rosbags.rosbag2 import Reader as Rosbag2Reader
from rosbags.typesys import Stores, get_typestore

from rgbd_glue_ros.closing import Closing
from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.files.bounded_yaml import document
from rgbd_glue_ros.files.reading import read_text, refuse_stand_in, stand_in
from rgbd_glue_ros.messages.fields import CameraInfo
from rgbd_glue_ros.recordings.bag.layout import (
    MCAP_MAGIC,
    METADATA,
    SIGNATURE,
    SQLITE_MAGIC,
    first_bytes,
    has_log,
    is_ros1,
    lacks_log,
    storage_files,
)
from rgbd_glue_ros.recordings.bag.message import DamagedError, RecordedMessage
from rgbd_glue_ros.recordings.bag.salvage import salvage
from rgbd_glue_ros.recordings.bag.sqlite import check_sqlite
from rgbd_glue_ros.recordings.bag.unpacking import PlainFiles, unpacked_message

logger = logging.getLogger(__name__)

_Reader = Rosbag1Reader | Rosbag2Reader


@dataclass(frozen=True)
class RecordedTopic:
    """A topic of a bag.

    Attributes:
        name: of the topic.
        type: for example ``sensor_msgs/msg/Image``.
        message_count: of the topic in the bag.
        offered_qos: the profiles of its publishers; empty if not recorded.
    """

    name: str
    type: str
    message_count: int
    offered_qos: tuple[Qos, ...] = ()


class BagFile(Closing):
    """An open bag.

    Attributes:
        path: a rosbag2 folder or storage file, or a ROS 1 bag.
        topics: those with at least one message, by name.
        is_ros1: whether messages are serialised as in ROS 1.
        damage: what is wrong with the bag, None as long as no damage is known.
    """

    def __init__(self, path: Path) -> None:
        """Opens it.

        Raises:
            InputError: there is no bag, it has no messages, or nothing of it can be read.
        """
        self.path = path
        self.damage: str | None = None
        self._readers: list[_Reader] = []
        if not path.exists():
            raise InputError(path, "does not exist", "give a bag")
        self._files = storage_files(path)
        if not self._files:
            raise InputError(path, "is not a bag", f"looked for {SIGNATURE}")
        if all(stand_in(first_bytes(file)) for file in self._files):
            refuse_stand_in(first_bytes(self._files[0]), self._files[0])
        _say_what_is_missing(path, self._files)
        self._plain_files = PlainFiles()
        self._plain = self._unpacked()
        self.is_ros1 = any(is_ros1(plain) for _, plain in self._plain[:1])
        self._typestore = get_typestore(Stores.ROS1_NOETIC if self.is_ros1 else Stores.ROS2_JAZZY)
        try:
            self._open_with_index()
            self.topics = _indexed_topics([c for r in self._readers for c in r.connections])
        except Exception as error:  # noqa: BLE001 (a damaged file makes it raise almost anything)
            logger.debug("%s: read without its index (%r)", path, error)
            self._close_readers()
            self.topics = self._scan()
        if not self.topics:
            self.close()
            without_log = [file.name for file in self._files if lacks_log(file)]
            raise InputError(
                path,
                f"holds no message: {self.damage or 'it is empty'}",
                f"copy {without_log[0]}-wal too, the log that its recorder left beside it"
                if without_log
                else "record again",
            )

    def _unpacked(self) -> list[tuple[Path, Path]]:
        """Each file with its unpacked form; without those that cannot be unpacked."""
        found = []
        for file in self._files:
            with self._noting_damage(file):
                found.append((file, self._plain_files.of(file)))
        return found

    def _open_with_index(self) -> None:
        """Opens readers of the complete files; may raise almost anything without a valid index."""
        if any(has_log(plain) for _, plain in self._plain):
            raise DamagedError("its recorder did not finish it")
        if self.is_ros1 and first_bytes(self._plain[0][1]).startswith(MCAP_MAGIC):
            raise DamagedError("no reader supports ROS 1 messages in MCAP")
        for _, plain in self._plain:
            if first_bytes(plain).startswith(SQLITE_MAGIC):
                check_sqlite(plain)
            reader = Rosbag1Reader(plain) if self.is_ros1 else Rosbag2Reader(plain)
            reader.open()
            self._readers.append(reader)

    def reopened(self) -> BagFile:
        """The same bag, to be read beside this one, and closed before it."""
        again = copy(self)
        again._readers = []  # noqa: SLF001 (its own)
        again._plain_files = PlainFiles()  # noqa: SLF001 (those of this one are used)
        if self._readers:
            again._open_with_index()  # noqa: SLF001 (as this one)
        return again

    def encoding(self, topic: str) -> str:
        """The encoding of the first image of a topic; "" if it is not an image."""
        try:
            image = self.first(topic)
        except InputError:
            return ""
        return str(getattr(image, "encoding", "") or getattr(image, "format", ""))

    def messages(self, topics: Collection[str] = ()) -> Iterator[RecordedMessage]:
        """The messages of some topics (by default all), from the beginning, in order of time.

        In a damaged file they are in the order of writing; they end where the damage begins, and
        ``damage`` describes it.
        """
        messages = self._indexed(topics) if self._readers else self._salvaged()
        return (message for message in messages if not topics or message.topic in topics)

    def first(self, topic: str) -> Any:
        """The first message of a topic, as from ``deserialize``.

        Raises:
            InputError: no message can be read, or its bytes do not match its type.
        """
        message = next(self.messages([topic]), None)
        if message is None:
            why = self.damage or "the bag has none"
            raise InputError(topic, f"no message can be read ({why})", "check the recording")
        return self.deserialize(message)

    def deserialize(self, message: RecordedMessage) -> Any:
        """The message as an object with the fields it has in ROS 2.

        Raises:
            InputError: its bytes do not match its type.
        """
        try:
            # with the standard definitions: those in the bag may be damaged too
            if self.is_ros1:
                fields: Any = self._typestore.deserialize_ros1(message.data, message.type)
            else:
                fields = self._typestore.deserialize_cdr(message.data, message.type)
        except Exception as error:
            raise InputError(
                message.topic,
                f"a message is not a valid {message.type} ({error})",
                "check the recording",
            ) from error
        if self.is_ros1 and message.type == "sensor_msgs/msg/CameraInfo":
            return _ros2_camera_info(fields)
        return fields

    def close(self) -> None:
        """Releases the files."""
        self._close_readers()
        self._plain_files.close()

    def _close_readers(self) -> None:
        while self._readers:
            self._readers.pop().close()

    def _indexed(self, topics: Collection[str]) -> Iterator[RecordedMessage]:
        given = set()
        try:
            for connection, stamp_ns, data in merge(*self._parts(topics), key=itemgetter(1)):
                given.add((connection.topic, stamp_ns))
                yield RecordedMessage(
                    connection.topic, connection.msgtype, stamp_ns, unpacked_message(data)
                )
        except Exception as error:  # noqa: BLE001 (as on opening)
            # damage between the indexed parts, or merely a file without chunks that is out of order
            logger.debug("%s: continuing without its index (%r)", self.path, error)
            for message in self._salvaged():
                if (message.topic, message.stamp_ns) not in given:
                    yield message

    def _parts(self, topics: Collection[str]) -> Iterator[Iterator[tuple[Connection, int, bytes]]]:
        for reader in self._readers:
            chosen = [c for c in reader.connections if not topics or c.topic in topics]
            if chosen:
                yield reader.messages(chosen)

    def _salvaged(self) -> Iterator[RecordedMessage]:
        for file, plain in self._plain:
            with self._noting_damage(file):
                yield from salvage(plain)

    @contextmanager
    def _noting_damage(self, file: Path) -> Iterator[None]:
        try:
            yield
        except DamagedError as error:
            self.damage = str(error) if file == self.path else f"{file.name}: {error}"

    def _scan(self) -> dict[str, RecordedTopic]:
        counts = Counter((message.topic, message.type) for message in self._salvaged())
        return {
            topic: RecordedTopic(topic, message_type, count)
            for (topic, message_type), count in sorted(counts.items())
        }


def _say_what_is_missing(path: Path, files: list[Path]) -> None:
    """Logs which of the files named by the metadata are missing."""
    if not (path / METADATA).is_file():
        return
    try:
        content = document(read_text(path / METADATA))
        paths = content["rosbag2_bagfile_information"]["relative_file_paths"]
        named = {Path(str(path)).name for path in paths}
    except (InputError, yaml.YAMLError, KeyError, TypeError):
        return
    missing = named - {file.name for file in files}
    # the same number of files under other names are the same files, renamed
    if missing and len(files) < len(named):
        logger.warning(
            "%s: %d of its %d parts %s missing (%s); continuing without",
            path,
            len(missing),
            len(named),
            "is" if len(missing) == 1 else "are",
            ", ".join(sorted(missing)),
        )


def _ros2_camera_info(ros1: Any) -> CameraInfo:
    """Renames the matrices, which have capital names in ROS 1."""
    return CameraInfo(
        header=ros1.header,
        height=ros1.height,
        width=ros1.width,
        distortion_model=ros1.distortion_model,
        d=ros1.D,
        k=ros1.K,
        r=ros1.R,
        p=ros1.P,
        binning_x=ros1.binning_x,
        binning_y=ros1.binning_y,
        roi=ros1.roi,
    )


def _indexed_topics(connections: Collection[Connection]) -> dict[str, RecordedTopic]:
    topics: dict[str, RecordedTopic] = {}
    for connection in sorted(connections, key=lambda c: c.topic):
        known = topics.get(connection.topic)
        qos = (
            tuple(connection.ext.offered_qos_profiles)
            if isinstance(connection.ext, ConnectionExtRosbag2)
            else ()
        )
        count = connection.msgcount + (known.message_count if known else 0)
        if count:
            topics[connection.topic] = RecordedTopic(
                connection.topic, connection.msgtype, count, qos
            )
    return topics

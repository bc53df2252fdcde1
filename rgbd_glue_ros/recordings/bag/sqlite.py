"""Bags in SQLite: reads damaged ones, and refuses malicious ones.

A database can compute its apparent content: an endless view, or a column of gigabytes.
"""

from __future__ import annotations

import sqlite3
import struct
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

from rgbd_glue_ros.recordings.bag.layout import has_log, log_of
from rgbd_glue_ros.recordings.bag.message import DamagedError, RecordedMessage

# Steps of SQLite's virtual machine, of which a row of a table takes a dozen
_STEPS_A_ROW, _STEPS = 100, 100_000
# Minimum bytes of the file per row
_SMALLEST_ROW = 8


def check_sqlite(path: Path) -> None:
    """Checks that the tables of a bag are real tables, and contain no more than the file.

    Raises:
        DamagedError: a table is computed, or larger than the file.
        sqlite3.Error: the file is not an intact database.
    """
    with closing(_opened(path)) as connection:
        _check_schema(connection)
        size = path.stat().st_size
        rows = size // _SMALLEST_ROW + 1
        _stop_after(connection, rows)
        counted, held = connection.execute(
            "SELECT count(*), total(length(data)) FROM (SELECT data FROM messages LIMIT ?)",
            (rows,),
        ).fetchone()
        if counted >= rows or held > size:
            raise DamagedError("its messages are larger than the file")


def _check_schema(connection: sqlite3.Connection) -> None:
    for kind, name, page in connection.execute("SELECT type, name, rootpage FROM sqlite_master"):
        if kind not in ("table", "index") or not page:
            raise DamagedError(f"it computes {name!r}, where a recorder stores messages")
    for table in ("topics", "messages"):
        columns = connection.execute(f"PRAGMA table_xinfo({table})").fetchall()
        computed = [name for _, name, *_, hidden in columns if hidden]
        if computed:
            raise DamagedError(f"it computes the column {computed[0]!r} of {table}")


def _stop_after(connection: sqlite3.Connection, rows: int) -> None:
    """Ends a query that takes longer than one over a number of rows can."""
    calls = 0

    def count() -> bool:
        nonlocal calls
        calls += 1
        return calls * _STEPS > _STEPS_A_ROW * rows + _STEPS

    connection.set_progress_handler(count, _STEPS)


# SQLite: pages; the header says their size (1 for 65536) and how many there are
_SQLITE_SIZES = struct.Struct(">16xH10xI")


def salvage_sqlite(path: Path) -> Iterator[RecordedMessage]:
    """The messages of a database in the order of writing, as far as it goes.

    Raises:
        DamagedError: after the last readable message, unless the file is intact.
        sqlite3.Error: the file is unreadable from some point on.
    """
    with path.open("rb") as file:
        page_size, pages = _SQLITE_SIZES.unpack(file.read(_SQLITE_SIZES.size))
    page_size = 65536 if page_size == 1 else page_size
    messages = _sqlite_messages(path)
    if path.stat().st_size >= page_size * pages:
        yield from messages
        return
    yield from _without_the_last_larger_than(page_size, messages)
    raise DamagedError("it is truncated")


def _without_the_last_larger_than(
    page_size: int, messages: Iterator[RecordedMessage]
) -> Iterator[RecordedMessage]:
    """The messages up to the last one that needs more than a page.

    SQLite reads the missing part of the last page as zeros, so the last message that continues in
    further pages may end in zeros. Pages are filled in order: earlier ones are intact.
    """
    held: list[RecordedMessage] = []
    for message in messages:
        if len(message.data) > page_size:
            yield from held
            held = [message]
        elif held:
            held.append(message)
        else:
            yield message


def _sqlite_messages(path: Path) -> Iterator[RecordedMessage]:
    connection = _opened(path)
    try:
        # otherwise SQLite would read nothing of a file that is shorter than its header says
        connection.execute("PRAGMA writable_schema = ON")
        _check_schema(connection)
        left = path.stat().st_size + (log_of(path).stat().st_size if has_log(path) else 0)
        _stop_after(connection, left // _SMALLEST_ROW)
        topics = {
            number: (str(topic), str(message_type))
            for number, topic, message_type in connection.execute(
                "SELECT id, name, type FROM topics"
            )
        }
        for number, stamp_ns, data in connection.execute(
            "SELECT topic_id, timestamp, data FROM messages ORDER BY id"
        ):
            if not (isinstance(data, bytes) and isinstance(stamp_ns, int)):
                raise DamagedError("a row of its messages is invalid")
            left -= len(data) + _SMALLEST_ROW
            if left < 0:
                raise DamagedError("its messages are larger than the file")
            yield RecordedMessage(*topics[number], stamp_ns, data)
    finally:
        connection.close()


def _opened(path: Path) -> sqlite3.Connection:
    # a log beside the file is read only where the file may change
    mode = "mode=ro" if has_log(path) else "immutable=1"
    return sqlite3.connect(f"{path.resolve().as_uri()}?{mode}", uri=True)

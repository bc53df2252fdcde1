"""What is in a recording of Rerun, read by Rerun's own reader."""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path
from typing import Any

import pytest

Rows = dict[str, list[dict[str, Any]]]


def rows_of(file: Path) -> Rows:
    """The rows of every entity, each the values of its columns, in the order they were logged."""
    chunk = pytest.importorskip("rerun.chunk", reason="this rerun-sdk has no such reader")
    rows = defaultdict(list)
    for part in chunk.RrdReader(file).stream():
        rows[part.entity_path].extend(part.to_record_batch().to_pylist())
    for of_entity in rows.values():
        of_entity.sort(key=lambda row: next(v for k, v in row.items() if k.endswith("RowId")))
    return rows


def column(rows: list[dict[str, Any]], name: str) -> list[Any]:
    """The values of the column whose name ends so, of the rows that have one."""
    return [
        value
        for row in rows
        for key, value in row.items()
        if key.endswith(name) and value is not None
    ]

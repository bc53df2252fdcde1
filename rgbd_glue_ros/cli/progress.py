"""Progress bars, which only those see who watch a terminal, and counts in words."""

from __future__ import annotations

from typing import Any

from tqdm import tqdm


def bar(unit: str, total: int | None = None, **options: Any) -> tqdm[Any]:
    """A bar that counts in ``unit``, as in " frames"; ``options`` are tqdm's."""
    # None: no bar where nobody watches
    return tqdm(total=total, unit=unit, disable=None, dynamic_ncols=True, **options)


def counted(count: int, noun: str) -> str:
    """As ``1 frame``, ``2 frames``."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"

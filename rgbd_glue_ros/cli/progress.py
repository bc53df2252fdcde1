"""Progress bars, which only those see who watch a terminal, and counts in words."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from tqdm import tqdm

if TYPE_CHECKING:
    from rgbd_glue_ros.types import OdometryEstimate

from rgbd_glue_ros.printable import printable

_COLUMNS, _ROWS = 80, 24


def bar(unit: str, total: int | None = None, **options: Any) -> tqdm[Any]:
    """A bar that counts in ``unit``, as in " frames"; ``options`` are tqdm's."""
    # None: no bar where nobody watches. Some terminals, as of containers, have a size of 0 by 0.
    size = {"dynamic_ncols": True} if _columns() else {"ncols": _COLUMNS, "nrows": _ROWS}
    return _Bar(total=total, unit=unit, disable=None, **size, **options)


def _columns() -> int:
    """Of the terminal; 0 where it does not say, or there is none."""
    try:
        return os.get_terminal_size(sys.stderr.fileno()).columns
    except (OSError, ValueError):
        return 0


class _Bar(tqdm):  # type: ignore[type-arg]
    """Names of recordings in its texts are fit for a terminal."""

    def set_description(self, desc: str | None = None, refresh: bool | None = True) -> None:
        """As tqdm's."""
        super().set_description(printable(desc or ""), refresh)

    def set_postfix_str(self, s: str = "", refresh: bool = True) -> None:
        """As tqdm's."""
        super().set_postfix_str(printable(s), refresh)


@contextmanager
def tracking_bar(frames: int) -> Iterator[Callable[[OdometryEstimate], None]]:
    """A bar of so many frames; what it gives is called with the estimate of each."""
    with bar(" frames", frames) as shown:
        # where nothing is compiled yet, the first frame is half a minute away
        shown.set_postfix_str("warming up")

        def show(estimate: OdometryEstimate) -> None:
            shown.set_postfix_str(estimate.state.value, refresh=False)
            shown.update()

        yield show


def counted(count: int, noun: str) -> str:
    """As ``1 frame``, ``2 frames``."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"

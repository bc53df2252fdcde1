"""Progress bars, shown only on a terminal, and counts in words."""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from tqdm import tqdm

if TYPE_CHECKING:
    from rgbd_glue_ros.types import OdometryEstimate

from rgbd_glue_ros.printable import counted, printable

__all__ = ["bar", "counted", "tracking_bar"]

_COLUMNS, _ROWS = 80, 24

_WARMING_UP = "warming up"
_COMPILING = "warming up: compiling, once after installation (about a minute)"
# With compiled code on the disk, warming up takes less.
_WARM_S = 4.0


def bar(unit: str, total: int | None = None, **options: Any) -> tqdm[Any]:
    """A bar that counts in ``unit``, as in " frames"; ``options`` are tqdm's."""
    # None: no bar without a terminal. Some terminals, as in containers, have a size of 0 by 0.
    size = {"dynamic_ncols": True} if _columns() else {"ncols": _COLUMNS, "nrows": _ROWS}
    return _Bar(total=total, unit=unit, disable=None, **size, **options)


def _columns() -> int:
    """Width of the terminal; 0 if it is unknown, or there is none."""
    try:
        return os.get_terminal_size(sys.stderr.fileno()).columns
    except (OSError, ValueError):
        return 0


class _Bar(tqdm):  # type: ignore[type-arg]
    """A bar in whose texts names of recordings are printable."""

    def set_description(self, desc: str | None = None, refresh: bool | None = True) -> None:
        """As tqdm's."""
        super().set_description(printable(desc or ""), refresh)

    def set_postfix_str(self, s: str = "", refresh: bool = True) -> None:
        """As tqdm's."""
        super().set_postfix_str(printable(s), refresh)


@contextmanager
def tracking_bar(frames: int) -> Iterator[Callable[[OdometryEstimate], None]]:
    """A bar for a number of frames; its result is called with the estimate of each."""
    with bar(" frames", frames) as shown:
        shown.set_postfix_str(_WARMING_UP)
        compiling = threading.Timer(_WARM_S, lambda: shown.set_postfix_str(_COMPILING))
        compiling.daemon = True
        compiling.start()

        def show(estimate: OdometryEstimate) -> None:
            if shown.n == 0:
                compiling.cancel()
                # rate and remaining time are those of frames
                shown.reset()
            shown.set_postfix_str(estimate.state.value, refresh=False)
            shown.update()

        try:
            yield show
        finally:
            compiling.cancel()

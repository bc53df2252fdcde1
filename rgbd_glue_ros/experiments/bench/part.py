"""The interface of a part of a benchmark."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol


class Part(Protocol):
    """A measurement; however it ends, ``figures`` gives what was measured until then."""

    @property
    def title(self) -> str:
        """What it does, for the progress bar."""

    @property
    def frame_count(self) -> int:
        """The maximum number of frames that it will process."""

    def run(self, step: Callable[[], None]) -> None:
        """Measures; calls ``step`` after every frame.

        Raises:
            InputError: the recording cannot be used.
            MissingExtraError: a library is not installed.
            RuntimeError: what is measured ended.
        """

    def figures(self) -> dict[str, Any]:
        """What was measured, ready for JSON."""

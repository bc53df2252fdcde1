"""Whether silence is a fault yet: a node may be started long before its camera."""

from __future__ import annotations

from enum import Enum


class Silence(Enum):
    """What it means that nothing complete arrives."""

    WAITING = "nobody has published anything yet"
    TOO_EARLY = "publishers have just appeared"
    FAULT = "there are publishers, or there were"


class FirstPublishers:
    """Judges silence by what each check sees of a node's publishers, one check after the other."""

    def __init__(self) -> None:
        """Begins before the first check."""
        # before the first check nothing is known, and a publisher seen there may be a moment old
        self._had_none = True
        self._has_heard = False

    def judge(self, *, has_publishers: bool, has_messages: bool) -> Silence:
        """What silence at this check means; to be called at each.

        The first publishers have from the check that finds them until the next to send something.

        Args:
            has_publishers: whether any of the topics has a publisher now.
            has_messages: whether a message has arrived on any of them since the last check.
        """
        had_none, self._had_none = self._had_none, not has_publishers
        self._has_heard |= has_messages
        if self._has_heard:
            return Silence.FAULT
        if not has_publishers:
            return Silence.WAITING
        return Silence.TOO_EARLY if had_none else Silence.FAULT

"""Whether several publishers of a topic send at once, or one has gone and is still counted."""

from __future__ import annotations

# The numbers of messages begin anew with each new publisher, which takes seconds to start; those of
# two that both send go back and forth.
_BACK_AND_FORTH = 3


class Mixture:
    """Follows the numbers that publishers give their messages, from one check to the next."""

    def __init__(self) -> None:
        """Begins before the first message."""
        self._last: int | None = None
        self._has_messages = self._had_several = False
        self._steps_back = 0

    def add(self, number: int | None) -> None:
        """Takes the next message.

        Args:
            number: among those of its publisher; None if the middleware gives none.
        """
        self._has_messages = True
        if number is not None and self._last is not None and number <= self._last:
            self._steps_back += 1
        self._last = number

    def judge(self, publishers: int) -> bool:
        """Whether messages of several publishers have come since the last check; call it at each.

        Without numbers that is assumed where there are several at two checks in a row.

        Args:
            publishers: how many are counted.
        """
        has_several = publishers > 1
        lasts = has_several and self._had_several and self._has_messages
        is_mixed = has_several and self._steps_back >= _BACK_AND_FORTH
        has_numbers = self._last is not None
        self._had_several = has_several
        self._has_messages, self._steps_back = False, 0
        return is_mixed if has_numbers else lasts

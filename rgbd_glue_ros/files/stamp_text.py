"""Stamps as text: decimal numbers of seconds, or of smaller units."""

from __future__ import annotations

from collections.abc import Sequence
from decimal import Decimal

from rgbd_glue_ros.types import NANOSECONDS
from rgbd_glue_ros.types.checks import END_OF_TIME_NS

# Upper limits of stamps in these units; today's stamps in each are a thousand times those in the
# previous
_SECONDS_BELOW, _MILLISECONDS_BELOW, _MICROSECONDS_BELOW = Decimal("9.2e9"), Decimal(10**14), 10**17


def stamps_ns(texts: Sequence[str]) -> list[int]:
    """Stamps of one file as nanoseconds, without passing through a float.

    Args:
        texts: decimal numbers of seconds, or of smaller units according to their magnitude.

    Raises:
        ValueError: a number is not finite, or exceeds 64 bits.
        ArithmeticError: a text is not a number.
    """
    numbers = [Decimal(text) for text in texts]
    if any(not number.is_finite() for number in numbers):
        raise ValueError("a stamp that is not finite")
    largest = max(map(abs, numbers), default=Decimal(0))
    # an exponent of a million would create a whole number of a million digits
    if largest >= END_OF_TIME_NS:
        raise ValueError("a stamp out of range")
    unit = _nanoseconds_of_unit(largest)
    return [int((number * unit).to_integral_value()) for number in numbers]


def _nanoseconds_of_unit(largest: Decimal) -> int:
    if largest < _SECONDS_BELOW:
        return NANOSECONDS
    if largest < _MILLISECONDS_BELOW:
        return NANOSECONDS // 10**3
    return NANOSECONDS // 10**6 if largest < _MICROSECONDS_BELOW else 1


def parse_stamp(text: str) -> int:
    """Nanoseconds from a decimal number of seconds, without passing through a float.

    A number too large for seconds is in milli-, micro- or nanoseconds, as in ``stamps_ns``.

    Raises:
        ValueError: the number is not finite.
        ArithmeticError: the text is not a number.
    """
    (stamp_ns,) = stamps_ns([text])
    return stamp_ns


def format_stamp(stamp_ns: int) -> str:
    """Seconds with nine decimals; ``parse_stamp`` gives the same nanoseconds back."""
    seconds, nanoseconds = divmod(abs(int(stamp_ns)), NANOSECONDS)
    return f"{'-' if stamp_ns < 0 else ''}{seconds}.{nanoseconds:09d}"

"""Axes of charts: positions of values, and which of them are labelled."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rgbd_glue_ros.types import Float64

_STEPS = (1.0, 2.0, 2.5, 5.0, 10.0)


@dataclass(frozen=True)
class Axis:
    """The mapping of values to an axis.

    Attributes:
        low: value at its start.
        high: value at its end.
        ticks: values and their labels.
        is_logarithmic: whether equal ratios have equal lengths, instead of equal differences.
    """

    low: float
    high: float
    ticks: tuple[tuple[float, str], ...]
    is_logarithmic: bool = False

    def at(self, values: Float64) -> Float64:
        """Fractions of the axis, also for values beyond its ends."""
        ends = np.array([self.low, self.high])
        if self.is_logarithmic:
            values, ends = np.log(np.maximum(values, 1e-300)), np.log(ends)
        return np.asarray((values - ends[0]) / ((ends[1] - ends[0]) or 1.0), np.float64)


def linear(low: float, high: float, unit: str = "", count: int = 6) -> Axis:
    """An axis with about ``count`` round ticks that ends where the values end."""
    values = [value for value in ticks(low, high, count) if value <= high]
    return Axis(low, high, tuple((value, f"{value:g}{unit}") for value in values))


def rising(highest: float, rows: int) -> Axis:
    """A y axis from zero that ends at the first tick above all values."""
    values = ticks(0.0, highest, rows)
    return Axis(0.0, values[-1] or 1.0, tuple((value, f"{value:g}") for value in values))


def symmetric(furthest: float, rows: int) -> Axis:
    """A y axis centred on zero that ends at the first tick beyond all values."""
    values = ticks(0.0, furthest, max(1, rows // 2))
    end = values[-1] or 1.0
    both = sorted({*values, *(-value for value in values)})
    return Axis(-end, end, tuple((value, f"{value:g}") for value in both))


def logarithmic(*values: float) -> Axis:
    """An axis from the first to the last of the values, which are its ticks."""
    return Axis(values[0], values[-1], tuple((v, f"{v:g}") for v in values), is_logarithmic=True)


def ticks(low: float, high: float, count: int = 6) -> list[float]:
    """Round numbers from ``low`` on until ``high`` is covered, about ``count`` of them."""
    if not high > low:
        return [low]
    rough = (high - low) / count
    power = 10.0 ** np.floor(np.log10(rough))
    step = next(s * power for s in _STEPS if s * power >= rough * (1 - 1e-9))
    first, last = np.ceil(low / step - 1e-9), np.ceil(high / step - 1e-9)
    return [float(f"{i * step:.12g}") for i in range(int(first), int(last) + 1)]

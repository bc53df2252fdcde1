"""Names of the errors of a registered pair in tables, charts and pages."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Metric:
    """Names of one error.

    Attributes:
        title: in full.
        short: for narrow columns.
        unit: in plain text.
        symbol: of the unit, in pages and charts.
    """

    title: str
    short: str
    unit: str
    symbol: str


METRICS = {
    "rotation_deg": Metric("Rotation", "rot.", "deg", "°"),
    "translation_cm": Metric("Translation", "trans.", "cm", "cm"),
    "chamfer_mm": Metric("Chamfer distance", "chamfer", "mm", "mm"),
}
"""By their names in ``pairs.json``."""

"""Places the names of dots in a picture, away from dots and other names."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

# Average width of letters of a proportional font, as a fraction of the font's size.
_LETTER = 0.58
_GAP = 4.0
# Maximum distance of a name above or below its dot, lines.
_ROWS = 6


@dataclass(frozen=True)
class Box:
    """An upright rectangle in pixels, y downward."""

    left: float
    top: float
    right: float
    bottom: float

    def overlap(self, other: Box) -> float:
        """The area of intersection."""
        width = min(self.right, other.right) - max(self.left, other.left)
        height = min(self.bottom, other.bottom) - max(self.top, other.top)
        return max(0.0, width) * max(0.0, height)

    def outside(self, frame: Box) -> float:
        """The area of this one that the frame does not cover."""
        return (self.right - self.left) * (self.bottom - self.top) - self.overlap(frame)


def placed(
    dots: Mapping[str, tuple[float, float]], radius: float, font_px: float, frame: Box
) -> dict[str, Box]:
    """A box for the name of every dot.

    Dots with the least room come first; of the places around a dot the first free one is used,
    otherwise the one with the least overlap.

    Args:
        dots: their positions, by name, pixels.
        radius: of a dot.
        font_px: size of the letters.
        frame: the area that names should not exceed.
    """
    taken = {
        name: Box(x - radius, y - radius, x + radius, y + radius) for name, (x, y) in dots.items()
    }
    found: dict[str, Box] = {}
    for name in sorted(dots, key=lambda n: -_crowd(dots, n)):
        x, y = dots[name]
        others = [box for other, box in taken.items() if other != name] + [*found.values()]
        candidates = _around(x, y, radius, _LETTER * font_px * len(name), font_px)
        found[name] = min(
            candidates,
            key=lambda box: sum(box.overlap(o) for o in others) + 10 * box.outside(frame),
        )
    return found


def _crowd(dots: Mapping[str, tuple[float, float]], name: str) -> float:
    x, y = dots[name]
    return sum(1 / (1 + (x - a) ** 2 + (y - b) ** 2) for a, b in dots.values())


def _around(x: float, y: float, radius: float, width: float, height: float) -> list[Box]:
    """Places right and left of a dot, above and below it, and then higher and lower."""
    away = radius + _GAP
    right, left = x + away, x - away - width
    places = [(right, y), (left, y), (x - width / 2, y - away - height / 2)]
    places.append((x - width / 2, y + away + height / 2))
    for rows in range(1, _ROWS):
        for middle in (y - rows * height, y + rows * height):
            places += [(right, middle), (left, middle)]
    return [Box(at, y - height / 2, at + width, y + height / 2) for at, y in places]

"""Colours that tell many lines of one chart apart."""

from __future__ import annotations

CSS = """
:root { --c0: #1d5fd1; --c1: #c2620a; --c2: #1a8f5a; --c3: #8a4bd0; --c4: #cf2f3c; --c5: #0f8b9d;
  --c6: #d04c97; --c7: #8b6f14; --c8: #5d6b7b; --c9: #5a8f1e; }
@media (prefers-color-scheme: dark) { :root { --c0: #6aa5ff; --c1: #f0963c; --c2: #35b57c;
  --c3: #b58cf0; --c4: #f0626c; --c5: #3fc3d6; --c6: #f07fc0; --c7: #d1b04a; --c8: #93a1b1;
  --c9: #93cc4e; } }
"""
_COLORS = 10


def look(i: int) -> tuple[str, str]:
    """Colour and style of the i-th line; a page that uses it has ``CSS``."""
    return f"var(--c{i % _COLORS})", "dashed" if i >= _COLORS else "" if i else "thick"

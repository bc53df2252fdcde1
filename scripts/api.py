"""Writes docs/api.md from the docstrings of the public names: ``python scripts/api.py``."""

from __future__ import annotations

import enum
import inspect
import re
from collections.abc import Iterator
from pathlib import Path
from textwrap import dedent
from typing import Any

import rgbd_glue_ros

PAGE = Path(__file__).resolve().parents[1] / "docs" / "api.md"
_HEAD = """\
# The library

What `from rgbd_glue_ros import ...` provides; the rest of the package may change. `T_a_b` maps
points in frame b to frame a; metres, radians and seconds; stamps in whole nanoseconds. `Float64`,
`Float32`, `Int64` and `UInt8` are NumPy arrays of that type. Written by `python scripts/api.py`
from the docstrings; `examples/` shows how to use them.
"""
_WIDTH = 90
_KINDS = (
    ("Functions", inspect.isfunction),
    ("Classes", inspect.isclass),
)
_SECTION = re.compile(
    r"^(Args|Attributes|Raises|Returns|Yields):\n((?: {4}.*\n|\n)+)", re.MULTILINE
)
_ENTRY = re.compile(r"^(\w[\w., ]*): ")


def markdown() -> str:
    """The page."""
    parts = [_HEAD]
    public = {name: getattr(rgbd_glue_ros, name) for name in sorted(rgbd_glue_ros.__all__)}
    for title, is_kind in _KINDS:
        some = {name: thing for name, thing in public.items() if is_kind(thing)}
        links = ", ".join(f"[`{name}`](#{name.lower()})" for name in some)
        parts.append(f"## {title}\n\n{links}\n")
        parts += [_described(name, thing) for name, thing in some.items()]
    return "\n".join(parts)


def _described(name: str, thing: Any) -> str:
    lines = [f"### {name}", "", *_signature(name, thing), _text(thing)]
    if inspect.isclass(thing):
        lines += _members(thing)
    return "\n".join(lines)


def _signature(name: str, thing: Any) -> list[str]:
    # an enumeration and an exception are made by nobody else
    if inspect.isclass(thing) and issubclass(thing, (enum.Enum, Exception)):
        return []
    return ["```python", _call(name, thing), "```", ""]


def _call(name: str, thing: Any) -> str:
    signature = inspect.signature(thing)
    given = [_parameter(p) for p in signature.parameters.values() if p.name != "self"]
    back = signature.return_annotation
    end = "" if back in (inspect.Signature.empty, "None", None) else f" -> {back}"
    line = f"{name}({', '.join(given)}){end}"
    if len(line) <= _WIDTH:
        return line
    return f"{name}(\n" + "".join(f"    {text},\n" for text in given) + f"){end}"


def _parameter(parameter: inspect.Parameter) -> str:
    stars: dict[Any, str] = {
        inspect.Parameter.VAR_POSITIONAL: "*",
        inspect.Parameter.VAR_KEYWORD: "**",
    }
    text = f"{stars.get(parameter.kind, '')}{parameter.name}: {parameter.annotation}"
    default = parameter.default
    if default is inspect.Parameter.empty:
        return text
    # of some defaults the name in memory says nothing
    is_named = isinstance(default, enum.Enum)
    shown = f"{type(default).__name__}.{default.name}" if is_named else repr(default)
    return f"{text} = {'...' if shown.startswith('<') else shown}"


def _members(kind: type[Any]) -> Iterator[str]:
    """The public methods and properties of a class itself, and the members of an enumeration."""
    if issubclass(kind, enum.Enum):
        yield "Members: " + ", ".join(f"`{member.name}`" for member in kind) + "\n"
        return
    for name, member in vars(kind).items():
        if name.startswith("_"):
            continue
        if isinstance(member, property):
            yield f"**`.{name}`** (property): {_text(member)}"
        elif isinstance(member, (staticmethod, classmethod)) or inspect.isfunction(member):
            function = getattr(kind, name)
            yield f"**`.{_inline(name, function)}`**: {_text(function)}"


def _inline(name: str, function: Any) -> str:
    return " ".join(_call(name, function).split()).replace("( ", "(").replace(", )", ")")


def _text(thing: Any) -> str:
    """A docstring, its sections as lists."""
    doc = (inspect.getdoc(thing) or "") + "\n"
    text = _SECTION.sub(lambda m: f"*{m[1]}*\n\n{_section(m[1], m[2])}\n", doc)
    return text.replace("``", "`").rstrip("\n") + "\n"


def _section(title: str, block: str) -> str:
    """The entries of a section as a list; what is returned has no name, and is one sentence."""
    if title == "Returns":
        return " ".join(block.split()) + "\n"
    entries: list[str] = []
    for line in dedent(block).splitlines():
        if line.startswith(" ") and entries:
            entries[-1] += f" {line.strip()}"
        elif line.strip():
            entries.append(line)
    named = [_ENTRY.sub(r"`\1`: ", entry) for entry in entries]
    return "".join(f"- {entry}\n" for entry in named)


if __name__ == "__main__":
    PAGE.write_text(markdown(), encoding="utf-8")

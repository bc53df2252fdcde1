"""YAML of any origin: a file of a kilobyte that expands to a billion values is refused."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import yaml

MAX_TEXT = 2**20
"""Bytes of a YAML file; a calibration has a thousand."""

_MAX_DEPTH = 64
_MAX_NODES = 100_000


class BoundedLoader(yaml.SafeLoader):
    """Counts aliases as if they were expanded, and limits the nesting of values."""

    def __init__(self, text: str) -> None:
        super().__init__(text)
        self._depth = 0
        self._nodes = 0
        self._sizes: dict[str, int] = {}

    def compose_node(self, parent: Any, index: Any) -> Any:
        """As in PyYAML, within limits."""
        event: yaml.NodeEvent = self.peek_event()  # type: ignore[no-untyped-call]
        is_alias = isinstance(event, yaml.AliasEvent)
        if is_alias:
            # an alias inside its own target has no size yet, and would be endless
            self._nodes += self._sizes.get(event.anchor or "", _MAX_NODES)
        before = self._nodes
        self._nodes += 1
        self._depth += 1
        if self._depth > _MAX_DEPTH or self._nodes > _MAX_NODES:
            raise yaml.YAMLError(
                f"more than {_MAX_NODES} values, or nested deeper than {_MAX_DEPTH}"
            )
        node = super().compose_node(parent, index)
        self._depth -= 1
        if event.anchor is not None and not is_alias:
            self._sizes[event.anchor] = self._nodes - before
        return node

    def compose_mapping_node(self, anchor: Any) -> yaml.MappingNode:
        """As in PyYAML, but duplicate keys are refused, since it is unclear which value counts."""
        node: yaml.MappingNode = super().compose_mapping_node(anchor)
        lines: dict[tuple[str, str], int] = {}
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode):
                continue
            name, line = (key.tag, key.value), key.start_mark.line + 1
            if name in lines:
                raise yaml.YAMLError(
                    f"line {line}: {key.value} is also given in line {lines[name]}"
                )
            lines[name] = line
        return node


def documents(text: str, loader: type[BoundedLoader] = BoundedLoader) -> Iterator[Any]:
    """The values of every document in a text.

    Raises:
        yaml.YAMLError: the text is not YAML, or exceeds the limits.
    """
    if len(text) > MAX_TEXT:
        raise yaml.YAMLError(f"more than {MAX_TEXT} characters")
    try:
        yield from yaml.load_all(text, loader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        line = f"line {mark.line + 1}: " if mark else ""
        raise yaml.YAMLError(f"{line}{error.problem or error.context}") from error
    except (ValueError, OverflowError, RecursionError, AttributeError) as error:
        # what PyYAML does not catch: invalid dates, numbers of a million digits
        raise yaml.YAMLError(f"an invalid value ({error})") from error


def document(text: str) -> Any:
    """The values of a text of one document; None if it is empty.

    Raises:
        yaml.YAMLError: the text is not YAML, has several documents, or exceeds the limits.
    """
    found = list(documents(text))
    if len(found) > 1:
        raise yaml.YAMLError(f"{len(found)} documents instead of one")
    return found[0] if found else None

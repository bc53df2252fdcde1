"""What was warned of during a run, for its report: nobody keeps a terminal."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager

_PACKAGE = __name__.partition(".")[0]
# A recording with thousands of damaged files warns thousands of times.
_MOST = 100


class _Listener(logging.Handler):
    def __init__(self, heard: list[str]) -> None:
        super().__init__(logging.WARNING)
        self._heard = heard

    def emit(self, record: logging.LogRecord) -> None:
        text = record.getMessage()
        if text not in self._heard and len(self._heard) < _MOST:
            self._heard.append(text)


class _Naming(logging.Filter):
    def __init__(self, name: str) -> None:
        super().__init__()
        self._name = name

    def filter(self, record: logging.LogRecord) -> bool:
        text = record.getMessage()
        if record.name.startswith(_PACKAGE) and self._name not in text:
            record.msg, record.args = f"{self._name}: {text}", ()
        return True


class _Once(logging.Filter):
    def __init__(self) -> None:
        super().__init__()
        self._said: set[str] = set()

    def filter(self, record: logging.LogRecord) -> bool:
        if not record.name.startswith(_PACKAGE):
            return True
        text = record.getMessage()
        is_new = text not in self._said
        if len(self._said) < _MOST:
            self._said.add(text)
        return is_new


@contextmanager
def said_once() -> Iterator[None]:
    """Shows what this package logs meanwhile once: a recording may be opened again and again."""
    with _filtered(_Once):
        yield


@contextmanager
def named_warnings(name: str) -> Iterator[None]:
    """Puts a name before what this package logs meanwhile: of many recordings, which is meant."""
    with _filtered(lambda: _Naming(name)):
        yield


@contextmanager
def _filtered(by: Callable[[], logging.Filter]) -> Iterator[None]:
    filters = [(handler, by()) for handler in logging.getLogger().handlers]
    for handler, each in filters:
        handler.addFilter(each)
    try:
        yield
    finally:
        for handler, each in filters:
            handler.removeFilter(each)


@contextmanager
def heard_warnings(heard: list[str] | None = None) -> Iterator[list[str]]:
    """Collects what this package warns of meanwhile, from any thread, each text once.

    Args:
        heard: the list that it is added to, and that the ``with`` gives; None for a new one.
    """
    heard = [] if heard is None else heard
    listener = _Listener(heard)
    package = logging.getLogger(_PACKAGE)
    package.addHandler(listener)
    try:
        yield heard
    finally:
        package.removeHandler(listener)

"""Compilation of the inner loops to machine code."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

from numba import njit

from rgbd_glue_ros.code_cache import CodeCache

F = TypeVar("F", bound=Callable[..., Any])


def compiled(function: F) -> F:
    """The function as machine code, which takes and returns plain arrays and numbers.

    It is compiled when first called and cached on disk, lets other Python threads run, and divides
    by zero as in IEEE 754, without a check. Sums keep their written order: otherwise their last
    digits would differ between newly compiled code and code from disk.
    """
    dispatcher: Any = njit(nogil=True, error_model="numpy")(function)
    if hasattr(dispatcher, "enable_caching"):  # else NUMBA_DISABLE_JIT is set
        dispatcher._cache = CodeCache(function)  # noqa: SLF001 - as cache=True does it
    return cast(F, dispatcher)


def inlined(function: F) -> F:
    """A function that is inlined into compiled ones: what is done at every point."""
    return cast(F, njit(inline="always", error_model="numpy")(function))

"""How the inner loops become machine code."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

from numba import njit

from rgbd_glue_ros.code_cache import CodeCache

F = TypeVar("F", bound=Callable[..., Any])


def compiled(function: F) -> F:
    """The function as machine code, which takes and gives plain arrays and numbers.

    It is compiled when it is first called and kept on disk, lets other Python threads run, and
    divides by zero as IEEE 754 has it, without a check. Sums are taken in the order written: left
    to the compiler, their last digits differ between code just compiled and code from disk.
    """
    dispatcher: Any = njit(nogil=True, error_model="numpy")(function)
    if hasattr(dispatcher, "enable_caching"):  # else NUMBA_DISABLE_JIT is set
        dispatcher._cache = CodeCache(function)  # noqa: SLF001 - as cache=True does it
    return cast(F, dispatcher)


def inlined(function: F) -> F:
    """A part of compiled functions that is put into each of them: what is done at every point."""
    return cast(F, njit(inline="always", error_model="numpy")(function))

"""How the inner loops become machine code."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar, cast

from numba import njit

F = TypeVar("F", bound=Callable[..., Any])


def compiled(function: F) -> F:
    """The function as machine code, which takes and gives plain arrays and numbers.

    It is compiled when it is first called and kept on disk, lets other Python threads run, and
    divides by zero as IEEE 754 has it, without a check. Sums are taken in the order written: left
    to the compiler, their last digits differ between code just compiled and code from disk.
    """
    return cast(F, njit(cache=True, nogil=True, error_model="numpy")(function))


def inlined(function: F) -> F:
    """A part of compiled functions that is put into each of them: what is done at every point."""
    return cast(F, njit(inline="always", error_model="numpy")(function))


def forget_stale_code(package: Path) -> None:
    """Removes the indices of compiled code that are older than a source beside it.

    An index names the types that its functions take; one that a newer version has not got any more
    ends in an error that says nothing, where compiling anew would do.
    """
    for cache in package.rglob("__pycache__"):
        with suppress(OSError):  # what cannot be removed cannot be written either
            newest = max((p.stat().st_mtime for p in cache.parent.glob("*.py")), default=0.0)
            for index in cache.glob("*.nbi"):
                if index.stat().st_mtime < newest:
                    index.unlink(missing_ok=True)


forget_stale_code(Path(__file__).parent)

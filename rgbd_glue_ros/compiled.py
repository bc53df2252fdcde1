"""How the inner loops become machine code."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

from numba import njit

F = TypeVar("F", bound=Callable[..., Any])


def compiled(function: F) -> F:
    """The function as machine code, which takes and gives plain arrays and numbers.

    It is compiled when it is first called and kept on disk, lets other Python threads run, and
    divides by zero as IEEE 754 has it, without a check.
    """
    return cast(F, njit(cache=True, nogil=True, error_model="numpy")(function))


def compiled_sums(function: F) -> F:
    """The same, where sums may be taken in any order and be fused with products.

    A fifth faster where many are taken. The last digits then depend on the processor.
    """
    faster = {"reassoc", "contract", "arcp", "nsz"}
    return cast(F, njit(cache=True, nogil=True, error_model="numpy", fastmath=faster)(function))


def inlined(function: F) -> F:
    """A part of compiled functions that is put into each of them: what is done at every point."""
    return cast(F, njit(inline="always", error_model="numpy")(function))

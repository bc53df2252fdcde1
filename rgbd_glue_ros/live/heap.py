"""Memory settings of a process that handles frames for hours, so that no frame waits for them."""

from __future__ import annotations

import ctypes
import gc

# <malloc.h>
_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD, _M_ARENA_MAX = -1, -3, -8
# The largest value that glibc accepts: larger blocks return to the system when they are freed.
_LARGEST_BLOCK = 32 * 2**20
# How much may be free at the end of the heap before it returns to the system.
_KEPT = 8 * _LARGEST_BLOCK


def keep_freed_memory() -> None:
    """Makes glibc keep freed memory for reuse; must be called before threads start.

    By default each thread has its own heap, which returns large blocks to the system as soon as
    they are free. The next image then causes a page fault for every 4 kB: at 1920x1080, that is
    3 ms of processor time per frame, in which no other Python thread of the process runs. With
    another C library this does nothing.
    """
    try:
        set_option = ctypes.CDLL(None).mallopt
    except (AttributeError, TypeError):  # another C library, or another system
        return
    set_option(_M_ARENA_MAX, 1)
    set_option(_M_MMAP_THRESHOLD, _LARGEST_BLOCK)
    set_option(_M_TRIM_THRESHOLD, _KEPT)


def exempt_loaded_objects() -> None:
    """Exempts all current objects from later garbage collections.

    Modules, ROS and compiled code leave 150,000 of them. A full collection would take 60 ms for
    them, in which no frame is processed. Later objects are collected as usual, in a few ms.
    """
    gc.collect()
    gc.freeze()

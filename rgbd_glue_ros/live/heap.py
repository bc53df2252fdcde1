"""The memory of a process that takes frames for hours, so that no frame waits for it."""

from __future__ import annotations

import ctypes
import gc

# <malloc.h>
_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD, _M_ARENA_MAX = -1, -3, -8
# The greatest that glibc takes: larger blocks are the system's own again when they are freed.
_LARGEST_BLOCK = 32 * 2**20
# What may lie free at the end of the heap before it is given back.
_KEPT = 8 * _LARGEST_BLOCK


def keep_freed_memory() -> None:
    """Lets this process use what it freed again; before it starts threads, and with glibc alone.

    By default each thread has a heap of its own, which gives large blocks back to the system as
    soon as they are free. The next image then costs a page fault for every 4 kB: at 1920x1080, that
    is 3 ms of processor time a frame, in which no other Python thread of the process runs.
    """
    try:
        set_option = ctypes.CDLL(None).mallopt
    except (AttributeError, TypeError):  # another C library, or another system
        return
    set_option(_M_ARENA_MAX, 1)
    set_option(_M_MMAP_THRESHOLD, _LARGEST_BLOCK)
    set_option(_M_TRIM_THRESHOLD, _KEPT)


def exempt_loaded_objects() -> None:
    """Exempts all objects that exist now from later garbage collections.

    Modules, ROS and compiled code leave 150,000 of them, through which a full collection takes
    60 ms, in which no frame is processed. Later objects are collected as before, in a few ms.
    """
    gc.collect()
    gc.freeze()

"""Whether the machine has the shared memory that the DDS profile takes for images."""

from __future__ import annotations

import re
from pathlib import Path

SHARED_MEMORY = Path("/dev/shm")  # noqa: S108 - it is where DDS has its memory
# Processes with a segment each: the driver's and the node's.
_PROCESSES = 2
_SEGMENT = re.compile(r"<segment_size>\s*(\d+)\s*</segment_size>")


def explain_shared_memory(profiles: str, size_bytes: int) -> str | None:
    """That /dev/shm is too small for a profile; None where it is not.

    Args:
        profiles: the XML of the DDS profiles that are in use; "" for none.
        size_bytes: of /dev/shm.
    """
    found = _SEGMENT.search(profiles)
    needed = _PROCESSES * int(found[1]) if found else 0
    if size_bytes >= needed:
        return None
    return (
        f"{SHARED_MEMORY} holds {size_bytes / 2**20:.0f} MB, and by the DDS profile each process "
        f"that publishes or receives images takes {needed / _PROCESSES / 2**20:.0f} MB: images "
        "will be sent by the network, cut up and lost. Start the container with --shm-size=256m, "
        "or with --ipc=host"
    )

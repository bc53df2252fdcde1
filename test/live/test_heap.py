"""Images of a frame lie where those of the frame before lay."""

from __future__ import annotations

import subprocess
import sys

import pytest

# In a process of its own: what is set stays set.
PROGRAM = """
import sys
import threading
from array import array
from resource import RUSAGE_THREAD, getrusage

from rgbd_glue_ros.live.heap import keep_freed_memory

if "keep" in sys.argv:
    keep_freed_memory()


def frames(count):
    # as rclpy makes images of messages
    color, depth = array("B"), array("B")
    for _ in range(count):
        color, depth = array("B"), array("B")
        color.frombytes(bytes(1920 * 1080 * 3))
        depth.frombytes(bytes(1920 * 1080 * 2))


def count_faults():
    frames(3)
    before = getrusage(RUSAGE_THREAD).ru_minflt
    frames(10)
    print(getrusage(RUSAGE_THREAD).ru_minflt - before)


thread = threading.Thread(target=count_faults)
thread.start()
thread.join()
"""


def page_faults(*arguments: str) -> int:
    """Of a thread that makes the images of ten frames, one after the other."""
    command = [sys.executable, "-c", PROGRAM, *arguments]
    return int(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


@pytest.mark.skipif(sys.platform != "linux", reason="sets what glibc alone has")
def test_a_thread_that_allocates_images_for_every_frame_reuses_memory() -> None:
    assert page_faults("keep") < 100 < page_faults()


COLLECTIONS = """
import gc

from rgbd_glue_ros.live.heap import exempt_loaded_objects

loaded = [[] for _ in range(100_000)]
exempt_loaded_objects()
# what a full collection still goes through
print(len(gc.get_objects()), gc.get_freeze_count())
cycle = []
cycle.append(cycle)
del cycle
print(gc.collect())
"""


def test_loaded_objects_are_left_out_of_collections_and_later_garbage_is_collected() -> None:
    command = [sys.executable, "-c", COLLECTIONS]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    left, exempt, collected = map(int, done.stdout.split())
    assert left < 1000
    assert exempt > 100_000
    assert collected == 1

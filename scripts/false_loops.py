"""Counts loops between different rooms: ``python scripts/false_loops.py RECORDING RECORDING...``.

Views of every recording are compared with those of all others by the rules of ``rgbd-glue map``,
whatever they look like: appearance alone would leave out most of them. None should be taken for
the same place.
"""

from __future__ import annotations

import sys
from itertools import combinations
from pathlib import Path

import numpy as np

from rgbd_glue_ros.geometry.views import view_of
from rgbd_glue_ros.parameters import load_preset
from rgbd_glue_ros.recordings import open_recording
from rgbd_glue_ros.registration.glue import Glue
from rgbd_glue_ros.slam.loop_closure import loop_edge
from rgbd_glue_ros.slam.map_keyframe import MapKeyframe

VIEWS = 6


def keyframes_of(source: Path, glue: Glue) -> list[MapKeyframe]:
    """Views of a recording, evenly spread."""
    config = load_preset("live")
    with open_recording(source) as recording:
        rows = np.linspace(0, recording.frame_count - 1, VIEWS).astype(int).tolist()
        return [
            MapKeyframe.seen(
                number, frame.stamp_ns, np.eye(4), view_of(frame, config.camera), glue, config
            )
            for number, frame in enumerate(recording.select(rows))
        ]


def main(sources: list[Path]) -> int:
    """Prints what is taken for the same place, and returns 1 if anything is."""
    config = load_preset("live")
    glue = Glue(config)
    rooms = {source: keyframes_of(source, glue) for source in sources}
    compared, accepted = 0, 0
    for one, other in combinations(sources, 2):
        for parent in rooms[one]:
            for child in rooms[other]:
                compared += 1
                # a graph that is wrong would have the camera where the other one was
                if loop_edge(parent, child, glue, config, np.eye(4)) is not None:
                    accepted += 1
                    print(f"false: view {parent.row} of {one}, view {child.row} of {other}")
    print(f"{compared} pairs of views of different rooms, {accepted} taken for the same place")
    return int(accepted > 0)


if __name__ == "__main__":
    sys.exit(main([Path(word) for word in sys.argv[1:]]))

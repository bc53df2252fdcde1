"""The script that takes the parts of the method away, on a few frames of the bundled recording."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import make_bag
import pytest
from rigs.bag_frames import write_small_bag
from rigs.paths import ROOT


@pytest.mark.slow
def test_with_any_part_removed_the_rest_still_tracks(tmp_path: Path) -> None:
    bag = write_small_bag(tmp_path / "bag", make_bag.FRAME_COUNT)
    program = str(ROOT / "scripts" / "ablation.py")
    command = [sys.executable, program, str(bag), "--every", "10"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    lines = [
        [cell.strip() for cell in line.strip("|").split("|")] for line in done.stdout.splitlines()
    ]
    errors = {line[0]: line[1] for line in lines[:12] if len(line) == 3}
    assert {"whole", "no visual features", "no filter", "no prediction"} <= {*errors}
    assert float(errors["whole"]) < 1.0
    # every frame but the first, which starts the map, has its pose in one of four ways
    counts = next(line for line in lines if len(line) == 5 and line[1].isdigit())
    assert sum(map(int, counts[1:])) == 10

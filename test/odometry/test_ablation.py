"""The script that takes the parts of the method away, on a few frames of the bundled recording."""

from __future__ import annotations

import subprocess
import sys

import pytest
from rigs.paths import ROOT

from rgbd_glue_ros.experiments.demo.demo import bundled_bag


@pytest.mark.slow
def test_with_any_part_removed_the_rest_still_tracks() -> None:
    program = str(ROOT / "scripts" / "ablation.py")
    command = [sys.executable, program, str(bundled_bag()), "--every", "10"]
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

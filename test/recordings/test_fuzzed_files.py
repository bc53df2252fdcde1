"""Files that are damaged at random: whatever reads them ends with code 0 or 2, and in one line.

Every day has a seed of its own, which is printed. ``RGBD_GLUE_FUZZ_SEED`` gives another one.
``RGBD_GLUE_FUZZ_S=3600`` takes an hour.
"""

from __future__ import annotations

import os
import shutil
import time
from collections import Counter
from datetime import datetime, timezone
from pathlib import Path

import numpy as np
import pytest
from rigs.file_fuzzer import BAD_INPUT, OK, Outcome, kinds, tried

SECONDS = float(os.environ.get("RGBD_GLUE_FUZZ_S", "15"))
TODAY = datetime.now(timezone.utc).date().toordinal()
SEED = int(os.environ.get("RGBD_GLUE_FUZZ_SEED", str(TODAY)))


@pytest.mark.slow
def test_whatever_is_damaged_ends_with_code_0_or_2_and_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    made = kinds(tmp_path / "whole")
    for name, kind in made.items():
        out = tmp_path / "out"
        out.mkdir()
        assert kind.read(kind.path, out) == OK, name
        shutil.rmtree(out)
    names = sorted(made)
    outcomes: list[Outcome] = []
    end = time.monotonic() + SECONDS
    while time.monotonic() < end:
        number = len(outcomes)
        random = np.random.default_rng([SEED, number])
        name = names[number % len(names)]
        folder = tmp_path / f"{number}"
        outcomes.append(tried(name, made[name], folder, random))
        if not outcomes[-1].fault:
            shutil.rmtree(folder)
    codes = Counter(outcome.code for outcome in outcomes)
    with capsys.disabled():
        print(f"\n{len(outcomes)} damaged files of seed {SEED}, codes {dict(codes)}", end=" ")  # noqa: T201
    faults = [
        f"RGBD_GLUE_FUZZ_SEED={SEED}, number {number} ({outcome.damage}) "
        f"{outcome.fault}:\n{outcome.said}"
        for number, outcome in enumerate(outcomes)
        if outcome.fault
    ]
    assert not faults, "\n".join(faults[:20])
    assert codes[BAD_INPUT] > len(outcomes) / 10
    assert codes[OK] > len(outcomes) / 10

"""The bar of a run: what is shown before the first frame, and the rate of frames."""

from __future__ import annotations

import time

import pytest

from rgbd_glue_ros.cli import progress
from rgbd_glue_ros.types import OdometryEstimate, TrackingState


def shown_by(monkeypatch: pytest.MonkeyPatch) -> list[progress._Bar]:
    """The bars that are made, which are drawn although nobody looks."""
    made: list[progress._Bar] = []

    def bar(unit: str, total: int) -> progress._Bar:
        made.append(progress._Bar(total=total, unit=unit, ncols=150, disable=False))
        return made[-1]

    monkeypatch.setattr(progress, "bar", bar)
    return made


def test_compiling_is_told_and_takes_no_part_in_the_rate(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    made = shown_by(monkeypatch)
    monkeypatch.setattr(progress, "_WARM_S", 0.0)
    with progress.tracking_bar(3) as show:
        deadline = time.monotonic() + 10
        while made[0].postfix != progress._COMPILING:
            assert time.monotonic() < deadline
            time.sleep(0.01)
        began = made[0].start_t
        show(OdometryEstimate(0, TrackingState.TRACKING, None))
        assert made[0].start_t > began
        assert (made[0].n, made[0].postfix) == (1, "tracking")
        after = made[0].start_t
        show(OdometryEstimate(1, TrackingState.TRACKING, None))
        assert (made[0].n, made[0].start_t) == (2, after)
    assert "compiling, once after installation (about a minute)" in capsys.readouterr().err


def test_a_warm_start_is_not_called_compiling(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    shown_by(monkeypatch)
    with progress.tracking_bar(1) as show:
        show(OdometryEstimate(0, TrackingState.TRACKING, None))
    said = capsys.readouterr().err
    assert "warming up" in said
    assert "compiling" not in said

"""Pictures of moments of a run: its keyframes, and its worst moments."""

from __future__ import annotations

import base64
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from rgbd_glue_ros.evaluation.trajectory_errors import Evaluation
from rgbd_glue_ros.experiments.replay.run_record import FrameRecord, Run
from rgbd_glue_ros.experiments.report.escaping import escape
from rgbd_glue_ros.types import NANOSECONDS, TrackingState

CSS = """
.strip { display: grid; grid-template-columns: repeat(auto-fill, minmax(8.5rem, 1fr)); gap: .9rem; }
.strip figure { margin: 0; }
.strip img { display: block; width: 100%; border-radius: 6px; background: var(--card); }
.strip figcaption { font-size: .78rem; line-height: 1.35; margin-top: .3rem; color: var(--quiet); }
.strip figcaption b { color: var(--text); font-weight: 600; }
"""

_KEYFRAMES = 12
_LOST = 3
# a picture of another moment shows something else
_NEAR_NS = NANOSECONDS // 2


@dataclass(frozen=True)
class Moment:
    """A time, and a text about it."""

    stamp_ns: int
    said: str


def moments(run: Run, evaluation: Evaluation | None) -> list[str]:
    """The sections with pictures; none if the run kept none."""
    if not run.thumbnails:
        return []
    marked = [frame for frame in run.frames if frame.is_keyframe]
    count = min(_KEYFRAMES, len(marked))
    chosen = np.linspace(0, len(marked) - 1, count).astype(int).tolist()
    some = [Moment(marked[i].stamp_ns, f"number {i}") for i in chosen]
    shown = "" if len(chosen) == len(marked) else f", {len(chosen)} of {len(marked)}"
    sections = {
        "Worst moments": _strip(run, list(worst(run.frames, evaluation))),
        f"Keyframes{shown}": _strip(run, some),
    }
    return [f"<h2>{title}</h2>{strip}" for title, strip in sections.items() if strip]


def worst(frames: Sequence[FrameRecord], evaluation: Evaluation | None) -> Iterator[Moment]:
    """Where tracking was lost, where the error is largest, matches are fewest, a frame slowest."""
    before = TrackingState.INITIALIZING
    losses = []
    for frame in frames:
        if frame.state is TrackingState.LOST and before is not TrackingState.LOST:
            losses.append(Moment(frame.stamp_ns, "lost"))
        before = frame.state
    yield from losses[:_LOST]
    if evaluation is not None:
        row = int(np.argmax(evaluation.errors_m))
        error = f"largest error, {100 * evaluation.errors_m[row]:.1f} cm"
        yield Moment(int(evaluation.stamps_ns[row]), error)
    for name, said in (
        ("visual_inliers", "fewest visual inliers, {}"),
        ("credible", "fewest geometric matches, {}"),
    ):
        known = [(getattr(f, name), f.stamp_ns) for f in frames if getattr(f, name) is not None]
        if known:
            fewest, stamp_ns = min(known)
            yield Moment(stamp_ns, said.format(fewest))
    if len(frames) > 1:
        # the first frame also creates the keyframe and buffers
        slowest = max(frames[1:], key=lambda frame: frame.latency_ms)
        yield Moment(slowest.stamp_ns, f"slowest, {slowest.latency_ms:.0f} ms")


def _strip(run: Run, shown: Sequence[Moment]) -> str:
    """Pictures with captions, in order of time, possibly several per picture; "" without any."""
    stamps = np.array(sorted(run.thumbnails), np.int64)
    said: dict[int, list[str]] = {}
    for moment in sorted(shown, key=lambda m: m.stamp_ns):
        nearest = int(stamps[np.argmin(np.abs(stamps - moment.stamp_ns))])
        if abs(nearest - moment.stamp_ns) <= _NEAR_NS:
            said.setdefault(nearest, []).append(moment.said)
    figures = []
    for stamp_ns, words in said.items():
        seconds = (stamp_ns - run.frames[0].stamp_ns) / NANOSECONDS
        jpeg = base64.b64encode(run.thumbnails[stamp_ns]).decode()
        text = escape("; ".join(dict.fromkeys(words)))
        figures.append(
            f'<figure data-at="{seconds:.2f}"><img src="data:image/jpeg;base64,{jpeg}" '
            f'alt="{text}" /><figcaption><b>{seconds:.1f} s</b> {text}</figcaption></figure>'
        )
    return f'<div class="strip">{"".join(figures)}</div>' if figures else ""

"""``bench.md`` from the content of ``bench.json``."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rgbd_glue_ros.experiments.bench.contest import OURS
from rgbd_glue_ros.experiments.bench.floors import FLOORS
from rgbd_glue_ros.experiments.bench.picture import PICTURE
from rgbd_glue_ros.experiments.report.escaping import markdown
from rgbd_glue_ros.experiments.report.markdown import NOTHING, bullets, number, table
from rgbd_glue_ros.printable import printable

_Figures = Mapping[str, Any]

PIP = "pip install"

_CONTEST = """\
All methods process each frame before any gets the next, starting with a different one each time.
Peers are run as plain frame-to-frame odometry: no keyframe, no motion model, no prior, at the
settings in their documentation; a frame that a peer cannot register has no pose, and the next is
registered to the last one with a pose. A peer that is too slow is measured on the frames that it
completed in its time, and has no APE, which grows with the path. Times are from a frame in memory
to its pose: median and 95th percentile on the wall clock, and the median of the processor time of
all threads, which other work on the machine disturbs less. APE is after SE(3) alignment, RPE over
one second, both rmse."""

_BUSY = """ **That is more than the number of cores: wall-clock times and drops of
the node say more about the other processes than about these.**"""

_STAGES = """\
Median milliseconds of each stage of this odometry, and its floor: the cost of its core in C++ on
frames of the same run (least of three in a row, on every fiftieth frame). Refinement and geometric
features run on a second thread in parallel with visual features and registration, so that the
stages add up to more than a frame; geometric matching includes the wait for these features. If a
floor is above the stage, the stage is faster than that library."""

_HONESTY = """\
Normalised error (NEES) of the transform from every frame to its keyframe: its mean is 6 if the
covariance is consistent, larger if it is overconfident, smaller if it is too cautious. It includes
the error of the ground truth."""

_ROBUSTNESS = """\
The odometry on degraded versions of the same recordings. Longest: seconds between two poses with
tracking lost in between. Restarts: starts at the last known pose after being lost for long."""

_LIVE = """\
The recording as raw images, published at its own rate by another process over DDS to the node
with the same parameters. Latency is from the receipt of a frame's last message to the publication
of its pose; round trip: from publication of the images until the pose is back at the publisher.
Ready: from the start of the node's process until it has subscribed."""

_MEMORY = """\
Memory first grows, as the map of keyframes and the caches of libraries fill, and then stays:
`docs/robustness.md` has figures of a hundred thousand frames."""


def to_markdown(figures: _Figures) -> str:
    """The page."""
    sequences: _Figures = figures["sequences"]
    parts = ["# Benchmarks", _header(figures)]
    for title, text, body in (
        ("Error and time", _CONTEST, _contests(sequences, figures["not_installed"])),
        ("Stages and their floors", _STAGES, _stages(sequences)),
        ("Consistency of the covariance", _HONESTY, _honesty(sequences)),
        ("Robustness", _ROBUSTNESS, _robustness(sequences)),
        ("The node over DDS", _LIVE, _live(sequences)),
        ("Memory", _MEMORY, _memory(figures)),
    ):
        if body:
            parts += [f"## {title}", text, body]
    if figures["problems"]:
        parts += ["## Skipped", bullets(figures["problems"])]
    return "\n\n".join(parts) + "\n"


def _header(figures: _Figures) -> str:
    machine = figures["machine"]
    versions = ", ".join(f"{name} {version}" for name, version in machine["versions"].items())
    busy = max(figures["load"]) > machine["cores"] + 1
    load = " to ".join(f"{value:.1f}" for value in figures["load"])
    written = f"{figures['begun']}, in {_duration(figures['minutes'])}"
    return f"""\
Written {written}, by

```
{printable(figures["command"])}
```

on {machine["cores"]} cores of {machine["processor"]}, {machine["memory_gb"]} GB, \
{machine["system"]}, Python {machine["python"]}; {versions}. \
Runnable processes on the whole machine, over a minute: {load}; niceness of these \
{machine["niceness"]}.{_BUSY if busy else ""}

The peers are those of the extra `bench`; `scripts/bench` installs them and runs everything."""


def _duration(minutes: float) -> str:
    return f"{minutes:.0f} min" if minutes >= 1 else f"{60 * minutes:.0f} s"


def _contests(sequences: _Figures, not_installed: Mapping[str, str]) -> str:
    head = ["", "frames", "ms", "p95", "CPU ms", "APE (cm)", "RPE (cm/s)", "RPE (°/s)", "lost"]
    parts = []
    for name, content in sequences.items():
        frames = content["contest"][OURS]["frames"]
        rows = [
            _contestant(f"**{who}**" if who == OURS else who, result, frames)
            for who, result in content["contest"].items()
        ]
        # a whole command in a cell would push all columns out of view
        rows += [
            [who, f"not installed: {f'{PIP} (below)' if how.startswith(PIP) else how}", *[""] * 7]
            for who, how in not_installed.items()
        ]
        parts += [f"### {markdown(name)}", table(head, rows)]
    commands = sorted({how for how in not_installed.values() if how.startswith(PIP)})
    if parts and commands:
        lines = "\n".join(commands)
        parts.append(f"What is not installed comes, in a clone, by\n\n```\n{lines}\n```")
    if parts:
        parts.append(f"![Error against time]({PICTURE})")
    return "\n\n".join(parts)


def _contestant(who: str, result: _Figures, frames: int) -> list[str]:
    wall, cpu = result.get("wall_ms", {}), result.get("cpu_ms", {})
    ape, *rpe = _errors(result)
    return [
        who,
        str(result["frames"]),
        number(wall.get("p50"), 1),
        number(wall.get("p95"), 1),
        number(cpu.get("p50"), 1),
        ape if result["frames"] == frames else NOTHING,
        *rpe,
        str(result["lost"]),
    ]


def _errors(result: _Figures) -> list[str]:
    ape, rpe = result.get("ape"), result.get("rpe")
    return [
        number(100 * ape["rmse_m"], 2) if ape else NOTHING,
        number(100 * rpe["trans_rmse_m"], 2) if rpe else NOTHING,
        number(rpe["rot_rmse_deg"], 2) if rpe else NOTHING,
    ]


def _stages(sequences: _Figures) -> str:
    if not sequences:
        return ""
    what = {floor.stage: floor.what for floor in FLOORS}
    stages = list(dict.fromkeys(s for c in sequences.values() for s in c["stages_ms"]))
    rows = [
        [
            stage.replace("_", " "),
            *(
                f"{number(c['stages_ms'].get(stage), 1)} / {number(c['floors_ms'].get(stage), 1)}"
                for c in sequences.values()
            ),
            what.get(stage, NOTHING),
        ]
        for stage in stages
    ]
    return table(
        ["stage", *(f"{markdown(name)}, ours / floor" for name in sequences), "floor"], rows
    )


def _honesty(sequences: _Figures) -> str:
    known = {name: c["nees"] for name, c in sequences.items() if "nees" in c}
    rows = [
        [name, f"{nees['mean']:.1f}", f"{nees['median']:.1f}", str(nees["count"])]
        for name, nees in known.items()
    ]
    if len(rows) > 1:
        count = sum(nees["count"] for nees in known.values())
        mean = sum(nees["mean"] * nees["count"] for nees in known.values()) / count
        rows.append(["all", f"{mean:.1f}", NOTHING, str(count)])
    return table(["", "mean", "median", "transforms"], rows) if rows else ""


def _robustness(sequences: _Figures) -> str:
    head = ["", "frames", "APE (cm)", "RPE (cm/s)", "RPE (°/s)", "lost", "longest (s)", "restarts"]
    head.append("NEES")
    parts = []
    for name, content in sequences.items():
        if "robustness" not in content:
            continue
        tracking = {**content["tracking"], **content["contest"][OURS], "nees": content.get("nees")}
        rows = [
            _degraded(kind, result)
            for kind, result in {"as recorded": tracking, **content["robustness"]}.items()
        ]
        parts += [f"### {markdown(name)}", table(head, rows)]
    return "\n\n".join(parts)


def _degraded(kind: str, result: _Figures) -> list[str]:
    nees = result.get("nees")
    return [
        kind,
        str(result["frames"]),
        *_errors(result),
        str(result["lost"]),
        number(result["longest_without_pose_s"], 2),
        str(result["restarts"]),
        number(nees["mean"] if nees else None, 1),
    ]


def _live(sequences: _Figures) -> str:
    head = ["", "frames", "dropped", "lost", "latency p50 (ms)", "p95", "round trip p50", "p95"]
    head += ["ready (s)", "memory, peak (MB)", "APE (cm)", "RPE (cm/s)", "RPE (°/s)"]
    rows = []
    for name, content in sequences.items():
        live = content.get("live")
        if live is None:
            continue
        node, both = live.get("node_latency_ms", {}), live["latency_ms"]
        rows.append(
            [
                name,
                str(live["frames"]),
                str(sum(live["dropped"].values())) if "dropped" in live else NOTHING,
                str(live["lost"]),
                number(node.get("p50"), 1),
                number(node.get("p95"), 1),
                number(both["p50"], 1),
                number(both["p95"], 1),
                number(live["ready_s"], 1),
                number(live["peak_rss_mb"], 0),
                *_errors(live),
            ]
        )
    return table(head, rows) if rows else ""


def _memory(figures: _Figures) -> str:
    memory = figures.get("memory")
    if not memory or not memory["frames"]:
        return ""
    frames, resident = memory["frames"], memory["resident_mb"]
    half = max(1, len(frames) // 2)
    chosen = sorted({round(i * (len(frames) - 1) / 7) for i in range(8)})
    growth = f"{max(resident[half:] or resident) - max(resident[:half]):+.1f} MB"
    return (
        f"{memory['recording']} repeatedly through one odometry, in one process that also reads "
        f"it: {frames[-1]} frames, at most {max(resident):.0f} MB; the maximum of the second half "
        f"is that of the first {growth}.\n\n"
        + table(
            ["frames", *(str(frames[i]) for i in chosen)],
            [["MB resident", *(f"{resident[i]:.0f}" for i in chosen)]],
        )
    )

"""The figures of registered pairs as tables in the paper's layout."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from rgbd_glue_ros.evaluation.registration_errors import THRESHOLDS
from rgbd_glue_ros.experiments.pairs.metrics import METRICS
from rgbd_glue_ros.experiments.report.escaping import markdown
from rgbd_glue_ros.experiments.report.markdown import NOTHING, bullets, number, table

_ERRORS = """\
Accuracy: percent of all pairs whose error is at most the threshold. For a pair without a transform,
mean and median use the errors of the identity, and it is accurate at no threshold. Chamfer
distance: between the scenes merged by the estimate and by the ground truth, mean squared distance
to the nearest point, summed over both directions, in m² times 1000, as in UR&R."""

_INLIERS = """\
Mean over all pairs with geometric matches. Inliers: matches that the true transform maps onto each
other within the distance. Filter recall: percent of all pairs that the filter was applied to."""

_OTHERS = """\
Every method starts from the two frames alone. The time is that of a whole pair, including
both frames' features."""

_STAGES = """\
Median of each stage in milliseconds, features for both frames, visual and geometric in parallel;
mean of the whole pair in seconds."""


def to_markdown(figures: dict[str, Any]) -> str:
    """``pairs.md`` from the content of ``pairs.json``."""
    gaps: dict[str, dict[str, Any]] = figures["gaps"]
    features = figures["features"]
    parts = [
        f"# Pairs: visual {features['visual']}, geometric {features['geometric']}",
        f"Recordings: {markdown(', '.join(figures['sources']))}.",
        "## Registration",
        _registration(gaps),
        _ERRORS,
        "## Geometric correspondences",
        _correspondences(gaps),
        _INLIERS,
        "## Time",
        _times(gaps),
        _STAGES,
    ]
    others = [
        (name, gap, content)
        for gap in gaps
        for name, figured in figures["others"].items()
        for content in [figured["gaps"][gap]]
    ]
    if others:
        own = [("ours", gap, content) for gap, content in gaps.items()]
        by_gap = sorted([*own, *others], key=lambda row: int(row[1]))
        parts += ["## Others on the same pairs", _comparison(by_gap), _OTHERS]
    if figures["problems"]:
        parts += ["## Skipped", bullets(figures["problems"])]
    return "\n\n".join(parts) + "\n"


def _registration(gaps: dict[str, dict[str, Any]]) -> str:
    head = ["frames apart", "pairs", "failed", *_error_head()]
    return table(
        head,
        (
            [gap, str(content["pairs"]), str(content["failed"]), *_errors(content)]
            for gap, content in gaps.items()
        ),
    )


def _comparison(rows: Iterable[tuple[str, str, dict[str, Any]]]) -> str:
    """A table of several methods.

    Args:
        rows: name of the method, frames apart, and figures as ``gap_figures`` gives them.
    """
    head = ["frames apart", "method", "pairs", "failed", *_error_head(), "pair (s)"]
    return table(
        head,
        (
            [
                *(gap, method, str(content["pairs"]), str(content["failed"])),
                *_errors(content),
                f"{content['seconds_per_pair']:.2f}",
            ]
            for method, gap, content in rows
        ),
    )


def _error_head() -> list[str]:
    head = []
    for name, limits in THRESHOLDS.items():
        metric = METRICS[name]
        head.append(f"{metric.title.lower()} ({metric.unit}) ≤ {limits[0]:g}")
        head += [f"≤ {limit:g}" for limit in limits[1:]]
        head += ["mean", "med."]
    return head


def _errors(content: dict[str, Any]) -> list[str]:
    cells = []
    for name in THRESHOLDS:
        error = content[name]
        cells += [f"{percent:.1f}" for percent in error["accuracy"].values()]
        cells += [f"{error['mean']:.2f}", f"{error['median']:.2f}"]
    return cells


def _correspondences(gaps: dict[str, dict[str, Any]]) -> str:
    rows = []
    for gap, content in gaps.items():
        for side in ("before", "after"):
            ratio, amount = content["inlier_ratio"][side], content["inlier_amount"][side]
            recall = number(content["filter_recall"], 1) if side == "after" else NOTHING
            figures = [number(v, 1) for v in ratio.values()]
            figures += [number(v, 0) for v in amount.values()]
            rows.append([gap, side, *figures, recall])
    limits = next(iter(gaps.values()))["inlier_ratio"]["before"]
    head = [f"{figure} {limit} cm" for figure in ("ratio (%)", "amount") for limit in limits]
    return table(["frames apart", "filter", *head, "filter recall"], rows)


def _times(gaps: dict[str, dict[str, Any]]) -> str:
    stages = list(dict.fromkeys(stage for c in gaps.values() for stage in c["stages_ms"]))
    rows = [
        [
            gap,
            *(number(content["stages_ms"].get(stage), 1) for stage in stages),
            f"{content['seconds_per_pair']:.2f}",
        ]
        for gap, content in gaps.items()
    ]
    return table(["frames apart", *(s.replace("_", " ") for s in stages), "pair (s)"], rows)

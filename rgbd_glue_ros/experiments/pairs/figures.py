"""The figures of many pairs, as in the paper's tables."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from statistics import fmean
from typing import Any

from rgbd_glue_ros.evaluation.registration_errors import error_statistics
from rgbd_glue_ros.experiments.pairs.evaluation import INLIER_THRESHOLDS_CM, Inliers, PairResult
from rgbd_glue_ros.experiments.replay.run_record import stage_medians

EPSILON_SQUARED_M2 = (0.002, 0.004, 0.006, 0.008, 0.01)
"""Upper ends of the ranges of table S3."""


def gap_figures(results: Sequence[PairResult]) -> dict[str, Any]:
    """The figures of all pairs of a gap; ratios, accuracies and recall are in percent.

    Args:
        results: of at least one pair.
    """
    described = [r for r in results if r.before.matches]
    epsilons = [r.epsilon_m**2 for r in results if r.filtered]
    sides = {
        "before": [r.before for r in described],
        "after": [r.after for r in described],
    }
    return {
        "pairs": len(results),
        "failed": sum(r.errors.failed for r in results),
        **error_statistics([r.errors for r in results]),
        "inlier_ratio": {side: _means(sets, _ratio) for side, sets in sides.items()},
        "inlier_amount": {side: _means(sets, _amount) for side, sets in sides.items()},
        "filter_recall": 100 * fmean(r.filtered for r in results),
        "epsilon_squared_m2": fmean(epsilons) if epsilons else None,
        "epsilon_squared_ranges": _by_epsilon(results),
        "visual_matches": fmean(r.visual.matches for r in results),
        "geometric_matches": fmean(r.before.matches for r in results),
        "seconds_per_pair": fmean(r.seconds for r in results),
        "stages_ms": stage_medians(r.stages_ms for r in results),
    }


def _by_epsilon(results: Sequence[PairResult]) -> list[dict[str, Any]]:
    """Table S3: visual matches of the pairs whose ε² falls into each of its ranges."""
    rows = []
    # if a fallback gave ε there may be none
    seen = [r for r in results if r.visual.matches]
    for lowest, highest in zip((0.0, *EPSILON_SQUARED_M2), EPSILON_SQUARED_M2, strict=False):
        matched = [r.visual for r in seen if lowest < r.epsilon_m**2 <= highest]
        rows.append(
            {
                "above_m2": lowest,
                "up_to_m2": highest,
                "pairs": len(matched),
                "visual_matches": fmean(v.matches for v in matched) if matched else None,
                "visual_inlier_ratio": _means(matched, _ratio),
            }
        )
    return rows


def _means(
    sets: Sequence[Inliers], figure: Callable[[Inliers, int], float]
) -> dict[str, float | None]:
    """The mean over all sets, by threshold; None where there are none."""
    return {
        f"{limit:g}": fmean(figure(inliers, column) for inliers in sets) if sets else None
        for column, limit in enumerate(INLIER_THRESHOLDS_CM)
    }


def _ratio(inliers: Inliers, column: int) -> float:
    return 100 * inliers.amounts[column] / inliers.matches


def _amount(inliers: Inliers, column: int) -> float:
    return inliers.amounts[column]

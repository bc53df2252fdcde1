"""The report of registered pairs: one self-contained HTML page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rgbd_glue_ros.evaluation.registration_errors import THRESHOLDS
from rgbd_glue_ros.experiments.pairs.charts import CSS as CHARTS_CSS
from rgbd_glue_ros.experiments.pairs.charts import curves, scatter
from rgbd_glue_ros.experiments.pairs.evaluation import INLIER_THRESHOLDS_CM
from rgbd_glue_ros.experiments.pairs.gallery import CSS as GALLERY_CSS
from rgbd_glue_ros.experiments.pairs.gallery import LEGEND, WORST, Example, gallery, severity
from rgbd_glue_ros.experiments.pairs.metrics import METRICS
from rgbd_glue_ros.experiments.pairs.results import GLUE, ByGap
from rgbd_glue_ros.experiments.report import charts
from rgbd_glue_ros.experiments.report.escaping import escape
from rgbd_glue_ros.experiments.report.markdown import NOTHING, number
from rgbd_glue_ros.experiments.report.page import SIDE_BY_SIDE, changed_parameters, page, tiles
from rgbd_glue_ros.parameters import Config

_CSS = """
.wide table { font-size: .82rem; }
.wide th, .wide td { padding-left: .4rem; padding-right: .1rem; }
.wide th:first-child, .wide td:first-child { padding-left: 0; }
.wide .group { text-align: center; padding-bottom: 0; color: var(--text); }
.wide .groups th { border-bottom: 0; } .wide .apart td { border-top: 2px solid var(--line); }
.wide .first { border-left: 1px solid var(--line); }
.best { font-weight: 650; }
h3 { font-size: .95rem; margin: 1.6rem 0 .6rem; }
"""

_RIGHT_OR_WRONG = (
    "The image registered to above, the one registered below. Matches are correct or wrong "
    "according to the true motion."
)
_WORST_ROWS = 20
_AT_10_CM = INLIER_THRESHOLDS_CM.index(10)


def render(
    figures: Mapping[str, Any],
    results: Mapping[str, ByGap],
    config: Config,
    shown: Sequence[Example],
) -> str:
    """The page.

    Args:
        figures: the content of ``pairs.json``.
        results: of every pair, by method and gap; at least one.
        config: of the experiment.
        shown: pairs to show pictures of, the worst first.
    """
    names = {name: _name(name, figures) for name in results}
    gaps = sorted(results[GLUE])
    parts = [
        _summary(figures, results[GLUE]),
        _tiles(figures["gaps"][str(gaps[0])], gaps[0]),
        "<h2>Errors</h2>",
        curves(results, names),
        _registration(figures, names),
        "<h2>Worst pairs</h2>",
        *_pictures(shown),
        _worst(results[GLUE]),
        "<h2>The adaptive threshold</h2>",
        _thresholds(figures["gaps"], results[GLUE]),
        "<h2>Geometric correspondences</h2>",
        _correspondences(figures["gaps"]),
        "<h2>Where the time goes</h2>",
        f"<p>Median for pairs {gaps[0]} frames apart, features of both. {SIDE_BY_SIDE}</p>",
        charts.bars(_stages(figures["gaps"][str(gaps[0])]), "ms", "var(--estimate)"),
        *_problems(figures["problems"]),
        "<h2>Parameters that differ from the defaults</h2>",
        changed_parameters(config),
    ]
    return page(_title(figures), parts, GALLERY_CSS + CHARTS_CSS + _CSS)


def _title(figures: Mapping[str, Any]) -> str:
    sources = figures["sources"]
    where = sources[0] if len(sources) == 1 else f"{len(sources)} recordings"
    return f"{_features(figures)} on {where}"


def _features(figures: Mapping[str, Any]) -> str:
    sides = (figures["features"][side] for side in ("visual", "geometric"))
    return " + ".join(side.upper() for side in sides if side != "none") or "no features"


def _name(method: str, figures: Mapping[str, Any]) -> str:
    return _features(figures) if method == GLUE else method.replace("_", " ")


def _summary(figures: Mapping[str, Any], own: ByGap) -> str:
    pairs = sum(map(len, own.values()))
    gaps = ", ".join(map(str, sorted(own)))
    sources = figures["sources"]
    more = f" of {len(sources)} recordings" if len(sources) > 1 else ""
    return f"<p>{pairs} pairs of frames{more}, {gaps} frames apart, registered by rgbd-glue.</p>"


def _tiles(content: Mapping[str, Any], gap: int) -> str:
    accuracy = {name: content[name]["accuracy"] for name in THRESHOLDS}
    shown = [
        (f"{accuracy['rotation_deg']['5']:.1f}", "%", "within 5°"),
        (f"{accuracy['translation_cm']['5']:.1f}", "%", "within 5 cm"),
        (f"{content['rotation_deg']['mean']:.2f}", "°", "mean error of rotation"),
        (f"{content['translation_cm']['mean']:.2f}", "cm", "mean error of translation"),
        (f"{content['failed']}", f"of {content['pairs']}", "without a transform"),
        (f"{content['seconds_per_pair']:.2f}", "s", "per pair, including features of both frames"),
    ]
    return f"<h3>{gap} frames apart</h3>{tiles(shown)}"


def _registration(figures: Mapping[str, Any], names: Mapping[str, str]) -> str:
    groups = "".join(
        f'<th class="group first" colspan="{len(limits) + 2}">{METRICS[name].title} '
        f"({METRICS[name].symbol})</th>"
        for name, limits in THRESHOLDS.items()
    )
    columns = "".join(
        "".join(
            f'<th class="n{" first" if i == 0 else ""}">≤ {limit:g}</th>'
            for i, limit in enumerate(limits)
        )
        + '<th class="n">mean</th><th class="n">med.</th>'
        for limits in THRESHOLDS.values()
    )
    body = ""
    for gap in figures["gaps"]:
        rows = {GLUE: figures["gaps"][gap]}
        rows |= {name: peer["gaps"][gap] for name, peer in figures["others"].items()}
        body += _rows_of_gap(gap, {names[name]: row for name, row in rows.items()})
    return (
        "<h3>As in the paper's tables: accuracy in percent, mean and median</h3>"
        '<div class="wide"><table><tr class="groups"><th></th><th></th><th></th><th></th>'
        f"{groups}</tr><tr><th>method</th>"
        '<th class="n">apart</th><th class="n">pairs</th><th class="n">failed</th>'
        f"{columns}</tr>{body}</table></div>"
    )


def _rows_of_gap(gap: str, rows: Mapping[str, Mapping[str, Any]]) -> str:
    numbers = {
        name: [
            value
            for error in THRESHOLDS
            for value in (
                *row[error]["accuracy"].values(),
                -row[error]["mean"],
                -row[error]["median"],
            )
        ]
        for name, row in rows.items()
    }
    best = [max(column) for column in zip(*numbers.values(), strict=True)]
    text = ""
    for name, row in rows.items():
        cells = ""
        for i, value in enumerate(numbers[name]):
            marks = ["n"] + ["first"] * (i % 5 == 0)
            marks += ["best"] * (len(rows) > 1 and value == best[i])
            shown = f"{value:.1f}" if i % 5 < 3 else f"{-value:.2f}"
            cells += f'<td class="{" ".join(marks)}">{shown}</td>'
        text += (
            f'<tr class="{"" if text else "apart"}"><td>{escape(name)}</td>'
            f'<td class="n">{gap}</td><td class="n">{row["pairs"]}</td>'
            f'<td class="n">{row["failed"]}</td>{cells}</tr>'
        )
    return text


def _pictures(shown: Sequence[Example]) -> list[str]:
    if not shown:
        return []
    worst, typical = shown[:WORST], shown[WORST:]
    parts = [
        f"<p>{_RIGHT_OR_WRONG}</p>",
        LEGEND,
        gallery(worst),
    ]
    return [*parts, "<h3>From the middle of the field</h3>", gallery(typical)] if typical else parts


def _worst(own: ByGap) -> str:
    ranked = sorted(
        (result for results in own.values() for result in results), key=severity, reverse=True
    )[:_WORST_ROWS]
    body = "".join(
        f'<tr><td>{escape(r.recording)}</td><td class="n">{r.target}</td>'
        f'<td class="n">{r.source}</td>'
        + (
            f'<td class="n">{NOTHING}</td>' * 3
            if r.errors.failed
            else f'<td class="n">{r.errors.rotation_deg:.2f}</td>'
            f'<td class="n">{r.errors.translation_cm:.2f}</td>'
            f'<td class="n">{r.errors.chamfer_mm:.2f}</td>'
        )
        + f'<td class="n">{r.visual.amounts[_AT_10_CM]} of {r.visual.matches}</td>'
        f'<td class="n">{r.after.amounts[_AT_10_CM]} of {r.after.matches}</td></tr>'
        for r in ranked
    )
    return (
        f'<h3>The {len(ranked)} worst</h3><div class="wide"><table><tr><th>recording</th>'
        '<th class="n">to</th><th class="n">from</th><th class="n">rotation (°)</th>'
        '<th class="n">translation (cm)</th><th class="n">chamfer (mm)</th>'
        '<th class="n">visual within 10 cm</th><th class="n">geometric within 10 cm</th></tr>'
        f"{body}</table></div>"
    )


def _thresholds(gaps: Mapping[str, Any], own: ByGap) -> str:
    text = (
        "<p>The worse the visual matches, the wider the filter: ε² against the share of visual "
        "matches that are correct within 5 cm, for every pair that was filtered, and the mean of "
        "each range of table S3.</p>"
    )
    columns = "".join(
        f"<div>{scatter(gap, gaps[str(gap)], results)}{_ranges(gaps[str(gap)])}</div>"
        for gap, results in sorted(own.items())
        if any(r.filtered for r in results)
    )
    return f'{text}<div class="two">{columns}</div>' if columns else "<p>No pair was filtered.</p>"


def _ranges(content: Mapping[str, Any]) -> str:
    head = "".join(f'<th class="n">{limit:g} cm</th>' for limit in INLIER_THRESHOLDS_CM)
    body = "".join(
        f"<tr><td>{row['above_m2']:g} – {row['up_to_m2']:g}</td>"
        f'<td class="n">{row["pairs"]}</td><td class="n">{number(row["visual_matches"], 0)}</td>'
        + "".join(
            f'<td class="n">{number(ratio, 1)}</td>'
            for ratio in row["visual_inlier_ratio"].values()
        )
        + "</tr>"
        for row in content["epsilon_squared_ranges"]
    )
    return (
        '<div class="wide"><table><tr><th>ε² (m²)</th><th class="n">pairs</th>'
        f'<th class="n">matches</th>{head}</tr>{body}</table></div>'
    )


def _correspondences(gaps: Mapping[str, Any]) -> str:
    limits = [f"{limit:g}" for limit in INLIER_THRESHOLDS_CM]
    head = "".join(
        f'<th class="n{" first" if i == 0 else ""}">{limit} cm</th>'
        for _ in ("ratio", "amount")
        for i, limit in enumerate(limits)
    )
    body = ""
    for gap, content in gaps.items():
        for side in ("before", "after"):
            cells = "".join(
                f'<td class="n{" first" if limit == limits[0] else ""}">'
                f"{number(content[figure][side][limit], digits)}</td>"
                for figure, digits in (("inlier_ratio", 1), ("inlier_amount", 0))
                for limit in limits
            )
            recall = f"{content['filter_recall']:.1f}" if side == "after" else ""
            body += (
                f'<tr><td class="n">{gap}</td><td>{side} the filter</td>{cells}'
                f'<td class="n first">{recall}</td></tr>'
            )
    return (
        "<p>Mean over all pairs with geometric matches. Inliers are matches that the true "
        "transform maps onto each other within the distance; filter recall is the percent of "
        "pairs that the filter was applied to.</p>"
        '<div class="wide"><table><tr class="groups"><th></th><th></th>'
        '<th class="group first" colspan="3">Inlier ratio (%)</th>'
        '<th class="group first" colspan="3">Inliers</th><th class="first"></th></tr>'
        f'<tr><th class="n">apart</th><th></th>{head}<th class="n first">recall (%)</th></tr>'
        f"{body}</table></div>"
    )


def _stages(content: Mapping[str, Any]) -> dict[str, float]:
    return {name.replace("_", " "): value for name, value in content["stages_ms"].items()}


def _problems(problems: Sequence[str]) -> list[str]:
    if not problems:
        return []
    rows = "".join(f"<tr><td>{escape(problem)}</td></tr>" for problem in problems)
    return ["<h2>Left out</h2>", f"<table>{rows}</table>"]

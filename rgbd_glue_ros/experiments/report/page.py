"""The common frame of all reports: one self-contained HTML page, for any width."""

from __future__ import annotations

from collections.abc import Iterable

from rgbd_glue_ros.experiments.report import charts, plans, timeline
from rgbd_glue_ros.experiments.report.escaping import escape
from rgbd_glue_ros.parameters import Config, parameters, values

SIDE_BY_SIDE = "Stages that run in parallel add up to more than the whole."
"""Note on a list of stages."""

_CSS = """
:root { --page: #fff; --card: #f6f7f9; --text: #16202c; --quiet: #5d6b7b; --line: #e3e7ec;
  --estimate: #1d5fd1; --truth: #a9b4c0; --geometric: #c2620a; --good: #1a8f5a; --bad: #cf2f3c;
  --wait: #d9a514; color-scheme: light dark; }
@media (prefers-color-scheme: dark) { :root { --page: #11161d; --card: #1a212b; --text: #e6ebf1;
  --quiet: #93a1b1; --line: #2a3441; --estimate: #6aa5ff; --truth: #66727f; --geometric: #f0963c;
  --good: #35b57c; --bad: #f0626c; --wait: #e2bb45; } }
* { box-sizing: border-box; }
body { margin: 0; background: var(--page); color: var(--text);
  font: 16px/1.5 system-ui, -apple-system, "Segoe UI", Roboto, "Noto Sans", sans-serif; }
main { max-width: 66rem; margin: 0 auto; padding: 2rem 1.25rem 3rem; }
h1 { font-size: 1.6rem; line-height: 1.2; margin: 0 0 .3rem; overflow-wrap: anywhere;
  text-wrap: balance; }
h2 { font-size: 1.1rem; margin: 2.6rem 0 1rem; padding-top: 1.1rem;
  border-top: 1px solid var(--line); }
h2, h3 { overflow-wrap: anywhere; text-wrap: balance; }
p { margin: 0 0 1rem; color: var(--quiet); max-width: 46rem; }
.tiles { display: grid; grid-template-columns: repeat(auto-fit, minmax(9.5rem, 1fr)); gap: .7rem;
  margin: 1.5rem 0 0; }
.tile { background: var(--card); border-radius: 10px; padding: .8rem 1rem .75rem; }
.tile b { display: block; font-size: 1.55rem; line-height: 1.25; font-weight: 650;
  font-variant-numeric: tabular-nums; white-space: nowrap; }
.tile b small { font-size: .95rem; font-weight: 500; color: var(--quiet); }
.tile span { color: var(--quiet); font-size: .82rem; display: block; }
.two { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(100%, 22rem), 1fr));
  gap: 1.5rem 2.5rem; align-items: start; }
table { border-collapse: collapse; width: 100%; font-size: .9rem; }
td, th { text-align: left; padding: .38rem .8rem .38rem 0; border-bottom: 1px solid var(--line);
  vertical-align: top; font-weight: 400; }
th { color: var(--quiet); }
.n { text-align: right; padding: .38rem 0 .38rem .8rem; font-variant-numeric: tabular-nums;
  white-space: nowrap; }
code { font: .86em ui-monospace, "SF Mono", Consolas, monospace; overflow-wrap: anywhere; }
td small { color: var(--quiet); }
.wide { overflow-x: auto; margin: 0 0 1.2rem; }
.wide table { width: auto; min-width: 100%; white-space: nowrap; }
.notes { background: var(--card); border-left: 4px solid var(--wait); border-radius: 6px;
  padding: .7rem 1rem; margin: 1rem 0; overflow-wrap: anywhere; }
.notes p { margin: 0 0 .3rem; color: var(--text); font-weight: 600; }
.notes ul { margin: 0; padding-left: 1.2rem; font-size: .9rem; }
footer { margin-top: 3rem; padding-top: 1rem; border-top: 1px solid var(--line);
  color: var(--quiet); font-size: .8rem; }
caption { text-align: left; font-weight: 600; padding-bottom: .3rem; }
"""


def page(title: str, parts: Iterable[str], css: str = "") -> str:
    """A page with a heading.

    Args:
        title: text of the heading.
        parts: HTML below it.
        css: besides that of all pages.
    """
    return (
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(title)} · rgbd-glue</title><style>"
        f"{_CSS}{charts.CSS}{plans.CSS}{timeline.CSS}{css}</style>"
        f"</head><body><main><h1>{escape(title)}</h1>{''.join(parts)}</main>"
        f"<script>{timeline.SCRIPT}</script></body></html>\n"
    )


def tiles(figures: Iterable[tuple[str, str, str]]) -> str:
    """The most important figures: number, unit, and meaning."""
    body = "".join(
        f'<div class="tile"><b>{value} <small>{unit}</small></b><span>{text}</span></div>'
        for value, unit, text in figures
    )
    return f'<div class="tiles">{body}</div>'


def notes(texts: Iterable[str]) -> str:
    """A box with what was warned of; nothing if there was nothing."""
    items = "".join(f"<li>{escape(text)}</li>" for text in texts)
    if not items:
        return ""
    return f'<div class="notes"><p>Warnings</p><ul>{items}</ul></div>'


def changed_parameters(config: Config) -> str:
    """A table of the parameters that differ from their defaults."""
    chosen = values(config)
    rows = [
        f"<tr><td><code>{p.name}</code><br><small>{escape(p.description)}</small></td>"
        f'<td class="n">{escape(str(chosen[p.name]))} {escape(p.unit)}</td>'
        f'<td class="n">{escape(str(p.default))}</td></tr>'
        for p in parameters(config)
        if chosen[p.name] != p.default
    ]
    if not rows:
        return "<p>None does.</p>"
    head = '<tr><th>parameter</th><th class="n">value</th><th class="n">default</th></tr>'
    return f"<table>{head}{''.join(rows)}</table>"

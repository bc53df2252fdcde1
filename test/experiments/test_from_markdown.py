"""What this package writes as Markdown is the same on a page."""

from __future__ import annotations

from rigs.pages import Page

from rgbd_glue_ros.experiments.report.from_markdown import from_markdown
from rgbd_glue_ros.experiments.report.markdown import table

ODD = "a <b> | `c` [d](e) & f"


def test_headings_tables_lists_code_and_pictures_become_html() -> None:
    text = "\n\n".join(
        [
            "# Title",
            "## Part",
            "Some **bold**\nwords.",
            "```\nrgbd-glue bench\n```",
            table(["who", "ms"], [["us", "1.0"], ["you", "2.0"]]),
            "- one\n- two",
            "![A picture](it.svg)",
        ]
    )
    rows = (
        '<tr><th>who</th><th class="n">ms</th></tr>'
        '<tr><td>us</td><td class="n">1.0</td></tr><tr><td>you</td><td class="n">2.0</td></tr>'
    )
    assert from_markdown(text, {"it.svg": "<svg></svg>"}) == [
        "<h2>Part</h2>",
        "<p>Some <b>bold</b> words.</p>",
        "<p><code>rgbd-glue bench</code></p>",
        f'<div class="wide"><table>{rows}</table></div>',
        "<ul><li>one</li><li>two</li></ul>",
        "<figure><svg></svg></figure>",
    ]


def test_a_name_of_whatever_letters_is_shown_as_it_is_and_is_no_part_of_the_page() -> None:
    (block,) = from_markdown(table(["who"], [[ODD]]), {})
    page = Page(block)
    assert page.open == []
    assert page.fetched == []
    assert "".join(page.text).replace("who", "", 1) == ODD

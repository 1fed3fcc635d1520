"""One page that needs nothing from outside: its style, tables and pictures."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Sequence
from html import escape

import numpy as np

from blendcap.io.images import png

STYLE = """
:root { color-scheme: light dark; --ink: #2b2f37; --soft: #69707c; --line: #d4d8de; --paper: #fdfdfe; --card: #f3f4f6;
  --good: #2f7d4a; --bad: #b8322f; --accent: #2f6fb7; }
@media (prefers-color-scheme: dark) { :root { --ink: #e4e6ea; --soft: #9aa2ae; --line: #3b4048; --paper: #17191d;
  --card: #20242a; --good: #6cc48a; --bad: #ef7f78; --accent: #7fb2e8; } }
* { box-sizing: border-box; }
body { margin: 0 auto; max-width: 68rem; padding: 2.5rem 1.25rem 5rem; background: var(--paper); color: var(--ink);
  font: 16px/1.5 system-ui, sans-serif; }
h1 { font-size: 1.9rem; line-height: 1.2; margin: 0 0 .2rem; } h2 { font-size: 1.2rem; margin: 3rem 0 .8rem; }
p.lead { color: var(--soft); margin: 0 0 1.6rem; } a { color: var(--accent); }
.cards { display: grid; grid-template-columns: repeat(auto-fit, minmax(9.5rem, 1fr)); gap: .8rem; }
.card { background: var(--card); border-radius: .6rem; padding: .8rem 1rem; }
.card b { display: block; font-size: 1.45rem; font-weight: 600; font-variant-numeric: tabular-nums; }
.card span { color: var(--soft); font-size: .85rem; } .good b { color: var(--good); } .bad b { color: var(--bad); }
ul.concerns { margin: 0; padding: 0; list-style: none; }
ul.concerns li { border-left: 3px solid var(--bad); background: var(--card); padding: .6rem 1rem; margin: .5rem 0;
  border-radius: 0 .5rem .5rem 0; overflow-wrap: anywhere; }
figure { margin: 1rem 0; overflow-x: auto; } figure svg { width: 100%; height: auto; min-width: 34rem; }
figure img, video { width: 100%; height: auto; border-radius: .6rem; display: block; }
figcaption { color: var(--soft); font-size: .85rem; margin-top: .4rem; }
details { margin: .6rem 0; } summary { cursor: pointer; font-weight: 600; }
.scroll { overflow-x: auto; max-height: 32rem; overflow-y: auto; }
table { border-collapse: collapse; width: 100%; font-size: .88rem; font-variant-numeric: tabular-nums; }
th, td { text-align: right; padding: .3rem .7rem; border-bottom: 1px solid var(--line); white-space: nowrap; }
th:first-child, td:first-child { text-align: left; white-space: normal; overflow-wrap: anywhere; }
thead th { position: sticky; top: 0; background: var(--paper); color: var(--soft); font-weight: 600; }
"""


def page(title: str, lead: str, sections: Iterable[tuple[str, str]]) -> str:
    """A whole page; `sections` are titles and finished HTML, empty ones are left out."""
    body = "\n".join(f"<section><h2>{escape(name)}</h2>\n{html}</section>" for name, html in sections if html)
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n"
        f'<h1>{escape(title)}</h1>\n<p class="lead">{escape(lead)}</p>\n{body}\n</body>\n</html>\n'
    )


def cards(entries: Iterable[tuple[str, str, str]]) -> str:
    """Numbers in boxes: (what, value, "" or "good" or "bad")."""
    boxes = (f'<div class="card {kind}"><b>{escape(value)}</b><span>{escape(what)}</span></div>'
             for what, value, kind in entries)  # fmt: skip
    return f'<div class="cards">{"".join(boxes)}</div>'


def table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table that scrolls on its own when it is long."""
    head = "".join(f"<th>{escape(cell)}</th>" for cell in header)
    body = "\n".join("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in rows)
    return f'<div class="scroll"><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>'


def sentences(lines: Iterable[str], kind: str = "") -> str:
    """A list of sentences."""
    items = "".join(f"<li>{escape(line)}</li>" for line in lines)
    return f'<ul class="{kind}">{items}</ul>' if items else ""


def figure(html: str, caption: str = "") -> str:
    """A picture, plot or film with words under it."""
    under = f"<figcaption>{escape(caption)}</figcaption>" if caption else ""
    return f"<figure>{html}{under}</figure>"


def image(picture: np.ndarray, alt: str) -> str:
    """A picture (H, W, 3) uint8 inside the page."""
    return f'<img alt="{escape(alt)}" src="{data_uri(png(picture), "image/png")}">'


def film(content: bytes, kind: str) -> str:
    """An MP4 or GIF inside the page."""
    if kind == "image/gif":
        return f'<img alt="preview" src="{data_uri(content, kind)}">'
    return f'<video controls loop muted playsinline preload="auto" src="{data_uri(content, kind)}"></video>'


def data_uri(content: bytes, kind: str) -> str:
    """A file's bytes inside the page."""
    return f"data:{kind};base64,{base64.b64encode(content).decode()}"

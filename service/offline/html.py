"""Self-contained HTML pages: style and pictures inside, nothing fetched from anywhere.

All text goes through `html_text`; the page's own policy forbids scripts and anything from outside.
"""

from __future__ import annotations

import base64
import html
from collections.abc import Iterable, Sequence

import cv2

from lumpwatch.models.roi import Image

_POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'"
STYLE = """
:root { color-scheme: light; }
body { font: 15px/1.5 system-ui, sans-serif; color: #1c2733; background: #f4f6f8; margin: 0; }
main { max-width: 1120px; margin: 0 auto; padding: 24px; }
section { background: #fff; border: 1px solid #dde3e9; border-radius: 8px; padding: 4px 20px 16px; margin: 16px 0; }
h1 { font-size: 24px; margin: 8px 0 0; } h2 { font-size: 18px; margin: 14px 0 6px; }
p.note, p.sub, figcaption { color: #55636f; } img { max-width: 100%; height: auto; }
table { border-collapse: collapse; margin: 8px 0; }
th, td { text-align: left; padding: 4px 14px 4px 0; border-bottom: 1px solid #e6ebf0; vertical-align: top; }
th { font-weight: 600; color: #43505c; } td.n, th.n { text-align: right; }
.warn { background: #fff6e0; border-color: #e9c46a; } .bad, .false { color: #b3261e; font-weight: 600; }
.good, .true { color: #1d7a3a; font-weight: 600; }
.sheet { display: flex; flex-wrap: wrap; gap: 16px; } figure { margin: 0; max-width: 320px; }
.tiles { display: grid; grid-template-columns: repeat(auto-fit, minmax(150px, 1fr)); gap: 10px; margin: 1.2em 0; }
.tile { background: #fff; border: 1px solid #dde3e9; border-radius: 8px; padding: .6em .8em; }
.tile b { display: block; font-size: 1.5em; } .tile span { color: #55636f; font-size: .88em; }
img.plot { width: 100%; } img.still { max-width: 220px; border-radius: 4px; display: block; }
@media print { .tile, tr { break-inside: avoid; } }
"""
"""Of every page that lumpwatch writes."""


def html_text(value: object) -> str:
    """Any value as text of a page; bytes of a file name that are no UTF-8 are shown as they are coded."""
    return html.escape(str(value).encode("utf-8", "backslashreplace").decode())


def html_page(title: str, parts: Iterable[str]) -> str:
    """A page of parts that are HTML already."""
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{html_text(title)}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n<main>\n"
        f"<h1>{html_text(title)}</h1>\n" + "\n".join(parts) + "\n</main>\n</body>\n</html>\n"
    )


def html_section(title: str, parts: Iterable[str], kind: str = "") -> str:
    """A section of parts that are HTML already."""
    return f'<section class="{kind}">\n<h2>{html_text(title)}</h2>\n' + "\n".join(parts) + "\n</section>"


def html_paragraph(words: object, kind: str = "") -> str:
    """A paragraph of text."""
    return f'<p class="{kind}">{html_text(words)}</p>'


def html_items(lines: Iterable[object]) -> str:
    """A list of texts."""
    return "<ul>\n" + "\n".join(f"<li>{html_text(line)}</li>" for line in lines) + "\n</ul>"


def html_table(headings: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table; headings are text, cells are HTML already."""
    head = "".join(f"<th>{html_text(heading)}</th>" for heading in headings)
    body = "\n".join("<tr>" + "".join(f"<td>{cell}</td>" for cell in row) + "</tr>" for row in rows)
    return f"<table>\n<thead><tr>{head}</tr></thead>\n<tbody>\n{body}\n</tbody>\n</table>"


def html_picture(content: bytes, what: str, kind: str = "png") -> str:
    """An image inside the page; `what` it shows, in words."""
    data = base64.b64encode(content).decode("ascii")
    return f'<img alt="{html_text(what)}" src="data:image/{kind};base64,{data}">'


def html_photo(bgr: Image, what: str) -> str:
    """A camera's picture inside the page."""
    _, encoded = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, 85])
    return html_picture(bytes(encoded), what, "jpeg")


def html_figure(image: str, caption: object) -> str:
    """An image (HTML) with a caption (text)."""
    return f"<figure>\n{image}\n<figcaption>{html_text(caption)}</figcaption>\n</figure>"

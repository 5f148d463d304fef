"""The page: one HTML file that needs nothing else. Elements are built, never pasted, so that every name is escaped."""

import base64
import re
from collections.abc import Mapping, Sequence
from xml.etree import ElementTree as ET

from railctl.analysis.report.parts import Figure, Listing, Part, Section
from railctl.analysis.report.tables import Table

POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'"  # browsers hold the page to it
STYLE = """
:root { color-scheme: light dark; --ink: #1c1c1c; --paper: #ffffff; --faint: #666; --line: #d5d5d5; --link: #0058a3; }
@media (prefers-color-scheme: dark) {
  :root { --ink: #e6e6e6; --paper: #17191c; --faint: #a5a5a5; --line: #3c4046; --link: #7cc0ff; }
}
body { margin: 0 auto; padding: 1.5rem; max-width: 74rem; background: var(--paper); color: var(--ink);
  font: 1rem/1.55 system-ui, sans-serif; }
.files a + a { margin-left: 1em; }
h2 { margin-top: 3rem; border-bottom: 1px solid var(--line); padding-bottom: 0.2rem; }
p, li, figcaption, .caption { max-width: 48rem; }
a { color: var(--link); }
nav ul { columns: 18rem; padding-left: 1.2rem; }
nav li { break-inside: avoid; }
nav li.section { font-weight: 600; list-style: none; margin-left: -1.2rem; }
figure { margin: 2rem 0; break-inside: avoid; }
figure img { max-width: 100%; height: auto; background: #fff; border-radius: 4px; padding: 6px;
  box-sizing: border-box; }
figcaption, .caption { color: var(--faint); font-size: 0.9rem; margin: 0.3rem 0; }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; font-size: 0.85rem; font-variant-numeric: tabular-nums; margin: 0.5rem 0; }
th, td { padding: 0.2rem 0.7rem 0.2rem 0; text-align: left; border-bottom: 1px solid var(--line); white-space: nowrap; }
td.number, th.number { text-align: right; }
summary { cursor: pointer; font-weight: 600; }
@media print {
  body { max-width: none; font-size: 9pt; }
  nav, .files { display: none; }
  .scroll { overflow: visible; }
  th, td { white-space: normal; padding-right: 0.4rem; }
}
""".strip()


def page(title: str, sections: Sequence[Section], images: Mapping[str, bytes]) -> str:
    """The whole document; `images` are the figures' SVG by name."""
    body = _tag("body", _tag("h1", f"Report on {title}"), _contents(sections))
    for section in sections:
        body.append(_tag("h2", section.title, id=_anchor(section.title)))
        body.extend([_part(part, images) for part in section.parts])
    head = _tag(
        "head",
        _tag("meta", charset="utf-8"),
        _tag("meta", http_equiv="Content-Security-Policy", content=POLICY),
        _tag("meta", name="viewport", content="width=device-width, initial-scale=1"),
        _tag("title", f"Report on {title}"),
        _tag("style", STYLE),
    )
    text = ET.tostring(_tag("html", head, body, lang="en"), encoding="unicode", method="html")
    return f"<!DOCTYPE html>\n{text}\n"


def _tag(name: str, /, *inside: str | ET.Element, **attributes: str) -> ET.Element:
    element = ET.Element(name, {key.rstrip("_").replace("_", "-"): value for key, value in attributes.items()})
    for part in inside:
        if isinstance(part, ET.Element):
            element.append(part)
        else:
            element.text = (element.text or "") + part
    return element


def _anchor(title: str) -> str:
    return re.sub(r"[^a-z0-9]+", "-", title.lower()).strip("-")


def _contents(sections: Sequence[Section]) -> ET.Element:
    entries = []
    for section in sections:
        entries.append(_tag("li", _tag("a", section.title, href=f"#{_anchor(section.title)}"), class_="section"))
        entries += [
            _tag("li", _tag("a", part.title, href=f"#{part.name}"))
            for part in section.parts
            if isinstance(part, Figure | Table)
        ]
    return _tag("nav", _tag("ul", *entries))


def _part(part: Part, images: Mapping[str, bytes]) -> ET.Element:
    match part:
        case str():
            return _tag("p", part)
        case Listing(lines):
            return _tag("ul", *(_tag("li", line) for line in lines))
        case Figure():
            return _figure(part, images[part.name])
        case Table():
            return _table(part)


def _figure(figure: Figure, image: bytes) -> ET.Element:
    source = f"data:image/svg+xml;base64,{base64.b64encode(image).decode()}"
    files = _files(*(f"{figure.name}.{kind}" for kind in ("png", "svg")))
    return _tag(
        "figure",
        _tag("h3", figure.title),
        _tag("img", src=source, alt=f"{figure.title}. {figure.caption}"),
        _tag("figcaption", figure.caption),
        files,
        id=figure.name,
    )


def _table(table: Table) -> ET.Element:
    shown = table.shown()
    is_number = [any(not isinstance(row[number], str) for row in table.rows) for number in range(len(table.columns))]
    classes = [{"class_": "number"} if number else {} for number in is_number]
    head = _tag("tr", *(_tag("th", column.heading, **of) for column, of in zip(table.columns, classes, strict=True)))
    rows = [_tag("tr", *(_tag("td", text, **of) for text, of in zip(row, classes, strict=True))) for row in shown]
    grid = _tag("div", _tag("table", _tag("thead", head), _tag("tbody", *rows)), class_="scroll")
    inside = [_tag("p", table.caption, class_="caption"), grid, _files(f"{table.name}.csv")]
    if table.is_folded:
        return _tag("details", _tag("summary", table.title), *inside, id=table.name)
    return _tag("section", _tag("h3", table.title), *inside, id=table.name)


def _files(*names: str) -> ET.Element:
    return _tag("p", *(part for name in names for part in (_tag("a", name, href=name),)), class_="files caption")

"""Pages: one look and one writer. What is not built here is text, and is escaped.

>>> print(bullets(["1 < 2", bold("oil") + ": floats"]))
<ul><li>1 &lt; 2</li><li><b>oil</b>: floats</li></ul>
"""
import base64
from collections.abc import Iterable, Sequence

from jinja2 import Environment
from markupsafe import Markup

_TEMPLATES = Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True)
_PAGE = _TEMPLATES.from_string("""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">
<title>{{ title }}</title>
<style>
body{font:15px sans-serif;margin:2em auto;padding:0 1em;max-width:80em;line-height:1.4}
table{border-collapse:collapse;display:block;overflow-x:auto}
td,th{padding:.35em .8em;border-bottom:1px solid #ddd;text-align:right;white-space:nowrap}
td:first-child,th:first-child,td.words,th.words{text-align:left}
td.words{white-space:normal}
tr.marked{background:#fbe9e7}
img{max-width:100%;height:auto}
@media print{body{margin:0;max-width:none}table{display:table}tr{break-inside:avoid}}
</style></head><body>
<h1>{{ heading }}</h1>
{% for part in parts %}
{{ part }}
{% endfor %}
</body></html>
""")
_TABLE = _TEMPLATES.from_string("""<table>
<tr>{% for head in heads %}<th{% if loop.index0 in words %} class="words"{% endif %}>{{ head }}</th>{% endfor %}</tr>
{% for row in rows %}
<tr{% if loop.index0 in marked %} class="marked"{% endif %}>{% for cell in row %}
<td{% if loop.index0 in words %} class="words"{% endif %}>{{ cell }}</td>{% endfor %}</tr>
{% endfor %}
</table>""")


def page(title: str, parts: Iterable[str], heading: str = "") -> str:
    """Return a whole page.

    Parameters
    ----------
    title : of the window.
    parts : results of the other functions here, one below the other; empty ones are left out.
    heading : above them; the title if nothing is said.
    """
    return _PAGE.render(title=title, heading=heading or title, parts=[part for part in parts if part])


def paragraph(*sentences: str) -> Markup:
    """Return a paragraph of sentences; empty without any."""
    text = Markup(" ").join(sentence for sentence in sentences if sentence)
    return Markup("<p>{}</p>").format(text) if text else Markup()


def section(text: str) -> Markup:
    """Return the heading of a section."""
    return Markup("<h2>{}</h2>").format(text)


def bold(text: str) -> Markup:
    """Return a text in bold."""
    return Markup("<b>{}</b>").format(text)


def bullets(items: Sequence[str]) -> Markup:
    """Return a list; empty without items."""
    return Markup("<ul>{}</ul>").format(Markup().join(map(Markup("<li>{}</li>").format, items))) if items else Markup()


def table(heads: Sequence[object], rows: Sequence[Sequence[object]], words: Iterable[int] = (),
          marked: Iterable[int] = ()) -> Markup:
    """Return a table.

    Parameters
    ----------
    words : columns, beside the first, that hold words: numbers stand at the right.
    marked : rows that catch the eye.
    """
    return Markup(_TABLE.render(heads=heads, rows=rows, words=set(words), marked=set(marked)))


def picture(png: bytes, description: str) -> Markup:
    """Return a picture that the page holds itself."""
    return Markup('<img alt="{}" src="data:image/png;base64,{}">').format(description, base64.b64encode(png).decode())

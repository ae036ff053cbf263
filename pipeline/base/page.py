"""Pages: one look and one writer. What is not built here is text, and is escaped.

>>> print(bullets(["1 < 2", bold("oil") + ": floats"]))
<ul><li>1 &lt; 2</li><li><b>oil</b>: floats</li></ul>
"""
import base64
import functools
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

from jinja2 import Environment, StrictUndefined, Template
from markupsafe import Markup

# Pages of a run, which lie side by side in its folder: file and what a link to it says.
RUN_PAGES = {"index.html": "this run", "metrics.html": "metrics", "advice.html": "advice", "cost.html": "cost",
             "effects.html": "effects"}
RUN_FILE = "scene.json"  # by which the folder of a run is known

_TEMPLATES = Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True, undefined=StrictUndefined)
_TABLE = _TEMPLATES.from_string("""<table>
<tr>{% for head in heads %}<th{% if loop.index0 in words %} class="words"{% endif %}>{{ head }}</th>{% endfor %}</tr>
{% for row in rows %}
<tr{% if loop.index0 in marked %} class="marked"{% endif %}>{% for cell in row %}
<td{% if loop.index0 in words %} class="words"{% endif %}>{{ cell }}</td>{% endfor %}</tr>
{% endfor %}
</table>""")


def page(title: str, parts: Iterable[str], heading: str = "", path: Path | None = None,
         links: Mapping[str, str] = MappingProxyType({}), style: str = "", head: str = "") -> str:
    """Return a whole page.

    Parameters
    ----------
    title : of the window.
    parts : results of the other functions here, one below the other; empty ones are left out.
    heading : above them; the title if nothing is said.
    path : file of the page; one in the folder of a run gets links to the other pages of that run.
    links : further links: file, relative to the page, and what the link says.
    style, head : what the page adds to the style and to its head, which is not escaped.
    """
    beside = path is not None and (path.parent / RUN_FILE).is_file()
    links = {file: text for file, text in RUN_PAGES.items() if beside and file != path.name} | dict(links)
    sheet = Path(__file__).with_suffix(".css").read_text(encoding="utf-8")
    return str(filled(__file__, title=title, heading=heading or title, parts=[part for part in parts if part],
                      links=links, style=Markup(f"{sheet}{style}"), head=Markup(head)))


def rendered(template: Path, **values: object) -> Markup:
    """Return a template of Jinja with values, which it escapes unless they are Markup."""
    return Markup(_template(template).render(**values))


def filled(module: str, **values: object) -> Markup:
    """Return the template that has the name of a file of Python, beside it: digests count both together."""
    return rendered(Path(module).with_suffix(".html"), **values)


@functools.cache
def _template(path: Path) -> Template:
    return _TEMPLATES.from_string(path.read_text(encoding="utf-8"))


def paragraph(*sentences: str) -> Markup:
    """Return a paragraph of sentences; empty without any."""
    text = joined(*sentences)
    return Markup("<p>{}</p>").format(text) if text else Markup()


def joined(*sentences: str) -> Markup:
    """Return sentences as one text."""
    return Markup(" ").join(sentence for sentence in sentences if sentence)


def section(text: str) -> Markup:
    """Return the heading of a section."""
    return Markup("<h2>{}</h2>").format(text)


def bold(text: str) -> Markup:
    """Return a text in bold."""
    return Markup("<b>{}</b>").format(text)


def link(text: str, address: str) -> Markup:
    """Return a text that leads to an address, relative to the page."""
    return Markup('<a href="{}">{}</a>').format(address, text)


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


# What templates call by name.
_TEMPLATES.globals |= {"bullets": bullets, "table": table}


def picture(png: bytes, description: str) -> Markup:
    """Return a picture that the page holds itself."""
    return Markup('<img alt="{}" src="data:image/png;base64,{}">').format(description, base64.b64encode(png).decode())


def details(summary: str, *parts: str) -> Markup:
    """Return parts that open on a click on their summary."""
    return Markup("<details><summary>{}</summary>\n{}\n</details>").format(summary, Markup("\n").join(parts))

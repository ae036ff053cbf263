"""The site of the documents: `./run docs` builds it into docs/_build, with every warning an error.

It is read without a network: search, letters, equations and pictures are local. The Markdown stays what a forge shows;
what only the site knows is here: the order of the pages is in _toc.yml, links that leave this folder are led where the
site has an answer, and docstrings in the style of this project become fields.
"""
import os
import re
import subprocess
import sys
import textwrap
import tomllib
from pathlib import Path

import latex2mathml.converter
import yaml
import ziamath
from docutils import nodes
from sphinx.util import logging

logger = logging.getLogger(__name__)

DOCS = Path(__file__).parent
ROOT = DOCS.parent
sys.path.insert(0, str(ROOT))

_about = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
project, version, release = "Eye-oil pipeline", _about["version"], _about["version"]
author = _about["authors"][0]["name"]
copyright = f"{author}, {_about['license']} license"

extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx_external_toc"]
exclude_patterns = ["_build", "report", "images"]
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 4  # a link to a heading is what it is on a forge
nb_execution_mode = "off"  # docs/make_notebook.py runs it
autodoc_member_order = "bysource"
autodoc_typehints = "description"
autodoc_typehints_format = "short"
autodoc_mock_imports: list[str] = []
add_module_names = False
python_display_short_literal_types = True
napoleon_google_docstring = False
napoleon_use_ivar = True
napoleon_custom_sections = [("Class attributes", "Attributes")]

html_theme = "pydata_sphinx_theme"
html_title = project
html_static_path = ["site.css"]
html_css_files = ["site.css"]
html_search_scorer = str(DOCS / "search_scorer.js")
html_show_sourcelink = False
html_copy_source = False
html_math_renderer = "paths"
html_theme_options = {
    "logo": {"text": project},
    "navbar_align": "left",
    "header_links_before_dropdown": 8,
    "show_toc_level": 2,
    "secondary_sidebar_items": ["page-toc"],
    "footer_start": ["copyright"],
    "footer_end": [],
}
html_sidebars = {"index": [], "gallery": [], "cite": []}


# Equations, as paths of a mathematical font: no script, no letters to load, the same in every browser.

# What the library does not know, in what it knows; letters that it draws upright.
TEX = ((re.compile(r"\\mathrel\{(.)\}"), r"{\1}"), (re.compile(r"\\arg(?![a-z])"), r"\\operatorname{arg}"),
       *((re.compile(rf"\\{name}(?![a-z])"), letter) for name, letter in (
           ("phi", "𝜙"), ("epsilon", "𝜖"), ("vartheta", "𝜗"), ("varrho", "𝜚"))))


def parts_of(tex: str) -> list[str]:
    """Return the parts of an equation that may stand on lines of their own: wide spaces part them.

    >>> parts_of(r"a = {b \\quad c}, \\qquad d \\qquad (P1)")
    ['a = {b \\\\quad c},', 'd', '(P1)']
    """
    parts, depth = [""], 0
    for token in re.split(r"(\\(?:qquad|quad|begin|end|left|right)(?![a-z])|(?<!\\)[{}])", tex):
        depth += {"{": 1, "\\begin": 1, "\\left": 1, "}": -1, "\\end": -1, "\\right": -1}.get(token, 0)
        if depth == 0 and token in (r"\qquad", r"\quad"):
            parts.append("")
        else:
            parts[-1] += token
    return [part.strip() for part in parts if part.strip()]


def drawn(self, node: nodes.Element, tex: str, size: float, inline: bool) -> str:
    """Return an equation as SVG, with its TeX as the words that are read out."""
    known = tex
    for pattern, words in TEX:
        known = pattern.sub(words, known)
    if unknown := re.findall(r"\\\w+", re.sub(r"<[^>]*>", "", latex2mathml.converter.convert(known))):
        logger.warning("%s: cannot be drawn: %s", " ".join(unknown), tex, location=node)
    picture = ziamath.Latex(known, size=size, inline=inline, color="currentColor")
    label = f'role="img" aria-label="{self.attval(tex)}" style="vertical-align: {picture.getyofst():.2f}px"'
    return picture.svg().replace("<svg ", f"<svg {label} ", 1)


def inline_equation(self, node: nodes.Element) -> None:
    """Write an equation in a line."""
    self.body.append(drawn(self, node, node.astext(), 16.5, True))
    raise nodes.SkipNode


def display_equation(self, node: nodes.Element) -> None:
    """Write an equation of its own, whose number stands at the right and can be linked to, as `#I1`."""
    self.body.append('<div class="equation">')
    for part in parts_of(node.astext()):
        number = re.fullmatch(r"\(([A-Z]\d+)\)", part)
        self.body.append(f'<a class="number" id="{number[1]}" href="#{number[1]}">{part}</a>' if number else
                         f"<span>{drawn(self, node, part, 18.0, False)}</span>")
    self.body.append("</div>\n")
    raise nodes.SkipNode


# Links to what is not a page of the site.

PAGES = {"README.md": "index.md", "CHANGELOG.md": "changelog.md", "CONTRIBUTING.md": "contributing.md"}
LINK = re.compile(r"(?<!!)\[([^\[\]]*)\]\(([^)\s#:]+)(#[^)\s]*)?\)")


def lead_links(app, name: str, source: list[str]) -> None:
    """Let links to documents outside of this folder lead to their pages, and let those to folders name them."""
    folder = (DOCS / name).parent

    def led(match: re.Match) -> str:
        words, target, anchor = match[1], match[2], match[3] or ""
        path = Path(os.path.normpath(folder / target))
        if path.parent == ROOT and path.name in PAGES:
            return f"[{words}]({os.path.relpath(DOCS / PAGES[path.name], folder)}{anchor})"
        if path.is_dir() or (path.suffix == ".md" and not path.is_relative_to(DOCS)):
            named = f"`{path.relative_to(ROOT)}`"
            return named if words == named.strip("`") else f"{words} ({named})"
        return match[0]

    if not name.endswith("notebook"):
        source[0] = LINK.sub(led, source[0])


# Pages that the code fills.

def printed(module: str, *arguments: str) -> str:
    """Return what a stage prints."""
    command = [sys.executable, "-m", module, *arguments]
    return subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout


def headed(text: str) -> str:
    """Return a printed list as Markdown, with headings for names that stand alone on their lines: search finds them.

    >>> print(headed("Effects\\n  drag\\n    Slows down.\\n      rate: per second\\n  none: at all"))
    ## Effects
    <BLANKLINE>
    ### drag
    <BLANKLINE>
    ```text
      Slows down.
        rate: per second
    none: at all
    ```
    """
    blocks: list[list[str]] = [[]]
    for line in text.splitlines():
        depth = len(line) - len(line.lstrip())
        if depth <= 2 and re.fullmatch(r"[A-Z][a-z ]+|[a-z_0-9]+", line.strip()):
            blocks += [[f"##{'#' * (depth // 2)} {line.strip()}"], []]
        elif line.strip() or blocks[-1]:
            blocks[-1].append(line)
    made = ["\n".join(one) if one[0].startswith("##") else "\n".join(["```text", *_to_the_left(one), "```"])
            for one in blocks if one]
    return "\n\n".join(made)


def _to_the_left(lines: list[str]) -> list[str]:
    return textwrap.dedent("\n".join(lines)).strip("\n").splitlines()


def fill_in(app, name: str, source: list[str]) -> None:
    """Put what a stage prints where a page asks for it: `<!-- python -m pipeline.scene --list -->`."""
    source[0] = re.sub(r"<!-- python -m (\S+) (.*) -->",
                       lambda match: headed(printed(match[1], *match[2].split())), source[0])


# Words of users, for search and index.

WORDS = yaml.safe_load((DOCS / "_words.yml").read_text(encoding="utf-8"))


def put_words(app, name: str, source: list[str]) -> None:
    """Put the words of `_words.yml` behind the headings that answer them."""
    for place, words in WORDS.items():
        page, _, heading = place.partition("#")
        if page != name:
            continue
        app.env.note_dependency(str(DOCS / "_words.yml"))
        behind = [line.end() for line in re.finditer(r"^#+ (.+)$", source[0], re.MULTILINE) if slug(line[1]) == heading]
        if not behind:
            logger.warning("_words.yml: %s has no heading #%s", name, heading)
        for end in behind[:1]:
            entries = ", ".join(f"! {word}" for word in words)
            source[0] = f"{source[0][:end]}\n\n```{{index}} {entries}\n```\n{source[0][end:]}"


def slug(heading: str) -> str:
    """Return what a forge makes of a heading in links.

    >>> slug('What "touches" means, in short')
    'what-touches-means-in-short'
    """
    return re.sub(r"[^\w -]", "", heading).strip().lower().replace(" ", "-")


# Docstrings: `name : what it is`, where numpydoc has a type behind the colon; types come from annotations.

SECTION = re.compile(r"(Parameters|Attributes|Class attributes|Raises|Returns|Yields)$")
ENTRY = re.compile(r"(\*{0,2}\w+(?:, \*{0,2}\w+)*) : (.+)")


def as_numpydoc(app, what: str, name: str, thing: object, options: object, lines: list[str]) -> None:
    """Give every name of a section a line of its own, for napoleon."""
    within, made = False, []
    for index, line in enumerate(lines):
        if index + 1 < len(lines) and set(lines[index + 1].strip()) == {"-"}:
            within = bool(SECTION.match(line))
        match = ENTRY.fullmatch(line) if within else None
        made += [match[1], f"    {match[2]}"] if match else [line]
    lines[:] = made


def setup(app) -> dict[str, bool]:
    """Connect what is above."""
    app.add_html_math_renderer("paths", (inline_equation, None), (display_equation, None))
    app.connect("source-read", put_words)
    app.connect("source-read", fill_in)
    app.connect("source-read", lead_links)
    app.connect("autodoc-process-docstring", as_numpydoc, priority=400)
    return {"parallel_read_safe": True, "parallel_write_safe": True}

"""A page that answers one question of a surgeon, to be read in two minutes.

Every page says the same things in the same order: the answers, one picture, that it is no advice, and, on a click, the
tables, what the answers rest on, and what words mean. The file `<report>_page.py` of `studies` writes the page of the
studies with that `report`, and says so in a :class:`StudyPage`.
"""
import dataclasses
import io
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from markupsafe import Markup

from pipeline.base import page
from pipeline.base.canvas import empty_figure
from pipeline.base.errors import UserError
from pipeline.base.files import replacing, write_text
from pipeline.base.tables import csv_of
from pipeline.base.words import NO_ADVICE
from pipeline.studies.guests import guest, page_modules
from pipeline.studies.model import Outcome
from pipeline.web.embedded import data_url

if TYPE_CHECKING:
    from pipeline.studies.family import Family
    from pipeline.studies.plan import Study

Names = tuple[str, ...] | Callable[[Sequence[str]], Sequence[str]]
DOCS = "../../../../docs"  # from outputs/studies/<study>/<level>
# What words mean, for readers who compute nothing.
WORDS = {
    "touched": "the oil (or gas) reaches the retina. A film of aqueous micrometers thin, which real oil may leave, "
               "is in no computation here.",
    "aqueous": "the clear, watery fluid that fills what the oil (or gas) leaves of the eye.",
    "light and heavy oil": "lighter than aqueous, so that it floats; heavier, so that it sinks.",
    "supine and prone": "lying on the back; lying face down.",
    "fundus": "the back of the eye, as a doctor sees it through the pupil.",
    "interface": "where oil and aqueous meet inside the eye.",
    "contact line": "where the interface meets the wall: the edge of what the oil touches.",
    "contact angle": "between interface and wall, through the aqueous. It is small, since the wall likes aqueous more "
                     "than oil: aqueous creeps under the edge of the oil.",
    "tension": "pulls the oil into a ball, while its weight in aqueous flattens it. In an eye both are about as "
               "strong, so that the face of the oil is round, not level as that of gas.",
    "at rest": "when weight, tension and wetting are in balance (the shape of least energy). Oil comes to rest within "
               "seconds to a minute after a movement.",
    "points": "differences of percentages: 64 in place of 67 % are 3 points.",
    "grid": "shapes at rest are computed as distances in many directions from one point, as a picture is of pixels.",
    "particles": "simulations follow the liquids as thousands of small parcels (smoothed particle hydrodynamics), "
                 "which push and drag their neighbors. Nothing smaller than such a parcel is seen.",
    "stress": "drag along the retina, force over area, in pascals: 133 Pa are 1 mmHg, but along the wall, not onto it.",
    "capillary number": "viscosity times speed over tension. Far below 1, tension decides how the oil breaks up, and "
                        "the viscosity does not matter.",
    "ppm": "parts in a million of the volume: in a cavity of 5 mL 1 ppm is 5 nL, nearly three million droplets of 1.5 "
           "micrometers.",
}


@dataclasses.dataclass(frozen=True)
class QuestionPage:
    """What a page says: answers and picture; all else opens on a click.

    Attributes
    ----------
    description : what was asked.
    answers : sentences, one for each thing that a reader may choose, such as an oil.
    picture, picture_words, caption : PNG, what it shows in words, and sentences below it.
    folded : heading -> what opens below it, such as a table.
    assumed, validated, not_validated : sentences; those of ``validated`` carry numbers and links.
    words : of ``WORDS``, that the page explains.
    """

    description: str
    answers: Sequence[str]
    picture: bytes
    picture_words: str
    caption: Sequence[str]
    folded: Mapping[str, Markup]
    assumed: Sequence[str]
    validated: Sequence[str]
    not_validated: str
    words: Sequence[str]

    def parts(self) -> list[str]:
        """Return the parts of the page."""
        return [page.filled(
            __file__, no_advice=NO_ADVICE, question=self,
            picture=data_url(self.picture, "image/png"), explained={word: WORDS[word] for word in self.words})]


def link_to(document: str) -> str:
    """Return a link from the page of a study to a page of the documents, such as "results/eye.md"."""
    return page.link(f"docs/{document}", f"{DOCS}/{document}")


def joined_tables(outcomes: Sequence[Outcome], name: str) -> tuple[list[str], list[list[str]]]:
    """Return heads and lines of a table that several cases have lines of.

    Raises
    ------
    UserError : no case has any.
    """
    tables = [outcome.tables[name] for outcome in outcomes if name in outcome.tables]
    if not tables:
        raise UserError(f"no case has a result for the table {name} yet; run the study, and see what its cases say")
    return tables[0][0], [line for table in tables for line in table[1:]]


def table_rows(outcomes: Sequence[Outcome], name: str) -> list[dict[str, str]]:
    """Return the lines of a table that several cases have lines of, as mappings from heads to cells."""
    heads, lines = joined_tables(outcomes, name)
    return [dict(zip(heads, line, strict=True)) for line in lines]


def written_tables(outcomes: Sequence[Outcome], names: Iterable[str], folder: Path) -> dict[str, list[dict[str, str]]]:
    """Write tables that several cases have lines of; return their lines, as mappings from heads to cells."""
    found = {name: table_rows(outcomes, name) for name in names}
    for name, rows in found.items():
        write_text(folder / f"{name}.csv", csv_of(tuple(rows[0]), rows))
    return found


def write_picture(path: Path, content: bytes) -> None:
    """Write a picture."""
    with replacing(path) as partial:
        partial.write_bytes(content)


def drawn(size: tuple[float, float], draw: Callable, *grid: int, **options) -> bytes:
    """Return a picture as PNG.

    Parameters
    ----------
    size : width and height in inches.
    draw : gets the axes, one or an array of them as ``grid`` (rows, columns) and ``options`` ask for.
    """
    canvas = empty_figure(size)
    draw(canvas.subplots(*grid, **options))
    buffer = io.BytesIO()
    canvas.savefig(buffer, dpi=120, format="png")
    return buffer.getvalue()


@dataclasses.dataclass(frozen=True)
class StudyPage:
    """What writes the page of a study: the file `<report>_page.py` ends in ``PAGE = StudyPage(__name__, ...)``.

    Attributes
    ----------
    module : name of its module.
    pictures, tables : names of the PNG and CSV files that it writes, or a function that names them by the families.
    write : called with the description of the study, its outcomes and the folder; returns the parts of the page, none
        where the page is the table.
    in_short : returns what rows of several cases say together.
    judge : called before all else with the study of the cases that have a result, their outcomes and the folder;
        returns the outcomes that are shown in place of these.
    lacks : returns what a family lacks that this page needs, in words; empty: nothing.
    """

    module: str
    pictures: Names
    tables: Names
    write: Callable[[str, Sequence[Outcome], Path], list[str]]
    in_short: Callable[[Sequence[Outcome]], list[Outcome]] = lambda outcomes: []
    judge: Callable[["Study", list[Outcome], Path], list[Outcome]] | None = None
    lacks: Callable[["Family"], str] = lambda family: ""

    @staticmethod
    def named(names: Names, families: Sequence[str]) -> Sequence[str]:
        """Return the names of files of a study with such families."""
        return names(families) if callable(names) else names


def page_of(report: str) -> StudyPage:
    """Return what writes the page of a report.

    Raises
    ------
    UserError : its file does not say.
    """
    module = guest(page_modules()[report])
    page = getattr(module, "PAGE", None)
    if not isinstance(page, StudyPage):
        raise UserError(f"{module.__file__}: has no PAGE, which must be a StudyPage")
    return page

"""A plan from words as users write them: the same for the command line and for Python."""
import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from markupsafe import Markup

from pipeline.base import page
from pipeline.base.errors import UserError
from pipeline.base.words import NO_ADVICE, nearest
from pipeline.equilibrium.least import Resting
from pipeline.equilibrium.star_cavity import levels_of
from pipeline.planning.bracket import bracket_of
from pipeline.planning.breaks import GLOBE, read_break
from pipeline.planning.chart import Charts
from pipeline.planning.confirm import confirming_scene
from pipeline.planning.report import by_oil, html_of, reading, shown_first, table, text_of, verdicts
from pipeline.planning.search import CACHE, FILL_ERROR, Answer, Question, Tables, answers
from pipeline.planning.settings import Settings, load_settings, postures
from pipeline.scenes.model import Eye
from pipeline.scenes.reader import Errors, Reader
from sim.parameters import parameter

Record = TypeVar("Record")
MAPS = 6    # answers that the page draws


@dataclasses.dataclass(frozen=True)
class Plan:
    """The answers to a question, the smallest fill first; a notebook shows the best one and a table.

    Attributes
    ----------
    question : what was asked, in SI units.
    eye : the eye that it was asked for.
    answers : one answer for every density of oil and every posture.
    """

    question: Question
    eye: Eye
    answers: tuple[Answer, ...]

    @property
    def best(self) -> Answer | None:
        """The smallest fill that covers the break; None where none does."""
        first = self.answers[0]
        return first if first.covers(self.question.largest_fill) else None

    def text(self) -> str:
        """Return all as text: what the command prints."""
        return text_of(self.question, self.answers, self.eye)

    def page(self) -> str:
        """Return all as a page, with maps of the fundus: of every oil in the first posture, and in the best one."""
        resting, question = Resting.of(self.eye), self.question
        charts, maps = Charts(resting.cavity(), {"": question.place}, self.eye.side == "right"), []
        shown = [answer for same in by_oil(question, self.answers).values() for answer in shown_first(question, same)]
        for answer in shown[:MAPS]:
            bracket = bracket_of(resting, question.liquids(question.oils[answer.oils[0]]), postures()[answer.posture],
                                 min(answer.fill, question.largest_fill), question.other_angles, FILL_ERROR)
            if bracket is None:
                raise UserError(f"{answer.oils[0]}, {answer.posture}, {100.0 * answer.fill:.1f} %: no shape at rest "
                                "was found for the map; ask for other postures")
            maps.append((answer, bracket, charts.address(bracket.contact, (bracket.low, bracket.high))))
        return html_of(self.question, self.answers, self.eye, maps)

    def scene(self) -> str:
        """Return the scene file that confirms the best answer by one simulation."""
        return confirming_scene(self.question, self.answers[0], self.eye, load_settings()[0].confirming_scene)

    def __str__(self) -> str:
        return self.text()

    def __repr__(self) -> str:
        return f"<{' '.join(verdicts(self.question, self.answers))}>"

    def _repr_html_(self) -> str:
        return str(Markup("\n").join([
            page.paragraph(f"Break: {self.question.place.words(self.eye.side)}."),
            page.bullets(verdicts(self.question, self.answers)), page.paragraph(reading(self.question, self.answers)),
            table(self.question, self.answers), page.paragraph(NO_ADVICE)]))


def plan_fill(place: str, size: str = "1h", *, margin: str | float = "0.5 mm", oils: Sequence[str] | None = None,
              postures: Sequence[str] | None = None, eye: Mapping[str, Any] | None = None,
              tension: str | float | None = None, contact_angle: str | float | None = None,
              largest_fill: str | float | None = None, cache: Path = CACHE) -> Plan:
    """Find the smallest fills, the oils and the postures that cover a break of the retina, as ``pipeline.plan`` does.

    Oil at rest is looked up or computed as the shape of least energy (docs/methods/equilibrium.md). It is an
    illustration of physics, not for decisions on a patient.

    Parameters
    ----------
    place : clock hour and angle from the posterior pole, such as "6h,60deg".
    size : width in clock hours, height in degrees or mm, or both, such as "2h,15deg" or "3mm".
    margin : how far the oil must reach beyond the break, m or a text such as "1 mm".
    oils : liquids to choose from; by default all of ``config/plan.yaml``.
    postures : postures to choose from; by default all.
    eye : keys of ``eye`` in a scene, such as ``{"axial_length": "26 mm", "lens": "aphakic"}``; by default the model
        eye, which is answered at once.
    tension : interfacial tension, N/m or a text; by default that of ``config/plan.yaml``.
    contact_angle : contact angle through the aqueous, rad or a text; by default that of ``config/plan.yaml``.
    largest_fill : share of the cavity above which a break counts as not covered.
    cache : folder in which tables of other eyes are kept.

    Returns
    -------
    The answers, the smallest fill first.

    Raises
    ------
    UserError : an argument is wrong, one sentence for each.

    Examples
    --------
    >>> best = plan_fill("6h,60deg", "2h", oils=["silicone_oil_1000"]).best
    >>> best.posture, f"{100.0 * best.fill:.0f} %"
    ('prone', '67 %')
    """
    shape = read_eye(eye or {})
    globe = float(-levels_of(shape)[1][0, 2])
    question = question_of(place, size, globe, margin=margin, oils=oils, chosen=postures, tension=tension,
                           contact_angle=contact_angle, largest_fill=largest_fill)
    return Plan(question, shape, tuple(answers(question, Tables(shape, cache), globe)))


def question_of(place: str, size: str, globe: float = GLOBE, *, margin: str | float = "0.5 mm",
                oils: Sequence[str] | None = None, chosen: Sequence[str] | None = None,
                **changed: str | float | None) -> Question:
    """Return what is asked, from words.

    Parameters
    ----------
    globe : radius of the globe behind, m, for sizes in mm.
    chosen : postures.
    changed : values of ``Settings`` that take the place of those in ``config/plan.yaml``, unless they are None.
    """
    settings, materials = load_settings()
    given = read_record(Settings, {name: value for name, value in changed.items() if value is not None}, settings)
    reach = read_record(_Margin, {"margin": margin}).margin
    known = _chosen("--oil", oils, settings.oils)
    return Question(read_break(place, size, globe), reach, {name: materials[name] for name in known},
                    materials[settings.other_liquid], _chosen("--postures", chosen, tuple(postures())),
                    given.tension, given.contact_angle, given.other_angles, given.largest_fill)


def read_eye(values: Mapping[str, Any]) -> Eye:
    """Return an eye from its keys in a scene."""
    return read_record(Eye, dict(values))


def read_record(kind: type[Record], values: Mapping[str, Any], base: Record | None = None) -> Record:
    """Read values as those of a scene are read; errors name them, and no file."""
    errors = Errors("")
    record: Record = Reader(errors).record(kind, dict(values), (), base)
    if errors.messages:
        raise UserError(*(sentence.removeprefix(": ") for sentence in errors.messages))
    return record


def _chosen(option: str, names: Sequence[str] | None, allowed: Sequence[str]) -> tuple[str, ...]:
    """Names, each once; all that are allowed where none is given."""
    if names is None:
        return tuple(allowed)
    for name in names:
        if name not in allowed:
            raise UserError(f'{option}: "{name}" is not known{nearest(name, allowed)}; known are {", ".join(allowed)}')
    return tuple(dict.fromkeys(names))


@dataclasses.dataclass(frozen=True)
class _Margin:
    """How far the oil must reach beyond a break."""

    margin: float = parameter(unit="m", minimum=0.0, maximum=0.01, meaning="reach of the oil beyond the break")

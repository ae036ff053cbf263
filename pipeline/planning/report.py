"""What a plan says, as text and as a page."""
from collections.abc import Sequence

import numpy as np

from pipeline.base import page
from pipeline.base.words import NO_ADVICE, columns
from pipeline.equilibrium.checked import CHECKED
from pipeline.planning.search import FILL_ERROR, Answer, Question
from pipeline.planning.touch import FILLS
from pipeline.scenes.model import Eye

NOTHING = "–"


def percent(share: float | None, digits: int = 0) -> str:
    """Return a share of one in percent."""
    return NOTHING if share is None else f"{100 * share:.{digits}f} %"


def fill_words(fill: float) -> str:
    """Return a smallest fill in words.

    >>> fill_words(0.5), fill_words(0.913), fill_words(0.999)
    ('50 % or less', '91.3 %', 'above 99.5 %')
    """
    if fill <= FILLS[0]:
        return f"{percent(FILLS[0])} or less"
    return f"above {percent(FILLS[-1], 1)}" if fill > FILLS[-1] else percent(fill, 1)


def span_words(answer: Answer) -> str:
    """Return what the fill may be."""
    if answer.low is None or answer.high is None:
        return NOTHING
    if answer.low <= FILLS[0]:
        return fill_words(FILLS[0]) if answer.high <= FILLS[0] else f"{percent(answer.high)} or less"
    if answer.high > FILLS[-1]:
        return f"{percent(answer.low)} or more"
    return f"{percent(answer.low)} to {percent(answer.high)}"


def eye_words(eye: Eye) -> str:
    """Return which eye was planned for."""
    if eye.model == "mesh":
        return f"the mesh {eye.path}"
    words = [f"{eye.lens}, {1e3 * eye.axial_length:g} mm long, an average eye of this length"]
    if eye.anterior_chamber:
        words.append("the anterior chamber filled too")
    if eye.buckle is not None:
        hours = eye.buckle.clock_hours
        place = "all around" if hours is None else f"from {hours[0]:g} to {hours[1]:g} o'clock"
        words.append(f"a buckle of {1e3 * eye.buckle.height:g} mm {place}")
    if eye.staphyloma is not None:
        words.append(f"a staphyloma of {1e3 * eye.staphyloma.depth:g} mm")
    return ", ".join(words)


def verdict(question: Question, found: Sequence[Answer]) -> list[str]:
    """Return the answer in sentences."""
    best = found[0]
    largest = percent(question.largest_fill)
    if not best.covers(question.largest_fill):
        return [f"The break cannot be covered: no oil and no posture asked for covers it with {largest} of the cavity "
                f"filled, and more is hardly got in.",
                f"The least that would do is {fill_words(best.fill)}: {best.oils[0]}, {_named(best.posture)}."]
    doubt = span_words(best)
    sentence = (f"{best.oils[0]}, {_named(best.posture)}: {fill_words(best.fill)} of the cavity"
                + (f" ({doubt})" if doubt not in (NOTHING, fill_words(best.fill)) else "") + ".")
    sentences = [f"The smallest fill that covers the break is {sentence}"]
    if best.high is not None and best.high > question.largest_fill:
        sentences.append(f"With another contact angle it may need more than the {largest} that are got in.")
    without = [answer for answer in found if not answer.covers(question.largest_fill)]
    if without:
        names = "; ".join(f"{answer.oils[0]}, {_named(answer.posture)}" for answer in without)
        sentences.append(f"It cannot be covered (more than {largest} would be needed) with: {names}.")
    return sentences


def assumptions(question: Question, eye: Eye) -> list[str]:
    """Return what the answer rests on."""
    angles = " and ".join(f"{np.degrees(angle):.3g}" for angle in question.other_angles)
    nasal = "nasal" if eye.side == "right" else "temporal"
    return [
        f"Clock hours as an observer sees them who faces the patient (chart of Amsler and Dubois): 3 is on the "
        f"patient's left, {nasal} in this {eye.side} eye.",
        f"Eye: {eye_words(eye)}. What is not named here, such as another individual shape, is only in a mesh.",
        f"The oil must reach {1e3 * question.margin:g} mm beyond the break on all sides.",
        f"Oil at rest: tension {1e3 * question.tension:g} mN/m, contact angle {np.degrees(question.contact_angle):.3g} "
        f"degrees through {question.other.name}, which wets the rest of the wall. Only densities, tension, angle and "
        f"shape matter; viscosity does not.",
        f"The range of a fill is that for {angles} degrees, with {percent(FILL_ERROR)} for the error of the shapes. "
        f"Where two shapes are at rest, as after filling in and after taking out, the one with less energy counts, and "
        f"the range holds both.",
        f"Fills above {percent(question.largest_fill)} are taken as not got in. The retina is attached, the head rests "
        f"and the oil is one body.",
    ]


def heads() -> tuple[str, ...]:
    """Return the heads of the table."""
    return ("oil", "posture", "smallest fill", "may be", "retina", "superior", "inferior", "macula")


def rows(found: Sequence[Answer]) -> list[tuple[str, ...]]:
    """Return the table: a line for every oil and posture, the smallest fill first."""
    return [(answer.oils[0], _named(answer.posture), fill_words(answer.fill), span_words(answer),
             *(percent(answer.shares[name]) for name in ("retina", "superior", "inferior", "macula")))
            for answer in found]


def text_of(question: Question, found: Sequence[Answer], eye: Eye) -> str:
    """Return the plan as text."""
    return "\n".join([f"Break: {question.place.words(eye.side)}.", *verdict(question, found), "",
                      *columns([heads(), *rows(found)]), "", _below(question, found), "", "Assumed:",
                      *(f"- {line}" for line in assumptions(question, eye)), "", "Checked:",
                      *(f"- {line}" for line in CHECKED), "", NO_ADVICE, ""])


def html_of(question: Question, found: Sequence[Answer], eye: Eye, maps: Sequence[bytes] = ()) -> str:
    """Return the plan as a page.

    Parameters
    ----------
    maps : of the fundus, PNG files, of the first answers.
    """
    first, *others = verdict(question, found)
    marked = [index for index, answer in enumerate(found) if not answer.covers(question.largest_fill)]
    return page.page("Fill, oil and posture for a break of the retina", [
        page.paragraph(page.bold(NO_ADVICE)),
        page.paragraph(f"Break: {question.place.words(eye.side)}."),
        page.paragraph(page.bold(first), *others),
        page.table(heads(), rows(found), words=(1,), marked=marked),
        page.paragraph(_below(question, found)),
        page.section("What the oil touches") if maps else "",
        page.paragraph("Maps of the fundus as an observer sees it who faces the patient: ivory is touched, the break "
                       "is red, the edge is uncertain where it is hatched.") if maps else "",
        *(part for png, answer in zip(maps, found, strict=False) for part in (
            page.paragraph(page.bold(_caption(answer, question))), page.picture(png, _caption(answer, question)))),
        page.section("Assumed"),
        page.bullets(assumptions(question, eye)),
        page.section("What was validated, and what was not"),
        page.bullets(CHECKED),
    ])


def _caption(answer: Answer, question: Question) -> str:
    return f"{answer.oils[0]}, {_named(answer.posture)}, {percent(min(answer.fill, question.largest_fill), 1)}"


def _below(question: Question, found: Sequence[Answer]) -> str:
    alike = dict.fromkeys(answer.oils for answer in found if len(answer.oils) > 1)
    return " ".join([f"The last four columns: covered share of the retina and its parts at this fill, or at "
                     f"{percent(question.largest_fill)} where more would be needed.",
                     *(f"{', '.join(oils[1:])} rest as {oils[0]} does." for oils in alike)])


def _named(posture: str) -> str:
    return posture.replace("_", " ")

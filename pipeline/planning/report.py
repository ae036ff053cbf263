"""What a plan says, as text and as a page: oil by oil, the posture that was asked for first."""
from collections.abc import Sequence

import numpy as np

from pipeline.base import page
from pipeline.base.words import NO_ADVICE, columns, in_a_row
from pipeline.equilibrium.checked import CHECKED
from pipeline.planning.search import FILL_ERROR, Answer, Question
from pipeline.planning.touch import FILLS
from pipeline.scenes.model import Eye
from pipeline.scenes.retina import side_word
from sim.liquid import GAS_DENSITY

NOTHING = "–"
HEADS = ("", "posture", "smallest fill", "range", "retina", "superior", "inferior", "macula")
WORDS = (0, 1, 2, 3)    # columns of the table that hold words


def percent(share: float | None, digits: int = 0) -> str:
    """Return a share of one in percent.

    >>> percent(0.934), percent(float("nan"))
    ('93 %', '–')
    """
    return NOTHING if share is None or np.isnan(share) else f"{100 * share:.{digits}f} %"


def fill_words(fill: float, digits: int = 0) -> str:
    """Return a smallest fill in words.

    >>> fill_words(0.5), fill_words(0.932), fill_words(0.999)
    ('at most 50 %', '93 %', 'more than 99.5 %')
    """
    if round(100 * fill) <= 100 * FILLS[0]:
        return f"at most {percent(FILLS[0])}"
    return f"more than {percent(FILLS[-1], 1)}" if fill > FILLS[-1] else percent(fill, digits)


def span_words(answer: Answer) -> str:
    """Return what the fill may be."""
    if answer.low is None or answer.high is None:
        return NOTHING
    if answer.high > FILLS[-1]:
        return f"at least {percent(answer.low)}"
    if answer.low <= FILLS[0]:
        return fill_words(FILLS[0]) if answer.high <= FILLS[0] + FILL_ERROR else f"at most {percent(answer.high)}"
    return f"{percent(answer.low)[:-2]} to {percent(answer.high)}"


def posture_words(posture: str) -> str:
    """Return how a patient lies or sits.

    >>> posture_words("upright"), posture_words("left_side")
    ('upright', 'on the left side')
    """
    return f"on the {posture.replace('_', ' ')}" if posture.endswith("_side") else posture.replace("_", " ")


def oil_words(question: Question, oils: Sequence[str]) -> str:
    """Return what oils of one density are: light, heavy or a gas, and their names."""
    density = question.oils[oils[0]].density
    kind = "gas" if density < GAS_DENSITY else "light oil" if density < question.other.density else "heavy oil"
    names = [name.replace("_", " ") for name in oils]
    first = names[0].rpartition(" ")[0] + " "
    names[1:] = [name.removeprefix(first) for name in names[1:]]
    names[0] = names[0].removeprefix(f"{kind} ")
    return f"{kind} ({in_a_row([name[:1].upper() + name[1:] if kind == 'heavy oil' else name for name in names])})"


def by_oil(question: Question, found: Sequence[Answer]) -> dict[str, list[Answer]]:
    """Return the answers of every oil, in words, in the order of the question; the smallest fill first in each."""
    known = {answer.oils: oil_words(question, answer.oils) for answer in found}
    order = sorted(known, key=lambda oils: list(question.oils).index(oils[0]))
    return {known[oils]: [answer for answer in found if answer.oils == oils] for oils in order}


def shown_first(question: Question, same: Sequence[Answer]) -> list[Answer]:
    """Return two answers of an oil, or one: the first posture that was asked for, and the one of the smallest fill."""
    asked = next(answer for answer in same if answer.posture == question.postures[0])
    return [asked] if asked is same[0] else [asked, same[0]]


def fill_needed(question: Question, answer: Answer) -> str:
    """Return the smallest fill of an answer and what it may be, or that there is none."""
    largest, doubt = question.largest_fill, span_words(answer)
    if not answer.covers(largest):
        return f"not covered with {percent(largest)}"
    fill = fill_words(answer.fill)
    return fill if doubt in (NOTHING, fill) or fill == fill_words(FILLS[0]) else f"{fill} ({doubt})"


def verdict(question: Question, found: Sequence[Answer]) -> list[str]:
    """Return the answer in sentences, one for every oil."""
    largest = question.largest_fill
    if not found[0].covers(largest):
        best = found[0]
        return [f"The break cannot be covered: no oil and no posture asked for covers it with {percent(largest)} of "
                f"the cavity filled, and more can hardly be filled in. The least that would do is "
                f"{fill_words(best.fill, 1)}: {oil_words(question, best.oils)}, {posture_words(best.posture)}."]
    return [_of_oil(question, words, same) for words, same in by_oil(question, found).items()]


def _of_oil(question: Question, words: str, same: Sequence[Answer]) -> str:
    """What one oil needs: in the posture that was asked for first, at least, and where it does not do."""
    asked, *least = shown_first(question, same)
    said = f"{words[0].upper()}{words[1:]}, patient {posture_words(asked.posture)}: {fill_needed(question, asked)}"
    said += " of the cavity" * asked.covers(question.largest_fill)
    if asked.covers(question.largest_fill) and round(100 * (asked.high or 0.0)) > 100 * question.largest_fill:
        said += f", perhaps more than the {percent(question.largest_fill)} that can be filled in"
    said += "".join(f"; least when {posture_words(one.posture)}, {fill_needed(question, one)}" for one in least
                    if one.covers(question.largest_fill))
    without = [posture_words(one.posture) for one in same if one is not asked
               and not one.covers(question.largest_fill)]
    return said + (f"; not covered when {in_a_row(without)}." if without else ".")


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


def assumptions(question: Question, eye: Eye) -> list[str]:
    """Return what the answer rests on."""
    angles = in_a_row([f"{np.degrees(angle):.3g}" for angle in question.other_angles])
    return [
        f"Clock hours are those of an observer who faces the patient (chart of Amsler and Dubois): 3 is on the "
        f"patient's left, {side_word(True, eye.side == 'right')} in this {eye.side} eye.",
        f"Eye: {eye_words(eye)}. Other individual features need a mesh.",
        f"The oil must reach {1e3 * question.margin:g} mm beyond the break on all sides.",
        f"Oil at rest: tension {1e3 * question.tension:g} mN/m, contact angle {np.degrees(question.contact_angle):.3g} "
        f"degrees through {question.other.name}, which wets the rest of the wall. Only densities, tension, angle and "
        f"shape matter; viscosity does not.",
        f"Ranges are for contact angles of {angles} degrees, with {percent(FILL_ERROR)} for the error of the shapes. "
        f"Where oil can rest in two shapes, as after filling in and after taking out, the one with less energy "
        f"counts, and the range holds both.",
        f"More than {percent(question.largest_fill)} cannot be filled in. The retina is attached, the head rests and "
        f"the oil is one body.",
    ]


def rows(question: Question, found: Sequence[Answer]) -> list[tuple[str, ...]]:
    """Return the table: a line for every oil and posture, oil by oil, the smallest fill first."""
    return [(words, posture_words(answer.posture), fill_words(answer.fill, 0 if answer.covers(question.largest_fill)
                                                              else 1), span_words(answer),
             *(percent(answer.shares[name]) for name in ("retina", "superior", "inferior", "macula")))
            for words, same in by_oil(question, found).items() for answer in same]


def not_covered(question: Question, found: Sequence[Answer]) -> list[int]:
    """Return the lines of the table in which the break is not covered."""
    order = [answer for same in by_oil(question, found).values() for answer in same]
    return [number for number, answer in enumerate(order) if not answer.covers(question.largest_fill)]


def below(question: Question) -> str:
    """Return what stands below the table."""
    return (f"The last four columns: covered share of the retina and its parts at this fill, or at "
            f"{percent(question.largest_fill)} where more would be needed.")


def text_of(question: Question, found: Sequence[Answer], eye: Eye) -> str:
    """Return the plan as text."""
    return "\n".join([f"Break: {question.place.words(eye.side)}.", *verdict(question, found), "",
                      *columns([HEADS, *rows(question, found)]), "", below(question), "", "Assumed:",
                      *(f"- {line}" for line in assumptions(question, eye)), "", "Checked:",
                      *(f"- {line}" for line in CHECKED), "", NO_ADVICE, ""])


def _brief(question: Question, found: Sequence[Answer], answer: Answer) -> str:
    """What an oil is, without its names unless there are several such oils."""
    words = oil_words(question, answer.oils)
    kind = words.partition(" (")[0]
    return kind if sum(one.startswith(kind) for one in by_oil(question, found)) == 1 else words


def _touched(answer: Answer) -> str:
    retina, inferior, macula = (percent(answer.shares[name]) for name in ("retina", "inferior", "macula"))
    return f"touches {retina} of the retina, {inferior} of its inferior half, {macula} of the macula"


def html_of(question: Question, found: Sequence[Answer], eye: Eye, maps: Sequence[tuple[Answer, str]]) -> str:
    """Return the plan as a page.

    Parameters
    ----------
    maps : answers that are shown, each with a map of the fundus as a data URL.
    """
    return page.page("Which fill, oil and posture cover the break?", [page.filled(
        __file__, no_advice=NO_ADVICE, place=question.place.words(eye.side),
        eye=eye_words(eye), verdict=verdict(question, found), checked=CHECKED, assumed=assumptions(question, eye),
        maps=[(f"{_brief(question, found, answer)}, {posture_words(answer.posture)}", fill_needed(question, answer),
               _touched(answer), source) for answer, source in maps],
        table=page.table(HEADS, rows(question, found), words=WORDS, marked=not_covered(question, found)),
        below=below(question))])

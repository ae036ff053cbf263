"""What a plan says, as text and as a page: oil by oil, the posture that was asked for first."""
from collections.abc import Sequence

import numpy as np
from markupsafe import Markup

from pipeline.base import page
from pipeline.base.words import NO_ADVICE, columns, in_a_row
from pipeline.equilibrium.checked import CHECKED
from pipeline.planning.bracket import (
    BORDERLINE,
    COVERED,
    EXPLAINED,
    NOT_COVERED,
    VERDICTS,
    Bracket,
    verdict,
)
from pipeline.planning.chart import AS_SEEN
from pipeline.planning.search import FILL_ERROR, Answer, Question
from pipeline.planning.settings import ANGLE
from pipeline.planning.touch import FILLS
from pipeline.scenes.model import Eye
from pipeline.scenes.retina import side_word
from sim.liquid import GAS_DENSITY

NOTHING = "–"
PARTS = ("retina", "superior", "inferior", "macula")


def percent(share: float | None, digits: int = 0) -> str:
    """Return a share of one in percent.

    >>> percent(0.934), percent(float("nan"))
    ('93 %', '–')
    """
    return NOTHING if share is None or np.isnan(share) else f"{100 * share:.{digits}f} %"


def fill_words(fill: float, digits: int = 0) -> str:
    """Return a smallest fill in words.

    >>> fill_words(0.5), fill_words(0.932), fill_words(0.999)
    ('50 % or less', '93 %', 'more than 99.5 %')
    """
    if round(100 * fill) <= 100 * FILLS[0]:
        return f"{percent(FILLS[0])} or less"
    return f"more than {percent(FILLS[-1], 1)}" if fill > FILLS[-1] else percent(fill, digits)


def span_words(answer: Answer) -> str:
    """Return what the fill may be."""
    if answer.low is None or answer.high is None:
        return NOTHING
    if answer.high > FILLS[-1]:
        return f"at least {percent(answer.low)}"
    if answer.low <= FILLS[0]:
        return f"{percent(answer.high)} or less"
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


def fill_needed(question: Question, answer: Answer, of: str = " of the cavity") -> str:
    """Return the smallest fill of an answer and what it may be, or that there is none."""
    largest, doubt = question.largest_fill, span_words(answer)
    if answer.verdict(largest) == NOT_COVERED:
        return f"{NOT_COVERED} with {percent(largest)}"
    if round(100 * answer.fill) <= 100 * FILLS[0]:
        return f"{percent(FILLS[0])}{of} is enough (less was not looked at)"
    fill = fill_words(answer.fill, 0 if answer.covers(largest) else 1)
    return f"{fill if doubt == NOTHING else f'{fill} ({doubt})'}{of}"


def verdicts(question: Question, found: Sequence[Answer]) -> list[str]:
    """Return the answer in sentences: the least of all, where there are several oils, and one for every oil."""
    largest, same = question.largest_fill, by_oil(question, found)
    if not found[0].covers(largest):
        best = found[0]
        best_words = f"{fill_words(best.fill, 1)}: {oil_words(question, best.oils)}, {posture_words(best.posture)}"
        said = ("The break cannot be covered: no oil and no posture asked for"
                if best.verdict(largest) == NOT_COVERED else
                "It is uncertain whether the break can be covered: no oil and no posture asked for surely")
        return [f"{said} covers it with {percent(largest)} of the cavity, "
                f"taken as the most that gets filled. The least that would do is {best_words}."]
    least = [f"Least of all: {oil_words(question, found[0].oils)}, patient {posture_words(found[0].posture)}: "
             f"{fill_needed(question, found[0])}."] if len(same) > 1 else []
    return [*least, *(_of_oil(question, words, answers) for words, answers in same.items())]


def _of_oil(question: Question, words: str, same: Sequence[Answer]) -> str:
    """What one oil needs: in the posture that was asked for first, at least, and where it does not do."""
    largest = question.largest_fill
    asked, *least = shown_first(question, same)
    said = f"{words[0].upper()}{words[1:]}, patient {posture_words(asked.posture)}: {fill_needed(question, asked)}"
    if asked.verdict(largest) == BORDERLINE:
        said += f", perhaps more than {percent(largest)}, the most that is assumed to get filled"
    said += "".join(f"; least when {posture_words(one.posture)}, {fill_needed(question, one)}" for one in least
                    if one.covers(largest))
    for what in (BORDERLINE, NOT_COVERED):
        others = [posture_words(one.posture) for one in same if one is not asked and one.verdict(largest) == what]
        said += f"; {what} with {percent(largest)} when {in_a_row(others)}" if others else ""
    return f"{said}."


def reading(question: Question, found: Sequence[Answer]) -> str:
    """Return what a smallest fill and its range say of the break; empty where nothing covers it."""
    if not found[0].covers(question.largest_fill):
        return ""
    ends = f"{1e3 * question.margin:g} mm beyond the edge" if question.margin else "at the edge"
    return (f"At exactly a smallest fill the edge of the oil lies {ends} of the break: borderline, for this edge is "
            "uncertain. In brackets is what the smallest fill may be: below the first number the oil does not reach so "
            "far, from the second on it does.")


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
        f"Ranges are for contact angles of {angles} degrees ({ANGLE}), with {percent(FILL_ERROR)} for the error of the "
        f"shapes. Where oil can rest in two shapes, as after filling and after taking out, the one with less energy "
        f"counts, and the range holds both.",
        f"{percent(question.largest_fill)} is taken as the most that gets filled (--largest-fill): fluid in the "
        "front of the eye and behind the retina is left. The retina is attached, the head rests and the oil is one "
        "body.",
    ]


def heads(question: Question) -> tuple[str, ...]:
    """Return the heads of the table."""
    return ("", "posture", f"with {percent(question.largest_fill)}", "smallest fill", "range", *PARTS)


def rows(question: Question, found: Sequence[Answer]) -> list[tuple[str, ...]]:
    """Return the table: a line for every oil and posture, oil by oil, the smallest fill first."""
    largest = question.largest_fill
    return [(words, posture_words(answer.posture), answer.verdict(largest),
             fill_words(answer.fill, 0 if answer.covers(largest) else 1), span_words(answer),
             *(percent(answer.shares[name]) for name in PARTS))
            for words, same in by_oil(question, found).items() for answer in same]


def table(question: Question, found: Sequence[Answer]) -> Markup:
    """Return the table for a page; lines in which the break is not surely covered are marked."""
    order = [answer for same in by_oil(question, found).values() for answer in same]
    marked = [number for number, one in enumerate(order) if one.verdict(question.largest_fill) != COVERED]
    return page.table(heads(question), rows(question, found), words=range(5), marked=marked)


def below(question: Question) -> str:
    """Return what stands below the table."""
    largest = percent(question.largest_fill)
    return (f"With {largest}: whether the break is covered then, the most that is taken to get filled. The last four "
            f"columns: share of the retina and its parts that the oil touches at the smallest fill, or at {largest} "
            "where more would be needed.")


def text_of(question: Question, found: Sequence[Answer], eye: Eye) -> str:
    """Return the plan as text."""
    return "\n".join([f"Break: {question.place.words(eye.side)}.", *verdicts(question, found),
                      *filter(None, [reading(question, found)]), "",
                      *columns([heads(question), *rows(question, found)]), "", below(question), "", "Assumed:",
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


def html_of(question: Question, found: Sequence[Answer], eye: Eye,
            maps: Sequence[tuple[Answer, Bracket, str]]) -> str:
    """Return the plan as a page.

    Parameters
    ----------
    maps : answers that are shown, each with the oil at its fill, and a map of the fundus as a data URL.
    """
    def caption(answer: Answer, bracket: Bracket) -> dict[str, str]:
        fill = min(answer.fill, question.largest_fill)
        shown = verdict(*bracket.beyond(question.place)[1:])
        return {"words": f"{eye.side} eye, {_brief(question, found, answer)}, {posture_words(answer.posture)}",
                "needed": fill_needed(question, answer, ""), "verdict": f"{shown} at {percent(fill)}",
                "touched": _touched(answer), "others": bracket.other_words()}

    return page.page("Which fill, oil and posture cover the break?", [page.filled(
        __file__, no_advice=NO_ADVICE, place=question.place.words(eye.side), reading=reading(question, found),
        eye=eye_words(eye), side=eye.side, verdicts=verdicts(question, found), checked=CHECKED,
        assumed=assumptions(question, eye), hatched=f"{EXPLAINED} {VERDICTS}", view=AS_SEEN,
        maps=[caption(answer, bracket) | {"source": source} for answer, bracket, source in maps],
        table=table(question, found), below=below(question))])

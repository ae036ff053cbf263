"""A sequence of postures without a simulation: what oil at rest touches in each, and which breaks it covers.

It is that of a scene: its eye, its liquids with tension and contact angle, its fill, its breaks, and its postures over
time. In every posture that is held the oil is taken to be at rest, in the shape with the least energy; the turns
between are left out. Equations: docs/methods/equilibrium.md.
"""
import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np

from pipeline.base import page
from pipeline.base.errors import UserError
from pipeline.base.progress import progress
from pipeline.base.words import NO_ADVICE, columns, duration
from pipeline.equilibrium.checked import CHECKED
from pipeline.equilibrium.contact import shares
from pipeline.equilibrium.least import Resting
from pipeline.equilibrium.rest import Liquids
from pipeline.equilibrium.star_cavity import StarCavity
from pipeline.planning.bracket import EXPLAINED, VERDICTS, Bracket, bracket_of, verdict
from pipeline.planning.chart import AS_SEEN, UNCERTAIN, Charts
from pipeline.planning.settings import ANGLE, load_settings
from pipeline.scenes.effects import known_by_an_effect
from pipeline.scenes.fill import fill_at_end
from pipeline.scenes.folders import scene_path, scenes_folder
from pipeline.scenes.load import load_scene
from pipeline.scenes.model import LARGEST_ANGLE, SMALLEST_ANGLE, Scene
from pipeline.scenes.retina import globe_radius
from sim.effects import REGISTRY

ALIKE = 1e-4                # directions of gravity that differ by less are one posture
MOST_POSTURES = 100         # each takes about a second and a half
SHORT = 600.0               # s, a sequence that is not told in hours and minutes
LEAST_FILL, MOST_FILL = 0.01, 0.995
MAPS = 12                   # that a page draws
WHOLE = 0.995               # of the macula, from which on it is all of it
SHOWN = ("retina", "superior", "inferior", "macula")


@dataclasses.dataclass(frozen=True)
class Hold:
    """A posture that is held.

    Attributes
    ----------
    begin, end : s, in the time of the sequence.
    words : of the posture. down : (3,), direction of gravity in the eye.
    bracket : the shape of the oil, and what else is possible.
    shares : covered shares of the wall and the parts of the retina.
    margins : m, how far the oil reaches beyond every break, negative where it falls short: in the shape that is drawn,
        and at least and at most.
    pressures : Pa, smallest contact pressure on every break; NaN where part of it is not covered.
    """

    begin: float
    end: float
    words: str
    down: np.ndarray
    bracket: Bracket
    shares: dict[str, float]
    margins: dict[str, tuple[float, float, float]]
    pressures: dict[str, float]


@dataclasses.dataclass(frozen=True)
class Sequence:
    """All postures of a scene that are held, in order."""

    scene: Scene
    oil: str
    fill: float
    liquids: Liquids
    cavity: StarCavity
    holds: list[Hold]
    other_angles: tuple[float, ...]

    def covered(self, name: str, which: int = 0) -> tuple[float, float]:
        """Return the share of the time held in which a break is covered, and the longest time that it is not, s.

        That goes on through a turn, if the break is not covered before and after.

        Parameters
        ----------
        which : 0 with the shapes that are drawn, 1 with what covers least, 2 most.
        """
        held, covered, longest, begin = 0.0, 0.0, 0.0, None
        for hold in self.holds:
            held += hold.end - hold.begin
            if hold.margins[name][which] > 0.0:
                covered, begin = covered + hold.end - hold.begin, None
            else:
                begin = hold.begin if begin is None else begin
                longest = max(longest, hold.end - begin)
        return covered / held, longest


def sequence_of(path: Path) -> Sequence:
    """Let the oil of a scene come to rest in every posture that it holds.

    Raises
    ------
    UserError : the scene has errors, no eye, no two liquids with a tension and an angle, or a fill that has no shape.
    """
    scene = load_scene(path, "draft")  # at rest all levels are alike
    oil, fill, liquids = _oil_of(scene, path)
    postures = _held(scene, path)
    resting = Resting.of(scene.eye)
    cavity = resting.cavity()
    breaks = scene.patches(globe_radius(cavity.wall))["breaks"]
    other_angles = load_settings()[0].other_angles
    known: dict[tuple[int, ...], Bracket] = {}
    holds, scale = [], scene.output.second_means or 1.0
    with progress(len(postures), "oil at rest", unit="posture") as bar:
        for begin, end, down, words in postures:
            key = tuple(np.round(down / ALIKE).astype(int))
            if key not in known:
                found = bracket_of(resting, liquids, down, fill, other_angles)
                if found is None:
                    raise UserError(f"{path}: no shape at rest was found for {words}, {100 * fill:g} % of {oil}: all "
                                    "of the surface of the oil must be seen from one point")
                known[key] = found
            bracket = known[key]
            margins = {name: bracket.beyond(one) for name, one in breaks.items()}
            pressures = {name: bracket.pressure(one) if margins[name][0] > 0.0 else np.nan
                         for name, one in breaks.items()}
            holds.append(Hold(begin * scale, end * scale, words.replace("_", " "), down, bracket,
                              shares(bracket.contact), margins, pressures))
            bar.update(1)
    return Sequence(scene, oil, fill, liquids, cavity, holds, other_angles)


def _held(scene: Scene, path: Path) -> list[tuple[float, float, np.ndarray, str]]:
    found = [one for name, parameters in scene.effects.items()
             for one in REGISTRY[name].held(parameters, scene.output.duration)]
    if not found:
        raise UserError(f"{path}: holds no posture, for it has no effect that gives liquids a weight, or gravity never "
                        "rests")
    different = {tuple(np.round(down / ALIKE).astype(int)) for _, _, down, _ in found}
    if len(different) > MOST_POSTURES:
        raise UserError(f"{path}: holds {len(different)} different postures, but at most {MOST_POSTURES} can be looked "
                        "at; tell them as turns")
    return found


def _oil_of(scene: Scene, path: Path) -> tuple[str, float, Liquids]:
    """Name of the oil, its share of the cavity at the end of the scene, and what decides where it rests."""
    if scene.eye is None:
        raise UserError(f"{path}: is no scene of an eye, of which alone shapes at rest are known")
    fill = fill_at_end(scene, lambda name: load_scene(scene_path(name, scenes_folder(path)), scene.accuracy)) or {}
    held = [liquid for liquid in scene.liquids if fill.get(liquid.name, 0.0) > 0.0]
    angle, tension = known_by_an_effect(scene, "contact_angle_of"), max(
        (REGISTRY[name].tension_of(parameters) for name, parameters in scene.effects.items()), default=0.0)
    if len(held) != 2 or angle is None or not tension:
        raise UserError(f"{path}: oil at rest needs two liquids in the cavity, a tension and a contact angle, but it "
                        f"has {len(held)} liquids, {1e3 * tension:g} mN/m and {'no' if angle is None else 'an'} angle")
    oil, other = sorted(held, key=lambda liquid: -liquid.dynamic_viscosity)
    through_other = angle if scene.liquids[0].name == other.name else np.pi - angle
    if not SMALLEST_ANGLE <= through_other <= LARGEST_ANGLE:
        raise UserError(f"{path}: the contact angle is {np.degrees(through_other):.3g} deg through {other.name}, but "
                        f"shapes at rest are known from {np.degrees(SMALLEST_ANGLE):g} to "
                        f"{np.degrees(LARGEST_ANGLE):g} deg")
    share = fill[oil.name]
    if not LEAST_FILL <= share <= MOST_FILL:
        raise UserError(f"{path}: the cavity ends with {100 * share:.4g} % of {oil.name}, but shapes at rest are known "
                        f"from {100 * LEAST_FILL:g} to {100 * MOST_FILL:g} %")
    weight = max(REGISTRY[name].weight_of(parameters) for name, parameters in scene.effects.items())
    return oil.name, share, Liquids(other.density - oil.density, tension, through_other, weight)


def heads(sequence: Sequence) -> tuple[str, ...]:
    """Return the heads of the table."""
    return ("from", "to", "posture", *SHOWN, *(name.replace("_", " ") for name in _breaks(sequence)))


def rows(sequence: Sequence) -> list[tuple[str, ...]]:
    """Return the table, one line for every posture that is held."""
    clock = _clock(sequence)
    return [(clock(hold.begin), clock(hold.end), hold.words,
             *(f"{100 * hold.shares[name]:.0f} %" for name in SHOWN),
             *(_break_words(hold, name) for name in _breaks(sequence))) for hold in sequence.holds]


def _clock(sequence: Sequence) -> Callable[[float], str]:
    """What writes times of a sequence, s: in hours and minutes, or as they are where it is short."""
    if sequence.holds[-1].end < SHORT:
        return duration
    return lambda time: f"{round(time / 60.0) // 60}:{round(time / 60.0) % 60:02d}"


def _breaks(sequence: Sequence) -> list[str]:
    return [one.name for one in sequence.scene.breaks]


def _break_words(hold: Hold, name: str) -> str:
    margin, low, high = (1e3 * one for one in hold.margins[name])
    words = f"{verdict(low, high)}: oil edge {_reach(margin)} the break ({_span(low, high)})"
    return f"{words}, {hold.pressures[name]:.0f} Pa" if margin > 0.0 else words


def _reach(margin: float) -> str:
    """How far the oil reaches beyond a break, mm, in words."""
    return f"{margin:.1f} mm beyond" if margin > 0.0 else f"{-margin:.1f} mm short of"


def _span(low: float, high: float) -> str:
    if low <= 0.0 < high:
        return f"{-low:.1f} short to {high:.1f} beyond"
    return f"{abs(low):.1f} to {abs(high):.1f}"


def _drawn(sequence: Sequence) -> list[Hold]:
    """Return the first holds of the postures that differ, in order."""
    return list({id(hold.bracket): hold for hold in reversed(sequence.holds)}.values())[::-1]


def sentences(sequence: Sequence) -> list[str]:
    """Return what the sequence says in short."""
    oil, held = sequence.oil.replace("_", " "), sum(hold.end - hold.begin for hold in sequence.holds)
    mean = sum(hold.shares["retina"] * (hold.end - hold.begin) for hold in sequence.holds) / held
    found = [f"{oil[:1].upper()}{oil[1:]}, {100 * sequence.fill:.1f} % of the cavity, touches {100 * mean:.0f} % of "
             f"the retina on average over {duration(held)} in {len(sequence.holds)} postures.", _of_macula(sequence)]
    for name in _breaks(sequence):
        (share, bare), (least, longest), (most, shortest) = (sequence.covered(name, which) for which in range(3))
        same = least == most and shortest == longest
        shares_held, bare_times = ("", "") if same else (
            f" ({100 * least:.0f} to {100 * most:.0f} %)", f" ({duration(shortest)} to {duration(longest)})")
        found.append(f"Break {name.replace('_', ' ')}: covered {100 * share:.0f} % of that time{shares_held}, longest "
                     f"time not covered {duration(bare)}{bare_times}{', whatever is uncertain' if same else ''}.")
    return found


def _of_macula(sequence: Sequence) -> str:
    """How much of the macula the oil touches at least, in which posture, and how long that is held in all."""
    least = min(sequence.holds, key=lambda hold: hold.shares["macula"])
    if least.shares["macula"] > WHOLE:
        return "It touches all of the macula throughout."
    held = sum(hold.end - hold.begin for hold in sequence.holds if hold.bracket is least.bracket)
    return (f"Of the macula it touches {100 * least.shares['macula']:.0f} % at least: {least.words}, for "
            f"{duration(held)}.")


def assumptions(sequence: Sequence) -> list[str]:
    """Return what the answer rests on."""
    liquids = sequence.liquids
    angles = " and ".join(f"{np.degrees(angle):.3g}" for angle in sequence.other_angles)
    return [
        f"In every posture the oil is at rest, in the shape with the least energy; times of turns and of settling, "
        f"seconds each, are left out. Tension {1e3 * liquids.tension:g} mN/m, contact angle "
        f"{np.degrees(liquids.contact_angle):.3g} degrees ({ANGLE}), densities differ by "
        f"{liquids.density_difference:g} kg/m3.",
        "Pressure: that of the oil over the aqueous at the same place, at the point of the break where it is smallest.",
        f"In brackets: with contact angles of {angles} degrees, for it is not well known, in other shapes at rest, as "
        f"far as any were found, and with {1e3 * UNCERTAIN:g} mm for the error of the contact line.",
        VERDICTS,
    ]


def text_of(sequence: Sequence) -> str:
    """Return all as text."""
    return "\n".join([*sentences(sequence), "", *columns([heads(sequence), *rows(sequence)]), "", "Assumed:",
                      *(f"- {line}" for line in assumptions(sequence)), "", "Checked:",
                      *(f"- {line}" for line in CHECKED), "", NO_ADVICE, ""])


def html_of(sequence: Sequence) -> str:
    """Return all as a page, with maps of the first different postures."""
    patches, side = sequence.scene.patches(globe_radius(sequence.cavity.wall))["breaks"], sequence.scene.eye.side
    charts = Charts(sequence.cavity, patches, side == "right")

    def drawn(hold: Hold) -> dict[str, object]:
        bracket = hold.bracket
        return {"words": f"{side} eye, {hold.words}", "touched": f"{100 * hold.shares['retina']:.0f} % of the retina",
                "verdicts": [f"{name.replace('_', ' ')}: {verdict(*margins[1:])}"
                             for name, margins in hold.margins.items()],
                "others": bracket.other_words(),
                "source": charts.address(bracket.contact, (bracket.low, bracket.high))}

    title = sequence.scene.title or sequence.scene.name
    return page.page(f"{title}: oil at rest", [page.filled(
        __file__, no_advice=NO_ADVICE, sentences=sentences(sequence), side=side, view=AS_SEEN,
        hatched=f"{EXPLAINED} {VERDICTS}" if patches else EXPLAINED,
        maps=[drawn(hold) for hold in _drawn(sequence)[:MAPS]],
        table=page.table(heads(sequence), rows(sequence), words=(2, *range(7, 7 + len(patches)))),
        assumed=assumptions(sequence), checked=CHECKED)], heading=title)

"""A sequence of postures without a simulation: what oil at rest touches in each, and which breaks it covers.

It is that of a scene: its eye, its liquids with tension and contact angle, its fill, its breaks, and its postures over
time. In every posture that is held the oil is taken to be at rest, in the shape with the least energy; the turns
between are left out. Equations: docs/methods/equilibrium.md.
"""
import dataclasses
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from pipeline.base import page
from pipeline.base.errors import UserError
from pipeline.base.progress import progress
from pipeline.base.words import NO_ADVICE, columns, duration
from pipeline.cavity.rays import interpolation
from pipeline.equilibrium.checked import CHECKED
from pipeline.equilibrium.contact import Contact, shares
from pipeline.equilibrium.least import Found, Resting
from pipeline.equilibrium.rest import Liquids, Rest, at_rest
from pipeline.equilibrium.star_cavity import StarCavity
from pipeline.planning.chart import Charts
from pipeline.planning.settings import load_settings
from pipeline.scenes.effects import known_by_an_effect
from pipeline.scenes.fill import fill_at_end
from pipeline.scenes.folders import scene_path, scenes_folder
from pipeline.scenes.load import load_scene
from pipeline.scenes.model import LARGEST_ANGLE, SMALLEST_ANGLE, Scene
from pipeline.scenes.retina import direction, globe_radius
from sim.effects import REGISTRY

ALIKE = 1e-4                # directions of gravity that differ by less are one posture
MOST_POSTURES = 100         # each takes about a second and a half
LEAST_FILL, MOST_FILL = 0.01, 0.995
MAPS = 12                   # that a page draws
SHOWN = ("retina", "superior", "inferior", "macula")


@dataclasses.dataclass(frozen=True)
class Hold:
    """A posture that is held.

    Attributes
    ----------
    begin, end : s, in the time of the sequence.
    words : of the posture. down : (3,), direction of gravity in the eye.
    rest : shape of the oil. contact : what it touches.
    shares : covered shares of the wall and the parts of the retina.
    margins : m, how far the oil reaches beyond every break, negative where part of it is bare: with the contact angle
        of the scene, and the least and the most with the others that are possible.
    pressures : Pa, smallest contact pressure on every break; NaN where part of it is bare.
    """

    begin: float
    end: float
    words: str
    down: np.ndarray
    rest: Rest
    contact: Contact
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
        """Return the share of the time held in which a break is covered, and the longest time that it is bare, s.

        That goes on through a turn, if the break is bare before and after.

        Parameters
        ----------
        which : 0 with the contact angle of the scene, 1 with the one that covers least, 2 most.
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
    points = {name: interpolation(cavity.wall, cavity.faces, direction(*one.points())) for name, one in breaks.items()}
    other_angles = load_settings()[0].other_angles
    known: dict[tuple[int, ...], tuple[Rest, list[Contact]]] = {}
    holds, scale = [], scene.output.second_means or 1.0
    with progress(len(postures), "oil at rest", unit="posture") as bar:
        for begin, end, down, words in postures:
            key = tuple(np.round(down / ALIKE).astype(int))
            if key not in known:
                least = resting.least(liquids, down, fill)
                if least is None:
                    raise UserError(f"{path}: no shape at rest was found for {words}, {100 * fill:g} % of {oil}: all "
                                    "of the surface of the oil must be seen from one point")
                known[key] = least.rest, _contacts(resting, least, liquids, down, other_angles)
            rest, contacts = known[key]
            margins, pressures = {}, {}
            for name, (corners, weights) in points.items():
                found = [float((one.margin[corners] * weights).sum(axis=1).min()) for one in contacts]
                margins[name] = (found[0], min(found), max(found))
                pressure = rest.contact_pressure(np.einsum("kc,kcx->kx", weights, cavity.wall[corners]))
                pressures[name] = float(pressure.min()) if found[0] > 0.0 else np.nan
            holds.append(Hold(begin * scale, end * scale, words.replace("_", " "), down, rest, contacts[0],
                              shares(contacts[0]), margins, pressures))
            bar.update(1)
    return Sequence(scene, oil, fill, liquids, cavity, holds, other_angles)


def _contacts(resting: Resting, least: Found, liquids: Liquids, down: np.ndarray,
              angles: Iterable[float]) -> list[Contact]:
    """What a shape touches, and from there those with other contact angles, as far as they settle."""
    rest = least.rest
    others = [at_rest(rest.cavity, dataclasses.replace(liquids, contact_angle=angle), down, rest.fill, rest.distance)
              for angle in angles]
    return [resting.contact(least, beyond=True),
            *(Contact.of(one).on(resting.cavity()) for one in others if one.settled)]


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
    return [(duration(hold.begin), duration(hold.end), hold.words,
             *(f"{100 * hold.shares[name]:.0f} %" for name in SHOWN),
             *(_break_words(hold, name) for name in _breaks(sequence))) for hold in sequence.holds]


def _breaks(sequence: Sequence) -> list[str]:
    return [one.name for one in sequence.scene.breaks]


def _break_words(hold: Hold, name: str) -> str:
    margin, low, high = (1e3 * one for one in hold.margins[name])
    both = low <= 0.0 < high
    span = f"bare by {-low:.1f} to covered by {high:.1f}" if both else f"{abs(low):.1f} to {abs(high):.1f}"
    if margin > 0.0:
        return f"covered by {margin:.1f} mm ({span}), {hold.pressures[name]:.0f} Pa"
    return f"bare by {-margin:.1f} mm ({span})"


def sentences(sequence: Sequence) -> list[str]:
    """Return what the sequence says in short."""
    oil, held = sequence.oil.replace("_", " "), sum(hold.end - hold.begin for hold in sequence.holds)
    mean = sum(hold.shares["retina"] * (hold.end - hold.begin) for hold in sequence.holds) / held
    found = [f"{oil[:1].upper()}{oil[1:]}, {100 * sequence.fill:.1f} % of the cavity, touches {100 * mean:.0f} % of "
             f"the retina on average over {duration(held)} in {len(sequence.holds)} postures."]
    for name in _breaks(sequence):
        (share, bare), (least, longest), (most, shortest) = (sequence.covered(name, which) for which in range(3))
        same = least == most and shortest == longest
        shares_held, bare_times = ("", "") if same else (
            f" ({100 * least:.0f} to {100 * most:.0f} %)", f" ({duration(shortest)} to {duration(longest)})")
        found.append(f"Break {name.replace('_', ' ')}: covered {100 * share:.0f} % of that time{shares_held}, longest "
                     f"time bare {duration(bare)}{bare_times}{', with any of the contact angles' if same else ''}.")
    return found


def assumptions(sequence: Sequence) -> list[str]:
    """Return what the answer rests on."""
    liquids = sequence.liquids
    angles = " and ".join(f"{np.degrees(angle):.3g}" for angle in sequence.other_angles)
    return [
        f"In every posture the oil is at rest, in the shape with the least energy; times of turns and of settling, "
        f"seconds each, are left out. Tension {1e3 * liquids.tension:g} mN/m, contact angle "
        f"{np.degrees(liquids.contact_angle):.3g} degrees, densities differ by {liquids.density_difference:g} kg/m3.",
        "Covered by: how far the oil reaches beyond the break. Pressure: that of the oil over the aqueous at the same "
        "place, at the point of the break where it is smallest.",
        f"In brackets: with contact angles of {angles} degrees, for it is not well known. The shapes themselves are "
        "sure to about 0.3 mm of the contact line.",
    ]


def text_of(sequence: Sequence) -> str:
    """Return all as text."""
    return "\n".join([*sentences(sequence), "", *columns([heads(sequence), *rows(sequence)]), "", "Assumed:",
                      *(f"- {line}" for line in assumptions(sequence)), "", "Checked:",
                      *(f"- {line}" for line in CHECKED), "", NO_ADVICE, ""])


def html_of(sequence: Sequence) -> str:
    """Return all as a page, with maps of the first different postures."""
    patches = sequence.scene.patches(globe_radius(sequence.cavity.wall))["breaks"]
    charts = Charts(sequence.cavity, patches, sequence.scene.eye.side == "right")
    drawn = list({id(hold.rest): hold for hold in reversed(sequence.holds)}.values())[::-1][:MAPS]
    title = sequence.scene.title or sequence.scene.name
    return page.page(f"{title}: oil at rest", [page.filled(
        __file__, no_advice=NO_ADVICE, sentences=sentences(sequence),
        maps=[(hold.words, f"{100 * hold.shares['retina']:.0f} % of the retina", charts.address(hold.contact))
              for hold in drawn],
        table=page.table(heads(sequence), rows(sequence), words=(2, *range(7, 7 + len(patches)))),
        assumed=assumptions(sequence), checked=CHECKED)], heading=title)

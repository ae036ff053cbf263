"""The page of the explorer: one file with the tables, that asks no network for anything."""
import base64
import json
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup
from PIL import ImageColor

from pipeline.base import page
from pipeline.base.errors import UserError
from pipeline.base.palette import AQUEOUS, OIL
from pipeline.base.words import NO_ADVICE
from pipeline.cavity.regions import MACULA_RADIUS
from pipeline.equilibrium.checked import CHECKED
from pipeline.equilibrium.star_cavity import FINE, cavity_of
from pipeline.explorer.cases import AZIMUTHS, FILLS, LATITUDES, MERIDIANS, TABLES, TILTS, Tamponade, eyes, tamponades
from pipeline.explorer.chart import wall_radius
from pipeline.explorer.errors import LENGTH_STEP, Errors
from pipeline.explorer.interface import SIZE, Lattice
from pipeline.explorer.lookup import OVAL
from pipeline.explorer.table import DEEPEST, FOLDER, SHARE_STEP, SHIFT_STEP, Table, differences, path_of
from pipeline.explorer.table import REACH as MARGIN_REACH
from pipeline.pages.turning_view import EYE_AXES, EYE_VIEW, EYE_VIEWS
from pipeline.pictures.fundus_map import BREAK_COLOR, DISC_DISTANCE, DISC_RADIUS
from pipeline.pictures.marks import FAINT_INK, INK
from pipeline.planning.chart import UNCERTAIN
from pipeline.planning.search import FILL_ERROR
from pipeline.planning.settings import load_settings
from pipeline.scenes.model import Eye
from pipeline.scenes.retina import DISC_RISE, ORA, globe_radius
from pipeline.web.scripts import HERE as WEB
from pipeline.web.scripts import POLICY, library

MOST_BYTES = 12 * 10**6     # of the whole page
HERE = Path(__file__).parent
SCRIPTS = (HERE / "model.js", HERE / "surfaces.js", HERE / "fundus.js", WEB / "viewer.js", HERE / "explorer.js")
TITLE = "What does the oil touch?"
PARTS = ("whole retina", "superior half", "inferior half", "macula")
OTHER = 0.2                 # of the halves of the retina, by which shapes are told apart as two
WANTED = 0.5e-3             # m, that the tamponade must reach beyond a break
# Words, how far the face is raised and how far the right ear is lowered, degrees.
POSTURES = (("upright", 0, 0), ("on the back, head up 30°", 60, 0), ("on the back", 90, 0),
            ("on the left side", 0, -90), ("on the right side", 0, 90), ("face down 45°", -45, 0),
            ("face down", -90, 0))
START = {"fill": 85, "tamponade": "light", "side": "right", "pitch": 0, "roll": 0,
         "tear": {"hour": 6, "latitude": 60, "width": 1, "height": 10}}
NO_WEBGL = "This browser has no WebGL, so this view is missing. Everything else works."


def page_of(folder: Path = FOLDER) -> str:
    """Return the page with all tables that are in a folder.

    Raises
    ------
    UserError : there is no table, one is damaged, or the page is too large.
    """
    known = known_of(folder)
    values = json.dumps(known, separators=(",", ":"), ensure_ascii=True).replace("<", "\\u003c")
    code = "\n".join(path.read_text(encoding="utf-8") for path in SCRIPTS)
    body = page.rendered(
        HERE / "explorer.html", tamponades=known["tamponades"], eyes=[one["name"] for one in known["eyes"]],
        views=EYE_VIEWS, parts=PARTS, step=LENGTH_STEP, fills=(100 * FILLS[0], 100 * FILLS[-1]), ora=f"{ORA:g}",
        wanted=f"{1e3 * WANTED:g}", aqueous=AQUEOUS, oil=OIL,
        tear=f"rgb{BREAK_COLOR}")
    text = page.page(TITLE, [
        page.paragraph("Oil or gas at rest in an eye with its own lens. Move the fill, the head and the break.",
                       page.bold(NO_ADVICE)),
        body, library("three.min.js"), Markup(f"<script>\n{code}\nshowExplorer({values});\n</script>"),
        page.details("What this rests on", page.bullets(_assumed(known)), page.section("How far the tables are off"),
                     *Errors.read(folder).parts(), page.section("What was validated, and what was not"),
                     page.bullets(CHECKED)),
    ], style=(HERE / "explorer.css").read_text(encoding="utf-8"), head=POLICY)
    if len(text.encode()) > MOST_BYTES:
        raise UserError(f"the explorer would be larger than {MOST_BYTES / 1e6:g} MB; remove tables from {folder}")
    return text


def known_of(folder: Path = FOLDER) -> dict[str, Any]:
    """Return what the scripts know, as JSON has it."""
    errors, settings, kinds = Errors.read(folder), load_settings()[0], tamponades()
    found = [one for name, eye in eyes().items() if (one := _eye(name, eye, kinds, folder)) is not None]
    if not found:
        raise UserError(f"{folder} holds no tables; make them with python -m pipeline.explorer_tables")
    return {
        "tilts": TILTS.tolist(), "azimuths": len(AZIMUTHS), "fills": FILLS, "latitudes": len(LATITUDES),
        "meridians": len(MERIDIANS), "ora": ORA, "reach": MARGIN_REACH, "deepest": DEEPEST, "shareStep": SHARE_STEP,
        "shiftStep": SHIFT_STEP, "lattice": SIZE, "oval": OVAL, "wanted": WANTED, "lineError": UNCERTAIN,
        "fillError": FILL_ERROR, "shareErrors": errors.usual, "largestFill": settings.largest_fill,
        "eyes": found, "other": OTHER,
        "tamponades": {name: {"words": one.words, "floats": one.liquids.density_difference > 0.0,
                              "color": ImageColor.getrgb(one.color)} for name, one in kinds.items()},
        "colors": {"aqueous": ImageColor.getrgb(AQUEOUS), "ink": INK, "faint": FAINT_INK, "tear": BREAK_COLOR},
        "postures": [{"words": words, "pitch": pitch, "roll": roll} for words, pitch, roll in POSTURES],
        "start": START | {"eye": _first(found)}, "views": EYE_VIEWS, "view": EYE_VIEW,
        "axes": [(name, [1.12 * part for part in place]) for name, place in EYE_AXES.items()], "without": NO_WEBGL,
    }


def _eye(name: str, eye: Eye, kinds: Mapping[str, Tamponade], folder: Path) -> dict[str, Any] | None:
    """An eye with the tables that there are; None without any."""
    tables = {kind: Table.read(path) for kind in kinds if (path := path_of(name, kind, folder)).is_file()}
    if not tables:
        return None
    cavity = cavity_of(eye)
    low, high = cavity.wall.min(axis=0), cavity.wall.max(axis=0)
    globe, lattice = globe_radius(cavity.wall), Lattice.of(cavity)
    return {
        "name": name, "globe": globe, "center": (0.5 * (low + high)).tolist(),
        "low": lattice.low.tolist(), "step": lattice.step.tolist(),
        "half": float(0.53 * (high - low).max()), "volume": 1e6 * cavity.volume,
        "macula": float(np.degrees(np.arcsin(MACULA_RADIUS / globe))),
        "disc": [float(np.degrees(DISC_DISTANCE / globe)), -DISC_RISE, float(np.degrees(DISC_RADIUS / globe))],
        "wall": _packed(wall_radius(cavity_of(eye, FINE), *_twice(LATITUDES, MERIDIANS)).astype("<f4")),
        "tables": {kind: _packed(differences(table.margin), differences(table.depth), table.doubt)
                   for kind, table in tables.items()},
    }


def _twice(latitudes: np.ndarray, meridians: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Twice as many latitudes and meridians."""
    step = 0.5 * (latitudes[1] - latitudes[0])
    return step * np.arange(2 * len(latitudes) - 1), step * np.arange(2 * len(meridians))


def _first(found: list[dict[str, Any]]) -> float:
    """The length of the eye that is shown first, mm: that of ``TABLES``, or one that there is."""
    names = [one["name"] for one in found]
    return float(TABLES[0][0] if TABLES[0][0] in names else names[0])


def _packed(*arrays: np.ndarray) -> str:
    """Arrays one behind the other, deflated, as base64."""
    return base64.b64encode(zlib.compress(b"".join(np.ascontiguousarray(one).tobytes() for one in arrays), 9)).decode()


def _assumed(known: dict[str, Any]) -> list[str]:
    kinds = "; ".join(
        f"{one.words}: densities differ by {abs(one.liquids.density_difference):g} kg/m3, tension "
        f"{1e3 * one.liquids.tension:g} mN/m, contact angle {np.degrees(one.liquids.contact_angle):.3g} degrees "
        f"through the aqueous ({' and '.join(f'{np.degrees(angle):.3g}' for angle in one.other_angles)} for the range)"
        for one in tamponades().values())
    volumes = ", ".join(f"{one['name']} mm long, {one['volume']:.1f} mL behind the lens" for one in known["eyes"])
    others = " and ".join(f"{one['name']} mm" for one in known["eyes"] if one["name"] != TABLES[0][0])
    return [
        f"Eye: with its own lens, as wide as eyes of its length are on average ({volumes}).",
        "Clock hours are those that an observer sees who faces the patient.",
        f"{kinds[0].upper()}{kinds[1:]}. Viscosity does not matter at rest.",
        "The tamponade is one body at rest, the retina is attached, and aqueous wets the rest of the wall. Of two "
        "shapes at rest the one with less energy is shown, and the range holds both where both were found.",
        f"Shapes of least energy were computed at {len(FILLS)} fills from {FILLS[0]:.0%} to {FILLS[-1]:.1%}, in an eye "
        f"of {TABLES[0][0]} mm, at {len(TILTS)} angles between gravity and the axis of the eye and at two azimuths "
        f"each{f', and fewer in eyes of {others}' if others else ''}. What is shown lies between them.",
    ]

"""The page of a run: one file that holds all it shows and asks no network for anything."""
import json
import platform
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path

from markupsafe import Markup

from pipeline.advice.report import DISCLAIMER, HEADINGS, Report
from pipeline.base import page
from pipeline.base.tables import TIME
from pipeline.base.usage import KINDS
from pipeline.base.words import duration, memory
from pipeline.forecast.expected_error import ExpectedError
from pipeline.forecast.retina_error import UNIT
from pipeline.measures.events import Event
from pipeline.measures.metric import LAST
from pipeline.measures.place_course import courses_of
from pipeline.measures.rest import rest_in_words
from pipeline.measures.shown import Shown
from pipeline.measures.summary import breaks_over_time, changing, constant
from pipeline.pages.curves import curves
from pipeline.pages.fundus_strip import fundus_strip
from pipeline.pages.headlines import headlines_of
from pipeline.pages.movie_copy import movie_within
from pipeline.pages.scrubber import data_url, pictures_over_time, webp
from pipeline.pages.turning_view import turning_view
from pipeline.pictures.marks import clock
from pipeline.pictures.moments import read_picture, scaled
from pipeline.pictures.pace import pace_of
from pipeline.runs.run_folder import RunFolder
from pipeline.scenes.effects import illustration_in_words, knows_films
from sim.backend.choice import library
from sim.effects import REGISTRY

MOST_BYTES = 10 * 10**6  # of the whole page: it is sent by mail
HERE = Path(__file__).parent
POSTER_WIDTH = 800
# Browsers refuse whatever the page would ask others for.
POLICY = Markup('<meta http-equiv="Content-Security-Policy" content="default-src \'none\'; img-src data:; '
                'media-src data: blob:; style-src \'unsafe-inline\'; script-src \'unsafe-inline\'">\n'
                '<link rel="icon" href="data:,">')
ILLUSTRATION = ("This illustrates the physics; it is no prediction for a patient: nothing was compared with clinical "
                "data.")
NOT_IN_AN_EYE = ("In no scene are: the vitreous, the give of the wall and of the retina, and "
                 "films of aqueous thinner than the particle spacing")
FILMS_TOLD = ("; where they are and how thick follows from theory, by how fast the oil came over the wall and how long "
              "ago: the retina there counts as under oil, but not as touched")
PACKAGES = ("eye-oil-pipeline", library().name, "numpy", "scipy", "pyvista", "vtk", "snakemake")
FILES = {"movie.mp4": "movie", "movie.gif": "movie for slides", "poster.png": "last picture",
         "still.png": "illustration", "film.mp4": "film of the illustration", "moments.png": "eight moments",
         "metrics.csv": "metrics of every frame", "effects.csv": "cost of the effects",
         "scene.json": "scene in SI units", "run.pvd": "particles and surfaces, for ParaView"}


def page_of(run: RunFolder, *, shown: Sequence[Shown], advice: Report, errors: Sequence[ExpectedError],
            sources: dict[str, str], path: Path) -> str:
    """Return the page.

    Parameters
    ----------
    shown : metrics in the order of interest.
    errors : to expect of a scene like this one.
    sources : files of the scene, name -> text, the scene's own first.
    path : file of the page.
    """
    scene, events = run.scene, run.events
    return page.page(f"{run.title}: {scene.accuracy}", [
        page.paragraph(scene.description), page.paragraph(page.bold(scene.label)) if scene.label else "",
        _still(run), _numbers(run, shown, events, errors),
        Markup('<div class="wide">{}{}</div>').format(_movie(run), _scrubber(run)),
        _turning(run), _fundus(run),
        page.section("Over time"), _curves(run, shown, events),
        page.section("Metrics"), *breaks_over_time(courses_of(run.table, run.scene)), *_metrics(shown),
        page.section("What was simulated"), *_simulated(run, advice),
        page.section("What was left out, and why"), *_left_out(run, advice),
        page.section("Cost and expected error"), *_cost(run, errors),
        page.section("Files, versions, scene"), *_origin(run, sources),
    ], heading=run.title, path=path, links=_comparisons(run.folder), style=(HERE / "run_page.css").read_text(),
        head=POLICY)


def _numbers(run: RunFolder, shown: Sequence[Shown], events: Sequence[Event],
             errors: Sequence[ExpectedError]) -> Markup:
    found, illustrated = headlines_of(run.scene, shown), illustration_in_words(run.scene)
    items = Markup("\n").join(Markup("<li><b>{}</b>{}</li>").format(one.number, one.meaning) for one in found)
    said = [f"At the end ({clock(run.table[TIME][-1], run.scene.output.second_means)}), at accuracy "
            f"{run.scene.accuracy}: {1e3 * run.scene.numerics.particle_spacing:g} mm between particles."]
    if any(one.sure for one in found):
        said.append("± is half of what lies within one particle spacing of the contact line: how well the shape can be "
                    "read, not how far it is from the exact one.")
    elif illustrated:
        said.append(f"{illustrated}; they are in the tables below.")
    elif found:
        said.append("How sure these numbers are is not known; the errors to expect are below.")
    said += [f"At this level the covered retina at rest is {one.words} ({one.source})."
             for one in errors if one.unit == UNIT and not illustrated]
    rest = "" if illustrated else rest_in_words(run.table, events)
    breaks = Markup("\n").join(page.paragraph(page.bold(one.sentence())) for one in courses_of(run.table, run.scene))
    return Markup('<ul class="numbers">{}</ul>{}{}').format(
        items, breaks, page.paragraph(*said, f"{rest[:1].upper()}{rest[1:]}." if rest else "",
                              ILLUSTRATION if run.scene.container is None else ""))


def _still(run: RunFolder) -> Markup:
    """The illustration of the last frame; a scene in a plane has none."""
    if run.scene.dimension == 2:
        return Markup()
    return Markup('<img class="still" alt="{}" src="{}">').format(
        "The opened eye with its liquids" if run.scene.container is None else "The liquids in their container",
        data_url(webp(read_picture(run.folder / "still.png")), "image/webp"))


def _movie(run: RunFolder) -> Markup:
    pace = pace_of(len(run.pictures), run.scene.output.frame_interval)
    poster = data_url(webp(scaled(read_picture(run.pictures[-1]), POSTER_WIDTH)), "image/webp")
    return Markup('<div class="movie"><h2>Movie</h2><video controls muted playsinline preload="auto" poster="{}" '
                  'src="{}"></video><p>{}.</p></div>{}').format(
        poster, data_url(movie_within(run.folder / "movie.mp4"), "video/mp4"),
        pace.in_words(len(run.pictures), run.scene.output.second_means).capitalize(), BLOB)


# Safari plays no movie from a data URL.
BLOB = Markup("""<script>
(video => {
  const bytes = Uint8Array.from(atob(video.getAttribute("src").split(",")[1]), letter => letter.charCodeAt(0));
  video.src = URL.createObjectURL(new Blob([bytes], {type: "video/mp4"}));
})(document.querySelector("video"));
</script>""")


def _scrubber(run: RunFolder) -> Markup:
    pictures = pictures_over_time(run)
    return Markup('<div class="scrubber"><h2>Frame by frame</h2><img alt="" src="{}"><input type="range" min="0" '
                  'max="{}" value="{}" aria-label="time"><p><output></output></p></div>{}').format(
        pictures[-1][1], len(pictures) - 1, len(pictures) - 1,
        _script("scrubber.js", "showScrubber", ".scrubber", pictures))


def _turning(run: RunFolder) -> Markup:
    if run.scene.dimension == 2:
        return page.paragraph("The scene is in a plane: there is no view of it that turns.")
    view = turning_view(run)
    boxes = Markup("\n").join(Markup('<label><input type="checkbox" checked>{}</label>').format(
        Markup().join(Markup('<i style="background:{}"></i>{}').format(*one) for one in mesh["legend"]))
        for mesh in view["meshes"])
    buttons = Markup("\n").join(Markup("<button>{}</button>").format(text) for text, _ in view["views"])
    return Markup(
        '<div class="turning"><h2>The last frame, to be turned</h2><div class="stage"><canvas tabindex="0" role="img" '
        'aria-label="surfaces of the last frame; arrow keys turn them"></canvas></div><p class="hint">Drag to turn; '
        'the nearer half of the wall is left out.</p><p>{}</p><p>{}</p></div>{}').format(
        boxes, buttons, _script("viewer.js", "showTurningView", ".turning", view))


def _fundus(run: RunFolder) -> Markup:
    """Maps of the retina over time; the pictures say what their colors are."""
    if run.scene.container is not None or run.scene.dimension == 2:
        return Markup()
    maps = [Markup('<figure><img alt="fundus, {}" src="{}"><figcaption>{}</figcaption></figure>').format(
        time, picture, time) for time, picture in fundus_strip(run)]
    words = page.paragraph(
        f"The {run.scene.eye.side} eye, as its examiner sees it: macula in the middle, circles at the equator, the ora "
        "serrata and the front of the pars plana. Colors are those of the pictures above.",
        "Where level stripes are pale blue the oil lies on a thin film of aqueous." if knows_films(run.scene) else "")
    return Markup('<h2>Fundus over time</h2><div class="strip">{}</div>{}').format(Markup("\n").join(maps), words)


def _script(file: str, function: str, root: str, values: object) -> Markup:
    """A script of this folder, and its call with an element and values; no text in them can end the script."""
    text = json.dumps(values, separators=(",", ":"), ensure_ascii=True).replace("<", "\\u003c")
    code = (HERE / file).read_text(encoding="utf-8")
    return Markup(f'<script>\n{code}{function}(document.querySelector("{root}"), {text});\n</script>')


def _curves(run: RunFolder, shown: Sequence[Shown], events: Sequence[Event]) -> Markup:
    drawn = [Markup('<img alt="{} over time" src="{}">').format(name, data_url(svg, "image/svg+xml"))
             for name, svg in curves(shown, run.table[TIME], events)]
    return Markup('<div class="curves">{}</div>').format(Markup("\n").join(drawn))


def _metrics(shown: Sequence[Shown]) -> list[Markup]:
    """What people ask for; how it was computed, and what stays the same, opens on a click."""
    first = [one for one in shown if one.metric.place < LAST]
    numerics = [one for one in shown if one.metric.place == LAST and not one.constant]
    still = [one for one in shown if one.constant]
    parts = [Markup('<div class="metrics">{}</div>').format(changing(first))]
    parts += [page.details("Numbers of the computation", changing(numerics))] if numerics else []
    return parts + ([page.details("What stays the same", constant(still))] if still else [])


def _simulated(run: RunFolder, advice: Report) -> list[Markup]:
    scene, last = run.scene, run.costs[-1]
    liquids = ", ".join(liquid.name.replace("_", " ") for liquid in scene.liquids)
    said = page.paragraph(
        f"{liquids.capitalize()}: {last['particles']:,} particles, {sum(one['steps'] for one in run.costs):,} steps of "
        f"the scheme {scene.numerics.scheme} on {' and '.join(dict.fromkeys(one['device'] for one in run.costs))}.")
    items = []
    for name in scene.effects:
        sentences = "; ".join(one.sentence for one in advice.advice if one.effect == name)
        what = _first_line(REGISTRY[name].Parameters).rstrip(".")
        items.append(page.bold(name) + f" ({what[:1].lower()}{what[1:]})" + (f": {sentences}." if sentences else "."))
    return [said, page.bullets(items), page.paragraph(DISCLAIMER)]


def _first_line(kind: type) -> str:
    return (kind.__doc__ or "").strip().partition("\n")[0]


def _left_out(run: RunFolder, advice: Report) -> list[Markup]:
    scene = run.scene
    items = [page.bold(one.effect) + f": {one.sentence}." for level in HEADINGS for one in advice.advice
             if one.level == level and one.effect not in scene.effects]
    advised = {one.effect for one in advice.advice}
    others = [name for name in REGISTRY if name not in scene.effects and name not in advised]
    return [page.bullets(items),
            page.paragraph(f"Not called for by this scene: {', '.join(others)}." if others else "",
                           f"{NOT_IN_AN_EYE}{FILMS_TOLD if knows_films(scene) else ''}."
                           if scene.container is None else "")]


def _cost(run: RunFolder, errors: Sequence[ExpectedError]) -> list[Markup]:
    every = {kind: [taken[kind] for taken in run.taken.values()] for kind in (*KINDS, "memory")}
    sums = {"wall": sum(every["wall"]), "cpu": sum(every["cpu"]), "memory": max(every["memory"], default=0.0)}
    rows = [(stage, duration(taken["wall"]), duration(taken["cpu"]), memory(taken["memory"]))
            for stage, taken in (*run.taken.items(), ("all", sums))]
    expected = [f"{one.quantity}: {one.words} ({one.source})" for one in errors]
    return [page.table(("stage", "by the clock", "of all cores", "memory"), rows),
            page.paragraph("Errors to expect, those of the accuracy study at this spacing:") if expected else
            page.paragraph("The error to expect is not known: the accuracy study has no case whose effects are all in "
                           "this scene."), page.bullets(expected)]


def _origin(run: RunFolder, sources: dict[str, str]) -> list[Markup]:
    links = [Markup('<a href="{}">{}</a>: {}').format(file, file, words) for file, words in FILES.items()
             if (run.folder / file).is_file()]
    versions = [(name, version(name)) for name in PACKAGES]
    versions += [("Python", platform.python_version()), ("system", f"{platform.system()} {platform.machine()}")]
    return [page.bullets(links),
            page.details("Versions when this page was made", page.table(("what", "version"), versions)),
            *(page.details(name, Markup("<pre>{}</pre>").format(text)) for name, text in sources.items())]


def _comparisons(folder: Path) -> dict[str, str]:
    """Links to the comparisons of this level with others, as far as they are made."""
    return {f"../{path.name}": path.stem.replace("compare_", "").replace("_", " and ")
            for path in sorted(folder.resolve().parent.glob("compare_*.html"))
            if folder.resolve().name in path.stem.split("_")[1:]}

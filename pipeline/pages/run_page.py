"""The page of a run: one file that holds all it shows and asks no network for anything."""
import platform
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path

from markupsafe import Markup

from pipeline.advice.report import DISCLAIMER, HEADINGS, Report
from pipeline.base import page
from pipeline.base.tables import TIME
from pipeline.base.usage import KINDS
from pipeline.base.words import NO_ADVICE, duration, in_a_row, memory
from pipeline.forecast.expected_error import ExpectedError
from pipeline.forecast.retina_error import UNIT
from pipeline.measures.charts import bars_of_metrics, curves
from pipeline.measures.events import Event, fill_in_table
from pipeline.measures.least_energy import RESTING
from pipeline.measures.metric import LAST
from pipeline.measures.place_course import courses_of
from pipeline.measures.rest import rest_in_words
from pipeline.measures.shown import Shown
from pipeline.measures.summary import breaks_over_time, changing, constant
from pipeline.pages.fundus_strip import fundus_strip
from pipeline.pages.headlines import Headline, headlines_of
from pipeline.pages.movie_copy import movie_within
from pipeline.pages.turning_view import view_within
from pipeline.pictures.marks import clock
from pipeline.pictures.moments import read_picture, scaled
from pipeline.pictures.pace import pace_of
from pipeline.runs.run_folder import RunFolder
from pipeline.scenes.effects import illustration_in_words, knows_films
from pipeline.scenes.retina import side_word
from pipeline.scenes.timeline import inherited, timeline_of, when
from pipeline.simulation.cost_files import read_costs
from pipeline.web.chart import Bar, bars, chart_library, chart_style, charts
from pipeline.web.embedded import data_url, webp
from pipeline.web.scripts import POLICY, called, library
from sim.backend.choice import library as library_of_kernels
from sim.effects import REGISTRY
from sim.liquid import GAS_DENSITY

HERE = Path(__file__).parent
POSTER_WIDTH = 800
NOT_COMPARED = "Nothing was compared with clinical data."
NOT_IN_AN_EYE = "No scene has the vitreous, or a wall and a retina that give"
NO_FILMS = ", or films of aqueous thinner than the particle spacing"
FILMS_TOLD = (". Films of aqueous thinner than the particle spacing are not simulated: theory tells where they are and "
              "how thick, by how fast the oil came over the wall and how long ago. The retina there counts as under "
              "oil, but not as touched")
PACKAGES = ("eye-oil-pipeline", library_of_kernels().name, "numpy", "scipy", "pyvista", "vtk", "snakemake")
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
    scene, events, time = run.scene, run.events, run.table[TIME]
    found = headlines_of(scene, shown, run.least_energy)
    bars_drawn = bars(bars_of_metrics(shown, time), _ends(run))
    body = page.filled(
        __file__, of_eye=scene.container is None, unfinished=_unfinished(run),
        description=page.paragraph(scene.description) + (page.paragraph(page.bold(scene.label)) if scene.label else ""),
        still=_still(run), numbers=found, resting=RESTING, no_advice=NO_ADVICE, said=_said(run, found, events, errors),
        breaks=Markup("\n").join(page.paragraph(page.bold(one.sentence())) for one in courses_of(run.table, scene)),
        movie=_movie(run), timeline=_timeline(run, sources), fundus=_fundus(run), view=_view(run),
        yes_or_no=bars_drawn, curves=charts(curves(shown, time, events)),
        metrics=[*breaks_over_time(courses_of(run.table, scene)), *_metrics(shown)],
        errors=_errors(errors, of_eye=scene.container is None), cost=_cost(run),
        simulated=Markup("\n").join(_simulated(run, advice)),
        left_out=Markup("\n").join(_left_out(run, advice)), origin=_origin(run, sources))
    return page.page(f"{run.title}: {scene.accuracy}", [chart_library(), body], heading=run.title, path=path,
                     links=_comparisons(run.folder), style=chart_style() + (HERE / "run_page.css").read_text(),
                     head=POLICY)


def _unfinished(run: RunFolder) -> str:
    """One sentence where the run goes on, or was stopped; empty where it is whole."""
    made, every = len(run.pictures), run.frame_count
    if made >= every:
        return ""
    second_means = run.scene.output.second_means
    now, end = (clock(frame * run.scene.output.frame_interval, second_means) for frame in (made - 1, every - 1))
    return (f"This run is not finished: {made} of {every} frames are drawn, up to {now} of {end.removeprefix('t = ')}. "
            "All below is of this part.")


def _said(run: RunFolder, found: Sequence[Headline], events: Sequence[Event], errors: Sequence[ExpectedError]
          ) -> Markup:
    """What the first numbers are, and how sure."""
    scene, illustrated, resting = run.scene, illustration_in_words(run.scene), run.least_energy
    said = [f"At the end ({clock(run.table[TIME][-1], scene.output.second_means)}), at accuracy {scene.accuracy}: "
            f"a resolution of {1e3 * scene.numerics.particle_spacing:g} mm."]
    if illustrated:
        said.append(f"{illustrated}; they are in the tables below.")
    elif found and not any(one.sure for one in found):
        said.append("The uncertainty of these numbers is unknown; the errors to expect are below.")
    rest = "" if illustrated else rest_in_words(run.table, events)
    rest = f"{rest[:1].upper()}{rest[1:]}." if rest else ""
    if rest and not rest.startswith("Nearly at rest"):
        rest = page.bold(rest)
    parts = [page.paragraph(*said), page.paragraph(rest)]
    notes = []
    if any(one.at_rest for one in found):
        notes.append(resting.explained())
    if any(one.sure for one in found):
        notes.append("±: reading uncertainty, half a particle spacing at the edge of the oil. The error of the shape "
                     "itself comes on top.")
    notes += [f"At this level the covered retina at rest is {one.words} ({one.source}). That is of the whole retina: "
              "for its halves and the macula no bound is known, and they may be farther off."
              for one in errors if one.unit == UNIT and not illustrated]
    notes += [NOT_COMPARED] * (scene.container is None)
    return Markup("\n").join([*(one for one in parts if one), page.paragraph(*notes)])


def _still(run: RunFolder) -> dict[str, str] | None:
    """The illustration of the last frame; a scene in a plane has none, nor has a run that is not finished."""
    file = run.folder / "still.png"
    if run.scene.dimension == 2 or not file.is_file():
        return None
    return {"alt": "The opened eye with its liquids" if run.scene.container is None else
            "The liquids in their container", "source": data_url(webp(read_picture(file)), "image/webp")}


def _movie(run: RunFolder) -> dict[str, object]:
    pace = pace_of(len(run.pictures), run.scene.output.frame_interval)
    poster = data_url(webp(scaled(read_picture(run.pictures[-1]), POSTER_WIDTH)), "image/webp")
    words = pace.in_words(len(run.pictures), run.scene.output.second_means)
    return {"poster": poster, "source": data_url(movie_within(run.folder / "movie.mp4"), "video/mp4"),
            "step": f"{1.0 / pace.rate:.6g}", "words": f"{words[:1].upper()}{words[1:]}",
            "script": Markup("<script>\n{}showMovie(document.querySelector('.movie'));\n</script>").format(
                Markup((HERE / "movie.js").read_text(encoding="utf-8")))}


def _timeline(run: RunFolder, sources: dict[str, str]) -> Markup:
    """What was done and when, as bars; what an extended scene says of it names that file."""
    scene, end, origin = run.scene, float(run.table[TIME][-1]), inherited(sources)
    spans = timeline_of(scene, fill_in_table(scene, run.table, run.cavity_volume), run.cavity_volume, end)
    return bars([Bar(one.words, when(one, end), [(one.begin / end, one.end / end, "")],
                     f"({origin[one.effect]})" if one.effect in origin else "") for one in spans],
                ("0 s", f"{end:g} s"))


def _ends(run: RunFolder) -> tuple[str, str]:
    """Words at both ends of an axis of time."""
    first, last = (clock(run.table[TIME][index], run.scene.output.second_means) for index in (0, -1))
    return first.removeprefix("t = "), last.removeprefix("t = ")


def _view(run: RunFolder) -> dict[str, object] | None:
    """The surfaces in space; a scene in a plane has none."""
    if run.scene.dimension == 2:
        return None
    view = view_within(run)
    return {"last": len(view["frames"]) - 1, "legends": [(mesh.pop("legend"), mesh["wall"]) for mesh in view["meshes"]],
            "views": [words for words, _ in view["views"]],
            "script": library("three.min.js") + called("viewer.js", "showTurningView", ".turning", view)}


def _fundus(run: RunFolder) -> dict[str, object] | None:
    """Maps of the retina over time."""
    scene = run.scene
    if scene.container is not None:
        return None
    kind = "gas" if any(liquid.density < GAS_DENSITY for liquid in scene.liquids) else "oil"
    films = f" Level stripes of pale blue: {kind} on a thin film of aqueous." if knows_films(scene) else ""
    left = side_word(False, scene.eye.side == "right")
    return {"maps": list(fundus_strip(run)), "words": page.paragraph(
        f"The {scene.eye.side} eye as its examiner sees it and a fundus photograph shows it (not the inverted view of "
        f"indirect ophthalmoscopy), superior above and {left} on the left: macula in the middle; circles at the "
        "equator, the ora serrata and the front of the pars plana; the pale rim beyond the ora serrata is no retina. "
        f"Colors are those of the movie.{films}")}


def _metrics(shown: Sequence[Shown]) -> list[Markup]:
    """What people ask for; how it was computed, and what stays the same, opens on a click."""
    first = [one for one in shown if one.metric.place < LAST]
    numerics = [one for one in shown if one.metric.place == LAST and not one.constant]
    still = [one for one in shown if one.constant]
    parts = [page.details("What changes: at the start and at the end, the smallest and the largest",
                          Markup('<div class="metrics">{}</div>').format(changing(first)))] if first else []
    parts += [page.details("Numbers of the computation", changing(numerics))] if numerics else []
    return parts + ([page.details("What stays the same", constant(still))] if still else [])


def _errors(errors: Sequence[ExpectedError], *, of_eye: bool) -> Markup:
    """The error of the coverage first, the others on a click."""
    def sentence(one: ExpectedError) -> str:
        return f"{one.quantity}: {one.words} ({one.source})"

    first = [page.bold(f"{sentence(one)}.") for one in errors if one.unit == UNIT]
    others = [sentence(one) for one in errors if one.unit != UNIT]
    if not errors:
        return page.paragraph("The error to expect is unknown: the accuracy study has no case whose effects are all in "
                              "this scene.")
    unknown = "" if first or not of_eye else "The error of the covered retina at this particle spacing is unknown."
    return Markup("\n").join([
        *(page.paragraph(one) for one in first), page.paragraph(unknown),
        *([page.details("Errors of simpler flows at this spacing", page.bullets(others))] if others else [])])


def _simulated(run: RunFolder, advice: Report) -> list[Markup]:
    scene = run.scene
    costs = [read_costs(path) for path in run.cost_files if path.is_file()] if _unfinished(run) else run.costs
    liquids = ", ".join(liquid.name.replace("_", " ") for liquid in scene.liquids)
    said = page.paragraph(
        f"{liquids.capitalize()}: {costs[-1]['particles']:,} particles, {sum(one['steps'] for one in costs):,} steps "
        f"of the scheme {scene.numerics.scheme} on {' and '.join(dict.fromkeys(one['device'] for one in costs))}.")
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
                           f"{NOT_IN_AN_EYE}{FILMS_TOLD if knows_films(scene) else NO_FILMS}."
                           if scene.container is None else "")]


def _cost(run: RunFolder) -> Markup:
    every = {kind: [taken[kind] for taken in run.taken.values()] for kind in (*KINDS, "memory")}
    sums = {"wall": sum(every["wall"]), "cpu": sum(every["cpu"]), "memory": max(every["memory"], default=0.0)}
    rows = [(stage, duration(taken["wall"]), duration(taken["cpu"]), memory(taken["memory"]))
            for stage, taken in (*run.taken.items(), ("all", sums))]
    return page.table(("stage", "by the clock", "of all cores", "memory"), rows)


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
    return {f"../{path.name}": in_a_row(path.stem.split("_")[1:])
            for path in sorted(folder.resolve().parent.glob("compare_*.html"))
            if folder.resolve().name in path.stem.split("_")[1:]}

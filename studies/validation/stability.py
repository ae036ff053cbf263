"""Hard cases: every scheme goes through every one of them, or says why not (``studies.validation.kit.hard_cases``).

Each case has a verdict: held; degraded (held, with far smaller steps or solves that end at their limit); refused, with
the sentence that the user reads; or failed. What a scheme cannot do stands in the table like everything else.
"""
import dataclasses
import itertools
import math
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from pipeline.base.errors import UserError
from pipeline.pictures.picture_grid import as_png, panels
from pipeline.scenes.load import PROJECT_CONFIG, load_scene
from pipeline.studies.family import Family
from pipeline.studies.model import Outcome, Row
from sim.effects.gravity import Jolt
from sim.parameters import parameter
from sim.schemes import REGISTRY as SCHEMES
from sim.schemes.wcsph import WCSPHParameters
from sim.settings import Liquid
from studies.validation.kit import hard_cases as hard
from studies.validation.kit.hard_cases import HardCase, Tank, Verdict

PICTURES = ("stability_table",)
COLORS = {hard.HELD: "#cfe8d5", hard.DEGRADED: "#f6e7b4", hard.REFUSED: "#d5dfee", hard.FAILED: "#f2b8ad"}
WORDS = {hard.HELD: "held", hard.DEGRADED: "held, small steps", hard.REFUSED: "refused", hard.FAILED: "failed"}
GROUPS = ("closed", "open", "time_step", "effects", "limits")


@dataclasses.dataclass(frozen=True)
class Parameters:
    """One scheme and one group of cases, which share solvers."""

    scheme: str = parameter(choices=tuple(SCHEMES), meaning="pressure solve and time integration")
    group: str = parameter(choices=GROUPS, meaning="group of cases")


def run(parameters: Parameters) -> Outcome:
    """Judge every case of the group."""
    outcome, cpu_begin = Outcome(), time.process_time()
    begin = time.perf_counter()
    for verdict in itertools.chain.from_iterable(part(parameters.scheme) for part in RUNS[parameters.group]):
        outcome.rows += verdict.rows(time.perf_counter() - begin)
        begin = time.perf_counter()
        if verdict.sentence:
            outcome.remarks.append(f"{parameters.scheme}, {verdict.name}: {WORDS[verdict.outcome]} "
                                   f"({verdict.sentence}).")
    outcome.rows.append(Row("processor time of all cases", time.process_time() - cpu_begin, "s"))
    return outcome


def judged(head: str, tank: Tank, cases) -> Iterator[Verdict]:
    """Verdicts of the cases on one tank, named after what the tank is."""
    for case in cases:
        verdict = hard.judge(tank, case)
        yield dataclasses.replace(verdict, name=f"{head}: {verdict.name}".removesuffix(": "))


def closed(scheme: str) -> Iterator[Verdict]:
    """Starts and events in a full cavity."""
    yield from judged(hard.HEADS["closed"], hard.closed_tank(scheme), hard.CLOSED)


def opened(scheme: str) -> Iterator[Verdict]:
    """Starts and events under a free surface; a scheme that chooses its speed of sound is told of the jolt."""
    if scheme != "wcsph":
        yield from judged(hard.HEADS["open"], hard.open_tank(scheme), hard.OPEN)
        return
    jerk = [case for case in hard.OPEN if "jerk" in case.name]
    short = [dataclasses.replace(case, duration=min(case.duration, 0.1)) for case in hard.OPEN if case not in jerk]
    yield from judged(hard.HEADS["open"], hard.open_tank(scheme), short)
    jolt = Jolt(0.0, (5.0 * hard.GRAVITY, 0.0, 0.0), 0.05)
    tank = hard.open_tank(scheme, effects={"gravity": hard.WORST_GRAVITY | {"jolts": (jolt,)}})
    yield from judged(hard.HEADS["open"], tank, [dataclasses.replace(case, duration=0.08) for case in jerk])


def time_steps(scheme: str) -> Iterator[Verdict]:
    """Fixed time steps below and above the limit, in runs, and in scene files against the limits known beforehand."""
    for head, tank, base in ((hard.HEADS["closed"], hard.closed_tank(scheme), hard.CLOSED[0]),
                             (hard.HEADS["open"], hard.open_tank(scheme), hard.OPEN[0])):
        yield from judged(head, tank, hard.fixed_steps(tank, dataclasses.replace(base, duration=0.1)))
    limit = 0.125 * hard.SPACING**2 * 970.0 / 1.0  # explicit viscosity of the oil
    for factor in hard.FACTORS:
        step = f"numerics: {{time_step: {factor * limit:.9g} s, scheme: {scheme}}}"
        yield scene_verdict(f"scene file: fixed step, {factor:g} of explicit viscosity's limit",
                            SCENE + "effects: {gravity: {}, viscosity: {}}\n" + WAVE_SPEED + step)


def densities(scheme: str) -> Iterator[Verdict]:
    """Equal densities, the largest ratios that the scheme claims, and 1:10000, which none does."""
    limit = SCHEMES[scheme].density_ratio_limit
    for ratio, is_closed in ((1.0, True), (limit(True), True), (limit(False), False)):
        liquids = (Liquid("heavy", 1000.0, 1e-3), Liquid("light", 1000.0 / ratio, 1e-3))
        tank = (hard.closed_tank if is_closed else hard.open_tank)(scheme, liquids=liquids)
        claim = "" if ratio == 1.0 else f" (the largest that {scheme} claims)"
        case = dataclasses.replace((hard.CLOSED if is_closed else hard.OPEN)[0], duration=0.1)
        head = hard.HEADS["closed" if is_closed else "open"]
        verdict = hard.judge(tank, case)
        yield dataclasses.replace(verdict, name=f"{head}: density 1:1" if ratio == 1.0 else f"{head}: largest ratio",
                                  sentence=f"1:{ratio:g}{claim}" + (f"; {verdict.sentence}" if verdict.sentence else "")
                                  if ratio > 1.0 else verdict.sentence)
    for is_closed in (True, False):
        blocks = FULL if is_closed else PARTLY
        yield scene_verdict(f"{hard.HEADS['closed' if is_closed else 'open']}: density 1:10000",
                            SCENE.replace(PARTLY, blocks).replace("silicone_oil_1000: {}",
                                                                  "silicone_oil_1000: {density: 0.1005 kg/m3}")
                            + f"effects: {{gravity: {{}}}}\nnumerics: {{scheme: {scheme}}}\n")


def tensions(scheme: str) -> Iterator[Verdict]:
    """Ten times the tension of oil in water, wetting everything and nothing, and none at all."""
    duration = 0.02 if scheme == "wcsph" else 0.05  # s; sound takes it thousands of steps
    for coefficient, angle, cases in ((0.4, 0.0, hard.TENSION), (0.4, 180.0, hard.TENSION[:1]),
                                      (0.0, 18.2, hard.TENSION[:1])):
        tank = hard.closed_tank(scheme, effects={
            "interface_tension": {"coefficient": coefficient, "contact_angle": math.radians(angle)}})
        head = f"tension x {coefficient / 0.04:g}, theta {angle:g}"
        yield from judged(head, tank, [dataclasses.replace(case, duration=duration) for case in cases])


def attractions(scheme: str) -> Iterator[Verdict]:
    """The attraction of the silicone-oil paper, which draws a body of oil together: a pair of particles oscillates."""
    for name, oil in (("as viscous as oil", hard.OIL), ("as thin as water", Liquid("thin oil", 970.0, 1e-3))):
        tank = hard.closed_tank(scheme, liquids=(hard.AQUEOUS, oil), effects={"cohesion": {"gamma": 3.0}})
        case = HardCase(name, duration=0.05 if scheme == "wcsph" else 0.2, works=True)
        yield from judged("cohesion, gamma 3", tank, [case])


def mixtures(scheme: str) -> Iterator[Verdict]:
    """Liquids that change from particle to particle, and a diffusion far above the explicit limit."""
    fast, still = hard.MIXING[1], 2e-3
    spacing = 0.5 * hard.SPACING
    tank = hard.closed_tank(scheme, spacing=spacing, effects={
        "diffusion": {"coefficient": 10.0 * (2.5 * spacing) ** 2 / still}},
        scheme_parameters=WCSPHParameters(sound_speed=0.05) if scheme == "wcsph" else None)
    yield from judged("diffusion", tank, [fast])
    tank = hard.closed_tank(scheme, effects={"diffusion": {"coefficient": 1e-5}})
    yield from judged("diffusion", tank, hard.MIXING[:1])


def refusals(scheme: str) -> Iterator[Verdict]:
    """Injections that cannot be: without an outlet, and of more than the cavity holds."""
    head = f"effects:\n  gravity: {{}}\n  injection: {{{INJECTION}"
    scheme_line = f"numerics: {{scheme: {scheme}}}\n"
    full = SCENE.replace(PARTLY, "blocks: [{liquid: aqueous, lower: [0, 0], upper: [20 mm, 20 mm]}]\n")
    yield scene_verdict("injection without an outlet", full + head + "}\n" + scheme_line)
    if "injection" in SCHEMES[scheme].refuses:
        yield scene_verdict("injection of more than the cavity holds", full + head + f", {DRAIN}}}\n" + scheme_line)
        return
    volume = 3.14 * (0.5 * hard.SIDE) ** 2
    tank = hard.closed_tank(scheme, effects={"injection": {
        "liquid": "oil", "drained_liquid": "aqueous", "flow": 5.0 * volume, "fill": 1.0,
        "cannula": (-4e-3, 0.0, 0.0), "drain": (9e-3, 0.0, 0.0)}})
    yield from judged("injection of more than the cavity holds", tank, [
        HardCase("", duration=0.5, works=True, exchanges=True,
                 refusal="runs out at the drain before the fill is reached")])


RUNS = {"closed": (closed,), "open": (opened,), "time_step": (time_steps,),
        "effects": (tensions, attractions, mixtures), "limits": (densities, refusals)}
PARTLY = "blocks: [{liquid: aqueous, lower: [0, 0], upper: [10 mm, 10 mm]}]\n"
FULL = "initial: {fill: {aqueous: 50 %, silicone_oil_1000: 50 %}}\n"
SCENE = """dimension: 2
container: {size: [20 mm, 20 mm]}
liquids:
  aqueous: {}
  silicone_oil_1000: {}
levels:
  draft: {particle_spacing: 1 mm}
  standard: {particle_spacing: 1 mm}
  fine: {particle_spacing: 1 mm}
output: {duration: 0.1 s, frame_interval: 0.05 s}
""" + PARTLY
WAVE_SPEED = "schemes: {wcsph: {sound_speed: 1 m/s}}\n"
INJECTION = ("liquid: silicone_oil_1000, drained_liquid: aqueous, flow: 1e-6 m3/s, fill: 90 %, "
             "cannula: [5 mm, 10 mm, 0 mm]")
DRAIN = "drain: [15 mm, 10 mm, 0 mm]"


def scene_verdict(name: str, text: str) -> Verdict:
    """What the reader of scene files says of a scene."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scene.yaml"
        path.write_text(text, encoding="utf-8")
        try:
            load_scene(path, "draft", PROJECT_CONFIG)
        except UserError as error:
            sentence = "; ".join(message.removeprefix(f"{path}: ") for message in error.messages)
            return Verdict(name, hard.REFUSED, sentence)
    return Verdict(name, hard.HELD)


def pictures(outcomes: list[Outcome]) -> dict[str, bytes]:
    """The table of all verdicts: cases by schemes."""
    table: dict[str, dict[str, str]] = {}
    for outcome in outcomes:
        scheme = outcome.case.split("-")[1]
        for row in outcome.rows:
            if row.quantity == "verdict":
                table.setdefault(row.at.strip("[]"), {})[scheme] = hard.OUTCOMES[int(row.value)]
    names = list(SCHEMES)
    canvas, axes = panels(1, 1, (9.0, 0.21 * (len(table) + 3)))
    axes = axes[0, 0]
    for line, (name, cells) in enumerate(table.items()):
        axes.text(-0.05, line, name, ha="right", va="center", fontsize=8)
        for column, scheme in enumerate(names):
            found = cells.get(scheme)
            axes.add_patch(_box(column, line, COLORS.get(found, "white")))
            axes.text(column + 0.5, line, WORDS.get(found, ""), ha="center", va="center", fontsize=7.5)
    for column, scheme in enumerate(names):
        axes.text(column + 0.5, -1.0, scheme.replace("_", " "), ha="center", va="center", fontsize=8, weight="bold")
    axes.set(xlim=(-2.2, len(names)), ylim=(len(table) - 0.4, -1.7))
    axes.axis("off")
    return {PICTURES[0]: as_png(canvas, 110)}


def _box(column: int, line: int, color: str):
    from matplotlib.patches import Rectangle

    return Rectangle((column + 0.02, line - 0.46), 0.96, 0.92, facecolor=color)


FAMILY = Family(__name__, Parameters, run,
                effects=("gravity", "viscosity_implicit", "interface_tension", "diffusion", "injection", "cohesion"),
                pictures=PICTURES, draw=pictures)

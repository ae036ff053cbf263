"""Studies of what accuracy costs: error against time, one figure and one CSV for every family of cases.

The first case of a family is its base, a sweep of the particle spacing, which further starts (``seed``) repeat; every
other case differs from it in one thing (tolerance, time step, scheme, precision, support radius) at one of its
resolutions. The error is that of the family's headline, and of several starts the mean. A family without a
reference (``self_convergence``) gives a curve instead, which is compared with that of the base at its finest
resolution. Times are those of the steps, without compilation, of all cores: on a computer that does other things as
well, the clock says little.
"""
import dataclasses
import itertools
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pipeline.base.canvas import empty_figure
from pipeline.base.files import replacing, write_text
from pipeline.base.tables import csv_of
from pipeline.forecast.expected_error import ALIKE, LEAST_ORDER, error_at, in_words
from pipeline.forecast.expected_error import COLUMNS as ORDER_COLUMNS
from pipeline.studies.family import Family
from pipeline.studies.model import COMPUTING_TIME, WALL_TIME, Outcome, Row, observed_order
from pipeline.studies.plan import Case, Study, spacings
from pipeline.studies.question_page import StudyPage

WIDTH = 0.022  # m, of the eye whose levels are marked
SPACING, REACHED = "particle spacing", "time reached"
UNTOLD = ("resolutions", "seed")  # parameters that are no change
NAMES = {"tolerance_factor": "tolerances x {:g}", "time_step_factor": "time step x {:g}", "support_ratio": "h/dx {:g}",
         "precision": "{}", "scheme": "{}"}
COLORS = ("#1b6ca8", "#c8553d", "#3a8f5c", "#8e5ba6", "#c99a2e", "#4aa8a0", "#d16ba5", "#7a8b2f", "#4b4e57", "#a05a2c")
MARKERS = "sD^v<>PXp"
ORDERS = np.linspace(LEAST_ORDER, 6.0, 1101)  # that are tried where the finest run is the reference


@dataclasses.dataclass(frozen=True)
class Point:
    """Runs that differ in their start only: what was changed, how exact and how dear they were; times in s.

    Attributes
    ----------
    error, least, most : mean error, and the least and the largest of so many ``starts``; nan where one failed.
    first : error of the first start, which the runs with a change have too.
    """

    change: str
    resolution: int
    particles: float
    error: float
    unit: str
    wall: float
    cpu: float
    least: float = math.nan
    most: float = math.nan
    first: float = math.nan
    starts: int = 1
    front: bool = False


def change_of(case: Case, base: Case) -> str:
    """Return in words what tells a case from the base of its family."""
    fields = [field.name for field in dataclasses.fields(base.parameters) if field.name not in UNTOLD]
    changed = [NAMES.get(name, name.replace("_", " ") + " {}").format(getattr(case.parameters, name))
               for name in fields if getattr(case.parameters, name) != getattr(base.parameters, name)]
    return ", ".join(changed) or SPACING


def on_front(times: Sequence[float], errors: Sequence[float]) -> list[bool]:
    """Tell for every point whether no other is both as exact and as fast, and better in one of the two."""
    pairs = list(zip(times, errors, strict=True))
    return [all(map(math.isfinite, one)) and not any(
        other[0] <= one[0] and other[1] <= one[1] and other != one for other in pairs) for one in pairs]


def points_of(cases: Sequence[Case], outcomes: Sequence[Outcome]) -> list[Point]:
    """Return the points of one family, those of its base first."""
    family, found = cases[0].family, []
    reference = _reference(cases[0], outcomes[0]) if family.headline.self_convergence else None
    for case, outcome in zip(cases, outcomes, strict=True):
        change = change_of(case, cases[0])
        for resolution in case.parameters.resolutions:
            rows = {row.quantity: row for row in outcome.rows if row.at.rpartition("=")[2] == str(resolution)}
            if reference is None:
                error, unit = _error(rows.get(family.headline.quantity))
            else:
                error, unit = _difference(outcome, resolution, reference), "1"
            number = {name: rows[name].value if name in rows else math.nan
                      for name in ("particles", WALL_TIME, COMPUTING_TIME)}
            found.append(Point(change, resolution, number["particles"], error, unit, number[WALL_TIME],
                               number[COMPUTING_TIME], error, error, error))
    found = _joined(found)
    front = on_front([point.cpu for point in found], [point.error for point in found])
    return [dataclasses.replace(point, front=best) for point, best in zip(found, front, strict=True)]


def _joined(points: Sequence[Point]) -> list[Point]:
    """The points with those that differ in their start only made one."""
    groups: dict[tuple, list[Point]] = {}
    for point in points:
        groups.setdefault((point.change, point.resolution), []).append(point)
    joined = []
    for same in groups.values():
        errors, wall, cpu = np.array([[point.error, point.wall, point.cpu] for point in same]).T
        joined.append(dataclasses.replace(
            same[0], error=float(errors.mean()), least=float(errors.min()), most=float(errors.max()), starts=len(same),
            wall=float(wall.mean()), cpu=float(cpu.mean())))
    return joined


def _error(row: Row | None) -> tuple[float, str]:
    if row is None or row.error is None or not math.isfinite(row.error):
        return math.nan, "1"
    return row.error, "1" if row.relative else row.unit


def _curve(outcome: Outcome, resolution: int):
    return next((np.array([curve.x, curve.y]) for curve in outcome.curves
                 if curve.label.rpartition("=")[2] == str(resolution)), None)


def _reference(case: Case, outcome: Outcome):
    return _curve(outcome, max(case.parameters.resolutions))


def _difference(outcome: Outcome, resolution: int, reference) -> float:
    """Root mean square difference of a curve from that of the reference, over the root mean square of that one."""
    curve = _curve(outcome, resolution)
    if curve is None or reference is None or np.array_equal(curve, reference):
        return math.nan
    difference = np.interp(reference[0], *curve) - reference[1]
    return float(np.sqrt((difference**2).mean() / (reference[1] ** 2).mean()))


def base_points(points: Sequence[Point]) -> list[Point]:
    """The points of the sweep of the particle spacing that have an error, coarse to fine."""
    return sorted((point for point in points if point.change == SPACING and math.isfinite(point.error)),
                  key=lambda point: point.resolution)


def law_of(points: Sequence[Point]) -> tuple[float, float]:
    """Return order p and factor C of the error C n^-p with n spacings along the case; nan without two errors.

    Where a run is compared with the finest one, of m spacings, their difference is C (n^-p - m^-p): p is the one that
    leaves the least of the logarithms. There is none if that is at the end of :data:`ORDERS`: the runs do not converge
    yet.
    """
    base = [point for point in base_points(points) if point.error > 0.0]
    if len(base) < 2:
        return math.nan, math.nan
    size, errors = (np.array([getattr(point, name) for point in base]) for name in ("resolution", "error"))
    finest = max((point.resolution for point in points if point.change == SPACING), default=0)
    if finest == size.max():
        order = observed_order(1.0 / size, errors)
        return order, float(np.exp(np.mean(np.log(errors) + order * np.log(size))))
    left = []
    for order in ORDERS:
        misses = np.log(errors) - np.log(size**-order - finest**-order)
        left.append((float(np.var(misses)), float(order), float(np.exp(misses.mean()))))
    _, order, factor = min(left)
    return (order, factor) if ORDERS[0] < order < ORDERS[-1] else (math.nan, math.nan)


def order_of(points: Sequence[Point]) -> float:
    """Observed order of the error with the particle spacing."""
    return law_of(points)[0]


def levels_of(points: Sequence[Point], per_width: float, levels: dict[str, float]) -> dict[str, tuple[float, ...]]:
    """Return for every accuracy level resolution, time and error.

    Both are interpolated in the sweep of the spacing. Beyond it the error follows the observed order and the time is
    nan: what small runs take says nothing about large ones (`pipeline.estimate` does).

    Parameters
    ----------
    levels : name -> particle spacing, m, in an eye of :data:`WIDTH`; a case resolves ``per_width`` of that.
    """
    base, order = base_points(points), order_to_quote(points)
    found: dict[str, tuple[float, ...]] = {}
    for name, spacing in levels.items():
        resolution = per_width * WIDTH / spacing
        inside = bool(base) and base[0].resolution <= resolution <= base[-1].resolution
        time = float(np.exp(np.interp(np.log(resolution), *np.log([(one.resolution, one.cpu) for one in base]).T))
                     ) if inside else math.nan
        known = [(one.resolution, one.error, one.least, one.most) for one in base]
        found[name] = (resolution, time, float(error_at(resolution, known, order)[0][0]) if base else math.nan)
    return found


def judge(study: Study, outcomes: list[Outcome], target: Path) -> list[Outcome]:
    """Write figures and tables; return what is to be said about them, and the outcomes, of which no error is asked."""
    return write_tradeoff(study, outcomes, target) + [unasked(outcome) for outcome in outcomes]


def write_tradeoff(study: Study, outcomes: Sequence[Outcome], target: Path) -> list[Outcome]:
    """Write a figure and a CSV of every family and ``orders.csv``; return what is to be said about them."""
    orders, found = [], []
    target.mkdir(parents=True, exist_ok=True)
    for family in study.families():
        cases = [case for case in study.cases.values() if case.family is family]
        points = points_of(cases, [next(one for one in outcomes if one.case == case.name) for case in cases])
        write_text(target / f"{family.name}.csv", csv_of([field.name for field in dataclasses.fields(Point)],
                                                         map(dataclasses.astuple, points)))
        _draw(target / f"{family.name}_tradeoff.png", family, points)
        orders += orders_of(family, points)
        found.append(in_short(family, points))
    write_text(target / "orders.csv", csv_of(ORDER_COLUMNS, orders))
    return found


def unasked(outcome: Outcome) -> Outcome:
    """The outcome without tolerances, for inexact runs are what such a study is about; that a run ends is asked."""
    rows = [row if row.quantity == REACHED else dataclasses.replace(row, tolerance=None) for row in outcome.rows]
    return dataclasses.replace(outcome, rows=rows)


def order_to_quote(points: Sequence[Point]) -> float:
    """The observed order, which must not promise more than the last refinement gave; nan without two errors."""
    base, order = base_points(points), order_of(points)
    if len(base) < 2 or _by_difference(points, base):
        return order
    return min(order, _last_order(base))


def _by_difference(points: Sequence[Point], base: Sequence[Point]) -> bool:
    """True where errors are differences from the finest run of the sweep."""
    return base[-1].resolution < max(point.resolution for point in points if point.change == SPACING)


def orders_of(family: Family, points: Sequence[Point]) -> list[dict]:
    """Return the rows of a family for orders.csv, one for every size; empty where nothing is known of its error.

    A difference from the finest run of the sweep says nothing of the error which that run has itself: the error is that
    of the observed law then, and unknown without one.
    """
    base = base_points(points)
    if not base:
        return []
    order, factor = law_of(points)
    by_difference = _by_difference(points, base)
    if by_difference and not math.isfinite(order):
        return []
    quoted, rows = order_to_quote(points), []
    for point in base:
        errors = [factor * point.resolution**-order] * 3 if by_difference else [point.error, point.least, point.most]
        rows.append({"case": family.name, "quantity": family.headline.quantity, "unit": point.unit,
                     "effects": " ".join(family.shown_by), "per_width": family.headline.per_width,
                     "resolution": point.resolution, **dict(zip(("error", "least", "most"), errors, strict=True)),
                     "starts": point.starts, "order": quoted})
    return rows


def _last_order(base: Sequence[Point]) -> float:
    """The order between the two finest runs: an estimate must not promise more than the last refinement gave."""
    last = base[-2:]
    return observed_order([1.0 / point.resolution for point in last], [point.error for point in last])


def in_short(family: Family, points: Sequence[Point]) -> Outcome:
    """What the levels give, and what every change gains or loses at the same resolution, as rows and as sentences: its
    error over that of the base from the same start, its time over the mean of all starts. Of a family without a
    reference also how far each size is from the finest.
    """
    order = order_of(points)
    outcome = Outcome([Row("observed order of the error", order)], case=f"{family.name} in short")
    base, said = {point.resolution: point for point in points if point.change == SPACING}, []
    bought = _bought(family, points)
    if bought:
        outcome.rows += [Row(f"{which} error at {level}", error, unit, at=f"n={size:.3g}")
                         for level, size, errors, unit, _ in bought
                         for which, error in zip(("mean", "least", "largest"), errors, strict=True)]
        outcome.remarks.append(f"{family.name}: {family.headline.quantity}, error to expect: "
                               + "; ".join(words for *_, words in bought) + ".")
    for point in base.values() if family.headline.self_convergence else ():
        at = f"n={point.resolution}"
        outcome.rows += [Row("particles", point.particles, at=at), Row(COMPUTING_TIME, point.cpu, "s", at=at)]
        if math.isfinite(point.error):
            outcome.rows.append(Row(family.headline.quantity, point.error, at=at))
    for point in points:
        beside = base.get(point.resolution)
        if point.change == SPACING or beside is None or beside.first == 0.0:
            continue
        exact, dear = point.error / beside.first, point.cpu / beside.cpu
        at = f"n={point.resolution}"
        outcome.rows += [Row(f"{point.change}: error over that of the base", exact, at=at, wall_s=point.wall),
                         Row(f"{point.change}: computing time over that of the base", dear, at=at, wall_s=point.wall)]
        said.append(f"{point.change} {exact:.2f} and {dear:.2f}")
    if said:
        outcome.remarks.append(f"{family.name}: {_said(order)}; error and computing time over those of the base: "
                               f"{'; '.join(said)}.")
    return outcome


def _bought(family: Family, points: Sequence[Point]) -> list[tuple[str, float, list[float], str, str]]:
    """For every accuracy level its name, spacings along the case, the errors to expect, their unit, all in words."""
    rows, found = orders_of(family, points), []
    for level, spacing in (spacings() if rows else {}).items():
        size = family.headline.per_width * WIDTH / spacing
        known = [[row[column] for column in ("resolution", "error", "least", "most")] for row in rows]
        errors, how = error_at(size, known, rows[0]["order"])
        unit = rows[0]["unit"]
        mean, spread = in_words(errors.tolist(), unit, rows[0]["starts"])
        words = f"{mean} at {level} ({', '.join(filter(None, (spread, how)))})"
        found.append((level, size, errors.tolist(), unit, words))
    return found


def _said(order: float) -> str:
    return f"order {order:.1f}" if math.isfinite(order) else "no order found"


def _draw(path: Path, family: Family, points: Sequence[Point]) -> None:
    from matplotlib.ticker import LogLocator, NullFormatter

    canvas = empty_figure((9.5, 5.2))
    axes = canvas.subplots()
    base, shown = base_points(points), [point for point in points if math.isfinite(point.error) and point.error > 0.0]
    axes.plot([point.cpu for point in base], [point.error for point in base], "o-", color="black", lw=1.4, ms=6,
              label=f"{SPACING}, {_said(order_of(points))}")
    bars = [point for point in base if point.starts > 1]
    if bars:
        axes.vlines([point.cpu for point in bars], [point.least for point in bars], [point.most for point in bars],
                    color="black", lw=1.2, label=f"least to largest of {bars[0].starts} starts")
    looks = zip(itertools.cycle(COLORS), itertools.cycle(MARKERS), strict=False)
    for change in dict.fromkeys(point.change for point in shown if point.change != SPACING):
        color, marker = next(looks)
        some = [point for point in shown if point.change == change]
        axes.plot([point.cpu for point in some], [point.error for point in some], marker, color=color, ms=7,
                  label=f"{change} ({', '.join(str(point.resolution) for point in some)})")
    front = sorted((point.cpu, point.error) for point in shown if point.front)
    if front:
        axes.plot(*zip(*front, strict=True), color="#c8a200", lw=5, alpha=0.35, zorder=0, label="Pareto front")
    # A difference from the finest run is no error: beside it, the error that a level has would mislead.
    levels = {} if family.headline.self_convergence else levels_of(points, family.headline.per_width, spacings())
    for level, (resolution, time, error) in levels.items():
        if math.isfinite(error) and math.isfinite(time):
            axes.plot(time, error, "*", ms=15, mfc="#c8a200", mec="black", zorder=6)
            axes.annotate(f"{level} ({resolution:.3g})", (time, error), (9, 6), textcoords="offset points", fontsize=9)
        elif math.isfinite(error) and order_to_quote(points) >= LEAST_ORDER:
            axes.axhline(error, color="#8a7000", lw=0.9, ls=":", zorder=0)
            axes.annotate(f"{level} ({resolution:.3g}), by the observed order", (0.995, error), xycoords=(
                "axes fraction", "data"), ha="right", va="bottom", fontsize=8, color="#6b5700")
    for point in base:
        starred = [size for size, time, _ in levels.values() if math.isfinite(time)]
        if not any(1.0 / ALIKE < point.resolution / size < ALIKE for size in starred):
            axes.annotate(f"{point.resolution}", (point.cpu, point.error), (5, 5), textcoords="offset points",
                          fontsize=8)
    unit = f" / {shown[0].unit}" if shown and shown[0].unit != "1" else ""
    axes.set(xlabel="computing time without compilation, all cores / s",
             ylabel=f"error: {family.headline.quantity}{unit}")
    if shown:
        axes.set(xscale="log", yscale="log")
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            axis.set_major_formatter("{x:g}")
            axis.set_minor_formatter(NullFormatter())
    axes.set_title(f"{family.name.replace('_', ' ')}: what accuracy costs (spacings along the case; stars: levels)",
                   loc="left", fontsize=11)
    axes.grid(alpha=0.3, which="both")
    canvas.legend(loc="outside right upper", frameon=False, fontsize=8)
    with replacing(path) as partial:
        canvas.savefig(partial, dpi=130)


PAGE = StudyPage(
    __name__, lambda families: [f"{family}_tradeoff" for family in families], lambda families: [*families, "orders"],
    lambda description, outcomes, folder: [], judge=judge,
    lacks=lambda family: "" if family.headline else "has no headline, whose error the report tradeoff shows")

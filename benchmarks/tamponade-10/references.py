"""Write the reference tables of tamponade-10 from the exact solutions, or check that they are theirs.

    python benchmarks/tamponade-10/references.py           write every <case>/reference.csv and template.csv
    python benchmarks/tamponade-10/references.py --check   exit code 1 where a table is another

Parameters come from <case>/case.json. It needs NumPy and SciPy and nothing of the pipeline: whatever the pipeline
computes is judged by these tables, so that they share no code with it. The eye has no exact solution; its
table is the mean of two codes, whose numbers `surface_evolver.py` has left in eye_at_rest/codes.csv.
"""
import argparse
import csv
import io
import json
import math
import sys
from fractions import Fraction
from pathlib import Path

import numpy as np
import score
from scipy.integrate import solve_ivp
from scipy.linalg import solve_banded
from scipy.optimize import brentq
from scipy.special import gamma, jn_zeros

HERE = Path(__file__).resolve().parent
Line = tuple[str, float | None, float, str, float, str]  # quantity, time in s, value, unit, tolerance, source
YOUNG_LAPLACE = "exact: equations of Young and Laplace"


def parameters(case: str) -> dict:
    """Return the values of case.json by name."""
    plain = json.loads((HERE / case / "case.json").read_text(encoding="utf-8"))
    return {name: one["value"] for name, one in plain.items() if isinstance(one, dict) and "value" in one} | {
        "codes": plain.get("codes")}


def sphere_at_rest() -> list[Line]:
    """Oil in a sphere: the axisymmetric interface of the given volume that meets the wall at the contact angle."""
    p, lines = parameters("sphere_at_rest"), []
    constant = (p["water_density"] - p["oil_density"]) * p["gravity"] / p["tension"]
    for angle in p["contact_angles"]:
        beta, apex = interface_in_sphere(p["radius"], constant, math.radians(angle), p["fill"])
        lines += [(f"arc_{angle:g}_deg", None, 360.0 - 2.0 * math.degrees(beta), "deg", 5.0, YOUNG_LAPLACE),
                  (f"height_on_axis_{angle:g}_deg", None, 1e3 * apex, "mm", 0.5, YOUNG_LAPLACE)]
        if angle == p["contact_angles"][0]:
            lines.append((f"covered_share_{angle:g}_deg", None, 0.5 * (1.0 + math.cos(beta)), "1", 0.02, YOUNG_LAPLACE))
    return lines


def interface_in_sphere(radius: float, constant: float, angle: float, fill: float) -> tuple[float, float]:
    """Return polar angle of the contact line from the lowest pole, rad, and height of the interface on the axis, m.

    Parameters
    ----------
    constant : drho g / sigma, 1/m2. angle : of contact, through the water, rad. fill : share that is oil.
    """
    def end(curvature: float) -> np.ndarray | None:
        """r, z, inclination and volume below the profile where it meets the wall; z counts from the axis."""
        def slope(s, state):
            r, z, phi, _ = state
            hoop = math.sin(phi) / r if r > 1e-12 * radius else curvature
            return (math.cos(phi), math.sin(phi), 2.0 * curvature + constant * z - hoop,
                    math.pi * r * r * math.sin(phi))

        def wall(s, state):
            return state[0] - radius * math.sin(state[2] + angle)

        def turned(s, state):
            return state[2] + angle - math.pi

        wall.terminal = turned.terminal = True
        wall.direction = 1.0
        found = solve_ivp(slope, (0.0, 4.0 * radius), (0.0, 0.0, 0.0, 0.0), events=(wall, turned), rtol=1e-10,
                          atol=1e-14 * radius, method="DOP853", max_step=0.02 * radius)
        return found.y_events[0][0] if len(found.t_events[0]) else None

    def miss(curvature: float) -> float:
        state = end(curvature)
        if state is None:
            return math.nan
        beta = state[2] + angle
        cap = radius * (1.0 - math.cos(beta))
        water = math.pi * cap**2 * (3.0 * radius - cap) / 3.0 - state[3]
        return 1.0 - water / (4.0 / 3.0 * math.pi * radius**3) - fill

    tried = np.sinh(np.linspace(-3.0, 3.0, 61)) / radius
    misses = np.array([miss(b) for b in tried])
    crossed = np.flatnonzero(misses[:-1] * misses[1:] <= 0.0)
    best = crossed[np.argmin(np.abs(tried[crossed]))]
    state = end(brentq(miss, tried[best], tried[best + 1], xtol=1e-9 / radius))
    beta = state[2] + angle
    return beta, -radius * math.cos(beta) - state[1]


def eye_at_rest() -> list[Line]:
    """Oil in an eye: the mean of two codes that look for the least energy, one of them Surface Evolver."""
    with (HERE / "eye_at_rest" / "codes.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    lines = []
    for posture in parameters("eye_at_rest")["postures"]:
        for part in ("retina", "inferior"):
            found = {row["code"]: float(row["value"]) for row in rows
                     if (row["posture"], row["part"], row["reference"]) == (posture, part, "yes")}
            words = ", ".join(f"{code} {value:.1f}" for code, value in found.items())
            lines.append((f"covered_{part}_{posture}", None, sum(found.values()) / len(found), "%", 3.0,
                          f"mean of two codes: {words}"))
    return lines


def film_on_plate() -> list[Line]:
    """Drainage of a film between two walls (oil is as good as one): dh/dt + d(h^3 drho g/(12 mu))/dz = 0.

    The film leaves evenly until the fan that begins at its upper end, h = sqrt(4 mu z/(drho g t)), has come down.
    """
    p = parameters("film_on_plate")
    speed = ((p["film_density"] - p["oil_density"]) * p["gravity"] * math.sin(math.radians(p["inclination"]))
             * p["film_thickness"]**2 / (12.0 * p["film_viscosity"]))
    lines = []
    for scaled in (float(Fraction(text)) for text in p["times"]):
        left = 1.0 - scaled if scaled <= 1.0 / 3.0 else 2.0 / 3.0 / math.sqrt(3.0 * scaled)
        lines.append(("film_left", float(f"{scaled * p['film_length'] / speed:.6g}"), left, "1", 0.1,
                      "exact for thin films: lubrication, kinematic wave"))
    return lines


def deposited_film() -> list[Line]:
    """Film behind a meniscus, between the limits of a viscous drop: 2^(2/3) and 4^(2/3) times that behind gas."""
    p = parameters("deposited_film")
    behind_gas = meniscus_curvature() * 3.0 ** (2.0 / 3.0)
    low, high = (behind_gas * factor ** (2.0 / 3.0) for factor in (2.0, 4.0))
    return [(f"thickness_Ca_{number:g}", None, 1e6 * 0.5 * (low + high) * p["radius"] * number ** (2.0 / 3.0), "um",
             1e6 * 0.5 * (high - low) * p["radius"] * number ** (2.0 / 3.0),
             "asymptotic: Bretherton 1961 and Hodges et al. 2004, middle and half of the range")
            for number in p["capillary_numbers"]]


def meniscus_curvature() -> float:
    """Return the curvature 0.643 that the profile y''' = (y - 1)/y^3 tends to where it joins the meniscus."""
    start = 1e-5  # on the branch y = 1 + a exp(x) that grows out of the film
    found = solve_ivp(lambda x, y: (y[1], y[2], (y[0] - 1.0) / y[0]**3), (0.0, 60.0), (1.0 + start, start, start),
                      rtol=1e-11, atol=1e-14, method="DOP853")
    return float(found.y[2, -1])


def capillary_rise() -> list[Line]:
    """Difference of the mean heights between and beside the plates: the tension of the walls carries the weight."""
    p = parameters("capillary_rise")
    weight = (p["heavy_density"] - p["light_density"]) * p["gravity"]
    return [(f"rise_{angle:g}_deg", p["duration"], 1e3 * 2.0 * p["tension"] * math.cos(math.radians(angle)) / weight
             * (1.0 / p["inside"] - 1.0 / p["outside"]), "mm", 0.5, "exact: Jurin's law between plates")
            for angle in p["contact_angles"]]


def rising_bubble() -> list[Line]:
    """Means of the three codes of the benchmark."""
    codes, end = parameters("rising_bubble")["codes"], parameters("rising_bubble")["duration"]
    lines = []
    for name, time, tolerance in (("smallest_circularity", None, 0.009), ("largest_speed", None, 0.005),
                                  ("height_of_center", end, 0.011)):
        found = codes[name]["value"]
        lines.append((name, time, sum(found.values()) / len(found), codes[name]["unit"], tolerance,
                      "mean of the codes " + ", ".join(f"{code} {value:g}" for code, value in found.items())))
    return lines


def saccade() -> list[Line]:
    """Stress at the wall of a sphere that turns: the velocity along circles, by finite differences along the radius."""
    p = parameters("saccade")
    found = {number: largest_stress(p, number) for number in p["womersley_numbers"]}
    return [(f"largest_stress_W_{number:g}", None, stress, "Pa", 0.05 * stress,
             "exact equation along the radius, by finite differences") for number, stress in found.items()]


def largest_stress(p: dict, womersley: float, points: int = 800, steps: int = 3000) -> float:
    """Return the largest stress, Pa, root mean square over the wall: u = v(r, t) sin(theta) seen from the wall.

    dv/dt = nu (v'' + 2 v'/r - 2 v/r^2) - r dw/dt with the rate w of the wall, v = 0 at r = 0 and R; Crank and Nicolson.
    """
    radius, duration = p["radius"], p["duration"]
    viscosity = math.pi * radius**2 / (duration * womersley**2)
    power = brentq(lambda n: gamma(2.0 * n + 2.0) / (4.0**n * gamma(n + 1.0)**2) - p["peak_over_mean"], 0.25, 8.0)
    peak = math.radians(p["amplitude"]) * p["peak_over_mean"] / duration

    def rate(time: float) -> float:
        share = min(max(time / duration, 0.0), 1.0)
        return peak * (4.0 * share * (1.0 - share))**power

    r = np.linspace(0.0, radius, points + 1)[1:-1]
    h, dt = radius / points, p["watched"] * duration / steps
    half = 0.5 * dt * viscosity
    above, here, below = half * (1.0 / h**2 + 1.0 / (h * r)), half * (-2.0 / h**2 - 2.0 / r**2), half * (
        1.0 / h**2 - 1.0 / (h * r))
    implicit = np.stack([np.roll(-above, 1), 1.0 - here, np.roll(-below, -1)])  # the corners are not read
    v, largest = np.zeros(len(r)), 0.0
    for n in range(steps):
        explicit = (1.0 + here) * v - r * (rate((n + 1) * dt) - rate(n * dt))
        explicit[:-1] += (above * np.append(v[1:], 0.0))[:-1]
        explicit[1:] += (below * np.append(0.0, v[:-1]))[1:]
        v = solve_banded((1, 1), implicit, explicit)
        slope = (-4.0 * v[-1] + v[-2]) / (2.0 * h)  # at the wall, where v is 0; second order
        largest = max(largest, p["density"] * viscosity * abs(slope))
    return math.sqrt(2.0 / 3.0) * largest  # the mean of sin(theta)^2 over a sphere


def spin_down() -> list[Line]:
    """Decay of the angular momentum in a circle: modes of the Bessel function J1 with shares 8/j^2."""
    p = parameters("spin_down")
    zeros = jn_zeros(1, 40)
    scaled = np.linspace(*p["window"], 400)  # in e-foldings of the slowest mode
    momentum = (8.0 / zeros**2 * np.exp(-np.multiply.outer(scaled, (zeros / zeros[0])**2))).sum(axis=-1)
    slowest = zeros[0]**2 * p["kinematic_viscosity"] / p["radius"]**2
    rate = -np.polyfit(scaled, np.log(momentum), 1)[0] * slowest
    return [("decay_rate", None, float(rate), "1/s", 0.05 * float(rate), "exact: modes of the circle")]


def sedimentation() -> list[Line]:
    """Fronts of clear heavy liquid at the bottom and of light liquid at the top: the flux is a (1 - a) v."""
    p, lines = parameters("sedimentation"), []
    for fraction in p["fractions"]:
        for time in p["times"]:
            lines += [(f"{which}_front_{fraction:g}", time, speed * p["slip"] * time, "m",
                       0.05 * speed * p["slip"] * time, "exact: Kynch 1952")
                      for which, speed in (("bottom", 1.0 - fraction), ("top", fraction))]
    return lines


def filling() -> list[Line]:
    """The fill that was asked for, and what such a fill touches at rest, as in eye_at_rest."""
    p = parameters("filling")
    at_rest = {line[0]: line for line in eye_at_rest()}
    lines = [("fill", p["duration"], 100.0 * p["fill"], "%", 0.5, "exact: what was asked for")]
    for part in ("retina", "inferior"):
        _, _, value, unit, tolerance, source = at_rest[f"covered_{part}_upright"]
        lines.append((f"covered_{part}", p["duration"], value, unit, tolerance, f"{source}; at rest"))
    return lines


CASES = {one.__name__: one for one in (sphere_at_rest, eye_at_rest, film_on_plate, deposited_film, capillary_rise,
                                       rising_bubble, saccade, spin_down, sedimentation, filling)}


def text_of(lines: list[Line]) -> str:
    """Return a reference table as CSV."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(score.REFERENCE_COLUMNS)
    for quantity, time, value, unit, tolerance, source in lines:
        writer.writerow((quantity, "" if time is None else f"{time:.6g}", f"{value:.5g}", unit, f"{tolerance:.3g}",
                         source))
    return text.getvalue()


def main() -> int:
    """Run the command; see the head of the file."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="compare only")
    check, stale = parser.parse_args().check, 0
    for case, lines in CASES.items():
        stale += settled(HERE / case / score.REFERENCE, text_of(lines()), check)
    return int(bool(stale + settled(HERE / "template.csv", score.template(score.read_references(HERE)), check)))


def settled(path: Path, text: str, check: bool) -> bool:
    """Write a file, or tell where it is another; return whether that was told."""
    if path.is_file() and path.read_text(encoding="utf-8") == text:
        return False
    if check:
        print(f"error: {path}: is not what references.py computes; run it without --check", file=sys.stderr)
        return True
    path.write_text(text, encoding="utf-8")
    return False


if __name__ == "__main__":
    sys.exit(main())

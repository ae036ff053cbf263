"""Judge of `pipeline.equilibrium`: the same oil by Surface Evolver, the field's program for such shapes.

    python tests/judges/surface_evolver.py                      all cases, as a table
    python tests/judges/surface_evolver.py --case eye_upright   one of them

It needs the program `evolver` (Debian: evolver-nox), which is no dependency of the pipeline; without it the script says
so and judges nothing. Evolver gets the exact wall as a formula, the tensions of interface and wetted wall, the weight
and the volume, and a level start. It moves the contact line along the wall and mends its own triangles: no code and no
approximation is shared with `pipeline.equilibrium` but the shape of the eye. What is free may not pass the wall: oil
that comes to the lens after the start rests on it as if a film of aqueous were between. Lengths are in mm there,
tensions in those of the interface.
"""
import argparse
import dataclasses
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT))

from pipeline.cavity.regions import retina_parts  # noqa: E402  the folder above is found first
from pipeline.equilibrium.contact import Contact, shares  # noqa: E402
from pipeline.equilibrium.rest import Liquids, at_rest, refined_start  # noqa: E402
from pipeline.equilibrium.star_cavity import DRAFT, FINE, Level, StarCavity, icosphere  # noqa: E402
from pipeline.scenes.eye_shape import FILLET, LENS_RADIUS, EyeShape, eye_shape  # noqa: E402

PROGRAM = "evolver"
RADIUS = 11e-3                  # m, of the sphere
PARTS = ("wall", "retina", "superior", "inferior", "macula")
TOLERANCE = 3.0                 # points of a covered share
WALL, FREE = 4, 1               # colors of the triangles of Evolver
KINDS = {"wall": WALL, "free": FREE}  # files that it writes
CUTS = 3                        # of the icosahedron that the start is made of
FRONT, EDGES = 3.0, (0.5, 0.34)  # mm: before this height the wall is cut until its edges are so short, in two goes
# Coarse, then twice as fine, then finer still at the front edges: with edges of 0.8 mm there they hold too little
# aqueous. What is last is without averaging, so that nothing but the energy moves the contact line.
COMMANDS = """
autopop off
mend := {{ u; V; u; V; }}
evolve := {{ g 8; mend; g 8; }}
quiet
evolve 5
r
evolve 4
cut := {{ refine edges ee where ee.length > {edges[0]} and {front} > {height} and on_constraint 1; }}
finer := {{ refine edges ee where ee.length > {edges[1]} and {front} > {height} and on_constraint 1; }}
smooth := {{ u; V; g 5; u; V; g 5; }}
cut
smooth
cut
smooth
evolve 3
U
g 250
U
finer
smooth
evolve
U
g 150
U
"""


@dataclasses.dataclass(frozen=True)
class Case:
    """A cavity, a fill and the direction of gravity."""

    shape: EyeShape | None      # None: the sphere
    fill: float
    down: tuple[float, float, float]
    contact_angle: float = 18.2  # deg, through the water

    @property
    def liquids(self) -> Liquids:
        """Oil and aqueous."""
        return Liquids(35.0, 0.04, np.radians(self.contact_angle))

    @property
    def level(self) -> Level:
        """What is negative inside."""
        if self.shape is None:
            return lambda points: np.linalg.norm(points, axis=-1) - RADIUS
        return self.shape.level

    @property
    def viewpoint(self) -> np.ndarray:
        """Point in the oil that sees the whole wall."""
        if self.shape is None:
            return -(0.7 * RADIUS if self.fill < 0.5 else 0.0) * np.array(self.down)
        return self.shape.viewpoint


CASES = {
    "sphere_80": Case(None, 0.80, (0.0, -1.0, 0.0)),
    "sphere_85": Case(None, 0.85, (0.0, -1.0, 0.0)),
    "eye_upright": Case(eye_shape(), 0.85, (0.0, -1.0, 0.0)),
    "eye_left_side": Case(eye_shape(), 0.85, (1.0, 0.0, 0.0)),
    "pseudophakic_upright": Case(eye_shape(0.026, lens="pseudophakic"), 0.85, (0.0, -1.0, 0.0)),
}


def main() -> None:
    """Run; see the head of the file."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--case", choices=CASES, help="one case (default: all)")
    parser.add_argument("--keep", type=Path, help="folder for the files of Evolver (default: none are kept)")
    options = parser.parse_args()
    if shutil.which(PROGRAM) is None:
        print(f"not judged: there is no program {PROGRAM} (Debian: apt-get install evolver-nox)")
        return
    names, missed = [options.case] if options.case else list(CASES), 0
    print("case, part: Surface Evolver / pipeline.equilibrium with 10,242 and 2,562 directions, in percent")
    for name in names:
        begin = time.perf_counter()
        judged = by_evolver(CASES[name], options.keep and options.keep / name)
        middle = time.perf_counter()
        own, coarse = by_energy(CASES[name])
        print(f"{name}: {middle - begin:.0f} s by Evolver, {time.perf_counter() - middle:.0f} s here")
        for part in PARTS:
            off = abs(judged[part] - own[part])
            missed += off > TOLERANCE
            print(f"  {part}: {judged[part]:.1f} / {own[part]:.1f}, {coarse[part]:.1f}"
                  + (f"  more than {TOLERANCE:g} points apart" if off > TOLERANCE else ""))
    raise SystemExit(1 if missed else 0)


def by_energy(case: Case) -> tuple[dict[str, float], dict[str, float]]:
    """Covered shares in percent by this project, with many directions and with those of a plan."""
    coarse = StarCavity.of_level(case.level, case.viewpoint, DRAFT)
    rest = at_rest(coarse, case.liquids, np.array(case.down), case.fill)
    fine = StarCavity.of_level(case.level, case.viewpoint, FINE)
    finer = at_rest(fine, case.liquids, np.array(case.down), case.fill, refined_start(rest, fine, FINE))
    return tuple({name: 100.0 * share for name, share in shares(Contact.of(one)).items()} for one in (finer, rest))


def by_evolver(case: Case, folder: Path | None = None) -> dict[str, float]:
    """Covered shares in percent by Surface Evolver."""
    return covered(case, triangles(case, folder)[0])


def triangles(case: Case, folder: Path | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Corners of the triangles on the wall and of the free ones by Surface Evolver, (n, 3, 3) each, m."""
    with tempfile.TemporaryDirectory() as temporary:
        place = folder or Path(temporary)
        place.mkdir(parents=True, exist_ok=True)
        turn = turned(case.down)
        (place / "oil.fe").write_text(datafile(case, turn))
        prints = "".join(PRINT.format(file=f"{name}.txt", color=color) for name, color in KINDS.items())
        (place / "oil.cmd").write_text(f"{commands(case, turn)}{prints}q\nq\n")
        for name in KINDS:
            (place / f"{name}.txt").unlink(missing_ok=True)
        command = [PROGRAM, "-x", "-f", "oil.cmd", "oil.fe"]
        done = subprocess.run(command, cwd=place, text=True, capture_output=True, stdin=subprocess.DEVNULL, check=False)
        (place / "oil.log").write_text(done.stdout + done.stderr)
        if not all((place / f"{name}.txt").is_file() for name in KINDS):
            raise SystemExit(f"{PROGRAM} ended with {done.returncode}: {(done.stdout + done.stderr)[-500:]}")
        wall, free = (1e-3 * np.loadtxt(place / f"{name}.txt").reshape(-1, 3, 3) @ turn for name in KINDS)
    return wall, free


def commands(case: Case, turn: np.ndarray) -> str:
    """Return what Evolver does; a sphere has no front edges."""
    edges = EDGES if case.shape else (99.0, 99.0)  # mm
    front = " + ".join(f"({turn[row, 2]:.9g})*ee.vertex[1].{name}" for row, name in enumerate("xyz") if turn[row, 2])
    return COMMANDS.format(edges=edges, front=front, height=FRONT)


def turned(down) -> np.ndarray:
    """Matrix (3, 3) from the eye to Evolver, where z is up."""
    up = -np.array(down)
    first = np.roll(up, 1)
    return np.stack([first, np.cross(up, first), up])


def datafile(case: Case, turn: np.ndarray) -> str:
    """Return the wall as a formula, and oil above a level as a closed surface of triangles."""
    points, faces, on_wall, wall_faces, volume = level_start(case)
    liquids = case.liquids
    bond = liquids.density_difference * liquids.gravity / liquids.tension * 1e-6      # 1/mm2
    edges = np.unique(np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1), axis=0)
    number = {tuple(edge): index + 1 for index, edge in enumerate(edges.tolist())}
    wetted = {tuple(sorted(pair)) for face in faces[wall_faces].tolist() for pair in zip(face, face[1:] + face[:1],
                                                                                      strict=True)}
    level = formula(case, turn)  # for what is on the wall, and for what may not pass it, such as oil before the lens
    bound = {True: " constraint 1", False: " constraint 2"}
    lines = ["gravity_constant 1", "constraint 1", f"formula: {level} = 0", "constraint 2 nonpositive",
             f"formula: {level} = 0", "", "vertices"]
    for index, (point, wall) in enumerate(zip(1e3 * points @ turn.T, on_wall, strict=True)):
        lines.append(f"{index + 1} {' '.join(f'{value:.9g}' for value in point)}{bound[bool(wall)]}")
    lines.append("edges")
    lines += [f"{index + 1} {a + 1} {b + 1}{bound[(a, b) in wetted]}"
              for index, (a, b) in enumerate(edges.tolist())]
    lines.append("faces")
    for index, (face, wall) in enumerate(zip(faces.tolist(), wall_faces, strict=True)):
        ends = zip(face, face[1:] + face[:1], strict=True)
        around = " ".join(str(number[a, b] if a < b else -number[b, a]) for a, b in ends)
        what = f"tension {np.cos(liquids.contact_angle):.9g} color {WALL}" if wall else f"color {FREE}"
        lines.append(f"{index + 1} {around}{bound[bool(wall)]} {what}")
    lines += ["bodies", f"1 {' '.join(str(index + 1) for index in range(len(faces)))} volume {1e9 * volume:.9g} "
                        f"density {-bond:.9g}", "", "read", ""]
    return "\n".join(lines)


def level_start(case: Case):
    """Points (n, 3) and triangles of oil above a level, which of them are on the wall, and the volume of the oil."""
    cavity, up = StarCavity.of_level(case.level, case.viewpoint, CUTS), -np.array(case.down)
    exact = StarCavity.of_level(case.level, case.viewpoint, FINE)
    coarser = StarCavity.of_level(case.level, case.viewpoint, DRAFT)
    volume = case.fill * (exact.volume + (exact.volume - coarser.volume) / 3.0)     # of the wall itself: by Richardson
    direction, faces = icosphere(CUTS)
    low, high = -40e-3, max(0.0, float(case.viewpoint @ up))
    rise = direction @ up
    for _ in range(50):     # of the level, so that the oil has its volume
        height = 0.5 * (low + high)
        room = np.where(rise < 0.0, (height - case.viewpoint @ up) / np.minimum(rise, -1e-9), np.inf)
        distance = np.minimum(cavity.radius, np.maximum(room, 1e-4))
        if cavity.solid @ distance[faces].prod(axis=1) / 6.0 > volume:
            low = height
        else:
            high = height
    on_wall = distance >= cavity.radius
    return case.viewpoint + distance[:, None] * direction, faces, on_wall, on_wall[faces].all(axis=1), volume


def formula(case: Case, turn: np.ndarray) -> str:
    """Return the level of the cavity in mm, as `EyeShape.level` has it, in the words of Evolver."""
    x, y, z = (f"({' + '.join(f'({turn[row, axis]:.9g})*{name}' for row, name in enumerate('xyz') if turn[row, axis])})"
               for axis in range(3))
    if case.shape is None:
        return f"sqrt({x}^2 + {y}^2 + {z}^2) - {1e3 * RADIUS:g}"
    a, b, c = 1e3 * case.shape.half_axes
    radius = f"sqrt(({x}/{a:.9g})^2 + ({y}/{b:.9g})^2 + ({z}/{c:.9g})^2)"
    slope = f"sqrt(({x}/{a * a:.9g})^2 + ({y}/{b * b:.9g})^2 + ({z}/{c * c:.9g})^2)"
    level = _smooth_maximum(f"(({radius} - 1)*{radius}/{slope})", f"({z} - ({1e3 * case.shape.front:.9g}))")
    if case.shape.lens_pole is not None:
        center = 1e3 * (case.shape.lens_pole + LENS_RADIUS)
        level = _smooth_maximum(level, f"({1e3 * LENS_RADIUS:g} - sqrt({x}^2 + {y}^2 + ({z} - {center:.9g})^2))")
    return level


def _smooth_maximum(a: str, b: str) -> str:
    width = 1e3 * FILLET
    return f"(maximum({a},{b}) + {0.25 * width:g}*maximum(1 - abs({a} - {b})/{width:g}, 0)^2)"


CORNERS = ", ".join(f"ff.vertex[{corner}].{axis}" for corner in (1, 2, 3) for axis in "xyz")
PRINT = f"""
foreach facet ff where ff.color == {{color}} do printf "{'%.9g ' * 9}\\n", {CORNERS} >> "{{file}}"
"""


def covered(case: Case, corners: np.ndarray) -> dict[str, float]:
    """Area of wetted triangles over that of the wall, part by part, in percent."""
    wall = StarCavity.of_level(case.level, case.viewpoint, FINE)
    whole = wall.wall[wall.faces]
    return {part: 100.0 * _areas(corners)[part] / _areas(whole)[part] for part in PARTS}


def _areas(corners: np.ndarray) -> dict[str, float]:
    area = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    masks = retina_parts(corners.mean(axis=1))
    masks["retina"], masks["wall"] = masks.pop("whole"), np.ones(len(area), bool)
    return {part: float(area[masks[part]].sum()) for part in PARTS}


if __name__ == "__main__":
    main()

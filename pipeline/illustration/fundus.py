"""A texture of the fundus: macula, optic disc, vessels, ora serrata; invented, but for the places of macula and disc.

In azimuthal equidistant coordinates around the posterior pole (Z3): the middle of the texture is the macula, its edge
the point in front. Vessels grow from the disc as a seeded random walk: the temporal ones bend around the macula.
Equations: docs/methods/pictures.md.
"""
import numpy as np
from PIL import Image, ImageDraw, ImageFilter

from pipeline.illustration.geometry import FULL_ANGLE
from pipeline.pictures.fundus_map import DISC_RADIUS, disc_direction
from pipeline.scenes.retina import ORA

SIZE, SEED = 2048, 11
ARCADE, ARCADE_END = 27.0, 12.0      # degrees: the arcades around the fovea, and how far temporal they end
STEP = 0.7                  # degrees between points of a vessel
FOVEA_FREE = 7.0            # degrees around the fovea without vessels
THINNEST, WIDEST = 0.11, 1.1        # degrees, of vessels
# Colors as shares of reflected light (linear), red green blue.
RETINA_COLOR, FAR_COLOR, MACULA_COLOR = (0.74, 0.27, 0.13), (0.66, 0.25, 0.13), (0.46, 0.12, 0.06)
DISC_COLOR, CUP_COLOR = (0.90, 0.62, 0.36), (0.97, 0.84, 0.64)
ARTERY_COLOR, VEIN_COLOR = (0.42, 0.035, 0.025), (0.24, 0.015, 0.035)
IRIS_COLOR, COLLARETTE_COLOR = (0.13, 0.22, 0.17), (0.40, 0.23, 0.085)
PARS_PLANA_COLOR, CILIARY_COLOR = (0.24, 0.125, 0.075), (0.13, 0.065, 0.045)


def fundus_texture(globe: float, right_eye: bool) -> np.ndarray:
    """Texture (size, size, 3) float32 of reflected shares, linear; row 0 is inferior, column 0 the patient's right.

    Parameters
    ----------
    globe : radius of the globe at the posterior pole, m.
    """
    rng = np.random.default_rng(SEED)
    axis = ((np.arange(SIZE) + 0.5) / SIZE * 2.0 - 1.0).astype(np.float32)     # in half of the time of float64
    x, y = FULL_ANGLE * axis[None, :], -FULL_ANGLE * axis[:, None]
    angle, around = np.hypot(x, y), np.arctan2(y, x)
    out = disc_direction(globe, right_eye)
    disc = (np.degrees(np.arccos(-out[2])) * out[:2] / np.hypot(*out[:2])).astype(np.float32)
    color = _mixed(RETINA_COLOR, FAR_COLOR, np.clip(angle / ORA, 0.0, 1.0))
    color *= (1.0 + 0.04 * _clouds(rng, 12) + 0.025 * _clouds(rng, 60))[..., None]
    color = _mixed(color, MACULA_COLOR, 0.85 * np.exp(-(angle / 6.5) ** 2))
    vessels = _vessels(rng, disc, right_eye)
    for pen, tone in ((vessels[1], VEIN_COLOR), (vessels[0], ARTERY_COLOR)):
        color = _mixed(color, tone, 0.8 * pen)
    from_disc = np.hypot(x - disc[0], y - disc[1])
    radius = float(np.degrees(DISC_RADIUS / globe))
    color = _mixed(color, DISC_COLOR, 0.9 * _edge(from_disc - radius, 0.5))
    color = _mixed(color, CUP_COLOR, 0.9 * _edge(np.hypot(x - disc[0], y - disc[1] - 0.2) - 0.5 * radius, 1.2))
    on_disc = from_disc < 1.05 * radius
    for pen, tone in ((vessels[1], VEIN_COLOR), (vessels[0], ARTERY_COLOR)):
        color = np.where(on_disc[..., None], _mixed(color, tone, 0.6 * pen), color)
    teeth = ORA + 1.2 * np.abs(np.sin(24.0 * around)) ** 0.7    # the dentate processes
    front = _mixed(PARS_PLANA_COLOR, CILIARY_COLOR, _edge(ORA + 19.0 - angle, 3.0))
    front = front * (1.0 + 0.25 * np.cos(70.0 * around) * _edge(ORA + 16.0 - angle, 4.0))[..., None]
    color = _mixed(color, front, _edge(teeth - angle, 0.5))
    return np.clip(color, 0.0, 1.0)[::-1]


def iris_texture() -> np.ndarray:
    """Texture (256, 2048, 3) float32 of the iris, linear: row 0 at the pupil, columns around."""
    rng = np.random.default_rng(SEED + 1)
    rows, columns = 256, 2048
    fine = Image.fromarray(rng.uniform(0, 255, (rows // 32, columns // 2)).astype(np.uint8)).resize((columns, rows))
    fibers = np.asarray(fine.filter(ImageFilter.GaussianBlur(1.0)), float) / 255.0 - 0.5
    inward = (np.arange(rows) + 0.5)[:, None] / rows
    base = _mixed(IRIS_COLOR, COLLARETTE_COLOR, np.clip((inward - 0.45) / 0.3, 0.0, 1.0) * np.ones((1, columns)))
    collarette = np.exp(-((inward - 0.68) / 0.06) ** 2)
    tone = 1.0 + 2.6 * fibers + 0.45 * collarette
    tone = tone - 0.75 * _edge(0.93 - inward, 0.05) - 0.5 * _edge(inward - 0.06, 0.06)
    return np.clip(base * tone[..., None], 0.01, 1.0).astype(np.float32)[::-1]


def _vessels(rng, disc: np.ndarray, right_eye: bool) -> tuple[np.ndarray, np.ndarray]:
    """Cover (size, size), 0 to 1, of arteries and of veins."""
    temporal = -1.0 if right_eye else 1.0
    pens = [Image.new("L", (SIZE, SIZE), 0) for _ in range(2)]
    for kind, pen in enumerate(pens):
        draw = ImageDraw.Draw(pen)
        wide = WIDEST * (0.72 if kind == 0 else 1.0)
        for up in (1.0, -1.0):
            for side, heading, width in ((temporal, 62.0, 1.0), (-temporal, 50.0, 0.8), (-temporal, 8.0, 0.5)):
                turned = np.radians(heading + (7.0 if kind else -7.0) + rng.uniform(-4, 4))
                start = np.array([side * np.cos(turned), up * np.sin(turned)])
                arcade = temporal if side == temporal else 0.0
                _grow(rng, draw, disc + 0.8 * start, start, wide * width, disc, arcade, 0)
    soft = ImageFilter.GaussianBlur(0.7)
    arteries, veins = (np.asarray(pen.filter(soft), np.float32) / 255.0 for pen in pens)
    return arteries, veins


def _grow(rng, draw, place, heading, width: float, disc, temporal: float, depth: int) -> None:
    """Draw a vessel from a place on and its branches; ``temporal`` is the side of the arcades, 0 for the others."""
    wander = 0.0
    while width > THINNEST:
        angle = float(np.hypot(*place))
        if angle > ORA - 6.0:
            return
        wander = 0.8 * wander + rng.normal(0.0, 0.07)
        outward = place / max(angle, 1e-9)
        if temporal and depth == 0 and temporal * place[0] < ARCADE_END:    # around the fovea
            around = np.array([-outward[1], outward[0]])
            wanted = around * (np.sign(around @ heading) or 1.0) + 0.1 * (ARCADE - angle) * outward
        else:                                                               # and on to the periphery
            away = (place - disc) / max(float(np.hypot(*(place - disc))), 1e-9)
            wanted = 0.5 * outward + 0.3 * away + 4.0 * np.clip((FOVEA_FREE + 6.0 - angle) / 6.0, 0.0, 1.0) * outward
        if angle < FOVEA_FREE:
            return
        turn = np.array([-heading[1], heading[0]])
        heading = heading + 0.1 * wanted + wander * turn * (0.35 if depth == 0 else 0.6)
        heading = heading / np.hypot(*heading)
        ahead = place + STEP * heading
        draw.line([_pixel(place), _pixel(ahead)], fill=255, width=max(1, round(width * SIZE / (2.0 * FULL_ANGLE))))
        place, width = ahead, width * (0.9945 if depth == 0 else 0.988)
        if width > 1.6 * THINNEST and rng.random() < (0.07, 0.05, 0.03, 0.02)[min(depth, 3)]:
            side = 1.0 if rng.random() < 0.5 else -1.0
            turned = side * np.radians(rng.uniform(28.0, 55.0))
            cos, sin = np.cos(turned), np.sin(turned)
            branch = np.array([cos * heading[0] - sin * heading[1], sin * heading[0] + cos * heading[1]])
            _grow(rng, draw, place, branch, width * rng.uniform(0.5, 0.72), disc, temporal, depth + 1)


def _pixel(place) -> tuple[float, float]:
    return (0.5 + 0.5 * place[0] / FULL_ANGLE) * SIZE, (0.5 - 0.5 * place[1] / FULL_ANGLE) * SIZE


def _clouds(rng, cells: int) -> np.ndarray:
    """Smooth noise (size, size) of mean 0 and deviation 1."""
    coarse = Image.fromarray(rng.normal(0.0, 1.0, (cells, cells)).astype(np.float32))
    fine = np.asarray(coarse.resize((SIZE, SIZE), Image.Resampling.BICUBIC))
    return (fine - fine.mean()) / fine.std()


def _edge(distance: np.ndarray, width: float) -> np.ndarray:
    """1 where a distance is negative, 0 where it is positive, smooth over a width."""
    return np.clip(0.5 - distance / width, 0.0, 1.0)


def _mixed(first, second, share: np.ndarray) -> np.ndarray:
    first, second, share = (np.asarray(one, np.float32) for one in (first, second, share[..., None]))
    return first + share * (second - first)

"""Light through an opened eye, by Mitsuba 3: paths that scatter in the liquids, and a denoiser.

The interface and the faces of the cut do not refract: with the true indices the interface would hardly be seen, and
lamps are sampled straight through them, so that few paths are enough.
Equations: docs/methods/pictures.md.
"""
import dataclasses
import tempfile
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from pipeline.base.threads import library_threads
from pipeline.illustration.geometry import Part
from pipeline.illustration.looks import TISSUES, Look, Tissue
from pipeline.illustration.view import ANGLE, View

CLEAR = ("glass", "oil_face", "aqueous_face", "interface", "lens", "lens_cut", "cornea", "cornea_cut")
OIL_INDEX, CORNEA_INDEX = 1.404, 1.376
DEPTH, ROULETTE = 32, 2         # turns of a path: at most, and after which it may end by chance
GUIDE_PATHS = 4
AROUND = 2                      # times as many paths for what is around the eye in a film: it is traced but once
MARGIN = 0.02                   # of the height, around the eye: within it a picture fades into what stays the same
BRIGHTNESS = 0.28               # 0.18 over the usual light; the denoiser's own guess depends on the threads
BLOCK = 32                      # pixels: noise is drawn by blocks, whose size would else depend on the threads
CLAMP, CLAMP_AT = 6.0, 99.9     # paths brighter than so many times this percentile of the picture are noise
SKY_SIZE = (256, 128)
TABLE_RADIUS = 2000.0           # mm: its edge is beyond the picture
TABLE_NEAR, TABLE_FAR, TABLE_FADE = (0.84, 0.86, 0.89), (0.62, 0.68, 0.76), 150.0     # mm
EXPOSURE, WHITE = 1.5, 2.6     # light that is shown as 1 before, and as white after, the curve (Z6)


def why_not() -> str:
    """Why Mitsuba cannot draw here, in words; empty where it can."""
    try:
        import mitsuba
        import mitsuba_oidn  # noqa: F401

        mitsuba.set_variant("scalar_rgb")
    except ModuleNotFoundError:
        return "is not installed"
    except (ImportError, OSError) as error:     # such as a library of the system that a bare Debian lacks
        return f"cannot be loaded ({error})"
    return ""


@dataclasses.dataclass(frozen=True)
class _Surroundings:
    """What a view shows whatever the liquids do.

    Attributes
    ----------
    light : (height, width, 3) of the whole picture with an empty eye.
    box : left, upper, right and lower edge of the eye in it, pixels.
    share : (rows, columns, 1) of the picture of the eye in what is shown; it fades out at the edge of the box.
    around : lamps and table for Mitsuba.
    sensor : that sees the box.
    guides : color and direction (rows, columns, 3) of what lies behind the clear things; none where light is refracted.
    """

    light: np.ndarray
    box: tuple[int, int, int, int]
    share: np.ndarray
    around: dict
    sensor: object
    guides: tuple[np.ndarray, ...]

    @property
    def inside(self) -> tuple[slice, slice]:
        """The box as rows and columns."""
        left, upper, right, lower = self.box
        return slice(upper, lower), slice(left, right)


class Tracer:
    """Traces pictures of one eye; what stays the same from frame to frame is built once. In a film what is around the
    eye is traced once for every view, with an empty eye, and then only the part of the picture that holds the eye.

    Parameters
    ----------
    fixed : parts that all pictures have.
    textures : name of a part -> (rows, columns, 3) float32, linear.
    size : width and height in pixels.
    samples : paths through every pixel.
    threads : 0 for as many as are useful.
    film : whether many pictures follow each other, most of them with one view.
    """

    def __init__(self, fixed: Iterable[Part], look: Look, textures: dict[str, np.ndarray], size: tuple[int, int],
                 samples: int, threads: int = 0, *, film: bool = False):
        import drjit
        import mitsuba

        mitsuba.set_variant("scalar_rgb")
        drjit.set_thread_count(threads or library_threads())
        self.mitsuba, self.size, self.samples, self.look, self.film = mitsuba, size, samples, look, film
        self._folder = tempfile.TemporaryDirectory(prefix="illustration_")
        self._builder = _Builder(mitsuba, look, textures, Path(self._folder.name))
        fixed = list(fixed)
        self._points = np.concatenate([part.points for part in fixed])
        self._opaque = self._builder.shapes("opaque", [part for part in fixed if part.name not in CLEAR])
        self._clear = self._builder.shapes("clear", [part for part in fixed if part.name in CLEAR])
        self._seen: tuple = ()
        self._surroundings: _Surroundings | None = None

    def trace(self, parts: Iterable[Part], view: View, table: float) -> np.ndarray:
        """Linear light (height, width, 3) of a picture.

        Parameters
        ----------
        parts : that this picture has beside the fixed ones.
        table : mm, height of the table along ``view.up``.
        """
        seen = (*view.camera, *view.up, table)
        if self._surroundings is None or seen != self._seen:
            self._seen, self._surroundings = seen, self._surroundings_of(view, table)
        found, parts = self._surroundings, list(parts)
        changing = self._builder.shapes("changing", parts)
        light = self._light(self._opaque | self._clear | changing, found.around, found.sensor, self.samples)
        skins = [self._builder.skin(shape) for shape, part in zip(changing.values(), parts, strict=True)
                 if part.name == "interface"]
        eye = _denoised(light, self._with_skins(found, skins) if found.guides else ())
        whole = found.light.copy()
        whole[found.inside] += found.share * (eye - whole[found.inside])
        return whole

    def _surroundings_of(self, view: View, table: float) -> _Surroundings:
        """What stays the same as long as the view does."""
        all_of_it = (0, 0, *self.size)
        box = box_of(view.pixel(self._points, self.size), self.size) if self.film else all_of_it
        around = {"sky": _sky(self.mitsuba, view), "table": _table(self.mitsuba, view, table)}
        whole, sensor = (_sensor(self.mitsuba, view, self.size, one) for one in (all_of_it, box))
        guides = self._guides(self._opaque, around, whole, GUIDE_PATHS) if self.look.noise == 1 else ()
        light = np.zeros((*self.size[::-1], 3), np.float32)
        if self.film:
            empty = self._opaque | self._clear
            light = _denoised(self._light(empty, around, whole, AROUND * self.samples), guides)
        found = _Surroundings(light, box, _fading(box, self.size), around, sensor, ())
        return dataclasses.replace(found, guides=tuple(guide[found.inside] for guide in guides))

    def _with_skins(self, found: _Surroundings, skins: list[dict]) -> tuple[np.ndarray, ...]:
        """Guides with the interface over them, as much as it is seen: drops are kept, which would pass for noise."""
        if not skins:
            return found.guides
        guides = self._guides({f"skin_{k}": skin for k, skin in enumerate(skins)}, {}, found.sensor, 1)
        seen = self.look.skin.opacity * (guides[0].max(axis=2, keepdims=True) > 0.0)
        return tuple(behind + seen * (skin - behind) for behind, skin in zip(found.guides, guides, strict=True))

    def _light(self, shapes: dict, around: dict, sensor, samples: int) -> np.ndarray:
        paths = {"max_depth": DEPTH, "rr_depth": ROULETTE}
        light = self._render("volpath", paths, shapes, around | self._builder.media, sensor, samples)[..., :3]
        return np.minimum(light, CLAMP * np.percentile(light, CLAMP_AT))

    def _guides(self, shapes: dict, around: dict, sensor, samples: int) -> tuple[np.ndarray, ...]:
        """Colors (0 to 1) and directions (rows, columns, 3) of what is seen first."""
        found = self._render("aov", {"aovs": "albedo:albedo,normal:sh_normal"}, shapes, around, sensor, samples)
        return np.clip(found[..., :3], 0.0, 1.0), found[..., 3:6]

    def _render(self, kind: str, options: dict, shapes: dict, around: dict, sensor, samples: int) -> np.ndarray:
        scene = self.mitsuba.load_dict({"type": "scene", "integrator": {"type": kind, "block_size": BLOCK, **options},
                                        **around, **shapes})
        return np.array(self.mitsuba.render(scene, sensor=sensor, spp=samples, seed=1))


def box_of(places: np.ndarray, size: tuple[int, int]) -> tuple[int, int, int, int]:
    """Left, upper, right and lower edge, pixels, of what holds some places (n, 2) of a picture, with a margin."""
    margin = 2.0 * MARGIN * size[1]
    low = np.clip(np.floor(places.min(axis=0) - margin), 0, np.array(size) - 1).astype(int)
    high = np.clip(np.ceil(places.max(axis=0) + margin), low + 1, size).astype(int)
    return int(low[0]), int(low[1]), int(high[0]), int(high[1])


def _fading(box: tuple[int, int, int, int], size: tuple[int, int]) -> np.ndarray:
    """Share (rows, columns, 1) that falls to 0 at the edges of a box, but for those of the picture."""
    left, upper, right, lower = box
    rising = []
    for start, end, length in ((upper, lower, size[1]), (left, right, size[0])):
        place = np.arange(start, end) + 0.5
        from_start = place - start if start else np.full(end - start, np.inf)
        from_end = end - place if end < length else np.full(end - start, np.inf)
        rising.append(np.clip(np.minimum(from_start, from_end) / (MARGIN * size[1]), 0.0, 1.0))
    return np.minimum(rising[0][:, None], rising[1])[..., None].astype(np.float32)


def _denoised(light: np.ndarray, guides: tuple[np.ndarray, ...]) -> np.ndarray:
    import mitsuba_oidn

    pictures = [np.ascontiguousarray(one, np.float32) for one in (light, *guides)]
    return np.asarray(mitsuba_oidn.denoise(*pictures, hdr=True, input_scale=BRIGHTNESS))


def developed(light: np.ndarray) -> np.ndarray:
    """Pixels (height, width, 3) uint8 of linear light of the same shape (Z6), in the encoding of sRGB."""
    exposed = np.float32(EXPOSURE) * np.maximum(np.asarray(light, np.float32), 0.0)
    luminance = np.maximum(exposed @ np.array([0.2126, 0.7152, 0.0722], np.float32), 1e-9)[..., None]
    by_luminance = exposed * (1.0 + luminance / WHITE**2) / (1.0 + luminance)  # (Z6)
    by_channel = exposed * (1.0 + exposed / WHITE**2) / (1.0 + exposed)
    shown = np.clip(0.7 * by_luminance + 0.3 * by_channel, 0.0, 1.0)
    encoded = np.where(shown <= 0.0031308, 12.92 * shown, 1.055 * np.maximum(shown, 1e-9) ** (1.0 / 2.4) - 0.055)
    return (255.0 * encoded + 0.5).astype(np.uint8)


class _Builder:
    """Descriptions of shapes for Mitsuba.

    It makes the objects of them itself: one that Python has held is counted under Python's lock at every turn of a
    path, so that threads would wait for each other.
    """

    def __init__(self, mitsuba, look: Look, textures: dict[str, np.ndarray], folder: Path):
        self.look, self.folder = look, folder
        self.textures = {name: {"type": "bitmap", "raw": True,
                                "bitmap": mitsuba.Bitmap(np.ascontiguousarray(data, np.float32))}
                         for name, data in textures.items()}
        self.media = {name: {  # (Z5)
            "type": "homogeneous", "sigma_t": medium.density, "albedo": {"type": "rgb", "value": list(medium.albedo)}}
            for name, medium in look.media.items()}

    def shapes(self, kind: str, parts: Iterable[Part]) -> dict[str, dict]:
        """Meshes of parts by a name of each, for its file too; several parts of one kind may be of one tissue."""
        return {name: self._shape(part, self.folder / f"{name}.ply")
                for name, part in ((f"{kind}_{k}", part) for k, part in enumerate(parts))}

    def _shape(self, part: Part, path: Path) -> dict:
        """Mesh of a part with its material, and the liquids on either side."""
        import meshio

        data: dict[str, np.ndarray] = {}
        if part.normals is not None:
            data |= zip(("nx", "ny", "nz"), part.normals.T.astype(np.float32), strict=True)
        if part.places is not None:
            data |= zip("uv", part.places.T.astype(np.float32), strict=True)
        meshio.Mesh(part.points.astype(np.float32), [("triangle", part.triangles.astype(np.int32))],
                    point_data=data).write(path)
        return {"type": "ply", "filename": str(path), "bsdf": self._material(part),
                **{side: {"type": "ref", "id": name} for side, name in self._sides(part.name).items()}}

    def skin(self, shape: dict) -> dict:
        """An interface as the denoiser is to see it: opaque, without liquids beside it."""
        return {"type": "ply", "filename": shape["filename"], "bsdf": self._coated(
            {"type": "rgb", "value": list(self.look.skin.color)}, 0.0)}

    def _sides(self, name: str) -> dict[str, str]:
        return {"glass": {"interior": "oil"}, "interface": {"interior": "oil", "exterior": "aqueous"},
                "oil_face": {"interior": "oil"}, "aqueous_face": {"interior": "aqueous"}}.get(name, {})

    def _material(self, part: Part) -> dict:
        if part.name in ("oil_face", "aqueous_face"):
            return _veil({"type": "conductor", "material": "none"}, self.look.sheen)
        if part.name == "interface":
            return self._tissue(self.look.skin)
        if part.name == "glass":
            return {"type": "dielectric", "int_ior": OIL_INDEX, "ext_ior": 1.0}
        if part.name == "cornea":
            return {"type": "thindielectric", "int_ior": CORNEA_INDEX, "ext_ior": 1.0}
        if part.name in ("wall", "iris") and part.name in self.textures:
            return self._coated(self.textures[part.name], 0.12 if part.name == "wall" else 0.1)
        return self._tissue(TISSUES[part.name])

    def _tissue(self, tissue: Tissue) -> dict:
        material = self._coated({"type": "rgb", "value": list(tissue.color)}, tissue.gloss)
        return _veil(material, tissue.opacity) if tissue.opacity < 1.0 else material

    def _coated(self, color, gloss: float) -> dict:
        diffuse = {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": color}}
        if not gloss:
            return diffuse
        return {"type": "twosided", "bsdf": {"type": "principled", "base_color": color, "specular": 0.5,
                                             "roughness": 0.6 - 0.4 * gloss, "clearcoat": gloss,
                                             "clearcoat_gloss": 0.6}}


def _veil(material: dict, opacity: float) -> dict:
    return {"type": "mask", "opacity": {"type": "rgb", "value": opacity}, "material": material}


def _sensor(mitsuba, view: View, size: tuple[int, int], box: tuple[int, int, int, int]):
    """The camera, of whose picture a box is traced: left, upper, right and lower edge in pixels."""
    right, up, back = view.axes
    matrix = np.eye(4)
    matrix[:3, :3] = np.stack([-right, up, -back], axis=1)      # Mitsuba looks along +z, its x is to the left
    matrix[:3, 3] = view.camera
    return mitsuba.load_dict({
        "type": "perspective", "fov": float(np.degrees(ANGLE)), "fov_axis": "y", "near_clip": 1.0, "far_clip": 1e4,
        "to_world": mitsuba.ScalarTransform4f(matrix),
        "sampler": {"type": "independent"},
        "film": {"type": "hdrfilm", "width": size[0], "height": size[1],
                 "crop_offset_x": box[0], "crop_offset_y": box[1], "crop_width": box[2] - box[0],
                 "crop_height": box[3] - box[1], "rfilter": {"type": "box"}, "pixel_format": "rgb",
                 "component_format": "float32"}})


def _sky(mitsuba, view: View):
    """A soft dome with three soft lamps, and a fill into the opened half."""
    width, height = SKY_SIZE
    theta = (np.arange(height) + 0.5)[:, None] / height * np.pi
    phi = (np.arange(width) + 0.5)[None, :] / width * 2.0 * np.pi
    x, y, z = np.sin(phi) * np.sin(theta), np.cos(theta) * np.ones_like(phi), -np.cos(phi) * np.sin(theta)
    light = np.array([0.80, 0.86, 0.93]) * (0.62 + 0.22 * y)[..., None]
    # Direction of each lamp (right, up, toward the reader), its half width in degrees, strength and color.
    for way, wide, strength, color in (((-0.55, 0.75, 0.5), 17.0, 8.0, (1.0, 0.97, 0.92)),
                                       ((0.9, 0.45, 0.25), 12.0, 4.0, (0.93, 0.97, 1.0)),
                                       ((0.1, 0.9, -0.5), 14.0, 4.0, (1.0, 1.0, 1.0)),
                                       ((0.05, 0.25, 1.0), 24.0, 1.6, (1.0, 0.99, 0.97))):
        way = np.asarray(way) / np.linalg.norm(way)
        off = np.degrees(np.arccos(np.clip(x * way[0] + y * way[1] + z * way[2], -1.0, 1.0)))
        light = light + strength * (1.0 / (1.0 + np.exp((off - wide) / 2.5)))[..., None] * np.asarray(color)
    back = view.axes[2]
    level = back - (back @ view.up) * view.up
    level /= np.linalg.norm(level)
    matrix = np.eye(4)
    matrix[:3, :3] = np.stack([np.cross(view.up, level), view.up, level], axis=1)
    return mitsuba.load_dict({"type": "envmap", "bitmap": mitsuba.Bitmap(light.astype(np.float32)),
                              "to_world": mitsuba.ScalarTransform4f(matrix)})


def _table(mitsuba, view: View, height: float):
    right = view.axes[0] - (view.axes[0] @ view.up) * view.up
    right /= np.linalg.norm(right)
    matrix = np.eye(4)
    matrix[:3, :3] = TABLE_RADIUS * np.stack([right, np.cross(view.up, right), view.up], axis=1)
    matrix[:3, 3] = height * view.up + view.middle - (view.middle @ view.up) * view.up
    # The texture of a disk is by angle and distance from its middle.
    away = TABLE_RADIUS * (np.arange(2048) + 0.5) / 2048
    share = 1.0 - np.exp(-(away / TABLE_FADE) ** 2)
    color = (1.0 - share)[:, None] * np.array(TABLE_NEAR) + share[:, None] * np.array(TABLE_FAR)
    texture = {"type": "bitmap", "raw": True, "wrap_mode": "clamp",
               "bitmap": mitsuba.Bitmap(np.tile(color.astype(np.float32)[None], (4, 1, 1)))}
    return mitsuba.load_dict({"type": "disk", "to_world": mitsuba.ScalarTransform4f(matrix), "bsdf": {
        "type": "twosided", "bsdf": {"type": "diffuse", "reflectance": texture}}})

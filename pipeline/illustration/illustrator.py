"""Illustrations of the frames of one scene; what stays the same from frame to frame is made once."""
import dataclasses

import numpy as np
from PIL import Image

from pipeline.base.frame_files import FrameData
from pipeline.base.palette import rgb
from pipeline.cavity.signed_distance_grid import distance_of_mesh
from pipeline.illustration import mitsuba_picture, pyvista_picture
from pipeline.illustration.anatomy import MM, Level, anatomy_of
from pipeline.illustration.fundus import fundus_texture, iris_texture
from pipeline.illustration.geometry import Liquids, Opening, Part, liquids_of, optic_nerve, parts_of_eye
from pipeline.illustration.lettering import Name, lettered
from pipeline.illustration.looks import LOOKS
from pipeline.illustration.style import Style
from pipeline.illustration.view import View, view_of
from pipeline.pictures.fundus_map import disc_direction
from pipeline.pictures.marks import clock, pretty
from pipeline.pictures.paint import paint_of
from pipeline.pictures.section_panel import posture
from pipeline.scenes.effects import does, droplets_of
from pipeline.scenes.model import Scene
from pipeline.scenes.retina import globe_radius
from pipeline.scenes.shown_liquids import liquid_around, shown_liquids
from sim.effects.effect import MIXES

CELL, MARGIN = 0.25e-3, 1.6e-3      # m, of the distances to the cavity, and around it
REACH = 14.5e-3                     # m: half width of the plane of the cut, at least


def oils_of(scene: Scene) -> list[str]:
    """Names of the liquids that are drawn as bodies."""
    return [liquid.name for liquid in shown_liquids(scene)]


class Illustrator:
    """Draws frames of one scene with an eye.

    Parameters
    ----------
    scene : resolved scene.
    eye : pyvista.PolyData of the cavity, m.
    gravity : (3,) m/s2, by which the plane of the cut is chosen.
    film : whether many frames are drawn one after another.
    """

    def __init__(self, scene: Scene, eye, gravity: np.ndarray, style: Style, *, film: bool = False):
        import trimesh

        self.scene, self.style = scene, style
        distance = distance_of_mesh(trimesh.Trimesh(eye.points, eye.regular_faces, process=False), CELL, MARGIN)
        self.anatomy, self.right_eye = anatomy_of(scene.eye, distance), scene.eye.side == "right"
        points = np.asarray(eye.points, float)
        globe = globe_radius(points)
        segment = self.anatomy.segment
        back, front = points[:, 2].min(), points[:, 2].max() if segment is None else segment.apex
        self.middle = MM * np.array([0.0, 0.0, 0.5 * (back + front)])
        self.extent = MM * max(front - back, 2.0 * float(np.abs(points[:, :2]).max()))
        self.toward = view_of(gravity, self.right_eye, self.middle).toward
        self.opening = Opening(self.toward, MM * max(REACH, 1.15 * float(np.abs(points).max()) + 2e-3))
        self.disc = disc_direction(globe, self.right_eye)
        parts = parts_of_eye(eye, self.anatomy, self.opening)
        nerve = optic_nerve(self.anatomy, self.disc, self.opening)
        self.parts: list[Part] = parts if nerve is None else [*parts, nerve]
        self.textures = {"wall": fundus_texture(globe, self.right_eye), "iris": iris_texture()}
        self.look = LOOKS[style.look]
        self._tracer = mitsuba_picture.Tracer(self.parts, self.look, self.textures, style.size, style.samples,
                                              style.threads, film=film) if style.renderer == "mitsuba" else None

    def liquids(self, frame: FrameData, surfaces: dict) -> Liquids:
        """What is shown of the liquids of one frame.

        Parameters
        ----------
        surfaces : dict oil -> closed pyvista.PolyData with ``depth``, m.
        """
        import pyvista

        oil = pyvista.merge(list(surfaces.values()), merge_points=False) if len(surfaces) > 1 else \
            next(iter(surfaces.values()), pyvista.PolyData())
        return liquids_of(oil, self.anatomy, self.opening, frame.particle_spacing**3, self.look.whole)

    def picture(self, frame: FrameData, liquids: Liquids, swing: float = 0.0) -> Image.Image:
        """The illustration of one frame, without its words.

        Parameters
        ----------
        swing : how far the camera has gone around, rad.
        """
        view = self._view(frame, swing)
        if self._tracer is not None:
            table = min(float((part.points @ view.up).min()) for part in self.parts)
            pixels = mitsuba_picture.developed(self._tracer.trace(liquids.parts, view, table))
        else:
            pixels = pyvista_picture.draw([*self.parts, *liquids.parts], self.look, self.textures, view,
                                          self.style.size)
        return Image.fromarray(pixels)

    def with_words(self, picture: Image.Image, frame: FrameData, liquids: Liquids, swing: float = 0.0) -> Image.Image:
        """The illustration of one frame with the words that its style asks for."""
        if self.style.letters == "none":
            return picture
        scene, with_names = self.scene, self.style.letters == "names"
        return lettered(picture, self._view(frame, swing), self._names(liquids) if with_names else [],
                        legend=[] if with_names else self._legend(liquids), title=scene.title or scene.name,
                        time=f"{clock(frame.time, scene.output.second_means)}, {self.half}", label=scene.label,
                        posture=posture(frame.gravity), notes=self._notes(liquids))

    def _view(self, frame: FrameData, swing: float) -> View:
        return dataclasses.replace(view_of(frame.gravity, self.right_eye, self.middle, self.extent),
                                   toward=self.toward, swing=swing)

    @property
    def half(self) -> str:
        """Which eye it is, and which half of it stays."""
        stays = "inferior" if self.toward[1] > 0.5 else "nasal"
        return f"{'right' if self.right_eye else 'left'} eye, {stays} half"

    def _names(self, liquids: Liquids) -> list[Name]:
        anatomy, toward = self.anatomy, self.opening.toward
        across = self.opening.across / np.linalg.norm(self.opening.across)
        back = MM * float(self.anatomy.cavity.origin[2]) + MM * MARGIN
        names = [Name(_capital(self._liquid_name(face)), place, self._of_liquid(face))
                 for face, place in liquids.places.items()]
        names.append(Name("Macula", np.array([0.0, 0.0, back])))
        if self.disc @ toward < 0.0 and self.look.clear:
            names.append(Name("Optic disc", self._on_wall(self.disc)))
        # Where the cut is level, lower is inferior or to the patient's right.
        lower = across if across @ [0.3, 1.0, 0.0] < 0.0 else -across
        names.append(Name("Retina, choroid, sclera", self._on_wall(np.array([0.0, 0.0, -0.62]) + 0.78 * lower) * 1.04))
        if anatomy.segment is not None:
            names += [Name("Ciliary body", self._within(anatomy.ciliary, -lower)),
                      Name("Iris", self._within(anatomy.iris, -lower)),
                      Name("Cornea", self._within(anatomy.cornea, lower))]
            if anatomy.segment.lens != "aphakic":
                names.append(Name("Lens" if anatomy.segment.lens == "phakic" else "Artificial lens",
                                  self._within(anatomy.lens)))
        return names

    def _legend(self, liquids: Liquids) -> list[tuple]:
        """Colors (3,) and names of the liquids that are there, in the colors of all other pictures."""
        paint = paint_of(self.scene)
        oil = paint.covered if self.look.oil is None else rgb(self.look.oil)
        colors = {"oil_face": oil, "aqueous_face": paint.bare, "interface": rgb(self.look.interface)}
        return [(tuple(int(part) for part in colors[face]), _capital(self._liquid_name(face)))
                for face in colors if face in liquids.places]

    def _within(self, level: Level, side: np.ndarray | None = None) -> np.ndarray:
        """Place (3,), mm, on the cut that lies deepest in a part, on one side of the optic axis."""
        points = self.opening.points if side is None else self.opening.points[self.opening.points @ side > 0.0]
        return points[level(points).argmin()]

    def _on_wall(self, way: np.ndarray) -> np.ndarray:
        """Place (3,), mm, of the wall in a direction from the center of the globe."""
        reach = np.linspace(0.0, 25.0, 1000)[:, None] * way / np.linalg.norm(way)
        return reach[np.argmax(self.anatomy.inside(reach) > 0.0)]

    def _liquid_name(self, face: str) -> str:
        if face == "interface":
            return "interface"
        around = liquid_around(self.scene)
        names = oils_of(self.scene) if face == "oil_face" else [around.name] if around else []
        return " and ".join(pretty(name) for name in names) or "liquid"

    def _of_liquid(self, face: str) -> str:
        """What makes the oil what it is: its kinematic viscosity, and whether it floats."""
        oils, others = ([one for one in self.scene.liquids if (one.name in oils_of(self.scene)) is of_oil]
                        for of_oil in (True, False))
        if face != "oil_face" or len(oils) != 1:
            return ""
        kinematic = 1e6 * oils[0].dynamic_viscosity / oils[0].density
        words = (f"{kinematic:.3g}" if kinematic < 1000 else f"{round(kinematic, -1):,.0f}") + " mm²/s (cSt)"
        if others:
            words += ", floats up" if oils[0].density < others[0].density else ", sinks"
        return words

    def _notes(self, liquids: Liquids) -> list[str]:
        scene, notes = self.scene, []
        around = "the mesh of this eye, with layers drawn" if self.anatomy.shape is None else \
            "the simulated cavity; eye and vessels after textbooks"
        notes.append(f"Shapes of the liquids: simulated. Around them: {around}. "
                     f"Colors chosen; drawn by {'Mitsuba 3' if self.style.renderer == 'mitsuba' else 'VTK'}.")
        more = ["around the oil is air: as glass, with its index of refraction"] if self.look.whole else []
        if does(scene, MIXES):
            more.append("the liquids mix: oil is drawn where it is more than half")
        if liquids.left_out:
            drops = "one drop" if liquids.left_out == 1 else f"{liquids.left_out} drops"
            more.append(f"{drops} of fewer than three particles not drawn")
        if "oil_face" in liquids.places and "aqueous_face" in liquids.places:
            more.append("oil within 0.3 mm of the wall is drawn as touching it")
        if droplets_of(scene) is not None:
            more.append("droplets are too fine to be drawn")
        if not oils_of(scene):
            more.append("this scene has no oil")
        return notes + [f"{_capital('; '.join(more))}."] * bool(more)


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


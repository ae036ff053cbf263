"""The resolved scene: frozen, in SI, every default filled in. Its fields declare what a scene file may say."""
import dataclasses
import json
import math
from pathlib import Path
from typing import Any

from pipeline.scenes.retina import ASSUMED_HEIGHT, FRONT, HOUR, ORA, PARTS, Patch, part_of_chart, square
from sim.effects import REGISTRY
from sim.parameters import parameter
from sim.schemes import REGISTRY as SCHEMES
from sim.settings import Liquid, Numerics, Settings

LENSES = ("phakic", "pseudophakic", "aphakic")
SIDES = ("right", "left")
AT_REST = "at_rest"  # the start of two liquids in an eye
REST_WINDOW = 3.0  # s over which coverage is watched: in less, single particles at the wall hide its change
REST_RATE = 0.5  # points of the retina per second, up to which a scene is called at rest
SMALLEST_ANGLE, LARGEST_ANGLE = math.radians(5.0), math.radians(45.0)  # of contact: what a shape at rest is found for
SHAPES = ("box", "ball", "cylinder_x", "cylinder_y", "cylinder_z")
EQUATOR = math.radians(90.0) + 1e-9   # from the posterior pole; units are rounded
LARGEST_LATITUDE = math.radians(ORA)
IMAGES = (".nii", ".nii.gz", ".nrrd", ".nhdr")   # ends of the names of labelled images
MESH_UNITS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "in": 25.4e-3}


def is_image(path: Path | str) -> bool:
    """Say by its name whether the file of an eye is a labelled image."""
    return str(path).lower().endswith(IMAGES)


@dataclasses.dataclass(frozen=True)
class Buckle:
    """A scleral buckle: it presses the wall inward along a circle of latitude, all around or between clock hours."""

    height: float = parameter(unit="m", exclusive_minimum=0.0, maximum=0.005, meaning="depth of the indentation")
    width: float = parameter(0.004, unit="m", minimum=0.002, maximum=0.012,
                             meaning="width of the indentation at half its depth")
    latitude: float = parameter(math.radians(95.0), unit="rad", minimum=math.radians(50.0),
                                maximum=LARGEST_LATITUDE + 1e-9,
                                meaning="angle of its ridge from the posterior pole: equator 90 deg, ora 115 deg")
    clock_hours: tuple[float, float] | None = parameter(
        None, minimum=0.0, maximum=12.0,
        meaning="first and last clock hour, clockwise as an observer sees it who faces the patient; else all around")


@dataclasses.dataclass(frozen=True)
class Staphyloma:
    """A staphyloma: a bulge of the wall outward. At the posterior pole its depth is part of the axial length."""

    depth: float = parameter(unit="m", exclusive_minimum=0.0, maximum=0.006, meaning="depth of the bulge")
    width: float = parameter(0.010, unit="m", minimum=0.004, maximum=0.016,
                             meaning="width of the bulge at half its depth")
    angle: float = parameter(0.0, unit="rad", minimum=0.0, maximum=EQUATOR,
                             meaning="angle of its middle from the posterior pole")
    clock_hour: float = parameter(6.0, minimum=0.0, maximum=12.0,
                                  meaning="clock hour of its middle, as an observer sees it who faces the patient")


@dataclasses.dataclass(frozen=True)
class Landmarks:
    """Points of a mesh, in the coordinates of its file, that tell how it lies; what is not given is found."""

    fovea: tuple[float, float, float] | None = parameter(None, unit="m", meaning="fovea")
    optic_disc: tuple[float, float, float] | None = parameter(None, unit="m", meaning="middle of the optic disc")
    corneal_apex: tuple[float, float, float] | None = parameter(
        None, unit="m", meaning="apex of the cornea, or another point ahead on the axis")
    superior: tuple[float, float, float] = parameter((0.0, 1.0, 0.0), minimum=-1.0, maximum=1.0,
                                                     meaning="direction in the file that is superior")


@dataclasses.dataclass(frozen=True)
class Eye:
    """The cavity: a parametric eye or a mesh of the user's."""

    model: str = parameter("parametric", choices=("parametric", "mesh"), meaning="where the surface comes from")
    axial_length: float = parameter(0.024, unit="m", minimum=0.015, maximum=0.040,
                                    meaning="axial length of the parametric eye")
    horizontal_diameter: float | None = parameter(None, unit="m", minimum=0.015, maximum=0.040,
                                                  meaning="inner horizontal diameter, else a mean of measured eyes")
    vertical_diameter: float | None = parameter(None, unit="m", minimum=0.015, maximum=0.040,
                                                meaning="inner vertical diameter, else a mean of measured eyes")
    lens: str = parameter("phakic", choices=LENSES, meaning="own lens, artificial lens or none")
    side: str = parameter("right", choices=SIDES, meaning="which eye: temporal is the patient's right in a right eye")
    anterior_chamber: bool = parameter(False, meaning="the liquids fill the anterior chamber too, of an aphakic eye")
    pupil: float = parameter(0.005, unit="m", minimum=0.003, maximum=0.009,
                             meaning="diameter of the pupil through which they do")
    buckle: Buckle | None = parameter(None, meaning="scleral buckle of the parametric eye")
    staphyloma: Staphyloma | None = parameter(None, meaning="staphyloma of the parametric eye")
    path: str | None = parameter(None, meaning="mesh or labelled image (NIfTI, NRRD), relative to the folder of the "
                                               "scene file")
    label: int | None = parameter(None, minimum=1, maximum=2**31 - 1,
                                  meaning="number of the vitreous cavity in a labelled image")
    unit: str = parameter("mm", choices=MESH_UNITS, meaning="unit of length of a mesh, or of an image that names none")
    force: bool = parameter(False, meaning="accept a mesh or an image unlike an eye")
    smooth: bool = parameter(False, meaning="smooth the steps of voxels of a mesh, as those of an image always are, at "
                                         "the same volume")
    landmarks: Landmarks | None = parameter(
        None, meaning="how the mesh lies, else as the head of its file or its flat side tells, else x to the "
                      "patient's left, y superior, z anterior")


@dataclasses.dataclass(frozen=True)
class Break:
    """A break of the retina."""

    name: str = parameter(meaning="name, in columns and pictures")
    hour: float = parameter(unit="h", exclusive_minimum=0.0, maximum=12.0,
                            meaning="clock hour of its middle as an observer sees it who faces the patient: 12 is "
                                    "superior, 3 on the patient's left, half past six 6.5")
    latitude: float = parameter(unit="rad", minimum=0.0, maximum=LARGEST_LATITUDE,
                                meaning="angle of its middle from the posterior pole: equator 90 deg, ora serrata 115 "
                                        "deg")
    width: float | None = parameter(None, unit="h", exclusive_minimum=0.0, maximum=12.0, meaning="width in clock hours")
    height: float | None = parameter(None, unit="rad", exclusive_minimum=0.0, maximum=LARGEST_LATITUDE,
                                     meaning="height along the meridian, else 10 deg (2 mm)")
    diameter: float | None = parameter(None, unit="m", exclusive_minimum=0.0, maximum=0.02,
                                       meaning="diameter on the retina, in place of width and height")

    def patch(self, globe: float) -> Patch:
        """Return where it is; globe : radius of the globe, m, which turns a diameter into an angle."""
        meridian, latitude = self.hour * HOUR % 360.0, math.degrees(self.latitude)
        if self.diameter is not None:
            return square(meridian, latitude, math.degrees(self.diameter / globe))
        height = ASSUMED_HEIGHT if self.height is None else math.degrees(self.height)
        return Patch(meridian, latitude, (self.width or 0.0) * HOUR, height)


@dataclasses.dataclass(frozen=True)
class Region:
    """A part of the wall whose coverage is asked for."""

    name: str = parameter(meaning="name, in columns and pictures")
    latitudes: tuple[float, float] = parameter(
        (0.0, LARGEST_LATITUDE), unit="rad", minimum=0.0, maximum=math.radians(FRONT),
        meaning="angles from the posterior pole between which it lies: macula 0, equator 90, ora serrata 115, front of "
                "the pars plana 135 deg")
    hours: tuple[float, float] | None = parameter(
        None, unit="h", minimum=0.0, maximum=12.0,
        meaning="clock hours from which to which it reaches, clockwise; all around without them")
    part: str | None = parameter(None, choices=PARTS, meaning="part of the chart in place of hours")

    def patch(self, right_eye: bool) -> Patch:
        """Return where it is; right_eye : whether temporal is the patient's right."""
        low, high = map(math.degrees, self.latitudes)
        meridian, width = 0.0, 360.0
        if self.part is not None:
            meridian, width = part_of_chart(self.part, right_eye)
        elif self.hours is not None:
            width = HOUR * ((self.hours[1] - self.hours[0]) % 12.0 or 12.0)
            meridian = (HOUR * self.hours[0] + 0.5 * width) % 360.0
        return Patch(meridian, 0.5 * (low + high), width, high - low)


@dataclasses.dataclass(frozen=True)
class Funnel:
    """A solid funnel with an upright axis, a cone without ends, in a container."""

    center: tuple[float, ...] = parameter(unit="m", meaning="center of the lower opening")
    lower_radius: float = parameter(unit="m", exclusive_minimum=0.0, meaning="radius of the lower opening, mid-wall")
    upper_radius: float = parameter(unit="m", exclusive_minimum=0.0, meaning="radius of the upper opening, mid-wall")
    height: float = parameter(unit="m", exclusive_minimum=0.0, meaning="height from the lower to the upper opening")
    thickness: float = parameter(unit="m", exclusive_minimum=0.0, meaning="thickness of its wall, rounded at the rims")


@dataclasses.dataclass(frozen=True)
class Container:
    """The cavity: a rectangular box with closed walls, its lower corner at the origin; y is up."""

    size: tuple[float, ...] = parameter(unit="m", exclusive_minimum=0.0, maximum=1000.0,
                                        meaning="inner sides along x, y and, in three dimensions, z")
    funnels: tuple[Funnel, ...] = parameter((), meaning="solid funnels in it")


@dataclasses.dataclass(frozen=True)
class Block:
    """A block of one liquid at the start, as large as fits between two corners."""

    liquid: str = parameter(liquid=True, meaning="liquid of the block")
    lower: tuple[float, ...] = parameter(unit="m", meaning="corner with the smallest coordinates; the container's is 0")
    upper: tuple[float, ...] = parameter(unit="m", meaning="corner with the largest coordinates")
    velocity: tuple[float, ...] = parameter((), unit="m/s", meaning="velocity at the start; at rest without it")
    shape: str = parameter("box", choices=SHAPES,
                           meaning="all between the corners, or the ball (in 2D the disc) or the cylinder along an "
                                   "axis that touches the sides")
    replaces: bool = parameter(False, meaning="takes the place of what the blocks before it have where it is")

    @property
    def volume(self) -> float:
        """Volume, m3 (m2 in two dimensions)."""
        share = {"box": 1.0, "ball": math.pi / (2 * max(len(self.lower), 1))}
        return share.get(self.shape, math.pi / 4.0) * math.prod(self.sides)

    @property
    def sides(self) -> tuple[float, ...]:
        """Length along every axis, m."""
        return tuple(high - low for low, high in zip(self.lower, self.upper, strict=False))


@dataclasses.dataclass(frozen=True)
class Material(Liquid):
    """A named liquid of ``config/materials.yaml`` with the scene's changes."""

    color: str = parameter("#9ecae1", meaning="color in pictures, as #rrggbb")
    clear: bool = parameter(False, meaning="clear liquid that fills an eye: pictures show the others in it")
    source: str = parameter("", longest=1000, meaning="where the numbers come from")


@dataclasses.dataclass(frozen=True)
class Initial:
    """What fills the whole cavity at t = 0: one liquid, several stacked level, the lightest on top, or oil at rest."""

    liquid: str | None = parameter(None, liquid=True, meaning="liquid that fills the cavity, else the first liquid")
    fill: dict[str, float] | None = parameter(None, liquid=True, exclusive_minimum=0.0, maximum=1.0,
                                              meaning="fraction of the cavity that each liquid holds")
    shape: str = parameter("level", choices=("level", AT_REST),
                           meaning="liquids stacked level, or two of them where gravity, tension and contact angle "
                                   "let them rest in an eye")


@dataclasses.dataclass(frozen=True)
class Output:
    """What is saved, and how it is turned into surfaces and pictures."""

    duration: float = parameter(unit="s", exclusive_minimum=0.0, maximum=3600.0, meaning="simulated time")
    until_rest: bool = parameter(
        False, meaning="end before the duration, after the first segment in whose last "
                       f"{REST_WINDOW:g} s the covered shares of the retina change by less than {REST_RATE:g} points "
                       "per second")
    frame_interval: float = parameter(0.1, unit="s", exclusive_minimum=0.0, meaning="time between saved frames")
    second_means: float | None = parameter(None, unit="s", exclusive_minimum=0.0,
                                           meaning="what a simulated second stands for in a time-lapse: the clock "
                                                   "of the pictures shows it")
    allowed_frames: int = parameter(
        2000, minimum=1, maximum=100_000,
        meaning="frames, each with a picture, that may be saved; more are refused until they are allowed here")
    frames_per_segment: int = parameter(10, minimum=1, maximum=10000, meaning="frames between two checkpoints")
    cell_ratio: float = parameter(0.5, minimum=0.1, maximum=2.0, meaning="surface grid cell per particle spacing")
    contour: str = parameter("sharp", choices=("sharp", "flying_edges", "marching_cubes"),
                             meaning="surface algorithm; only sharp keeps the edge at the wall")
    kernel: str = parameter("isotropic", choices=("isotropic", "anisotropic"),
                            meaning="kernel of the surface: round, or stretched along the surface")
    smoothing_length: float | None = parameter(
        None, minimum=0.0, maximum=3.0,
        meaning="surface smoothing in particle spacings, else 1 in a full cavity, 0.5 with a free surface")
    image_size: tuple[int, int] = parameter((1920, 1080), minimum=64, maximum=8192,
                                            meaning="width and height in pixels")
    formats: tuple[str, ...] = parameter((), choices=("ply", "stl"), meaning="surface formats beside vtp")


@dataclasses.dataclass(frozen=True, kw_only=True)
class Scene:
    """One experiment, ready to run: a scene file with every default filled in, in SI units.

    The fields are the keys of a scene file; the order of ``liquids`` gives the phase indices. ``run.scene`` is one, and
    so is what ``scene.json`` of a run holds.
    """

    name: str = parameter(meaning="name of the scene, from its file")
    title: str = parameter("", longest=200, meaning="heading of the pictures and of the report")
    description: str = parameter("", longest=5000, meaning="what the scene shows")
    label: str = parameter("", longest=200, meaning="line drawn in every picture, for example a time-lapse warning")
    accuracy: str = parameter(meaning="accuracy level that gave the numerics")
    dimension: int = parameter(3, minimum=2, maximum=3, meaning="dimensions of space")
    start_from: str | None = parameter(None, meaning="scene whose last checkpoint is the start")
    allowed_time: float = parameter(
        7 * 86400.0, unit="s", exclusive_minimum=0.0, maximum=10 * 365 * 86400.0,
        meaning="time that the simulation may take on the computer; a longer one is refused until it is allowed here")
    eye: Eye | None = parameter(Eye(), meaning="the cavity, unless it is a container")
    breaks: tuple[Break, ...] = parameter((), meaning="breaks of the retina: when oil covers them, and how it presses")
    regions: tuple[Region, ...] = parameter((), meaning="parts of the wall whose coverage is measured")
    container: Container | None = parameter(None, meaning="rectangular cavity in place of an eye")
    liquids: tuple[Material, ...] = parameter(meaning="liquids; the first is phase 0")
    initial: Initial = parameter(Initial(), meaning="what fills the cavity at the start")
    blocks: tuple[Block, ...] = parameter((), meaning="blocks of liquid in a container at the start, not with initial")
    effects: dict[str, Any] = dataclasses.field(
        default_factory=dict,
        metadata={"meaning": "physics beside pressure", "kinds": {n: e.Parameters for n, e in REGISTRY.items()}})
    schemes: dict[str, Any] = dataclasses.field(
        default_factory=dict,
        metadata={"meaning": "parameters of schemes; only those of numerics.scheme are used",
                  "kinds": {n: s.Parameters for n, s in SCHEMES.items()}})
    numerics: Numerics = parameter(meaning="how the equations are solved")
    output: Output = parameter(meaning="what is saved and drawn")

    @property
    def closed(self) -> bool:
        """Whether the liquids fill the cavity completely, so that there is no free surface."""
        return is_closed(self.container, self.blocks)

    @property
    def frame_count(self) -> int:
        """Number of saved frames, with frame 0 at t = 0."""
        return round(self.output.duration / self.output.frame_interval) + 1

    @property
    def segment_count(self) -> int:
        """Number of segments, each with its own checkpoint."""
        return math.ceil((self.frame_count - 1) / self.output.frames_per_segment)

    @property
    def segment_names(self) -> list[str]:
        """Return the names of the segments: ``000``, ``001`` ..."""
        return [f"{segment:03d}" for segment in range(self.segment_count)]

    def frames_of_segment(self, segment: int) -> range:
        """Return the frames of one segment; the start, frame 0, belongs to segment 0."""
        if not 0 <= segment < self.segment_count:
            raise ValueError(f"segment {segment} is not in 0 to {self.segment_count - 1}")
        length = self.output.frames_per_segment
        first = segment * length + 1 if segment else 0
        return range(first, min((segment + 1) * length + 1, self.frame_count))

    def patches(self, globe: float) -> dict[str, dict[str, Patch]]:
        """Return where breaks and regions are: kind -> name -> patch; globe : radius of the globe, m."""
        right_eye = self.eye is None or self.eye.side == "right"
        return {"breaks": {one.name: one.patch(globe) for one in self.breaks},
                "regions": {one.name: one.patch(right_eye) for one in self.regions}}

    def settings(self) -> Settings:
        """Return what the solver needs: no names of files, no pictures."""
        liquids = tuple(Liquid(liquid.name, liquid.density, liquid.dynamic_viscosity) for liquid in self.liquids)
        return Settings(self.dimension, liquids, self.numerics, tuple(self.effects.values()), self.closed,
                        self.schemes.get(self.numerics.scheme), continued=self.start_from is not None)

    def to_json(self) -> str:
        """Return the scene as JSON text, the same text for the same scene."""
        return json.dumps(dataclasses.asdict(self), indent=2, ensure_ascii=False) + "\n"


def is_closed(container: Container | None, blocks: tuple[Block, ...]) -> bool:
    """Tell whether blocks that neither overlap nor reach outside fill a cavity; without blocks one liquid does.

    Blocks that replace others are taken to lie within them.
    """
    if container is None or not blocks:
        return True
    if any(block.shape != "box" for block in blocks if not block.replaces):
        return False
    blocks = tuple(block for block in blocks if not block.replaces)
    return math.isclose(sum(math.prod(block.sides) for block in blocks), math.prod(container.size), rel_tol=1e-9)


# What a scene file may say: its name is that of the file, and the accuracy is chosen for a run, not for a scene.
SCENE_KEYS = ("extends", "levels",
              *(field.name for field in dataclasses.fields(Scene) if field.name not in ("name", "accuracy")))

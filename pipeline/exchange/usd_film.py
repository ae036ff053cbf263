"""All saved times of a run in one USD file, for Blender, Houdini, Omniverse and Quick Look.

Positions are in m: bit for bit those of the surface files, right beside the glTF files, and as large as the eye is also
in programs that do not look at the unit. Y is up, which is superior in the eye. The default prim is named after the
scene and holds

``surfaces``   a mesh per liquid, whose points and triangles change with time, and the ``wall``, which stays
``materials``  of the meshes
``camera``, ``lights``  with which the file looks like something when it is opened; no lights in a ``.usdz``, where
               Quick Look allows none

All are made to be rendered and leave ``purpose`` at its default, as viewers hide other purposes. What each is for is in
its documentation. Between two saved times a surface stays what it was. The acceleration of gravity, m/s2, is the
attribute ``userProperties:gravity`` of the default prim: it turns in the frame of the eye, which stays.
"""
import math
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
import trimesh

from pipeline.base.errors import UserError
from pipeline.base.files import replacing
from pipeline.base.progress import progress
from pipeline.base.words import NO_ADVICE, duration
from pipeline.exchange.mesh_formats import ROUGHNESS, colors_of, linear, mesh_of
from pipeline.scenes.model import Scene
from pipeline.surfaces.saved_frame import SavedFrame

try:
    from pxr import Gf, Kind, Sdf, Tf, Usd, UsdGeom, UsdLux, UsdShade, UsdUtils, Vt
except ModuleNotFoundError as error:
    raise UserError("--format usd and usdz need the package usd-core, which is not installed: install the extra usd, "
                    "pip install 'eye-oil-pipeline[usd]'") from error

PLAYED = 24.0                   # pictures per second: what USD and its programs take where nothing is said
HELD = 0.999                    # of the time between two saved ones, at which a surface is still the old one
FRAMES_PER_SAVE = 20            # what is saved leaves the memory
CAMERA_FROM, SUN_FROM = (1.0, 0.35, 0.8), (0.3, 1.0, 0.8)  # the patient's left, superior, anterior
FOCAL_LENGTH, APERTURE = 0.05, (0.036, 0.02025)  # m, of the camera
MARGIN = 1.15                   # of what the camera sees, over the size of the cavity
FAILED = "{}: USD cannot write the file; is the disk full?"
SUN, SKY = 1.5, 0.6             # intensities; Blender makes the sun four times as bright


def time_codes_per_second(interval: float) -> float:
    """Return how many time codes are a second with frames every ``interval`` s: enough that none is skipped.

    >>> [time_codes_per_second(interval) for interval in (0.1, 0.04, 0.002)]
    [24.0, 25.0, 500.0]
    """
    # Programs play so many pictures in a second; Blender takes its own number all the same, 24 if nobody changes it.
    return max(PLAYED, 1.0 / interval)


def write_film(path: Path, frames: Sequence[SavedFrame], scene: Scene, wall: Path) -> None:
    """Write the surfaces of frames over time; the file appears by rename.

    Parameters
    ----------
    path : ``.usdc``, or ``.usdz``, a package of one such file.
    frames : at least one, in the order of time.
    wall : file of the surface of the cavity.

    Raises
    ------
    UserError : a file of a frame is missing or damaged.
    OSError : USD cannot write the file.
    """
    with replacing(path) as partial:
        package = path.suffix == ".usdz"
        layer = partial.with_suffix(".usdc")
        try:
            _write_layer(layer, path, frames, scene, wall, lights=not package)
            if package and not UsdUtils.CreateNewUsdzPackage(str(layer), str(partial), f"{path.stem}.usdc"):
                raise OSError(FAILED.format(path))
        except Tf.ErrorException as error:  # many lines, of places in the code of USD
            raise OSError(FAILED.format(path)) from error
        finally:
            if package:
                layer.unlink(missing_ok=True)


def _write_layer(layer: Path, name: Path, frames: Sequence[SavedFrame], scene: Scene, wall: Path, *,
                 lights: bool) -> None:
    stage, rate = Usd.Stage.CreateNew(str(layer)), time_codes_per_second(scene.output.frame_interval)
    codes = [round(rate * frame.time, 6) for frame in frames]
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    stage.SetTimeCodesPerSecond(rate)
    stage.SetFramesPerSecond(rate)
    stage.SetStartTimeCode(math.floor(codes[0]))
    stage.SetEndTimeCode(math.ceil(codes[-1]))  # programs that play whole ones would not show the last frame before
    _describe(stage, scene)

    run = UsdGeom.Xform.Define(stage, f"/{_identifier(scene.name)}")
    run.GetPrim().SetDocumentation("The whole run, in the frame of the eye: x to the patient's left, y superior, z "
                                   "anterior." if scene.eye else "The whole run, in the frame of the container.")
    Usd.ModelAPI(run).SetKind(Kind.Tokens.component)
    stage.SetDefaultPrim(run.GetPrim())
    gravity = run.GetPrim().CreateAttribute("userProperties:gravity", Sdf.ValueTypeNames.Vector3d)
    gravity.SetDocumentation("Acceleration of gravity, m/s2, in the axes of this file: it turns, and the eye stays.")

    meshes = _meshes(stage, run.GetPath(), scene)
    around = mesh_of(wall)
    meshes["wall"].set(around)
    _camera(stage, run.GetPath(), around.vertices)
    if lights:
        _lights(stage, run.GetPath())
    with progress(len(frames), str(name)) as bar:
        for number, (frame, code) in enumerate(zip(frames, codes, strict=True), start=1):
            gravity.Set(Gf.Vec3d(*map(float, frame.read().gravity)), code)
            for liquid in scene.liquids:
                meshes[liquid.name].set(mesh_of(frame.surface_path(liquid.name)), code)
            if number % FRAMES_PER_SAVE == 0:
                stage.Save()
            bar.update()
    # What programs show that know no time.
    for attribute in (gravity, *(one for mesh in meshes.values() for one in mesh.changing)):
        if attribute.GetNumTimeSamples():
            attribute.Set(attribute.Get(codes[-1]))
    stage.Save()


def _describe(stage, scene: Scene) -> None:
    """Say in the file what it is and how it was made."""
    layer = stage.GetRootLayer()
    made = (f"Made by the eye-oil pipeline: smoothed particle hydrodynamics, {scene.accuracy}, "
            f"{1e3 * scene.numerics.particle_spacing:g} mm between particles; surfaces of the liquids every "
            f"{scene.output.frame_interval:g} s of simulated time. A second of playback is a simulated second"
            + (f", which stands for {duration(meant)}." if (meant := scene.output.second_means) else "."))
    free = "The pipeline sets no conditions on the use of what it makes."
    sentences = (scene.label, made, NO_ADVICE if scene.eye else "", free)
    layer.documentation = "\n".join(filter(None, (scene.title, scene.description)))
    layer.comment = "\n".join(filter(None, sentences))
    layer.customLayerData = {"title": scene.title or scene.name, "label": scene.label, "scene": scene.name,
                             "accuracy": scene.accuracy, "made": made, "use": free}


class _Mesh:
    """A mesh of a stage, without triangles at first.

    Attributes
    ----------
    changing : all of its attributes that may change with time.
    """

    def __init__(self, stage, path, color: str, opacity: float, material, meaning: str):
        self.mesh = mesh = UsdGeom.Mesh.Define(stage, path)
        mesh.GetPrim().SetDocumentation(meaning)
        mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
        mesh.CreateDoubleSidedAttr(True)
        mesh.CreateDisplayColorPrimvar(UsdGeom.Tokens.constant).Set([_color(color)])
        mesh.CreateDisplayOpacityPrimvar(UsdGeom.Tokens.constant).Set([opacity])
        mesh.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
        UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(material)
        self.changing = (mesh.CreatePointsAttr(), mesh.CreateNormalsAttr(), mesh.CreateExtentAttr(),
                         mesh.CreateFaceVertexCountsAttr(), mesh.CreateFaceVertexIndicesAttr(),
                         mesh.CreateVisibilityAttr())
        self._count = 0  # points of the last surface
        self._code: float | None = None

    def set(self, surface: trimesh.Trimesh, code: float | None = None) -> None:
        """Show a surface from a time code on, at all times without one; one without triangles is invisible."""
        when = Usd.TimeCode.Default() if code is None else Usd.TimeCode(code)
        if self._code is not None and self._count == len(surface.vertices) > 0:
            # Where their number is the same, programs would move points of one surface to those of another.
            held = self._code + HELD * (code - self._code)
            for attribute in self.changing:
                attribute.Set(attribute.Get(self._code), held)
        self._count, self._code = len(surface.vertices), code
        points, normals = np.asarray(surface.vertices, np.float32), np.zeros((0, 3), np.float32)
        extent, faces = np.zeros((2, 3), np.float32), np.asarray(surface.faces, np.int32)
        if len(faces):
            normals, extent = surface.vertex_normals.astype(np.float32), np.stack([points.min(0), points.max(0)])
        shown = UsdGeom.Tokens.inherited if len(faces) else UsdGeom.Tokens.invisible
        values = (Vt.Vec3fArray.FromNumpy(points), Vt.Vec3fArray.FromNumpy(normals), Vt.Vec3fArray.FromNumpy(extent),
                  Vt.IntArray.FromNumpy(np.full(len(faces), 3, np.int32)), Vt.IntArray.FromNumpy(faces.ravel()), shown)
        for attribute, value in zip(self.changing, values, strict=True):
            attribute.Set(value, when)


def _meshes(stage, run, scene: Scene) -> dict[str, _Mesh]:
    """Define a mesh with its material for every liquid and for the ``wall``."""
    colors = colors_of(scene)
    for folder, meaning in (("surfaces", "Closed surfaces of the liquids, and the wall."),
                            ("materials", "Materials of the surfaces, by the same names.")):
        UsdGeom.Scope.Define(stage, run.AppendChild(folder)).GetPrim().SetDocumentation(meaning)
    meshes = {}
    for (name, (color, opacity)), identifier in zip(colors.items(), identifiers(colors), strict=True):
        meaning = ("Wall of the cavity; half transparent, so that the liquids are seen." if name == "wall" else
                   f"Closed surface of {name}, with triangles of its own at every saved time.")
        material = _material(stage, run.AppendPath(f"materials/{identifier}"), color, opacity)
        meshes[name] = _Mesh(stage, run.AppendPath(f"surfaces/{identifier}"), color, opacity, material, meaning)
        meshes[name].mesh.GetPrim().SetDisplayName(name)
    return meshes


def _material(stage, path, color: str, opacity: float):
    """Define a smooth dielectric."""
    material = UsdShade.Material.Define(stage, path)
    shader = UsdShade.Shader.Define(stage, path.AppendChild("surface"))
    material.GetPrim().SetDocumentation(f"Smooth dielectric of the color {color}.")
    shader.GetPrim().SetDocumentation("What every renderer of USD knows.")
    shader.CreateIdAttr("UsdPreviewSurface")
    for name, kind, value in (("diffuseColor", Sdf.ValueTypeNames.Color3f, _color(color)),
                              ("opacity", Sdf.ValueTypeNames.Float, opacity),
                              ("roughness", Sdf.ValueTypeNames.Float, ROUGHNESS),
                              ("metallic", Sdf.ValueTypeNames.Float, 0.0)):
        shader.CreateInput(name, kind).Set(value)
    material.CreateSurfaceOutput().ConnectToSource(shader.ConnectableAPI(), "surface")
    return material


def _camera(stage, run, points: np.ndarray) -> None:
    """Define a camera that sees all points (n, 3), m."""
    camera = UsdGeom.Camera.Define(stage, run.AppendChild("camera"))
    camera.GetPrim().SetDocumentation("Sees the whole cavity from the patient's left, in front and a little above.")
    center = 0.5 * (points.min(axis=0) + points.max(axis=0))
    radius = MARGIN * np.linalg.norm(points - center, axis=1).max()
    distance = radius / math.sin(math.atan(0.5 * min(APERTURE) / FOCAL_LENGTH))
    camera.CreateFocalLengthAttr(10.0 * FOCAL_LENGTH)  # lengths of a camera are in tenths of the unit
    camera.CreateHorizontalApertureAttr(10.0 * APERTURE[0])
    camera.CreateVerticalApertureAttr(10.0 * APERTURE[1])
    camera.CreateFocusDistanceAttr(float(distance))
    camera.CreateClippingRangeAttr(Gf.Vec2f(float(0.1 * distance), float(10.0 * distance)))
    towards = np.array(CAMERA_FROM) / np.linalg.norm(CAMERA_FROM)
    camera.AddTransformOp().Set(_looking(center + distance * towards, center))


def _lights(stage, run) -> None:
    lights = run.AppendChild("lights")
    UsdGeom.Scope.Define(stage, lights).GetPrim().SetDocumentation("So that the file is not dark when it is opened.")
    sky = UsdLux.DomeLight.Define(stage, lights.AppendChild("sky"))
    sun = UsdLux.DistantLight.Define(stage, lights.AppendChild("sun"))
    sky.GetPrim().SetDocumentation("Light from everywhere.")
    sun.GetPrim().SetDocumentation("Light from above the camera, which shows shapes.")
    sky.CreateIntensityAttr(SKY)
    sun.CreateIntensityAttr(SUN)
    sun.CreateNormalizeAttr(True)  # else the intensity is that of its small disc
    sun.AddTransformOp().Set(_looking(np.array(SUN_FROM), np.zeros(3)))


def _looking(place: np.ndarray, target: np.ndarray):
    """Return the matrix of what is in one place and looks at another one, along its -z axis, with y up."""
    return Gf.Matrix4d().SetLookAt(Gf.Vec3d(*map(float, place)), Gf.Vec3d(*map(float, target)),
                                   Gf.Vec3d(0.0, 1.0, 0.0)).GetInverse()


def _color(color: str):
    return Gf.Vec3f(*map(float, linear(color)))


def _identifier(name: str) -> str:
    return Tf.MakeValidIdentifier(name)


def identifiers(names: Iterable[str]) -> list[str]:
    """Return names as USD allows them, all different: it knows no hyphens.

    >>> identifiers(["light-oil", "light_oil"])
    ['light_oil', 'light_oil_']
    """
    found: list[str] = []
    for name in map(_identifier, names):
        while name in found:
            name += "_"
        found.append(name)
    return found

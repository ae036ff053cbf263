"""An illustration shows what was simulated, where it was, in an eye that is whole; the same bits every time."""
import json
import sys
import types

import drjit
import numpy as np
import pytest
from PIL import Image

from pipeline import illustrate, movie, still, turntable
from pipeline.base.checksum import append_checksum
from pipeline.base.errors import UserError
from pipeline.cavity.signed_distance_grid import distance_of_mesh
from pipeline.illustration import mitsuba_picture
from pipeline.illustration.anatomy import MM, anatomy_of, in_meridian, in_mm, polygon_level
from pipeline.illustration.fundus import SIZE, fundus_texture
from pipeline.illustration.geometry import Liquids, Opening, fundus_places, liquids_of, parts_of_eye
from pipeline.illustration.illustrator import Illustrator
from pipeline.illustration.lettering import in_two_lines, lettered, spread
from pipeline.illustration.style import Style, chosen_renderer
from pipeline.illustration.view import view_of
from pipeline.pictures.anterior_segment import ANGLE, anterior_segment
from pipeline.pictures.fundus_map import disc_direction
from pipeline.scenes.eye_shape import eye_mesh, shape_of
from pipeline.scenes.load import load_scene
from pipeline.scenes.model import Buckle, Eye

SIDEWAYS = np.array([-1.0, 0.0, 0.0])
SMALL = (160, 90)


def of_eye(**options):
    """Anatomy and surface (m) of an eye."""
    import pyvista

    eye = Eye(**options)
    mesh = eye_mesh(shape_of(eye))
    return anatomy_of(eye, distance_of_mesh(mesh, 0.4e-3, 1.6e-3)), pyvista.make_tri_mesh(mesh.vertices, mesh.faces)


@pytest.fixture(scope="module")
def eye():
    """Anatomy and surface (m) of the default eye."""
    return of_eye()


def pyvista_mesh(part):
    import pyvista

    return pyvista.make_tri_mesh(part.points, part.triangles)


def half_full(height=0.0):
    """Closed oil above a height (m), with its depth below the wall."""
    import pyvista

    # Its other sides lie outside the eye, as they do where oil is pushed into the wall.
    box = pyvista.Cube(bounds=(-0.02, 0.02, height, 0.02, -0.02, 0.02)).triangulate().subdivide(4)
    box.point_data["depth"] = np.full(box.n_points, 5e-3)
    return box


def ball(height):
    """Closed oil in the middle of the eye, at a height (m)."""
    import pyvista

    oil = pyvista.Sphere(radius=6e-3, center=(0.0, height, -1e-3))
    oil.clear_data()
    oil.point_data["depth"] = np.full(oil.n_points, 5e-3)
    return oil


def frame(gravity=(0.0, -9.81, 0.0)):
    return types.SimpleNamespace(gravity=np.array(gravity), particle_spacing=1e-3, time=1.5)


def test_layers_of_the_wall_lie_on_each_other_and_do_not_overlap(eye):
    anatomy, _ = eye
    opening = Opening(SIDEWAYS, 14.0)
    levels = {name: getattr(anatomy, name)(opening.points)
              for name in ("inside", "retina", "choroid", "sclera", "ciliary", "iris", "lens", "cornea")}
    covers = np.sum([level < -1e-3 for level in levels.values()], axis=0)
    assert covers.max() == 1
    posterior = (opening.points[:, 2] < 0.0) & (anatomy.outside(opening.points) < -0.02)
    assert (np.min([levels[name] for name in levels], axis=0)[posterior] < 0.02).all()


@pytest.mark.parametrize("options", [
    {"lens": "phakic"}, {"lens": "pseudophakic"}, {"lens": "aphakic"}, {"lens": "aphakic", "anterior_chamber": True}])
def test_every_eye_has_a_cornea_before_its_iris_before_its_lens(options):
    anatomy, _ = of_eye(**options)
    axis = np.stack([np.zeros(600), np.zeros(600), np.linspace(0.0, 14.0, 600)], axis=1)
    beside = axis + np.array([0.0, 4.0, 0.0])
    cornea, iris, lens = (axis[level < 0.0, 2] for level in (
        anatomy.cornea(axis), anatomy.iris(beside), anatomy.lens(axis)))
    assert cornea.max() == pytest.approx(MM * anatomy.segment.apex, abs=0.03)
    assert iris.size and iris.max() < cornea.min()
    assert lens.size == 0 if options["lens"] == "aphakic" else lens.min() < iris.min()


@pytest.mark.parametrize("options, toward", [
    ({}, SIDEWAYS), ({"buckle": Buckle(height=2e-3)}, [0.0, 1.0, 0.0]), ({"lens": "pseudophakic"}, SIDEWAYS),
    ({"lens": "aphakic", "axial_length": 0.030}, [0.0, 1.0, 0.0])])
def test_an_illustration_is_cut_where_the_section_has_its_outlines(options, toward):
    anatomy, surface = of_eye(**options)
    segment, angle = anterior_segment(Eye(**options)), np.linspace(0.0, np.pi, 2000)
    angle = angle[angle < segment.limbus]
    arcs = [MM * reach(angle)[:, None] * np.stack([np.sin(angle), np.cos(angle)], axis=-1)
            for reach in (segment.outside, segment.inside)]
    outlines = {"cornea_cut": np.concatenate([arcs[0], arcs[1][::-1]]), "iris_cut": in_mm(segment.iris())}
    if segment.lens != "aphakic":
        outlines["lens_cut"] = in_mm(segment.own_lens() if segment.lens == "phakic" else segment.implant())
    parts = {part.name: part for part in parts_of_eye(surface, anatomy, Opening(np.array(toward), 16.0))}
    for name, outline in outlines.items():
        face = pyvista_mesh(parts[name]).extract_feature_edges(
            feature_edges=False, manifold_edges=False, non_manifold_edges=False)
        edge = np.stack(in_meridian(np.asarray(face.points)), axis=-1)
        off = np.abs(polygon_level(edge, outline)), np.linalg.norm(outline[:, None] - edge, axis=-1).min(axis=1)
        for points, found in zip((edge, outline), off, strict=True):        # the root of the iris is in the wall
            assert found[points[:, 0] < MM * ANGLE - 0.4].max() < 0.1, name


def test_names_point_at_their_parts(eye):
    anatomy, surface = eye
    scene = load_scene("config/scenes/tamponade.yaml", "draft")
    illustrator = Illustrator(scene, surface, frame().gravity, Style("pyvista", size=SMALL))
    names = {name.text: name.place for name in illustrator._names(Liquids([]))}
    for text, level in {"Cornea": anatomy.cornea, "Iris": anatomy.iris, "Lens": anatomy.lens,
                        "Ciliary body": anatomy.ciliary}.items():
        assert level(names[text][None]) < -0.05 and abs(names[text] @ SIDEWAYS) < 1e-6, text
    assert names["Lens"][1] == pytest.approx(0.0, abs=0.15)


def test_the_face_of_the_oil_is_where_the_oil_is(eye):
    anatomy, _ = eye
    opening = Opening(SIDEWAYS, 14.0)
    found = liquids_of(half_full(height=2e-3), anatomy, opening, 1e-9)
    faces = {part.name: part.points for part in found.parts}
    assert faces["oil_face"][:, 1].min() == pytest.approx(2.0, abs=0.1)
    assert faces["aqueous_face"][:, 1].max() == pytest.approx(2.0, abs=0.1)
    for points in faces.values():
        assert anatomy.inside(points).max() < 15.0
    assert (anatomy.inside(faces["oil_face"]) < 0.1).all() and found.left_out == 0
    assert found.places["oil_face"][1] > 2.0 > found.places["aqueous_face"][1]


def test_drops_of_less_than_three_particles_are_left_out_and_counted(eye):
    import pyvista

    anatomy, _ = eye
    drop = pyvista.Sphere(radius=0.5e-3, center=(0.0, -5e-3, 0.0))
    drop.clear_data()
    drop.point_data["depth"] = np.full(drop.n_points, 5e-3)
    found = liquids_of(pyvista.merge([half_full(), drop], merge_points=False), anatomy,
                       Opening(SIDEWAYS, 14.0), 1e-9)
    assert found.left_out == 1
    face = next(part.points for part in found.parts if part.name == "oil_face")
    assert face[:, 1].min() > -0.1


@pytest.mark.parametrize("right_eye", [True, False])
def test_the_disc_of_the_texture_is_where_the_map_of_the_fundus_has_it(right_eye):
    globe = 11.3e-3
    texture = fundus_texture(globe, right_eye)
    place = fundus_places(1e3 * globe * disc_direction(globe, right_eye)[None])[0]
    column, row = (place * SIZE).astype(int)
    macula = texture[SIZE // 2, SIZE // 2]
    assert texture[row, column].sum() > 1.5 * macula.sum()     # the cup is pale
    assert (place[0] > 0.5) == right_eye                        # nasal: the patient's left of a right eye


@pytest.mark.parametrize("gravity", [[0, -9.81, 0], [0, 0, -9.81], [0, 0, 9.81], [9.81, 0, 0], [-3.0, -9.0, 1.0],
                                     [0, 0, 0]])
@pytest.mark.parametrize("right_eye", [True, False])
def test_up_in_the_picture_is_against_gravity(gravity, right_eye):
    view = view_of(np.array(gravity, float), right_eye, np.zeros(3))
    assert view.axes @ view.axes.T == pytest.approx(np.eye(3), abs=1e-12)
    lower, upper = view.pixel(np.stack([-view.up, view.up]), (1280, 720))
    assert upper[1] < lower[1] and upper[0] == pytest.approx(lower[0], abs=1e-6)
    assert view.axes[2] @ view.toward > 0.8     # it looks into the opened side
    assert view.pixel(view.middle, (1280, 720)) == pytest.approx([640, 360])


def test_a_long_eye_is_as_large_in_the_picture_as_a_usual_one():
    def height(extent: float) -> float:
        view = view_of(np.array([0.0, -9.81, 0.0]), True, np.zeros(3), extent)
        lower, upper = view.pixel(np.array([[0.0, -0.5 * extent, 0.0], [0.0, 0.5 * extent, 0.0]]), (1280, 720))
        return lower[1] - upper[1]
    assert height(24.0) < height(25.5) < 0.95 * 720
    assert height(33.0) == pytest.approx(height(25.5), rel=0.06)


def test_names_stand_apart_in_their_order():
    heights = spread([0.5, 0.501, 0.502, 0.9], [0.06, 0.1, 0.06, 0.06])
    assert (np.diff(heights) >= [0.06 - 1e-9, 0.1 - 1e-9, 0.06 - 1e-9]).all() and max(heights) <= 0.78


def test_light_of_the_white_point_is_white():
    white = mitsuba_picture.WHITE / mitsuba_picture.EXPOSURE
    shown = mitsuba_picture.developed(np.array([[[0.0] * 3, [white] * 3]]))
    assert shown.tolist() == [[[0, 0, 0], [255, 255, 255]]]


@pytest.fixture(scope="module")
def drawn(eye):
    """Pictures of half an eye of oil, by renderer, twice each."""
    _, surface = eye
    scene = load_scene("config/scenes/tamponade.yaml", "draft")
    found = {}
    for renderer in ("mitsuba", "pyvista"):
        illustrator = Illustrator(scene, surface, frame().gravity,
                                  Style(renderer, size=SMALL, samples=2, letters="none"))
        liquids, found[renderer] = illustrator.liquids(frame(), {"silicone_oil_1000": half_full()}), []
        for threads in (1, 2):
            drjit.set_thread_count(threads)
            found[renderer].append(np.asarray(illustrator.picture(frame(), liquids)))
    return found


@pytest.mark.thorough
@pytest.mark.parametrize("renderer", ["mitsuba", "pyvista"])
def test_any_threads_draw_the_same_picture_with_blue_water_below_lighter_oil_in_white_sclera(drawn, renderer):
    first, second = drawn[renderer]
    assert first.shape == (SMALL[1], SMALL[0], 3) and np.array_equal(first, second)
    view = view_of(frame().gravity, True, np.array([0.0, 0.0, 0.69]))
    oil, water = (first[tuple(reversed(view.pixel(np.array([0.0, y, -2.0]), SMALL).astype(int)))].astype(int)
                  for y in (5.0, -5.0))
    assert water[2] > water[0] + 25 and oil[0] > oil[2] + 10
    behind = view.pixel(np.array([0.0, 0.0, -11.95]), SMALL)[0]
    row = first[SMALL[1] // 2, :int(behind)].astype(int)
    assert (row[-12:].min(axis=1) > 150).any() and (row.max(axis=1) > 90).all()


def test_without_mitsuba_pyvista_draws_and_asking_for_it_is_refused(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "mitsuba_oidn", None)
    assert chosen_renderer(None) == "pyvista"
    assert capsys.readouterr().out == "Mitsuba is not installed: drawn by PyVista\n"
    with pytest.raises(UserError, match="--renderer is mitsuba, which is not installed; install it with pip install"):
        chosen_renderer("mitsuba")


@pytest.mark.thorough
def test_a_still_says_what_is_simulated_and_who_has_drawn_it(eye, monkeypatch):
    _, surface = eye
    scene, said = load_scene("config/scenes/tamponade.yaml", "draft"), []
    monkeypatch.setattr("pipeline.illustration.illustrator.lettered",
                        lambda picture, view, names, **words: said.append((names, words)))
    illustrator = Illustrator(scene, surface, frame().gravity, Style("pyvista", size=SMALL))
    illustrator.with_words(None, frame(), illustrator.liquids(frame(), {"silicone_oil_1000": half_full()}))
    names, words = said[0]
    assert [name.text for name in names][:2] == ["Silicone oil 1000", "Aqueous"]
    assert names[0].more.endswith("mm²/s (cSt), floats up")
    assert {"Macula", "Optic disc", "Iris", "Lens", "Cornea"} <= {name.text for name in names}
    white = Illustrator(scene, surface, frame().gravity, Style("pyvista", size=SMALL, look="paper"))
    white.with_words(None, frame(), white.liquids(frame(), {"silicone_oil_1000": half_full()}))
    assert {name.text for name in names} - {name.text for name in said[1][0]} == {"Optic disc"}  # behind white oil
    assert "Shapes of the liquids: simulated" in words["notes"][0] and "drawn by VTK" in words["notes"][0]
    assert words["posture"] == "upright" and words["time"] == "t = 1.50 s, right eye, nasal half"


@pytest.mark.parametrize("gravity, right_eye, words", [
    ([0, -9.81, 0], True, "right eye, nasal half"), ([0, 0, -9.81], False, "left eye, nasal half"),
    ([9.81, 0, 0], False, "left eye, inferior half")])
def test_which_half_of_which_eye_stays_is_said(gravity, right_eye, words):
    toward = view_of(np.array(gravity, float), right_eye, np.zeros(3)).toward
    assert Illustrator.half.fget(types.SimpleNamespace(toward=toward, right_eye=right_eye)) == words
    nasal = 1.0 if right_eye else -1.0          # the patient's left is +x
    assert toward[0] * nasal < 0.0 if "nasal" in words else toward[1] > 0.0


@pytest.mark.parametrize("size", ["10", "1600", "16x9000", "0x900", "wide x high"])
def test_sizes_that_cannot_be_are_told(size):
    with pytest.raises(UserError, match=f"--size: is {size}, but must be such as 1280x720"):
        still.main(["scene.json", "eye.vtp", "frames", "surfaces", "--output", "still.png", "--size", size])


@pytest.mark.parametrize("options, sentence", [
    (["--samples", "0"], "--samples is 0, but must be at least 1"),
    ([], "no such file; run the eye stage first"),
])
def test_wrong_options_are_told_in_one_sentence(tmp_path, options, sentence):
    with pytest.raises(UserError, match=sentence):
        still.main([*(str(tmp_path / name) for name in ("scene.json", "eye.vtp", "frames", "surfaces")),
                    "--output", str(tmp_path / "still.png"), *options])
    assert not (tmp_path / "still.png").exists()


def test_a_scene_in_a_plane_has_no_still():
    scene = load_scene("config/scenes/coupling_2d.yaml", "draft")
    with pytest.raises(UserError, match="coupling_2d: is in two dimensions, but a still shows bodies in space"):
        still.draw(scene, "eye.vtp", frame(), {}, Style("pyvista"))


def test_a_film_that_was_stopped_goes_on_after_its_last_picture(tmp_path, monkeypatch):
    drawn = []

    class Counting:
        stops_after = 2

        def __init__(self, scene, *_, film):
            self.scene = scene

        def liquids(self, *_):
            return None

        def with_words(self, picture, *_):
            return picture

        def picture(self, one, _):
            if len(drawn) == self.stops_after:
                raise KeyboardInterrupt
            drawn.append(one)
            return Image.new("RGB", (4, 4))

    monkeypatch.setattr(illustrate, "Illustrator", Counting)
    def write(name, text):
        (tmp_path / name).write_text(text)
        append_checksum(tmp_path / name)

    for number in range(3):
        write(f"frame_{number:05d}.vtu", "particles")
    (tmp_path / "surfaces").mkdir()
    write("surfaces/frame_00001_aqueous.vtp", "a surface")
    monkeypatch.setattr(illustrate, "read_frame", lambda path: types.SimpleNamespace(name=path.stem, gravity=None))
    monkeypatch.setattr(illustrate, "read_surfaces", lambda *_: {})
    scene = load_scene("config/scenes/tamponade.yaml", "draft")

    def run(depends):
        illustrate.illustrate(scene, None, tmp_path, tmp_path / "surfaces", tmp_path / "out", tmp_path,
                              Style("pyvista"), depends)

    # What was drawn of older surfaces, or beside another last frame, is drawn again.
    for change in (lambda: None, lambda: write("surfaces/frame_00001_aqueous.vtp", "another surface"),
                   lambda: write("frame_00002.vtu", "other particles")):
        change()
        drawn.clear()
        with pytest.raises(KeyboardInterrupt):
            run("a")
        assert [one.name for one in drawn] == ["frame_00000", "frame_00001"] and not (tmp_path / "out").exists()
    drawn.clear()
    run("a")
    assert [one.name for one in drawn] == ["frame_00002"]
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == [f"frame_{k:05d}.png" for k in range(3)]
    begun = tmp_path / "out.begun"
    begun.mkdir()
    (begun / "frame_00000.png").write_bytes(b"of another style")
    (begun / illustrate.DONE_WITH).write_text(json.dumps("other"))
    (tmp_path / "out").rename(tmp_path / "before")
    drawn.clear()
    Counting.stops_after = 9
    run("b")
    assert len(drawn) == 3


def test_the_time_of_a_film_is_that_of_its_pictures_by_their_size_and_paths():
    scene = load_scene("config/scenes/tamponade.yaml", "draft")
    usual = illustrate.expected_minutes(scene, Style("mitsuba", size=(960, 540), samples=1, threads=2))
    assert 201 * 2.0 / 60.0 < usual < 10.0
    assert illustrate.expected_minutes(scene, Style("mitsuba", size=(1920, 1080), samples=1, threads=2)) == 4 * usual
    assert illustrate.expected_minutes(scene, Style("mitsuba", size=(960, 540), samples=4, threads=2)) > 1.5 * usual


@pytest.mark.thorough
def test_a_film_is_traced_where_the_eye_is_and_looks_as_a_still_does(eye):
    """Around the eye nothing changes from frame to frame; in it oil that has moved is seen, also behind the cut."""
    _, surface = eye
    scene, style = load_scene("config/scenes/tamponade.yaml", "draft"), Style("mitsuba", size=SMALL, samples=8)
    film, alone = (Illustrator(scene, surface, frame().gravity, style, film=one) for one in (True, False))
    liquids = [film.liquids(frame(), {"silicone_oil_1000": ball(height)}) for height in (-3e-3, 3e-3)]
    first, second = (np.asarray(film.picture(frame(), one), float) for one in liquids)
    left, upper, right, lower = film._tracer._surroundings.box
    outside = np.ones(first.shape[:2], bool)
    outside[upper:lower, left:right] = False
    assert 0.2 < outside.mean() < 0.8 and np.array_equal(first[outside], second[outside])
    assert np.abs(first - second)[~outside].mean() > 5.0
    again = Illustrator(scene, surface, frame().gravity, style, film=True).picture(frame(), liquids[1])
    assert np.array_equal(second, np.asarray(again))        # whatever was drawn before
    still_picture = np.asarray(alone.picture(frame(), liquids[1]), float)
    assert np.abs(second - still_picture).mean() < 4.0 and np.abs(second - still_picture)[outside].mean() < 3.0


def test_a_box_holds_its_places_with_a_margin_and_stays_in_the_picture():
    box = mitsuba_picture.box_of(np.array([[50.0, 30.0], [100.0, 89.0]]), SMALL)
    assert 40 < box[0] < 50 and 20 < box[1] < 30 and 100 < box[2] < 110 and box[3] == SMALL[1]
    share = mitsuba_picture._fading(box, SMALL)[..., 0]
    assert share[-1, share.shape[1] // 2] == 1.0        # it fades at its own edges, not at those of the picture
    assert share[0].max() < 0.5 and share[:, 0].max() < 0.5


def test_the_interface_is_named_where_it_is_away_from_the_wall(eye):
    anatomy, surface = eye
    found = liquids_of(half_full(height=2e-3), anatomy, Opening(SIDEWAYS, 14.0), 1e-9)
    place = found.places["interface"]
    assert place[1] == pytest.approx(2.0, abs=0.1) and anatomy.inside(place[None])[0] < -0.8
    scene = load_scene("config/scenes/tamponade.yaml", "draft")
    illustrator = Illustrator(scene, surface, frame().gravity, Style("pyvista", size=SMALL))
    assert [words for _, words in illustrator._legend(found)] == ["Silicone oil 1000", "Aqueous", "Interface"]


@pytest.mark.parametrize("pace", ["1.2 × real time", "3.14 weeks per second"])
def test_the_pace_of_a_film_covers_no_words(pace):
    notes = ["Shapes of the liquids: simulated. Around them: " + 9 * "the simulated cavity ", "Oil is drawn. " * 5]
    blank = Image.new("RGB", (960, 540), "white")
    before = lettered(blank, view_of(frame().gravity, True, np.zeros(3)), [], legend=[], title="", time="", label="",
                      posture="", notes=notes)
    after = before.copy()
    movie.write_into_corner(after, pace)
    before, after = np.asarray(before), np.asarray(after)
    assert before[500:].min() < 200 and after[500:].min() < 200
    assert (before[(before != after).any(axis=2)] == 255).all()


def test_a_long_title_stands_in_two_lines_of_about_one_length():
    assert in_two_lines("Emulsified silicone oil, after Song et al., Fig. 8", lambda text: len(text) < 30) == [
        "Emulsified silicone oil,", "after Song et al., Fig. 8"]
    assert in_two_lines("Tamponade", lambda text: True) == ["Tamponade"]
    assert in_two_lines("Pneumonoultramicroscopic", lambda text: False) == ["Pneumonoultramicroscopic"]


def test_a_turntable_ends_where_it_begins_and_never_looks_at_the_edge_of_the_cut():
    swings = turntable.swings(48)
    assert swings[0] == 0.0 and abs(swings[-1] + swings[1]) < 1e-12
    for swing in swings:
        view = view_of(frame().gravity, True, np.zeros(3))
        turned = type(view)(view.up, view.toward, view.middle, float(swing))
        assert turned.axes @ turned.axes.T == pytest.approx(np.eye(3), abs=1e-12)
        assert turned.axes[2] @ view.toward > 0.3 and turned.axes[2] @ view.up == pytest.approx(view.axes[2] @ view.up)


def test_oil_with_a_pocket_of_aqueous_inside_is_pushed_outward_all_the_same(eye):
    import pyvista

    anatomy, _ = eye
    oil = pyvista.Sphere(radius=9e-3, theta_resolution=60, phi_resolution=60)
    pocket = pyvista.Sphere(radius=2e-3).flip_faces()
    both = pyvista.merge([oil, pocket], merge_points=False)
    for surface in (both, both.flip_faces()):
        surface.clear_data()
        surface.point_data["depth"] = np.zeros(surface.n_points)
        found = liquids_of(surface, anatomy, Opening(SIDEWAYS, 14.0), 1e-9)
        interface = next(part for part in found.parts if part.name == "interface")
        away = np.linalg.norm(interface.points, axis=1)
        assert away.max() == pytest.approx(9.65, abs=0.15) and away.min() == pytest.approx(2.0 - 0.65, abs=0.15)
        outward = np.einsum("ij,ij->i", interface.points, interface.normals) / away
        assert outward[away > 5.0].min() > 0.8 and outward[away < 5.0].max() < -0.8

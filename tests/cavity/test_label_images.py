"""Labelled images in place of a mesh: made here of a known eye, read back as its surface, or refused in a sentence."""
import gzip
import json

import nibabel
import nrrd
import numpy as np
import pytest
from conftest import ROOT
from helpers import forked
from helpers.cases import thorough

from pipeline.base.errors import UserError
from pipeline.cavity.landmarks import laid
from pipeline.cavity.mesh_import import import_mesh
from pipeline.scenes.eye_shape import eye_mesh, eye_shape

SHAPE = eye_shape()
EYE = eye_mesh(SHAPE)
BUMP, BUMP_RADIUS = np.array([0.0085, 0.006, -0.002]), 3e-3     # to the patient's left, up: tells mirror images
CENTER = np.array([31.0, 52.0, 12.0])                           # of the eye, RAS, mm: the right one
WAYS = {"R": (1, 0, 0), "L": (-1, 0, 0), "A": (0, 1, 0), "P": (0, -1, 0), "S": (0, 0, 1), "I": (0, 0, -1)}
CUBE = (0.5, 0.5, 0.5)


def level(points):
    """Negative inside the known eye, of points in m: x to the patient's left, y superior, z anterior."""
    return np.minimum(SHAPE.level(points), np.linalg.norm(points - BUMP, axis=-1) - BUMP_RADIUS)


def volume():
    """Volume of the known eye, m3, by fine cells."""
    axis = np.arange(-13e-3, 13e-3, 0.15e-3)
    return (level(np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1)) < 0.0).sum() * 0.15e-3**3


@pytest.fixture(scope="module")
def exact():
    return volume()


def turned(degrees, axis=(1.0, 2.0, 0.5)):
    """Rotation (3, 3) about an axis."""
    axis = np.array(axis) / np.linalg.norm(axis)
    cross = np.cross(np.eye(3), -axis)
    angle = np.radians(degrees)
    return np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross


def segmented(codes="RAS", sizes=CUBE, oblique=0.0, center=CENTER, wide=28.0, label=1):
    """Labels of the known eye, and the affine of their voxels to RAS, mm."""
    sizes = np.array(sizes)
    columns = turned(oblique) @ np.array([WAYS[code] for code in codes], float).T * sizes
    counts = np.ceil(wide / sizes).astype(int)
    affine = np.eye(4)
    affine[:3, :3] = columns
    affine[:3, 3] = center + 0.07 - columns @ (0.5 * (counts - 1))
    index = np.stack(np.meshgrid(*map(np.arange, counts), indexing="ij"), axis=-1)
    right, anterior, superior = np.moveaxis(index @ columns.T + affine[:3, 3] - center, -1, 0)
    inside = level(1e-3 * np.stack([-right, superior, anterior], axis=-1)) < 0.0
    return (label * inside).astype(np.uint8), affine


def nifti(path, labels, affine, unit="mm", kind=nibabel.Nifti1Image):
    image = kind(labels, affine)
    image.header.set_xyzt_units(unit)
    image.header["sform_code"], image.header["qform_code"] = 1, 0
    image.to_filename(path)
    return path


def nrrd_file(path, labels, affine, space="left-posterior-superior", **more):
    flip = {"left-posterior-superior": [-1, -1, 1], "LAS": [-1, 1, 1]}.get(space, [1, 1, 1])
    affine = np.diag([*flip, 1]) @ affine
    head = {"space": space, "space directions": affine[:3, :3].T, "space origin": affine[:3, 3],
            "space units": ["mm"] * 3, **more}
    nrrd.write(str(path), labels, {key: value for key, value in head.items() if value is not None})
    return path


def lying(path, label=1, side="right", **options):
    """Return the surface as the eye stage lays it, what was done, and what is said."""
    found = import_mesh(path, label=label, side=side, **options)
    mesh, lies = laid(found.mesh, None, side, str(path), found.space)
    return mesh, found, lies


def is_the_eye(mesh, exact, sizes=CUBE):
    """Whether a surface is that of the known eye, at its place and not mirrored."""
    assert mesh.is_watertight and mesh.volume == pytest.approx(exact, rel=5e-3)
    away = level(mesh.vertices)
    assert np.sqrt((away**2).mean()) < 0.25e-3 * max(sizes)
    far = mesh.vertices[SHAPE.level(mesh.vertices) > 1.2e-3]
    assert len(far) and np.linalg.norm(far.mean(axis=0) / np.linalg.norm(far.mean(axis=0))
                                       - BUMP / np.linalg.norm(BUMP)) < 0.1
    return True


@pytest.mark.parametrize(("codes", "sizes", "oblique"), [
    thorough("RAS", CUBE, 0.0), ("LPS", CUBE, 0.0), thorough("LAS", CUBE, 0.0), ("PIR", (0.4, 0.5, 0.6), 0.0),
    ("RAS", CUBE, 25.0), thorough("LIA", (0.5, 0.4, 1.0), -15.0), ("LAS", (0.3, 0.3, 1.5), 10.0)])
def test_every_orientation_gives_the_eye(exact, tmp_path, codes, sizes, oblique):
    mesh, found, lies = lying(nifti(tmp_path / "eye.nii.gz", *segmented(codes, sizes, oblique)))
    assert is_the_eye(mesh, exact, sizes)
    assert lies == ["turned as the head of its file tells, whose axes are RAS"] and not found.warnings
    assert found.repairs[0].startswith("read label 1 of an image of ")
    assert "its steps were smoothed at the same volume" in found.repairs[0]


@pytest.mark.parametrize("space", ["left-posterior-superior", thorough("right-anterior-superior"), thorough("LAS")])
@pytest.mark.parametrize("name", ["eye.nrrd", "eye.nhdr"])
def test_nrrd_gives_the_eye(exact, tmp_path, space, name):
    mesh, found, lies = lying(nrrd_file(tmp_path / name, *segmented("LPS", (0.4, 0.5, 0.6)), space=space))
    assert is_the_eye(mesh, exact) and "as the head of its file tells" in lies[0] and not found.warnings


@pytest.mark.thorough
def test_the_area_is_that_of_the_eye(tmp_path):
    """Steps of voxels would have up to half as much again."""
    labels, affine = segmented(wide=28.0)
    mesh, *_ = lying(nifti(tmp_path / "eye.nii", labels, affine))
    fine, *_ = lying(nifti(tmp_path / "fine.nii", *segmented(sizes=(0.2, 0.2, 0.2))))
    assert mesh.area == pytest.approx(fine.area, rel=0.01)


def test_an_image_without_orientation_lies_as_its_flat_side_says(exact, tmp_path):
    labels, affine = segmented("LPS")
    nifti(tmp_path / "eye.nii", labels, affine)
    content = (tmp_path / "eye.nii").read_bytes()
    (tmp_path / "eye.nii").write_bytes(content[:252] + bytes(4) + content[256:])    # qform_code and sform_code
    mesh, found, lies = lying(tmp_path / "eye.nii")
    assert mesh.volume == pytest.approx(exact, rel=5e-3)
    assert "its head does not tell how it lies (sform_code and qform_code are 0)" in found.warnings[0]
    assert "its flat side, where the lens is, is toward" in lies[0]
    mesh, found, _ = lying(nrrd_file(tmp_path / "eye.nrrd", labels, affine, space="scanner-xyz"))
    assert 'its space is "scanner-xyz"' in found.warnings[0] and mesh.volume == pytest.approx(exact, rel=5e-3)


# Units

def test_units_of_the_head_are_taken(exact, tmp_path):
    labels, affine = segmented()
    for unit, factor in (("meter", 1e-3), ("micron", 1e3)):
        scaled = np.diag([factor, factor, factor, 1.0]) @ affine
        assert is_the_eye(lying(nifti(tmp_path / "eye.nii", labels, scaled, unit))[0], exact)
    mesh, *_ = lying(nrrd_file(tmp_path / "eye.nrrd", labels, np.diag([0.1, 0.1, 0.1, 1.0]) @ affine,
                               **{"space units": ["cm"] * 3}))
    assert is_the_eye(mesh, exact)
    mesh, found, _ = lying(nifti(tmp_path / "eye.nii", labels, affine, "unknown"))
    assert is_the_eye(mesh, exact)
    assert "its head names no unit of length: it was taken to be in mm (eye.unit)" in found.warnings[0]
    with pytest.raises(UserError, match=r"measures .* mm, but an eye's .*set eye\.unit: cm"):
        lying(nifti(tmp_path / "eye.nii", labels, np.diag([0.1, 0.1, 0.1, 1.0]) @ affine))
    with pytest.raises(UserError, match="its units are furlong, but must be one of m, cm, mm, um, in"):
        lying(nrrd_file(tmp_path / "eye.nrrd", labels, affine, **{"space units": ["furlong"] * 3}))


# Labels

def head_of(**changes):
    """Both eyes of a head with their lenses, and a large label, voxels of 1.5 mm."""
    sizes, labels, affine = (1.0, 1.0, 1.0), np.zeros((150, 40, 40), np.uint8), np.eye(4)
    affine[:3, 3] = [-74.5, 30.0, -8.0]
    index = np.stack(np.meshgrid(*map(np.arange, labels.shape), indexing="ij"), axis=-1)
    right, anterior, superior = np.moveaxis(index * np.array(sizes) + affine[:3, 3], -1, 0)
    for label, x in ((3, 31.0), (4, -31.0)):
        place = np.stack([-(right - x), superior - 12.0, anterior - 52.0], axis=-1)
        labels[SHAPE.level(1e-3 * place) < 0.0] = label
        labels[np.linalg.norm(place - [0.0, 0.0, 8.5], axis=-1) < 2.5] = label + 2
    labels[2:-2, 2:12, 2:-2] = 9
    return labels, affine


def test_a_missing_label_is_answered_by_the_labels_with_their_volumes(tmp_path):
    path = nifti(tmp_path / "head.nii.gz", *head_of())
    with pytest.raises(UserError) as error:
        import_mesh(path)
    said = str(error.value)
    assert "(eye.label): is missing; the image has 3 (" in said and "9 (52.6 mL)" in said
    assert said.endswith("set eye.label: 3") or said.endswith("set eye.label: 4")
    with pytest.raises(UserError, match=r"\(eye\.label\): is 7, which is not in the image; the image has 3 \("):
        import_mesh(path, label=7)
    with pytest.raises(UserError, match="it has no labels at all, every voxel is 0"):
        import_mesh(nifti(tmp_path / "none.nii", 0 * head_of()[0], np.eye(4)))


def test_names_of_segments_are_told(tmp_path):
    labels, affine = segmented(label=2)
    labels[:3, :3, :3] = 1
    path = nrrd_file(tmp_path / "eye.seg.nrrd", labels, affine, **{
        "Segment0_Name": "Lens", "Segment0_LabelValue": "1", "Segment1_Name": "Vitreous left",
        "Segment1_LabelValue": "2"})
    with pytest.raises(UserError, match=r"1 \(Lens, .* mL\), 2 \(Vitreous left, .* mL\): 2 is probably meant"):
        import_mesh(path)
    with pytest.raises(UserError, match=r'it is the left eye by the name of its label, "Vitreous left", but eye\.side '
                                        r"is right: set eye\.side: left"):
        import_mesh(path, label=2)
    assert "read label 2 (Vitreous left) of" in import_mesh(path, label=2, side="left").repairs[0]


def test_the_side_is_told_by_the_other_eye_or_the_head(tmp_path):
    labels, affine = head_of()
    path = nifti(tmp_path / "head.nii.gz", labels, affine)
    assert not lying(path, 3)[1].warnings and not lying(path, 4, "left")[1].warnings
    with pytest.raises(UserError, match=r"eye.label: 4\): it is the left eye beside the one with the label 3, but"):
        import_mesh(path, label=4)
    assert "it is the left eye" in import_mesh(path, label=4, force=True).warnings[0]
    alone = nifti(tmp_path / "alone.nii.gz", np.where(labels == 4, 4, 0).astype(np.uint8), affine)
    assert "it is the left eye by its place in the image of a head, but eye.side is right" in lying(
        alone, 4)[1].warnings[0]


# What is no cavity

def spoiled(kind):
    labels, affine = segmented()
    shape = np.array(labels.shape)
    if kind == "border":
        labels = labels[:, : shape[1] - 22]
    elif kind == "two":
        labels = np.concatenate([labels, labels])
    elif kind == "wall":
        from scipy.ndimage import binary_erosion
        labels = labels - binary_erosion(labels, iterations=3).astype(np.uint8)
    elif kind == "gray":
        return (100.0 * labels + np.random.default_rng(1).random(labels.shape)).astype(np.float32), affine
    elif kind == "ct":
        return np.arange(labels.size, dtype=np.int32).reshape(labels.shape) % 4000 - 1000, affine
    elif kind == "times":
        labels = np.stack([labels, labels], axis=-1)
    elif kind == "slice":
        labels = labels[:, :, 28:29]
    elif kind == "thick":
        return segmented(sizes=(0.5, 0.5, 5.0))
    return labels, affine


REFUSED = {"border": "reaches the anterior border of the image, which may cut it off",
           "two": r"has 2 separate pieces \(5\.\d+ mL around \(.*give each eye a label of its own",
           "wall": "encloses a hollow of .* like the wall of the eye",
           "gray": "its values are not whole numbers, as those of gray images",
           "ct": "holds 3999 different values, like a gray image",
           "times": r"has 4 axes \(56 x 56 x 56 x 2\), but a labelled image has three",
           "slice": "is one slice",
           "thick": "is only [45] voxels wide along one of its axes, of 0.5 x 0.5 x 5 mm each"}


@pytest.mark.parametrize("kind", REFUSED)
def test_what_is_no_cavity_is_one_sentence(tmp_path, kind):
    labels, affine = spoiled(kind)
    with pytest.raises(UserError, match=REFUSED[kind]) as error:
        import_mesh(nifti(tmp_path / "eye.nii", labels, affine), label=1)
    assert "\n" not in str(error.value) and "eye.nii (eye." in str(error.value)


def test_voxels_without_a_size_are_refused(tmp_path):
    labels, affine = segmented()
    with pytest.raises(UserError, match="its head gives voxels without a size or a place"):
        import_mesh(nrrd_file(tmp_path / "eye.nrrd", labels, affine @ np.diag([1.0, 1.0, 0.0, 1.0])), label=1)


def test_sizes_of_voxels_are_never_guessed(tmp_path, capfd):
    """A head without them would make an eye of another size, which nobody sees."""
    labels, affine = segmented(sizes=(0.6, 0.6, 0.6))
    cases = []
    for name, spacings in (("none.nrrd", None), ("one_missing.nrrd", [0.6, 0.6, np.nan])):
        nrrd.write(str(tmp_path / name), labels, {} if spacings is None else {"spacings": spacings})
        cases.append((name, "neither space directions nor spacings of all axes"))
    content = bytearray(nifti(tmp_path / "eye.nii", labels, affine).read_bytes())
    content[252:256], content[80:92] = bytes(4), bytes(12)  # qform_code, sform_code and pixdim
    (tmp_path / "eye.nii").write_bytes(content)
    for name, words in [*cases, ("eye.nii", "gives voxels without a size")]:
        with pytest.raises(UserError, match=words):
            import_mesh(tmp_path / name, label=1)
    assert not "".join(capfd.readouterr())


def test_heads_that_contradict_themselves_or_tell_no_side_are_told(tmp_path):
    labels, affine = segmented()
    content = bytearray(nifti(tmp_path / "eye.nii", labels, affine).read_bytes())
    content[80:92] = np.array([0.45] * 3, "<f4").tobytes()
    (tmp_path / "eye.nii").write_bytes(content)
    warning, = import_mesh(tmp_path / "eye.nii", label=1).warnings
    assert "voxels of 0.45 x 0.45 x 0.45 (pixdim) and of 0.5 x 0.5 x 0.5 (sform)" in warning
    nrrd_file(tmp_path / "eye.nrrd", labels, affine, space=None, **{"space dimension": 3})
    warning, = import_mesh(tmp_path / "eye.nrrd", label=1).warnings
    assert "it names no space" in warning and "left and right may be exchanged" in warning


def test_an_ending_that_contradicts_the_content_is_told(tmp_path):
    labels, affine = segmented()
    packed = nifti(tmp_path / "a.nii.gz", labels, affine).read_bytes()
    (tmp_path / "packed.nii").write_bytes(packed)
    (tmp_path / "plain.nii.gz").write_bytes(gzip.decompress(packed))
    for name, words in (("packed.nii", "give it the ending .nii.gz"), ("plain.nii.gz", "give it the ending .nii$")):
        with pytest.raises(UserError, match=words):
            import_mesh(tmp_path / name, label=1)


def test_specks_and_hollows_are_mended_and_told(exact, tmp_path):
    labels, affine = segmented()
    labels[2:4, 2:4, 2:4] = 1
    labels[26:29, 26:29, 26:29] = 0
    mesh, found, _ = lying(nifti(tmp_path / "eye.nii", labels, affine))
    assert is_the_eye(mesh, exact)
    assert any("dropped 1 loose pieces with 0.0" in one for one in found.repairs)
    assert any("filled hollows with 0.0" in one for one in found.repairs)


@pytest.mark.thorough
def test_whole_numbers_are_read_whatever_their_kind(exact, tmp_path):
    labels, affine = segmented()
    for kind in (np.int16, np.float32, np.float64):
        assert is_the_eye(lying(nifti(tmp_path / "eye.nii.gz", labels.astype(kind), affine))[0], exact)
    image = nibabel.Nifti2Image(labels[..., None], affine)
    image.header["sform_code"] = 1
    image.header.set_xyzt_units("mm")
    image.to_filename(tmp_path / "two.nii")
    assert is_the_eye(lying(tmp_path / "two.nii")[0], exact)


@pytest.mark.parametrize("name", ["eye.nii", "eye.nii.gz", "eye.nrrd"])
def test_damaged_files_are_one_sentence(tmp_path, name):
    path = tmp_path / name
    (nifti if "nii" in name else nrrd_file)(path, *segmented())
    whole = path.read_bytes()
    for content in (whole[:len(whole) // 2], whole[:100], b"", b"version https://git-lfs.github.com/spec", b"x" * 999):
        path.write_bytes(content)
        with pytest.raises(UserError) as error:
            import_mesh(path, label=1)
        assert name in str(error.value) and "\n" not in str(error.value)


def test_voxels_of_a_head_lie_beside_it(tmp_path):
    path = nrrd_file(tmp_path / "eye.nhdr", *segmented())
    text = path.read_text()
    beside = next(one for one in tmp_path.iterdir() if one.name != "eye.nhdr")
    path.write_text(text.replace(beside.name, f"../{beside.name}"))
    with pytest.raises(UserError, match=r"its voxels are in \.\./.*, but must be in a file beside it"):
        import_mesh(path, label=1)
    path.write_text(text)
    beside.unlink()
    with pytest.raises(UserError, match="which is not beside it"):
        import_mesh(path, label=1)


# At the command line

def stage(folder, eye):
    (folder / "tamponade.yaml").write_text((ROOT / "config/scenes/clinic/tamponade.yaml").read_text())
    (folder / "case.yaml").write_text(f"extends: tamponade\nnumerics: {{particle_spacing: 2 mm}}\neye: {eye}\n")
    done = forked.run("pipeline.scene", folder / "case.yaml", "--config-dir", ROOT / "config", "--output",
                      folder / "scene.json")
    if done.returncode:
        return done
    return forked.run("pipeline.eye", folder / "scene.json", "--output", folder / "eye.vtp", "--report",
                      folder / "eye.json")


def test_the_stage_reads_an_image(tmp_path):
    nifti(tmp_path / "head.nii.gz", *head_of())
    done = stage(tmp_path, "{model: mesh, path: head.nii.gz}")
    assert done.returncode == 2 and "set eye.label: " in done.stderr and "Traceback" not in done.stderr
    done = stage(tmp_path, "{model: mesh, path: head.nii.gz, label: 4, side: left}")
    assert done.returncode == 0, done.stderr
    assert "repair: read label 4 of an image of 150 x 40 x 40 voxels of 1 x 1 x 1 mm: 5." in done.stdout
    assert "orientation: turned as the head of its file tells, whose axes are RAS" in done.stdout
    bounds = np.array(json.loads((tmp_path / "eye.json").read_text())["bounds"])
    np.testing.assert_allclose(bounds, EYE.bounds, atol=1e-3)


@pytest.mark.thorough
def test_a_label_without_an_image_is_refused(tmp_path):
    done = stage(tmp_path, "{label: 4}")
    assert done.returncode == 2 and "eye.label is given, but model is parametric" in done.stderr
    done = stage(tmp_path, "{model: mesh, path: eye.stl, label: 4}")
    assert done.returncode == 2 and "eye.stl is no labelled image" in done.stderr

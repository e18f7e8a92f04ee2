"""Parts from good files, from bad files, and what they weigh."""

import logging
import zipfile

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from kumitate.errors import InputError
from kumitate.grasping.contacts import sample_contacts
from kumitate.grasping.facets import segment
from kumitate.grasping.parameters import GraspParameters
from kumitate.grasping.part import MOST_FACES, Part


@pytest.fixture
def box():
    return trimesh.creation.box([40.0, 30.0, 20.0])


@pytest.mark.parametrize("suffix", ["stl", "obj", "ply", "off", "glb", "STL"])
def test_reads_the_formats(tmp_path, box, suffix):
    path = tmp_path / f"box.{suffix}"
    path.write_bytes(_exported(box, suffix.lower()))
    part = Part.load(path, unit="mm", density=1000.0)
    assert part.name == "box"
    assert part.watertight
    assert part.mesh.extents == pytest.approx([0.04, 0.03, 0.02])
    assert part.mass == pytest.approx(0.024)
    assert part.center_of_mass == pytest.approx(np.zeros(3), abs=1e-9)
    assert (len(part.mesh.faces), len(part.mesh.vertices)) == (12, 8)


def _exported(mesh, kind):
    content = mesh.export(file_type=kind)
    return content.encode() if isinstance(content, str) else content


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), offset=st.floats(-1.0, 1.0))
def test_mass_properties_are_those_of_the_solid(random_part, seed, offset):
    part = random_part(seed)
    moved = Part.from_mesh(part.mesh.copy().apply_translation([offset, -offset, 0.5]), density=500.0)
    assert moved.watertight
    assert moved.mass == pytest.approx(500.0 * abs(part.mesh.volume), rel=1e-6)
    assert moved.center_of_mass - [offset, -offset, 0.5] == pytest.approx(part.center_of_mass, abs=1e-6)
    assert part.center_of_mass == pytest.approx(part.mesh.center_mass, abs=1e-9)


def test_equal_shapes_have_equal_digests(block):
    shuffled = Part.from_mesh(trimesh.Trimesh(block.mesh.vertices, block.mesh.faces[::-1], process=False), mass=0.2)
    taller = Part.from_mesh(trimesh.creation.box([0.04, 0.03, 0.021]), mass=0.1)
    assert block.digest == shuffled.digest
    assert block.digest != taller.digest


@pytest.mark.parametrize(("unit", "likely"), [("m", "mm or cm or in"), ("cm", None), ("mm", None), ("in", None)])
def test_unit_decides_the_size(box, unit, likely):
    if likely:
        with pytest.raises(InputError, match=rf"in {unit} the part would be 40 m long; the unit is likely {likely}"):
            Part.from_mesh(box, unit=unit, mass=0.1)
    else:
        assert Part.from_mesh(box, unit=unit, mass=0.1).mesh.extents[0] <= 2.0


def test_too_small_names_the_likely_unit(box):
    metres = box.apply_scale(1e-3)
    with pytest.raises(InputError, match=r"in mm the part would be 4e-05 m long; the unit is likely m"):
        Part.from_mesh(metres, unit="mm", mass=0.1)


def test_no_such_unit(box):
    with pytest.raises(InputError, match=r"no unit 'furlong'; give one of mm, cm, m, in"):
        Part.from_mesh(box, unit="furlong", mass=0.1)


@pytest.mark.parametrize(
    "weight", [{}, {"mass": 1.0, "density": 1.0}, {"mass": 0.0}, {"mass": -1.0}, {"mass": np.nan}, {"density": np.inf}]
)
def test_weight_is_one_positive_number(box, weight):
    with pytest.raises(InputError, match=r"mass .*density|positive number"):
        Part.from_mesh(box, unit="mm", **weight)


# Files that are no meshes


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("empty.stl", b""),
        ("text.stl", b"this is a letter, not a mesh\n" * 40),
        ("html.stl", b"<!doctype html><title>404</title>" * 20),
        ("noise.stl", bytes(range(256)) * 10),
        ("noise.ply", bytes(range(256)) * 10),
        ("noise.obj", bytes(range(256)) * 10),
        ("noise.off", bytes(range(256)) * 10),
        ("noise.glb", bytes(range(256)) * 10),
        (
            "header.ply",
            b"ply\nformat binary_little_endian 1.0\nelement vertex 4000000000\nproperty float x\nend_header\n",
        ),
        ("bomb.glb", b"glTF\x02\x00\x00\x00\xff\xff\xff\xff\xff\xff\xff\x7fJSON{}"),
        ("vertices.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\n"),
        ("outside.obj", b"v 0 0 0\nv 10 0 0\nv 0 10 0\nf 1 2 9\n"),
        ("plane.obj", b"v 0 0\nv 10 0\nv 0 10\nv 10 10\nf 1 2 3\nf 1 3 4\n"),
        ("nothing.stl", b"solid nothing\nendsolid nothing\n"),
        ("mesh.step", b"ISO-10303-21;"),
        ("nosuffix", b"solid x"),
    ],
)
def test_what_is_no_mesh_is_refused_with_its_place(tmp_path, name, content):
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(InputError, match=name) as refused:
        Part.load(path, unit="mm", mass=0.1)
    assert refused.value.cure


@pytest.mark.parametrize("kind", ["stl", "stl_ascii", "ply", "glb"])
@pytest.mark.parametrize("share", [0.3, 0.6, 0.9])
def test_a_truncated_file_is_refused(tmp_path, kind, share):
    content = _exported(trimesh.creation.icosphere(radius=20.0), kind)
    path = tmp_path / f"cut.{kind.removesuffix('_ascii')}"
    path.write_bytes(content[: int(share * len(content))])
    with pytest.raises(InputError, match=r"cut\."):
        Part.load(path, unit="mm", mass=0.1)


@pytest.mark.parametrize("kind", ["obj", "off"])
@pytest.mark.parametrize("share", [0.3, 0.6, 0.9])
def test_a_file_cut_between_two_faces_is_refused_or_warned_of(tmp_path, kind, share):
    lines = _exported(trimesh.creation.icosphere(radius=20.0), kind).splitlines(keepends=True)
    path = tmp_path / f"cut.{kind}"
    path.write_bytes(b"".join(lines[: int(share * len(lines))]))
    try:
        said = Part.load(path, unit="mm", mass=0.1).warnings
    except InputError as error:
        said = (str(error),)
    assert any("does not bound a volume" in sentence or f"cut.{kind}" in sentence for sentence in said)


def test_a_missing_file_and_a_folder_are_refused(tmp_path):
    with pytest.raises(InputError, match=r"absent\.stl"):
        Part.load(tmp_path / "absent.stl", unit="mm", mass=0.1)
    (tmp_path / "folder.stl").mkdir()
    with pytest.raises(InputError, match=r"folder\.stl"):
        Part.load(tmp_path / "folder.stl", unit="mm", mass=0.1)


def test_a_file_past_the_limit_is_not_read(tmp_path):
    path = tmp_path / "huge.stl"
    with path.open("wb") as file:
        file.truncate(65 * 2**20)  # sparse
    with pytest.raises(InputError, match=r"65 MiB are more than the limit of 64 MiB"):
        Part.load(path, unit="mm", mass=0.1)


@pytest.mark.parametrize("suffix", ["3mf", "zip", "stl", "glb"])
def test_an_archive_is_not_unpacked(tmp_path, suffix):
    path = tmp_path / f"bomb.{suffix}"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("3D/3dmodel.model", b"0" * 50_000_000)
    with pytest.raises(InputError, match=r"bomb\."):
        Part.load(path, unit="mm", mass=0.1)


def test_a_mesh_names_no_other_file(tmp_path, box):
    (tmp_path / "box.mtl").write_text("newmtl a\nmap_Kd /etc/passwd\n")
    path = tmp_path / "box.obj"
    path.write_text("mtllib box.mtl\nusemtl a\n" + _exported(box, "obj").decode())
    assert len(Part.load(path, unit="mm", mass=0.1).mesh.faces) == 12


# Meshes that are no parts


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_vertices_that_are_not_finite_are_refused(box, value):
    vertices = box.vertices.copy()
    vertices[3, 1] = value
    with pytest.raises(InputError, match=r"1 vertices are not finite, the first is number 3"):
        Part.from_mesh(trimesh.Trimesh(vertices, box.faces, process=False), unit="mm", mass=0.1)


def test_no_triangles():
    with pytest.raises(InputError, match="no triangles"):
        Part.from_mesh(trimesh.Trimesh(), unit="mm", mass=0.1)


def test_one_triangle_and_flat_sheets_are_refused():
    triangle = trimesh.Trimesh([[0, 0, 0], [10, 0, 0], [0, 10, 0]], [[0, 1, 2]], process=False)
    sheet = trimesh.creation.box([40.0, 30.0, 0.0])
    for mesh in (triangle, sheet, trimesh.creation.box([40.0, 30.0, 1e-5])):
        with pytest.raises(InputError, match=r"flat.*thickness"):
            Part.from_mesh(mesh, unit="mm", mass=0.1)


def test_too_many_faces_are_refused_with_the_cure(tmp_path):
    sphere = trimesh.creation.icosphere(subdivisions=7, radius=50.0)  # 327,680 faces
    assert len(sphere.faces) > MOST_FACES
    path = tmp_path / "fine.stl"
    sphere.export(path)
    with pytest.raises(InputError, match=r"fine\.stl: 327680 faces are more than the 200000 .*coarser"):
        Part.load(path, unit="mm", mass=0.1)


# Meshes that are repaired


def test_repairs_are_said(box, caplog):
    doubled = trimesh.util.concatenate([box, box])
    with caplog.at_level(logging.INFO, logger="kumitate"):
        part = Part.from_mesh(doubled, unit="mm", mass=0.1, name="twice")
    assert part.repairs == ("duplicate faces dropped: 12",)
    assert "twice: duplicate faces dropped: 12" in caplog.text


def test_an_open_mesh_is_planned_on_with_the_hulls_mass_and_a_warning(box, caplog):
    lid = np.flatnonzero(box.face_normals[:, 2] > 0.5)
    tray = trimesh.Trimesh(box.vertices, np.delete(box.faces, lid, axis=0), process=False)
    part = Part.from_mesh(tray, unit="mm", density=1000.0)
    assert not part.watertight
    assert part.mass == pytest.approx(0.024)
    assert part.center_of_mass == pytest.approx(np.zeros(3), abs=1e-9)
    assert any("convex hull" in warning for warning in part.warnings)
    assert "convex hull" in caplog.text
    assert len(part.mesh.faces) == 10


BROKEN = {
    "inverted": lambda m: trimesh.Trimesh(m.vertices, m.faces[:, ::-1], process=False),
    "half inverted": lambda m: trimesh.Trimesh(
        m.vertices, np.where((np.arange(len(m.faces)) % 3 == 0)[:, None], m.faces[:, ::-1], m.faces), process=False
    ),
    "unmerged": lambda m: trimesh.Trimesh(
        m.triangles.reshape(-1, 3), np.arange(3 * len(m.faces)).reshape(-1, 3), process=False
    ),
    "doubled": lambda m: trimesh.util.concatenate([m, m]),
    "two-sided": lambda m: trimesh.Trimesh(m.vertices, np.vstack([m.faces, m.faces[:, ::-1]]), process=False),
    "one face missing": lambda m: trimesh.Trimesh(m.vertices, m.faces[1:], process=False),
    "noisy seams": lambda m: trimesh.Trimesh(
        m.triangles.reshape(-1, 3) + np.random.default_rng(5).normal(scale=1e-5, size=(3 * len(m.faces), 3)),
        np.arange(3 * len(m.faces)).reshape(-1, 3),
        process=False,
    ),
}


# Nothing in a two-sided hollow ball tells a cavity from a ball within a ball.
@pytest.mark.parametrize(
    ("kind", "shape"),
    [(k, s) for k in BROKEN for s in ("box", "torus", "hollow ball") if (k, s) != ("two-sided", "hollow ball")],
)
def test_broken_meshes_plan_like_sound_ones(kind, shape):
    sound = {
        "box": trimesh.creation.box([40.0, 30.0, 20.0]),
        "torus": trimesh.creation.torus(20.0, 6.0, 24, 16),
        "hollow ball": trimesh.util.concatenate(
            [trimesh.creation.icosphere(2, 20.0), BROKEN["inverted"](trimesh.creation.icosphere(2, 12.0))]
        ),
    }[shape]
    part, reference = (Part.from_mesh(mesh, unit="mm", density=1000.0) for mesh in (BROKEN[kind](sound), sound))
    assert not reference.repairs
    assert part.watertight
    assert len(part.mesh.faces) == len(reference.mesh.faces)
    assert part.mesh.volume == pytest.approx(sound.volume * 1e-9, rel=1e-4)
    assert part.mass == pytest.approx(reference.mass, rel=1e-4)
    assert part.center_of_mass == pytest.approx(reference.center_of_mass, abs=1e-6)


@pytest.mark.parametrize("flip", [(1, 1, 1), (-1, 1, 1), (1, -1, 1), (1, 1, -1)])
def test_as_few_faces_as_possible_are_turned(box, flip):
    """Whichever face is wound wrongly, also the one the search starts from."""
    box.apply_transform(np.diag([*flip, 1.0]))
    for turned in range(12):
        faces = box.faces.copy()
        faces[turned] = faces[turned, ::-1]
        part = Part.from_mesh(trimesh.Trimesh(box.vertices, faces, process=False), unit="mm", mass=0.1)
        assert part.repairs == ("faces wound against their neighbours turned: 1",)
        assert part.mesh.volume == pytest.approx(24e-6)


def test_lone_triangles_get_no_backs():
    """The rim of a lone triangle is no hole to fill."""
    centers = trimesh.creation.icosphere(1, 20.0).triangles_center
    loose = (centers[:, None] + 2.0 * np.eye(3)).reshape(-1, 3)
    part = Part.from_mesh(trimesh.Trimesh(loose, np.arange(240).reshape(-1, 3), process=False), unit="mm", mass=0.1)
    assert len(part.mesh.faces) == 80
    assert not part.watertight


def test_two_bodies_stay_two():
    blocks = [trimesh.creation.box([20.0, 20.0, 20.0]) for _ in range(2)]
    blocks[1].apply_translation([30.0, 0.0, 0.0])
    part = Part.from_mesh(trimesh.util.concatenate(blocks), unit="mm", density=1000.0)
    assert part.watertight
    assert not part.warnings
    assert part.mass == pytest.approx(0.016)
    assert part.center_of_mass == pytest.approx([0.015, 0.0, 0.0])


def test_bodies_that_overlap_are_warned_of():
    blocks = [trimesh.creation.box([20.0, 20.0, 20.0]) for _ in range(2)]
    blocks[1].apply_translation([10.0, 3.0, 1.0])
    part = Part.from_mesh(trimesh.util.concatenate(blocks), unit="mm", density=1000.0)
    assert any("overlaps itself" in warning for warning in part.warnings)
    assert len(part.mesh.faces) == 24


def test_slivers_leave_no_crack():
    """A vertex in the middle of an edge, tied in by a triangle without area, as exporters write them."""
    box = trimesh.creation.box([40.0, 30.0, 20.0])
    a, b, c = box.faces[0]
    middle = len(box.vertices)
    vertices = np.vstack([box.vertices, (box.vertices[a] + box.vertices[b]) / 2])
    faces = np.vstack([box.faces[1:], [[a, middle, c], [middle, b, c], [a, b, middle]]])
    part = Part.from_mesh(trimesh.Trimesh(vertices, faces, process=False), unit="mm", density=1000.0)
    assert part.watertight
    assert part.mesh.is_watertight
    assert part.mass == pytest.approx(0.024)
    assert part.repairs == ("faces without area dropped: 1",)
    assert len(segment(part, 0.0, 0.0)) == 6


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), faces=st.integers(1, 60))
def test_any_soup_is_planned_on_or_refused(seed, faces):
    """Random triangles, some of them degenerate, shared or doubled: never anything but a part or an InputError."""
    rng = np.random.default_rng(seed)
    vertices = rng.choice([0.0, 10.0, 20.0], size=(20, 3)) + rng.choice([0.0, 1e-5, 3.0]) * rng.random((20, 3))
    soup = trimesh.Trimesh(vertices, rng.integers(20, size=(faces, 3)), process=False)
    try:
        part = Part.from_mesh(soup, unit="mm", density=1000.0)
    except InputError:
        return
    assert part.mass > 0.0
    lengths = np.linalg.norm(part.mesh.face_normals, axis=1)
    assert lengths == pytest.approx(np.ones(len(part.mesh.faces)))
    facets = segment(part, 0.3, 0.3)
    assert set(facets.faces.tolist()) == set(range(len(part.mesh.faces)))
    contacts, _ = sample_contacts(part, facets, GraspParameters(t_bdry=0.0))
    assert np.isfinite(contacts.points).all()


@pytest.mark.parametrize("name", ["housing", "planewheel", "tool2", "ttube", "sandpart", "planerearstay", "bunnysim"])
def test_the_papers_objects_bound_volumes(paper_part, name):
    part = paper_part(name)
    assert part.watertight
    assert not part.warnings


def test_vertices_of_no_face_count_for_nothing(box):
    stray = trimesh.Trimesh(np.vstack([box.vertices, [[1e300, 0.0, 0.0]]]), box.faces[1:], process=False)
    alone = trimesh.Trimesh(box.vertices, box.faces[1:], process=False)
    with_it, without = (Part.from_mesh(mesh, unit="mm", mass=0.1) for mesh in (stray, alone))
    assert with_it.digest == without.digest
    assert with_it.repairs == without.repairs


def test_thousands_of_bodies_are_wound_outwards_in_seconds(rng):
    ball = trimesh.creation.icosphere(0, 0.4e-3)
    places = np.stack(np.meshgrid(*3 * [np.arange(14)]), axis=-1).reshape(-1, 1, 3) * 1e-3
    turned = np.where(rng.random((len(places), 1, 1)) < 0.4, ball.faces[:, ::-1], ball.faces)
    faces = (turned + len(ball.vertices) * np.arange(len(places))[:, None, None]).reshape(-1, 3)
    part = Part.from_mesh(trimesh.Trimesh((ball.vertices + places).reshape(-1, 3), faces, process=False), density=1.0)
    assert part.watertight
    assert part.mass == pytest.approx(len(places) * ball.volume, rel=1e-6)

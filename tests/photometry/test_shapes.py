"""Built-in shapes and mesh files: geometry, and a refusal for every kind of unusable mesh."""

import struct
from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from cislunar.errors import ConfigurationError, InputFileError
from cislunar.photometry.mesh_files import load_mesh
from cislunar.photometry.shadows.table import shadowing_pairs
from cislunar.photometry.shapes import (
    facets_from_triangles,
    icosahedron,
    icosphere,
    scale_axes,
    scale_to_sphere,
)

TETRAHEDRON = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]], dtype=float)
TETRAHEDRON_FACETS = [(0, 1, 2), (0, 3, 1), (0, 2, 3), (1, 3, 2)]


def write_obj(path, vertices, facets):
    lines = [f"v {x} {y} {z}" for x, y, z in vertices]
    lines += ["f " + " ".join(str(i + 1) for i in facet) for facet in facets]
    path.write_text("\n".join(lines) + "\n")
    return path


def write_stl_text(path, vertices, facets):
    lines = ["solid body"]
    for facet in facets:
        lines += ["facet normal 0 0 0", "outer loop"]
        lines += ["vertex {:.9e} {:.9e} {:.9e}".format(*vertices[i]) for i in facet]
        lines += ["endloop", "endfacet"]
    path.write_text("\n".join([*lines, "endsolid body"]))
    return path


def write_stl_binary(path, vertices, facets, header=b"solid but binary"):
    data = header.ljust(80, b"\0") + struct.pack("<I", len(facets))
    for facet in facets:
        data += struct.pack("<12fH", 0, 0, 0, *np.ravel([vertices[i] for i in facet]), 0)
    path.write_bytes(data)
    return path


WRITERS = {"a.obj": write_obj, "b.stl": write_stl_text, "c.STL": write_stl_binary}


def facets_of(path, **settings):
    mesh = load_mesh(path, **settings)
    return facets_from_triangles(mesh.vertices, mesh.triangles)


def hull_mesh(points):
    """Outward triangles of the convex hull of points."""
    hull = ConvexHull(points)
    facets = []
    for simplex, equation in zip(hull.simplices, hull.equations, strict=True):
        a, b, c = points[simplex]
        outward = np.cross(b - a, c - a) @ equation[:3] > 0
        facets.append(tuple(simplex if outward else simplex[::-1]))
    return hull, facets


def test_icosahedron_is_regular_and_has_the_area_of_the_sphere():
    shape = icosahedron(1.5)
    assert shape.areas.shape == (20,)
    np.testing.assert_allclose(shape.areas, 4 * np.pi * 1.5**2 / 20, rtol=1e-14)
    assert shape.equivalent_radius == pytest.approx(1.5, rel=1e-14)
    np.testing.assert_allclose(np.linalg.norm(shape.normals, axis=1), 1.0, rtol=1e-14)
    # Each facet has 3 neighbors at the dihedral angle: cos between normals = sqrt(5)/3.
    cosines = shape.normals @ shape.normals.T
    np.testing.assert_array_equal((np.abs(cosines - np.sqrt(5) / 3) < 1e-12).sum(axis=1), 3)
    np.testing.assert_allclose(icosahedron().areas, 0.6283185307179586, rtol=1e-14)


@pytest.mark.parametrize("subdivisions", [0, 1, 3])
def test_icosphere_is_closed_convex_and_of_the_given_area(subdivisions):
    shape = icosphere(subdivisions, 2.0)
    assert shape.areas.size == 20 * 4**subdivisions
    assert shape.total_area == pytest.approx(16 * np.pi, rel=1e-13)
    np.testing.assert_allclose(shape.areas @ shape.normals, 0.0, atol=1e-12)
    # Normals of a convex body are all different.
    cosines = shape.normals @ shape.normals.T - 2 * np.eye(shape.areas.size)
    assert cosines.max() < 1 - 1e-6


def test_icosphere_refuses_impossible_settings():
    with pytest.raises(ConfigurationError, match="subdivisions = 9"):
        icosphere(9)
    with pytest.raises(ConfigurationError, match=r"subdivisions = 1\.5"):
        icosphere(1.5)
    with pytest.raises(ConfigurationError, match="radius_m"):
        icosphere(0, 0.0)


@pytest.mark.parametrize("name", WRITERS)
def test_mesh_file_gives_the_hull_it_was_written_from(name, tmp_path):
    points = np.random.default_rng(3).normal(size=(40, 3))
    hull, facets = hull_mesh(points)
    path = WRITERS[name](tmp_path / name, points, facets)
    shape = facets_of(path, meters_per_unit=0.1)
    assert shape.total_area == pytest.approx(0.01 * hull.area, rel=1e-6)
    np.testing.assert_allclose(shape.normals, hull.equations[:, :3], atol=2e-5)
    scaled = scale_to_sphere(shape, 1.0)
    assert scaled.total_area == pytest.approx(4 * np.pi, rel=1e-12)
    np.testing.assert_allclose(scaled.areas / shape.areas, 4 * np.pi / shape.total_area)


def test_tetrahedron_areas_and_normals(tmp_path):
    shape = facets_of(write_obj(tmp_path / "t.obj", TETRAHEDRON, TETRAHEDRON_FACETS))
    np.testing.assert_allclose(shape.areas, 2 * np.sqrt(3), rtol=1e-14)
    # The normal of each facet points away from the vertex it lacks.
    np.testing.assert_allclose(shape.normals, -TETRAHEDRON[[3, 2, 1, 0]] / np.sqrt(3), atol=1e-15)


def test_obj_with_slashes_negative_indices_and_comments(tmp_path):
    path = tmp_path / "t.obj"
    lines = ["# a body", "o body", "vn 0 0 1"]
    lines += [f"v {x} {y} {z} # vertex" for x, y, z in TETRAHEDRON]
    lines += ["f 1/1/1 2//1 3", "f -4 -1 -3", "f 1 3 4", "s off", "f 2 4 3"]
    path.write_text("\n".join(lines))
    expected = facets_of(write_obj(tmp_path / "u.obj", TETRAHEDRON, TETRAHEDRON_FACETS))
    np.testing.assert_array_equal(facets_of(path).normals, expected.normals)


def test_coplanar_facets_are_convex(tmp_path):
    """A cube's faces are two triangles each."""
    cube = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
    hull, facets = hull_mesh(cube)
    for name, write in WRITERS.items():
        shape = facets_of(write(tmp_path / name, cube, facets))
        assert shape.areas.size == 12
        assert shape.total_area == pytest.approx(hull.area) == 6.0


@pytest.mark.parametrize("name", WRITERS)
@pytest.mark.parametrize(
    ("facets", "message"),
    [
        (TETRAHEDRON_FACETS[:3], "3 facets cannot close"),
        ([f[::-1] for f in TETRAHEDRON_FACETS], "face inward"),
        ([*TETRAHEDRON_FACETS[:3], (1, 2, 3)], r"facets \d and 4 run along"),
        ([*TETRAHEDRON_FACETS, (0, 0, 1)], "facet 5 is degenerate"),
        ([*TETRAHEDRON_FACETS, (0, 1, 2)], "facets 1 and 5 run along"),
    ],
)
def test_unusable_tetrahedra(name, facets, message, tmp_path):
    path = WRITERS[name](tmp_path / name, TETRAHEDRON, facets)
    with pytest.raises(InputFileError, match=message) as error:
        load_mesh(path)
    assert str(path) in str(error.value)


@pytest.mark.parametrize("name", WRITERS)
def test_open_mesh(name, tmp_path):
    points = np.random.default_rng(3).normal(size=(10, 3))
    _, facets = hull_mesh(points)
    path = WRITERS[name](tmp_path / name, points, facets[:-1])
    with pytest.raises(InputFileError, match=r"facet \d+ has an edge without neighbor"):
        load_mesh(path)


@pytest.mark.parametrize("name", WRITERS)
def test_facets_of_a_concave_body_shadow_each_other(name, tmp_path):
    octahedron = np.array(
        [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], dtype=float
    )
    _, facets = hull_mesh(octahedron)
    path = WRITERS[name](tmp_path / name, octahedron, facets)
    assert not shadowing_pairs(load_mesh(path)).any()
    octahedron[4] = [0, 0, -0.3]
    assert shadowing_pairs(load_mesh(WRITERS[name](path, octahedron, facets))).any()


def two_tetrahedra(path, second):
    """An OBJ file of two parts with a material each, the second as given."""
    write_obj(path, np.vstack([TETRAHEDRON, TETRAHEDRON + 5.0]), [])
    facets = [("bus", f) for f in TETRAHEDRON_FACETS] + [("panel", np.add(f, 4)) for f in second]
    lines = [f"usemtl {name}\nf " + " ".join(str(i + 1) for i in f) for name, f in facets]
    path.write_text(path.read_text() + "\n".join(lines))
    return path


def test_closed_mesh_of_two_parts_has_groups_and_shadows(tmp_path):
    path = two_tetrahedra(tmp_path / "two.obj", TETRAHEDRON_FACETS)
    mesh = load_mesh(path, meters_per_unit=2.0)
    assert mesh.groups == ("bus",) * 4 + ("panel",) * 4
    np.testing.assert_allclose(np.ptp(mesh.vertices, axis=0), 14.0)
    assert shadowing_pairs(mesh).any()


def test_part_inside_out(tmp_path):
    path = two_tetrahedra(tmp_path / "two.obj", [f[::-1] for f in TETRAHEDRON_FACETS])
    with pytest.raises(InputFileError, match="facet 5 and the others of its part face inward"):
        load_mesh(path)


@pytest.mark.parametrize("height", [0.0, 1e-8])
def test_sliver_without_area_is_degenerate(height, tmp_path):
    """Its normal would be rounding noise."""
    middle = 0.5 * (TETRAHEDRON[0] + TETRAHEDRON[1]) + [height, 0.0, 0.0]
    points = np.vstack([TETRAHEDRON, middle])
    facets = [*TETRAHEDRON_FACETS[1:], (0, 4, 2), (4, 1, 2), (0, 1, 4)]
    with pytest.raises(InputFileError, match="facet 6 is degenerate"):
        load_mesh(write_obj(tmp_path / "t.obj", points, facets))


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("q.obj", "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n", "line 5: facet 1 has 4"),
        ("q.obj", "v 0 0 zero\n", "line 1: cannot read 'v 0 0 zero'"),
        ("q.obj", "v 0 0 0\nv 1 0\nv 0 1 0\nf 1 2 3\n", "line 2: a vertex has 2 coordinates"),
        ("q.obj", "v 0 0 0\nv 1 0 0\nf 1 2 9\n", "facet 1 names vertex 9 of 2"),
        ("q.obj", "v 0 0 0\nf 0 1 1\n", "line 2: facet 1 names no known vertex"),
        ("q.obj", "", "0 facets cannot close"),
        ("q.stl", "solid s\nfacet\nvertex 0 0\n", "line 3: cannot read"),
        ("q.stl", "solid s\nvertex 0 0 0\nvertex 1 0 0\nendfacet\n", "facet 1 has 2 vertices"),
        ("q.stl", "solid s\nvertex 0 0 0\n", "ends within facet 1"),
        ("q.stl", "something else", "neither a text STL file nor a whole binary one"),
        ("q.stl", 34 * "-", "neither a text STL file nor a whole binary one"),
        ("q.ply", "ply", "must end in .obj or .stl"),
    ],
)
def test_unreadable_files(name, content, message, tmp_path):
    path = tmp_path / name
    path.write_text(content)
    with pytest.raises(InputFileError, match=message) as error:
        load_mesh(path)
    assert str(path) in str(error.value)


def test_truncated_missing_and_non_finite_files(tmp_path):
    path = write_stl_binary(tmp_path / "t.stl", TETRAHEDRON, TETRAHEDRON_FACETS, b"exported")
    path.write_bytes(path.read_bytes()[:-10])
    with pytest.raises(InputFileError, match="4 facets announced"):
        load_mesh(path)
    with pytest.raises(InputFileError, match=r"gone\.obj: cannot read"):
        load_mesh(tmp_path / "gone.obj")
    broken = TETRAHEDRON.copy()
    broken[3, 1] = np.nan
    with pytest.raises(InputFileError, match="facet 2 has a coordinate that is not finite"):
        load_mesh(write_obj(tmp_path / "n.obj", broken, TETRAHEDRON_FACETS))
    with pytest.raises(ConfigurationError, match="meters_per_unit"):
        load_mesh(path, meters_per_unit=-1.0)


def test_facets_in_order(tmp_path):
    """Merging vertices must not reorder facets: areas follow the file."""
    points = np.random.default_rng(5).normal(size=(12, 3))
    _, facets = hull_mesh(points)
    first = facets_of(write_stl_text(tmp_path / "a.stl", points, facets))
    second = facets_of(write_stl_text(tmp_path / "b.stl", points, facets[::-1]))
    np.testing.assert_allclose(first.areas, second.areas[::-1], rtol=1e-12)
    assert any(a != b for a, b in pairwise(first.areas))


def test_scaled_axes_of_facets_are_those_of_vertices():
    factors = np.array([1.3, 0.7, 2.0])
    made = scale_axes(facets_from_triangles(TETRAHEDRON, TETRAHEDRON_FACETS), factors)
    expected = facets_from_triangles(TETRAHEDRON * factors, TETRAHEDRON_FACETS)
    np.testing.assert_allclose(made.areas, expected.areas, rtol=1e-14)
    np.testing.assert_allclose(made.normals, expected.normals, atol=1e-15)


def test_equal_axis_scales_enlarge_and_ones_change_nothing():
    body = icosahedron()
    assert scale_axes(body, [1, 1, 1]) is body
    larger = scale_axes(body, [2.0, 2.0, 2.0])
    np.testing.assert_allclose(larger.areas, 4.0 * body.areas)
    np.testing.assert_allclose(larger.normals, body.normals, atol=1e-15)


@pytest.mark.parametrize("factors", [[1.0, 1.0], [1.0, 0.0, 1.0], [1.0, np.nan, 1.0], 2.0])
def test_impossible_axis_scales_are_refused(factors):
    with pytest.raises(ConfigurationError, match="axis_scale"):
        scale_axes(icosahedron(), factors)

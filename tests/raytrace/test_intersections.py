"""Where rays meet triangles: closed forms, the tree against the definition, and everything that rounding endangers."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from processing.errors import DataError
from processing.raytrace import bvh, moller_trumbore, shapes
from processing.raytrace.triangles import Triangles, joined, local_angles, local_frame

UNIT = np.array([[[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]])


def test_one_triangle_by_hand() -> None:
    # From above (0.25, 0.5): distance 2, weights 0.25 and 0.5 (thesis 4.1).
    hits = moller_trumbore.closest([[0.25, 0.5, 2.0]], [[0.0, 0, -1]], UNIT)
    assert (hits.distance[0], hits.triangle[0], hits.u[0], hits.v[0]) == (2.0, 0, 0.25, 0.5)
    # The distance counts in lengths of the direction; backwards, beside and along the plane there is nothing.
    assert moller_trumbore.closest([[0.25, 0.5, 2.0]], [[0.0, 0, -4]], UNIT).distance[0] == 0.5
    missed = moller_trumbore.closest([[0.25, 0.5, 2.0]] * 3, [[0.0, 0, 1], [1.0, 0, -1], [1.0, 0, 0]], UNIT)
    assert list(missed.triangle) == [-1, -1, -1]


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 2**32 - 1))
def test_the_tree_finds_what_the_definition_finds(seed: int) -> None:
    random = np.random.default_rng(seed)
    count = int(random.integers(1, 60))
    points = random.normal(size=(3 * count, 3)) * 10.0 ** random.uniform(-3, 3)
    mesh = Triangles(points, np.arange(3 * count).reshape(-1, 3))
    origin, direction = random.normal(size=(2, 200, 3)) * np.abs(points).max()
    expected = moller_trumbore.closest(origin, direction, mesh.corners_m)
    found = bvh.build(mesh).closest(origin, direction)
    np.testing.assert_array_equal(found.triangle, expected.triangle)
    hit = expected.triangle >= 0
    np.testing.assert_allclose(found.distance[hit], expected.distance[hit], rtol=1e-9)
    np.testing.assert_allclose(found.u[hit], expected.u[hit], atol=1e-9)
    np.testing.assert_allclose(found.v[hit], expected.v[hit], atol=1e-9)
    assert np.all(np.isinf(found.distance[~hit]))
    blocked = bvh.build(mesh).occluded(origin, direction, np.full(200, np.inf))
    np.testing.assert_array_equal(blocked, hit)


@pytest.mark.parametrize("scale", [1e-9, 1.0, 1e9])
def test_no_ray_slips_through_edges_and_corners(scale: float) -> None:
    # A closed body: rays from inside through its very vertices, and points of its edges, must all meet it.
    mesh = shapes.sphere(scale, divisions=2)
    a, b = (mesh.vertices_m[mesh.faces[:, i]] for i in (0, 1))
    weights = np.random.default_rng(0).random((40, 1, 1))
    aims = np.concatenate([mesh.vertices_m, ((1 - weights) * a + weights * b).reshape(-1, 3)])
    for origin in ((0.0, 0, 0), (0.3 * scale, -0.2 * scale, 0.1 * scale)):
        start = np.tile(origin, (len(aims), 1))
        hits = bvh.build(mesh).closest(start, aims - start)
        assert np.all(hits.triangle >= 0)
        np.testing.assert_allclose(hits.distance, 1.0, rtol=1e-9)


def test_rays_along_the_axes_of_boxes() -> None:
    # Directions with zeros, from points in the planes of the boxes' sides: 0 * inf there.
    mesh = shapes.plate(2.0, cells=8)
    grid = np.linspace(-1, 1, 9)
    x, y = (a.ravel() for a in np.meshgrid(grid, grid))
    origin = np.stack([x, y, np.ones_like(x)], axis=1)
    hits = bvh.build(mesh).closest(origin, np.tile([0.0, 0, -1], (len(x), 1)))
    np.testing.assert_array_equal(hits.distance, 1.0)
    # Within the plate's own plane there is nothing to meet.
    along = bvh.build(mesh).closest([[-5.0, 0.1, 0.0]], [[1.0, 0, 0]])
    assert along.triangle[0] == -1


def test_huge_and_tiny_triangles_together() -> None:
    ground = shapes.plate(1e7)
    chip = shapes.plate(1e-6, material=0).moved((3.0, 4.0, 1e-5))
    tree = bvh.build(joined([ground, chip]))
    hits = tree.closest([[3.0, 4.0, 1.0], [3.0 + 1e-6, 4.0, 1.0]], [[0.0, 0, -1]] * 2)
    assert hits.triangle[0] >= 2
    assert hits.triangle[1] < 2
    np.testing.assert_allclose(hits.distance, [1.0 - 1e-5, 1.0], rtol=1e-12)


def test_triangles_without_area_and_equal_triangles() -> None:
    point = np.zeros((1, 3, 3))
    line = np.array([[[0.0, 0, 0], [1, 1, 1], [2, 2, 2]]])
    corners = np.concatenate([point, line, np.tile(UNIT, (50, 1, 1))])
    mesh = Triangles(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))
    assert np.isnan(mesh.normals[:2]).all()
    hits = bvh.build(mesh).closest([[0.2, 0.2, 1.0]], [[0.0, 0, -1]])
    assert hits.distance[0] == 1.0
    nothing = Triangles(np.zeros((3, 3)), np.array([[0, 1, 2]]))
    assert bvh.build(nothing).closest([[0.0, 0, 1]], [[0.0, 0, -1]]).triangle[0] == -1


def test_rays_that_are_none_meet_nothing() -> None:
    tree = bvh.build(shapes.sphere(1.0, divisions=1))
    hits = tree.closest([[np.nan, 0, 0], [0.0, 0, 0], [np.inf, 0, 0]], [[0.0, 0, 1], [0.0, 0, 0], [1.0, 0, 0]])
    assert list(hits.triangle) == [-1, -1, -1]


def test_a_triangle_can_be_left_out() -> None:
    two = joined([Triangles(UNIT[0], [[0, 1, 2]]), Triangles(UNIT[0] - [0, 0, 1], [[0, 1, 2]])])
    for tree in (bvh.build(two).closest, lambda o, d, s: moller_trumbore.closest(o, d, two.corners_m, s)):
        hits = tree([[0.2, 0.2, 1.0]] * 2, [[0.0, 0, -1]] * 2, np.array([-1, 0]))
        np.testing.assert_array_equal(hits.triangle, [0, 1])


def test_local_frames_turn_normals_up() -> None:
    # Thesis 4.6 to 4.9, down and up included.
    random = np.random.default_rng(3).normal(size=(200, 3))
    normals = np.concatenate([random / np.linalg.norm(random, axis=1, keepdims=True), [[0, 0, 1], [0, 0, -1]]])
    turned = np.einsum("nij,nj->ni", local_frame(normals), normals)
    np.testing.assert_allclose(turned, np.tile([0.0, 0, 1], (len(normals), 1)), atol=1e-14)
    zenith, azimuth = local_angles(
        [math.sin(0.3) * math.cos(1.0), math.sin(0.3) * math.sin(1.0), math.cos(0.3)], [0, 0, 1]
    )
    assert (zenith, azimuth) == (pytest.approx(0.3), pytest.approx(1.0))


def test_bodies_have_the_areas_and_normals_of_their_shapes() -> None:
    def area(mesh: Triangles) -> float:
        c = mesh.corners_m
        return float(np.linalg.norm(np.cross(c[:, 1] - c[:, 0], c[:, 2] - c[:, 0]), axis=1).sum() / 2)

    assert area(shapes.plate(2.0, 3.0, cells=5)) == pytest.approx(6.0)
    assert area(shapes.dihedral(2.0)) == pytest.approx(8.0)
    assert area(shapes.trihedral(2.0)) == pytest.approx(12.0)
    assert area(shapes.strips(2.0, 1.0, 5)) == pytest.approx(2.0)
    assert list(shapes.strips(2.0, 1.0, 3).material) == [0, 0, 1, 1, 2, 2]
    ball = shapes.sphere(2.0, divisions=3)
    # A polyhedron inside the sphere: 1280 faces lose some per cent of 4 pi r^2.
    assert 0.98 * 16 * math.pi < area(ball) < 16 * math.pi
    assert np.all(np.einsum("ij,ij->i", ball.normals, ball.corners_m.mean(axis=1)) > 0)
    # Open corners show their fronts.
    assert np.all(shapes.trihedral(1.0).normals.sum(axis=1) > 0.99)
    assert np.all(shapes.dihedral(1.0).normals.sum(axis=1) > 0.99)
    assert len(shapes.rough_ground(4.0, 20, 0.1)) == 800


@pytest.mark.parametrize(
    "make",
    [
        lambda: Triangles(np.zeros((3, 2)), [[0, 1, 2]]),
        lambda: Triangles(np.zeros((3, 3)), [[0, 1, 3]]),
        lambda: Triangles(np.full((3, 3), np.nan), [[0, 1, 2]]),
        lambda: Triangles(np.zeros((3, 3)), np.zeros((0, 3), dtype=int)),
        lambda: Triangles(np.zeros((3, 3)), [[0, 1, 2]], np.array([0, 0])),
        lambda: shapes.patch((0, 0, 0), (1, 0, 0), (2, 0, 0)),
        lambda: joined([]),
    ],
)
def test_meshes_that_are_none_are_refused(make) -> None:
    with pytest.raises(DataError):
        make()

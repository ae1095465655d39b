"""Pictures: closed forms, mirrors by fields in space, energy, errors, both ways of tracing, what is left out."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from processing.errors import DataError
from processing.optics import fresnel, jones, mueller, stokes_vectors
from processing.raytrace import scattering, shapes, source_kernel
from processing.raytrace.backward import backward
from processing.raytrace.forward import forward, unreachable
from processing.raytrace.materials import Fresnel, Lambert, Ward
from processing.raytrace.picture import Picture, statistics
from processing.raytrace.sources import GaussianSource, PlaneSource, PointSource, RayleighSky, Sun
from processing.raytrace.triangles import joined
from processing.raytrace.view import View
from processing.raytrace.world import World, world

ALUMINIUM = 1.02 + 6.84j
DIHEDRAL_VIEW = View((0.3, 5.0, 4.0), (0.0, 0.7, 0.7), 6, 6, math.radians(20))


def dihedral(material, *lights) -> World:
    return world(shapes.dihedral(2.0), [material], list(lights))


def test_a_white_plate_under_a_plane_wave() -> None:
    # Lambert: L = rho E cos / pi, exactly and without noise.
    scene = world(shapes.plate(2.0), [Lambert(0.5)], [Sun((0, 0.5, math.sqrt(0.75)), 2.0, 0.0)])
    picture = backward(scene, View((0, 0, 5), (0, 0, 0), 4, 4, 0.2, (0, 1, 0)), samples=8)
    np.testing.assert_allclose(picture.mean[..., 0], 0.5 * 2 * math.sqrt(0.75) / math.pi, rtol=1e-13)
    assert np.all(picture.mean[..., 1:] == 0)
    assert np.all(picture.standard_error < 1e-9)
    assert np.all(picture.dolp == 0)
    assert np.isnan(picture.aop).all()


def test_two_mirrors_show_the_sky_as_fields_in_space_say() -> None:
    # A smooth dihedral: every ray meets both faces and then the sky. The field is carried as a vector in space, so no
    # frame is turned: E -> a_ss (E.s) s + a_pp (E.p) p', p = k x s before and p' = k' x s after.
    sky = RayleighSky((0.3, 0.5, 0.6), 2.0, 0.9)
    scene = dihedral(Fresnel(ALUMINIUM), sky)
    view = View((0.2, 1.6, 1.4), (0.05, 0.3, 0.35), 1, 1, 1e-6)
    found = backward(scene, view, bounces=2, samples=2).mean[0, 0]
    k = np.subtract(view.target_m, view.position_m)
    k /= np.linalg.norm(k)
    seen = [k]
    normals = []
    point = np.asarray(view.position_m, dtype=float)
    for _ in range(2):
        hit = scene.tree.closest(point[None] + 1e-9 * seen[-1], seen[-1][None])
        assert hit.triangle[0] >= 0
        point = point + hit.distance[0] * seen[-1]
        n = scene.normals[hit.triangle[0]]
        normals.append(n)
        seen.append(seen[-1] - 2 * (seen[-1] @ n) * n)
        point = point + 1e-9 * n
    assert scene.tree.closest(point[None], seen[-1][None]).triangle[0] == -1
    light = [-k for k in seen[::-1]]  # along the light: in, between, to the camera
    radiance, degree, *axis = source_kernel.seen(scene.sources[0], *seen[-1])
    x_in = np.array(axis)
    frame = np.stack([x_in, np.cross(light[0], x_in)], axis=1)
    _, camera_axis = view.rays(np.array(0.5), np.array(0.5))
    out = np.stack([camera_axis, np.cross(light[2], camera_axis)])
    j = np.zeros((2, 2), dtype=complex)
    for column in range(2):
        e = frame[:, column].astype(complex)
        for before, after, n in zip(light, light[1:], normals[::-1], strict=False):
            s = np.cross(before, n)
            s /= np.linalg.norm(s)
            ss, pp = fresnel.amplitudes(ALUMINIUM, -(before @ n))
            e = ss * (e @ s) * s + pp * (e @ np.cross(before, s)) * np.cross(after, s)
        j[:, column] = out @ e
    expected = radiance * jones.mueller(j) @ np.array([1.0, degree, 0.0, 0.0])
    np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-6 * expected[0])
    assert abs(expected[3]) > 1e-3 * expected[0]


@pytest.mark.parametrize(
    "light",
    [
        PointSource((0.5, 4.0, 2.0), 10.0, (1.0, 0.5, 0.3, 0.4)),
        Sun((0.2, 0.6, 0.7), 3.0, 0.05, (1.0, 0.0, 0.5, -0.5)),
        RayleighSky((0.2, 0.6, 0.7), 2.0),
        PlaneSource((0.0, 3.0, 3.0), (0.0, 0.5, 0.5), 5.0, 0.4, (1.0, 1.0, 0.0, 0.0)),
        GaussianSource((0.0, 3.0, 3.0), (0.0, 0.5, 0.5), 5.0, 0.3, (1.0, 0.0, 0.0, 1.0)),
    ],
)
def test_both_ways_of_tracing_give_the_same_picture(light) -> None:
    scene = dihedral(Fresnel(ALUMINIUM, 0.3, specular=0.7, diffuse=0.3), light)
    back = backward(scene, DIHEDRAL_VIEW, bounces=3, samples=600)
    fore = forward(scene, DIHEDRAL_VIEW, bounces=3, rays=120_000)
    error = np.sqrt(np.sum(back.standard_error**2 + fore.standard_error**2, axis=(0, 1)))
    difference = np.sum(back.mean - fore.mean, axis=(0, 1))
    # Four components of five sources beyond 4 sigma: 1 in 800 by chance, and the seeds are fixed.
    assert np.all(np.abs(difference) < 4 * error)
    assert error[0] < 0.03 * np.sum(back.mean[..., 0])


@settings(deadline=None, max_examples=15)
@given(
    st.sampled_from(
        [
            Lambert(1.0),
            Ward(0.2, 0.8, 0.2, "bounded"),
            Fresnel(ALUMINIUM, 0.2),
            Fresnel(30j, 0.4),
            Fresnel(1.5, 0.0, specular=0.5, diffuse=0.5),
        ]
    ),
    st.integers(0, 1000),
)
def test_no_picture_is_brighter_than_its_sky(material, seed: int) -> None:
    # Light scattered off matter that makes no energy is never brighter than the brightest of what shines on it.
    body = joined([shapes.trihedral(1.0), shapes.sphere(0.4, divisions=1).moved((0.5, 0.5, 0.6))])
    sky = RayleighSky((0.3, 0.2, 0.9), 1.0)
    view = View((3.0, 3.0, 3.0), (0.3, 0.3, 0.3), 4, 4, 0.3)
    picture = backward(world(body, [material], [sky]), view, bounces=8, samples=200, seed=seed)
    assert np.all(picture.mean[..., 0] <= 1.5 + 4.5 * picture.standard_error[..., 0] + 1e-12)
    polarized = np.linalg.norm(picture.mean[..., 1:], axis=-1)
    assert np.all(polarized <= picture.mean[..., 0] + 1e-12)


def test_mueller_pictures_hold_the_stokes_pictures_of_every_state() -> None:
    view = DIHEDRAL_VIEW
    state = (1.0, 0.3, -0.4, 0.5)
    lamp = PlaneSource((0.0, 3.0, 3.0), (0.0, 0.5, 0.5), 5.0, 0.4)
    polarized = PlaneSource(lamp.position_m, lamp.target_m, lamp.power, lamp.half_slope, state)
    material = Fresnel(ALUMINIUM, 0.3)
    whole = backward(dihedral(material, lamp), view, bounces=3, samples=20, mueller=True)
    one = backward(dihedral(material, polarized), view, bounces=3, samples=20)
    np.testing.assert_allclose(whole.mean @ np.array(state), one.mean, rtol=1e-9, atol=1e-12)
    lit = whole.mean[..., 0, 0] > 0
    assert np.all(mueller.is_realizable(whole.mean[lit], 1e-9))
    # 4.19 with ideal polarizers: half of what S0 and S1 add to.
    expected = (whole.mean[..., 0, :] - whole.mean[..., 1, :]) @ np.array(stokes_vectors.STATES["H"]) / 2
    np.testing.assert_allclose(whole.channels()["HV"], expected, atol=1e-14)
    with pytest.raises(DataError, match="holds Stokes"):
        one.channels()


def test_aluminium_in_visible_light_behind_polarizers() -> None:
    # Lamp and camera on either side, so that facets are met at the angle whose halves both rays make; the ratio
    # |HH - VV| / (HH + VV) of one facet is (Rs - Rp) / (Rs + Rp) of that angle: 0.0122 at 30 and 0.0598 at 60 degrees
    # (thesis 4.6, Fig. 4.14), upright incidence giving 0 (blue).
    for degrees, expected in ((0.01, 0.0), (30.0, 0.0122), (60.0, 0.0598)):
        angle = math.radians(degrees)
        place = 100 * np.array([0.0, math.sin(angle), math.cos(angle)])
        lamp = PlaneSource(tuple(place), (0, 0, 0), 100.0, 0.01, up=(1, 0, 0))
        scene = world(shapes.plate(1.0), [Fresnel(ALUMINIUM, 0.3)], [lamp])
        view = View((0.0, -place[1], place[2]), (0, 0, 0), 2, 2, 1e-4, (1, 0, 0))
        channels = backward(scene, view, bounces=1, samples=20, mueller=True).channels()
        red = np.abs(channels["HH"] - channels["VV"]) / (channels["HH"] + channels["VV"])
        np.testing.assert_allclose(red, expected, atol=5e-4)
        assert np.all(channels["HV"] < 1e-6 * channels["HH"])
    # With the lamp at the camera every facet that returns light is met upright: no polarization wherever one looks.
    lamp = PlaneSource((0, 0, 6.0), (0, 0, 0), 100.0, 1.0, up=(0, 1, 0))
    scene = world(shapes.plate(10.0), [Fresnel(ALUMINIUM, 0.5)], [lamp])
    view = View((0, 0, 6.0), (0, 0, 0), 9, 9, math.radians(78), (0, 1, 0))
    channels = backward(scene, view, bounces=1, samples=20, mueller=True).channels()
    assert np.all(np.abs(channels["HH"] - channels["VV"]) < 1e-9 * (channels["HH"] + channels["VV"]))


def test_standard_errors_are_those_of_pictures_with_other_seeds() -> None:
    scene = dihedral(Fresnel(ALUMINIUM, 0.3, specular=0.7, diffuse=0.3), RayleighSky((0.2, 0.6, 0.7), 2.0))
    pictures = [backward(scene, DIHEDRAL_VIEW, bounces=2, samples=60, seed=seed) for seed in range(40)]
    spread = np.var([p.mean for p in pictures], axis=0, ddof=1)
    told = np.mean([p.standard_error**2 for p in pictures], axis=0)
    lit = told[..., 0] > 0
    # 36 pixels, 4 components, 39 degrees of freedom each: the mean ratio is known to about 3 %; components share paths.
    assert np.mean(spread[lit] / np.where(told[lit] > 0, told[lit], 1.0)) == pytest.approx(1.0, abs=0.1)


def test_a_picture_depends_on_its_seed_alone() -> None:
    scene = dihedral(Fresnel(1.5, 0.2), Sun((0.2, 0.6, 0.7), 3.0))
    one, same, other = (backward(scene, DIHEDRAL_VIEW, samples=12, seed=seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(one.mean, same.mean)
    assert not np.array_equal(one.mean, other.mean)


def test_the_error_asked_for_is_reached_and_what_does_not_matter_is_left_out() -> None:
    strong, weak = Sun((0.2, 0.6, 0.7), 3.0), PointSource((0.0, 3.0, 3.0), 1e-4)
    scene = dihedral(Fresnel(ALUMINIUM, 0.3, specular=0.6, diffuse=0.1), strong, weak)
    picture = backward(scene, DIHEDRAL_VIEW, bounces=8, error=0.03)
    assert picture.error <= 0.03
    out = {(part.bounce, part.source) for part in picture.left_out}
    assert (1, 1) in out
    assert (8, 0) in out
    assert (1, 0) not in out
    assert sum(part.error for part in picture.left_out if part.met) <= 0.03 * 0.3
    # Lamps are no light without a reflection, and are not told as left out there.
    assert (0, 1) not in out
    assert all(part.error > 0 and part.rays == 36 * 16 for part in picture.left_out)
    # The whole picture, with all light, is the same within the errors.
    whole = backward(scene, DIHEDRAL_VIEW, bounces=8, samples=3000, seed=9)
    difference = np.sqrt(np.mean((picture.mean - whole.mean)[..., 0] ** 2)) / whole.mean[..., 0].mean()
    assert difference < 1.5 * 0.03
    full = backward(scene, DIHEDRAL_VIEW, bounces=8, error=0.03, leave_out=False)
    assert full.left_out == ()
    assert full.rays / full.samples > picture.rays / picture.samples


def test_an_error_that_cannot_be_reached_ends_at_the_most_samples() -> None:
    scene = dihedral(Fresnel(ALUMINIUM, 0.3), RayleighSky((0.2, 0.6, 0.7), 2.0))
    told: list[float] = []
    picture = backward(scene, DIHEDRAL_VIEW, error=1e-6, most_samples=64, progress=told.append)
    assert picture.samples == 64
    assert picture.error > 1e-6
    assert told
    assert all(0 <= x <= 1 for x in told)


def test_extreme_scenes() -> None:
    # A camera that grazes a plate, one within its plane, light along it, a lamp on it: finite, nothing negative.
    plate = shapes.plate(2.0)
    for z in (1e-9, 0.0):
        view = View((0.0, -3.0, z), (0.0, 0.0, 0.0), 4, 4, 0.1)
        for light in (Sun((0.0, 1.0, 0.0), 1.0, 0.0), PointSource((0.1, 0.1, 0.0), 1.0), RayleighSky((0, 0, 1))):
            picture = backward(world(plate, [Fresnel(1.5, 0.1)], [light]), view, samples=4)
            assert np.all(np.isfinite(picture.mean))
            assert np.all(picture.mean[..., 0] >= 0)
    # Index 1 is not there; sky seen directly is.
    sky = RayleighSky((0, 0, 1), 1.0)
    nothing = backward(
        world(plate, [Fresnel(1.0, 0.0)], [sky]), View((0, 0, 3), (0, 0, 0), 3, 3, 0.2, (0, 1, 0)), samples=2
    )
    assert np.all(nothing.mean == 0)
    upwards = backward(
        world(plate, [Lambert(0.5)], [sky]), View((0, 0, 3), (0, 0, 9), 3, 3, 0.01, (0, 1, 0)), bounces=0, samples=2
    )
    np.testing.assert_allclose(upwards.mean[..., 0], 1.5, rtol=1e-3)


def test_surfaces_do_not_shade_themselves() -> None:
    # Huge coordinates, tiny cells, grazing sun: no ray may meet the surface that it leaves, or its neighbours in plane.
    sun = Sun((1.0, 0.0, 1e-4), 1.0, 0.0)
    for size, offset in ((1e-3, 0.0), (1e3, 1e6)):
        plate = shapes.plate(size, cells=16).moved((offset, -offset, offset))
        view = View((offset, -offset, offset + 2 * size), (offset, -offset, offset), 16, 16, 0.3, (0, 1, 0))
        picture = backward(world(plate, [Lambert(1.0)], [sun]), view, bounces=1, samples=4)
        np.testing.assert_allclose(picture.mean[..., 0], 1e-4 / math.pi, rtol=1e-6)


def test_smooth_surfaces_are_told_of() -> None:
    sun = Sun((0.2, 0.6, 0.7), 3.0)
    assert unreachable(dihedral(Fresnel(1.5), sun))
    assert not unreachable(dihedral(Fresnel(1.5, 0.1), sun))


def test_statistics_of_few_samples() -> None:
    mean, error = statistics(np.array([[6.0]]), np.array([[14.0]]), 3)  # 1, 2, 3
    assert (mean[0, 0], error[0, 0]) == (2.0, pytest.approx(math.sqrt(1.0 / 3)))
    assert np.isnan(statistics(np.array([[6.0]]), np.array([[36.0]]), 1)[1]).all()
    dark = Picture(np.zeros((2, 2, 4)), np.zeros((2, 2, 4)), 4, 4, 0.1)
    assert dark.error == 0.0
    assert np.isnan(dark.dolp).all()


@pytest.mark.parametrize(
    "call",
    [
        lambda s: backward(s, DIHEDRAL_VIEW),
        lambda s: backward(s, DIHEDRAL_VIEW, samples=4, error=0.1),
        lambda s: backward(s, DIHEDRAL_VIEW, samples=0),
        lambda s: backward(s, DIHEDRAL_VIEW, error=-0.1),
        lambda s: backward(s, DIHEDRAL_VIEW, samples=4, bounces=-1),
        lambda s: forward(s, DIHEDRAL_VIEW, rays=1),
        lambda s: forward(s, DIHEDRAL_VIEW, bounces=0),
        lambda s: backward(
            world(shapes.plate(1.0), [Lambert(1)], [Sun((0, 0, 1))] * 2), DIHEDRAL_VIEW, samples=2, mueller=True
        ),
        lambda s: View((0, 0, 1), (0, 0, 0), 8, 8, 0.3),
        lambda s: View((0, 0, 1), (0, 0, 0), 0, 8, 0.3, (0, 1, 0)),
    ],
)
def test_what_cannot_be_asked_is_refused(call) -> None:
    with pytest.raises(DataError):
        call(dihedral(Lambert(0.5), Sun((0, 0, 1))))


def test_stokes_axes_turn_as_rotators_do() -> None:
    # About +z, from x to a turned axis: the cosine and sine of mueller.rotator.
    axis = np.array([math.cos(0.4), math.sin(0.4), 0.0])
    c, s = scattering.turn(np.array([0.0, 0, 1]), np.array([1.0, 0, 0]), axis)
    turned = scattering.turned_stokes(np.array([1.0, 0.3, 0.4, 0.5]), c, s)
    np.testing.assert_allclose(turned, mueller.rotator(0.4) @ [1.0, 0.3, 0.4, 0.5], atol=1e-15)

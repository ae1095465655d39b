"""Terms are left out where they cannot matter and kept where they do, with the error of both ways.

Each effect that the program decides on is met twice: where its bound is below the tolerance (it is left out, and the
whole model differs by less than the bound) and where it is above (it is kept, and leaving it out would cost more than
the tolerance).
"""

import math
from dataclasses import replace

import numpy as np
import pytest
from rail_data import BANDWIDTH_HZ, CELL_M, CENTRE_HZ, HEIGHT_M, C, distances, ground, rail, relative_db, sinc_profiles
from rail_session import RIG
from scipy.special import fresnel
from spotlight_data import flight, profiles, scattered, square

from polfuse_lab.products.antennas import antenna_pairs
from polfuse_lab.rig import Rig, parse_model
from processing.calibration.near_field import near_field
from processing.calibration.phase_centres import path_phases
from processing.calibration.rcs import plate_amplitude
from processing.optics.shifts import registered
from processing.radar.antenna import AntennaPair
from processing.radar.profiles import RangeProfiles
from processing.raytrace import shapes
from processing.raytrace.backward import LEFT_OUT_SHARE, backward
from processing.raytrace.materials import Fresnel
from processing.raytrace.sources import RayleighSky, Sun
from processing.raytrace.view import View
from processing.raytrace.world import world
from processing.sar.backprojection import backproject
from processing.sar.continuous import TOLERANCE_DB, sweep_motion
from processing.sar.planner import SAFETY_DB, Task, choose, migration_error_db
from processing.sar.polar_format import polar_format
from processing.sar.polar_format_geometry import polar_forecast
from processing.sar.range_migration import range_migration
from processing.sar.straight_track import straight_track
from processing.scattering import history
from processing.scattering.history import Sweep, history_reference, pattern_nodes, phase_history
from processing.scattering.shooting import Density, settle, shoot
from processing.scattering.surfaces import CONDUCTOR
from processing.scattering.target import radar_target
from processing.scene.model import Reflector

WAVELENGTH_M = C / CENTRE_HZ
TARGET = (5.0, 7.0, -HEIGHT_M)
AROUND = ground(np.arange(4.0, 6.0, 0.1), np.arange(5.5, 8.5, 0.25))


def large(**given):
    """A collect so large that the quick methods would be taken, were they exact enough."""
    return Task(**{"pixels": 1024**2, "pulses": 1024, "channels": 1, "oversampling": 8, "compensated": False, **given})


# Range curvature: polar format takes wavefronts for straight.


@pytest.mark.parametrize(("span_m", "left_out"), [(16.0, True), (80.0, False)])
def test_curvature_of_wavefronts(span_m, left_out):
    tolerance_db = -60.0
    antenna, grid = flight(150), square(int(span_m / 0.32), 0.32)
    foretold = polar_forecast(antenna, grid, C / 15e9, 750e6)
    task = large(
        wavelength_m=C / 15e9, furthest_m=8100.0, widest_rad=0.0, residual_m=None, bandwidth_hz=750e6, depth_m=60.0,
        polar=foretold,
    )  # fmt: skip
    assert (choose(task, tolerance_db).method == "pfa") == left_out
    data = profiles(scattered(20, span_m), antenna, span_m)
    error = relative_db(polar_format(data, grid)[0], backproject(data, grid, interpolator="sinc16")[0])
    assert (error < tolerance_db) == left_out
    # The expectation is for points anywhere; these keep within 0.9 of the extent, which is up to 4 dB less.
    assert error < foretold.error_db + SAFETY_DB["pfa"]


# Positions off the line that range migration takes them to stand on.


@pytest.mark.parametrize(("off_m", "left_out"), [(2e-5, True), (7e-4, False)])
def test_positions_off_a_straight_rail(off_m, left_out):
    tolerance_db = -40.0
    antenna = rail()
    antenna[:, 1] = off_m * np.random.default_rng(4).normal(size=len(antenna)).clip(-2, 2)
    task = large(
        wavelength_m=WAVELENGTH_M, furthest_m=14.0, widest_rad=math.radians(35),
        residual_m=straight_track(antenna, WAVELENGTH_M).residual_m, bandwidth_hz=BANDWIDTH_HZ,
    )  # fmt: skip
    assert (choose(task, tolerance_db).method == "rma") == left_out
    data = sinc_profiles([(0.3, 8.0, -HEIGHT_M), (-1.5, 9.5, -HEIGHT_M)], antenna, [1.0, 0.8])
    grid = ground(np.linspace(-3, 3, 60), np.linspace(6.5, 11.0, 24))
    error = relative_db(range_migration(data, grid)[0], backproject(data, grid, interpolator="sinc16")[0])
    assert (error < tolerance_db) == left_out
    assert error < migration_error_db(task) + SAFETY_DB["rma"]
    # The bound is not idle either: phases at random throw part of their power beyond the image, not most of it.
    assert left_out or error > migration_error_db(task) - 10


# Motion within the sweeps.


def swept(speed_m_s):
    """Range profiles of a trolley that goes on while it sweeps: the beat at every instant's own range, transformed."""
    ramp_s, antenna = 0.02, rail(31)
    t = (np.arange(256) / 256 - 0.5 + 0.5 / 256) * ramp_s
    slope = BANDWIDTH_HZ / ramp_s
    moved = antenna[:, None] + np.array([speed_m_s, 0.0, 0.0]) * t[:, None]
    away = np.linalg.norm(np.asarray(TARGET) - moved, axis=2)
    # The echo returns to where the antenna will be, 2 R / c later.
    radial = -speed_m_s * (TARGET[0] - moved[..., 0]) / away
    tau = 2 * (away + radial * away / C) / C
    beat = np.exp(-2j * np.pi * tau * (CENTRE_HZ + slope * t) + 1j * np.pi * slope * tau**2)
    r = CELL_M / 8 * np.arange(-160, 240)
    values = beat @ np.exp(4j * np.pi / C * slope * np.outer(t, r)) / len(t)
    values = values * np.exp(-4j * np.pi * slope / C**2 * r**2)
    velocity = np.tile([speed_m_s, 0.0, 0.0], (len(antenna), 1))
    return RangeProfiles(
        values[None], r, antenna, ("HH",), CENTRE_HZ, BANDWIDTH_HZ, "rectangular", True, velocity_m_s=velocity,
        ramp_s=ramp_s,
    )  # fmt: skip


@pytest.mark.parametrize(("speed_m_s", "left_out"), [(1e-3, True), (0.4, False)])
def test_motion_within_the_sweeps(speed_m_s, left_out):
    data = swept(speed_m_s)
    decided = sweep_motion(data)
    assert decided.modelled != left_out
    assert (decided.still_error_db <= TOLERANCE_DB) == left_out
    truth = backproject(swept(0.0), AROUND)
    still, moving, chosen = (backproject(data, AROUND, motion=way) for way in ("still", "moving", "auto"))
    np.testing.assert_array_equal(chosen, still if left_out else moving)
    error = relative_db(still, truth)
    # Seen 35 degrees off broadside the speed towards the target is 0.57 of the one that the bound is for (-5 dB).
    assert decided.still_error_db - 12 < error < decided.still_error_db
    assert (error < TOLERANCE_DB) == left_out
    # What is left by the whole model is the turn that is quadratic within a ramp, which is told too. (At the target:
    # beside it a passing radar's response has another shape, as its matched filter's has.)
    here = ground([TARGET[0]], [TARGET[1]])
    assert relative_db(backproject(data, here, motion="moving"), backproject(swept(0.0), here)) < decided.left_out_db


# Antennas apart: kept wherever the rig tells of them, whatever they would change.


def between(pair):
    """Profiles of the target between two antennas: half the path in place of the range."""
    antenna = rail(31)
    half = sum(distances(antenna + np.asarray(place), TARGET) for place in (pair.transmit_m, pair.receive_m)) / 2
    r = CELL_M / 8 * np.arange(-64, 200)
    values = np.sinc((r - half[:, None]) / CELL_M) * np.exp(-4j * np.pi / WAVELENGTH_M * half[:, None])
    return RangeProfiles(values[None], r, antenna, ("HH",), CENTRE_HZ, BANDWIDTH_HZ, "rectangular", True, pairs=(pair,))


def test_antennas_in_one_place_are_left_out_and_change_no_bit():
    alike = RIG.replace("[radar]", "phase_centres = {}\n[radar]")
    assert antenna_pairs(parse_model(alike, Rig, "rig.toml"), ["HH"]) is None
    data = between(AntennaPair())
    np.testing.assert_array_equal(backproject(data, AROUND), backproject(replace(data, pairs=None), AROUND))


@pytest.mark.parametrize("apart_m", [1e-5, 2e-3, 0.3])
def test_antennas_apart_are_followed_and_leaving_them_out_turns_the_phase_as_told(apart_m):
    told = f"phase_centres = {{ transmit_h_m = [{-apart_m}, {apart_m}, 0.0] }}\n[radar]"
    pairs = antenna_pairs(parse_model(RIG.replace("[radar]", told), Rig, "rig.toml"), ["HH"])
    assert pairs == (AntennaPair((-apart_m, apart_m, 0.0)),)
    data, here = between(pairs[0]), ground([TARGET[0]], [TARGET[1]])
    followed, ignored = (
        backproject(replace(data, pairs=way), here, interpolator="sinc16")[0, 0, 0] for way in (pairs, None)
    )
    # A point of amplitude 1 shows 1; sixteen taps at 8 bins are exact to -100 dB and beyond.
    assert abs(followed - 1) < 1e-4
    turned = path_phases(data.antenna_m, pairs, [TARGET], WAVELENGTH_M)[0, 0]
    assert np.angle(ignored) == pytest.approx(turned, abs=0.005 * abs(turned) + 2e-5)
    # In closed form, from the rail's middle: half the path less the range.
    half = sum(math.dist(TARGET, place) for place in (pairs[0].transmit_m, pairs[0].receive_m)) / 2
    assert turned == pytest.approx(-4 * np.pi / WAVELENGTH_M * (half - math.hypot(*TARGET)), rel=0.01)


# Bounces, sources and the sky's polarization in pictures.

FOLD_VIEW = View((0.3, 5.0, 4.0), (0.0, 0.7, 0.7), 6, 6, math.radians(20))
BOUNCES = 6


def fold(surface, *lights):
    return world(shapes.dihedral(2.0), [surface], list(lights))


def each_light(make, strengths, samples=400):
    """(bounces + 1, sources, rows, columns, 4) of a picture by the same random numbers: it is linear in the sources."""
    found = []
    for number in range(len(strengths)):
        alone = make(*(strength * (number == at) for at, strength in enumerate(strengths)))
        sums = [backward(alone, FOLD_VIEW, bounces=b, samples=samples, seed=3).mean for b in range(BOUNCES + 1)]
        found.append(np.diff(sums, axis=0, prepend=np.zeros((1, *sums[0].shape))))
    return np.stack(found, axis=1)


def size(light, whole):
    """Largest component's root mean square over the picture, of the mean S0."""
    return float(np.sqrt(np.max(np.mean(light**2, axis=(0, 1)))) / whole[..., 0].mean())


def check(picture, lights, error):
    """What was left out is together below its share of the error asked for, by the whole model; returns what it was."""
    out = np.zeros(lights.shape[:2], dtype=bool)
    for part in picture.left_out:
        out[part.bounce, part.source] = True
    whole = lights.sum(axis=(0, 1))
    missing = lights[out].sum(axis=0)
    assert sum(part.error for part in picture.left_out if part.met) <= LEFT_OUT_SHARE * error
    assert size(missing, whole) <= LEFT_OUT_SHARE * error
    return out, whole


@pytest.mark.parametrize(("error", "left_out"), [(0.8, True), (0.03, False)])
def test_bounces_in_a_picture(error, left_out):
    def make(sun):
        return fold(Fresnel(1.02 + 6.84j, 0.3, specular=0.6, diffuse=0.1), Sun((0.2, 0.6, 0.7), sun))

    lights = each_light(make, (3.0,))
    picture = backward(make(3.0), FOLD_VIEW, bounces=BOUNCES, error=error)
    out, whole = check(picture, lights, error)
    assert not out[1:3, 0].any()
    assert out[BOUNCES, 0]
    assert out[3, 0] == left_out
    # Leaving the third bounce out costs this, whether it may be or not.
    assert (size(lights[3, 0], whole) <= LEFT_OUT_SHARE * error) == left_out


@pytest.mark.parametrize(("radiance", "left_out"), [(2e-4, True), (0.3, False)])
def test_the_skys_light_and_its_polarization(radiance, left_out):
    error = 0.05

    def make(sun, sky):
        surface = Fresnel(1.5, 0.2, specular=0.9, diffuse=0.1)
        return fold(surface, Sun((0.2, 0.6, 0.7), sun), RayleighSky((0.2, 0.6, 0.7), sky))

    lights = each_light(make, (3.0, radiance))
    picture = backward(make(3.0, radiance), FOLD_VIEW, bounces=BOUNCES, error=error)
    out, whole = check(picture, lights, error)
    assert out[:, 1].all() == left_out
    assert out[1, 1] == left_out
    sky = lights[:, 1].sum(axis=0)
    assert (size(sky, whole) <= LEFT_OUT_SHARE * error) == left_out
    # Its linear polarization alone, which no unpolarized sky would replace.
    polarized = np.concatenate([np.zeros_like(sky[..., :1]), sky[..., 1:3]], axis=-1)
    assert (size(polarized, whole) <= LEFT_OUT_SHARE * error) == left_out


# Bounces of a radar's rays.


@pytest.mark.parametrize(("tolerance_db", "left_out"), [(3.0, True), (0.5, False)])
def test_bounces_of_a_radars_rays(tolerance_db, left_out):
    # Nearly level into a trihedral two walls answer, and the ground's part is small: 5.5 over 5.10 of the thesis, a
    # sixth at 2 degrees.
    edge_m, wavelength_m, elevation = 4 * 0.3048, 0.125, math.radians(2)
    place = 1e5 * np.array([math.cos(elevation) * math.sqrt(0.5)] * 2 + [math.sin(elevation)])
    target = radar_target(shapes.trihedral(edge_m), [CONDUCTOR], wavelength_m)
    found = settle(
        target, place, np.zeros(3), wavelength_m, tolerance_db=tolerance_db, start=Density(0.08, 4, 2)
    )  # fmt: skip
    assert found.reached
    assert found.density.bounces == (2 if left_out else 3)
    every = shoot(target, place, np.zeros(3), replace(found.density, bounces=6)).contributions
    upto = {
        most: every.chosen(every.bounces <= most).scattering(place, wavelength_m, np.zeros(3))[0, 0]
        for most in (2, 3, 6)
    }
    error = {most: float(np.abs(upto[most] - upto[6]).max() / np.abs(upto[6]).max()) for most in (2, 3)}
    allowed = 10 ** (tolerance_db / 20) - 1
    assert error[found.density.bounces] <= allowed
    assert (error[2] <= allowed) == left_out
    # The bounce after the last one kept is told.
    assert found.bounce_db[-1] <= 20 * math.log10(allowed)


# Near field of a target.


@pytest.mark.parametrize(("distance_m", "left_out"), [(25.0, True), (6.0, False)])
def test_near_field_of_a_target(distance_m, left_out):
    edge_m, wavelength_m = 1.22, 0.125
    # A diagonal of 1.725 m has its far field from 47.6 m; a plate of 0.87 m from 24.2 m.
    edge_m = 0.87 if left_out else edge_m
    plate = Reflector("plate", "plate", (0.0, distance_m, 0.0), edge_m)
    found = near_field(plate, [[0.0, 0.0, 0.0]], wavelength_m)
    assert found.is_near != left_out
    assert np.abs(found.far[0, 0]) == pytest.approx(float(plate_amplitude(edge_m, edge_m, 0, 0, wavelength_m)))
    # The mean of exp(-j k (x^2 + y^2) / R) over the plate, by Fresnel's integral along each edge.
    reach = edge_m / 2 * math.sqrt(4 / (wavelength_m * distance_m))
    sine, cosine = fresnel(reach)
    expected = 40 * math.log10(abs(cosine + 1j * sine) / reach)
    error = found.correction_db[0, 0]
    # Beyond Fresnel's approximation k D^4 / 64 R^3 is left: 0.5 rad at the corners at 6 m, parts in a hundred.
    assert error == pytest.approx(expected, abs=0.02 if left_out else 0.5)
    # At 2 D^2 / lambda phases reach pi / 4 at the corners, and 0.12 dB are lost; nearer it soon costs decibels.
    assert (abs(error) < 0.12) == left_out
    assert left_out or error < -3


# Shifts between exposures.


def blobs(right_px):
    """(64, 64) smooth scene, shifted in closed form."""
    random = np.random.default_rng(7)
    y, x = np.mgrid[0:64, 0:64].astype(float)
    places = random.uniform(6, 58, (30, 2))
    return 1000 + sum(300 * np.exp(-((y - b) ** 2 + (x - a - right_px) ** 2) / (2 * 2.5**2)) for a, b in places)


@pytest.mark.parametrize(("shift_px", "left_out"), [(0.02, True), (0.5, False)])
def test_shifts_between_exposures(shift_px, left_out):
    light = np.stack([blobs(0.0), blobs(shift_px)])
    placed, _, shifts, undone = registered(light, np.zeros((64, 64), dtype=bool), "auto")
    assert undone == (False, not left_out)
    assert shifts[1].right == pytest.approx(shift_px, abs=0.01)
    inner = np.s_[8:-8, 8:-8]

    def off(image):
        """Error in pixels: over the size of the gradients along the shift."""
        slope = (blobs(0.5) - blobs(-0.5))[inner]
        return float(np.sqrt(np.mean((image - light[0])[inner] ** 2) / np.mean(slope**2)))

    assert off(light[1]) == pytest.approx(shift_px, rel=0.02)
    assert off(placed[1]) < 0.03
    if left_out:
        np.testing.assert_array_equal(placed, light)


# The change of a footprint's pattern over the band.


@pytest.mark.parametrize(("bandwidth_hz", "left_out"), [(50e3, True), (150e6, False)])
def test_patterns_of_footprints_over_the_band(bandwidth_hz, left_out, monkeypatch):
    sweep, antenna = Sweep(1.3e9, bandwidth_hz, 32), np.array([[0.0, -2000.0, 1500.0]])
    level = radar_target(shapes.patch((-1, -1, 0), (2, 0, 0), (0, 2, 0)), [CONDUCTOR], sweep.wavelength_m)
    part = shoot(level, antenna[0], np.zeros(3), Density(0.3, 2, 1)).contributions
    assert (pattern_nodes(part, antenna[0], sweep).max() == 1) == left_out
    exact = history_reference(part, antenna, np.zeros(3), sweep)

    def off_db():
        found = phase_history(lambda _: part, antenna, np.zeros(3), sweep).echoes
        return 20 * np.log10(np.linalg.norm(found - exact) / np.linalg.norm(exact))

    assert off_db() < -50
    # With the pattern of the centre frequency alone.
    monkeypatch.setattr(history, "pattern_nodes", lambda part, antenna, sweep: np.ones(len(part), dtype=np.int64))
    assert (off_db() < -50) == left_out

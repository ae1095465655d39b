"""Compile the numerics once, so that the first picture in the field does not wait for the compiler.

``python -m polfuse_lab.warm_up`` is part of ``make setup``; compiled code is kept beside the sources.
"""

from __future__ import annotations

import multiprocessing
import os
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace

import numpy as np

from processing.calibration.facets import plate_facets
from processing.calibration.physical_optics import Antennas, physical_optics_scattering
from processing.fusion.anomalies import local_reed_xiaoli
from processing.fusion.kmeans import kmeans
from processing.optics.binning import bin_frame
from processing.optics.demosaic import demosaic
from processing.optics.mosaic import parse_mosaic
from processing.optics.mosaic_stokes import mosaic_stokes
from processing.optics.series import PolarizerSeries, SensorNoise
from processing.optics.stokes import stokes_planes
from processing.polarimetry.averaging import window_average
from processing.polarimetry.coherent import cameron
from processing.polarimetry.detection.cfar import Ring, cfar, ring_average
from processing.polarimetry.eigen import hermitian_eigen_of
from processing.polarimetry.freeman import freeman_durden
from processing.polarimetry.h_a_alpha import h_a_alpha
from processing.polarimetry.matrices import planes_of_vector
from processing.polarimetry.speckle.nonlocal_means import nonlocal_means
from processing.polarimetry.speckle.refined_lee import refined_lee
from processing.polarimetry.touzi import touzi
from processing.polarimetry.wishart import wishart_classify
from processing.polarimetry.yamaguchi import yamaguchi
from processing.radar.beat_kernel import beat_along_track
from processing.radar.profiles import RangeProfiles
from processing.radar.ridges import best_path
from processing.raytrace.backward import backward
from processing.raytrace.forward import forward, lit_points
from processing.raytrace.materials import Fresnel
from processing.raytrace.shapes import dihedral
from processing.raytrace.sources import Sun
from processing.raytrace.view import View
from processing.raytrace.world import world
from processing.sar.backprojection import backproject
from processing.sar.factorized import factorized
from processing.sar.grid import ImageGrid
from processing.sar.polar_format import polar_format
from processing.sar.range_migration import range_migration
from processing.scattering.contributions import together
from processing.scattering.history import Sweep, phase_history
from processing.scattering.rail_echoes import RailRadar, rail_echoes
from processing.scattering.rough import rough_points
from processing.scattering.shooting import Density, shoot
from processing.scattering.surfaces import RadarSurface
from processing.scattering.target import radar_target


def warm_up() -> None:
    """Run every compiled kernel on a few numbers, with the types that the program uses."""
    for part in PARTS:
        part()


def _focusing() -> None:
    """Images of all methods, and the beat signal."""
    antenna_m = np.zeros((16, 3))
    antenna_m[:, 0] = (np.arange(16) - 7.5) * 0.05
    profiles = RangeProfiles(
        values=np.ones((4, 16, 96), dtype=np.complex64),
        range_m=np.linspace(0.0, 23.75, 96),
        antenna_m=antenna_m,
        channels=("HH", "HV", "VH", "VV"),
        centre_hz=2.4e9,
        bandwidth_hz=80e6,
    )
    grid = ImageGrid(x_m=np.linspace(-1.0, 1.0, 8), y_m=np.linspace(4.0, 8.0, 8), z_m=-1.0)
    for interpolator in ("linear", "cubic", "sinc8", "sinc16"):  # one kernel for each filter length
        backproject(profiles, grid, interpolator=interpolator)
    # A single position goes into a live image by a kernel of its own.
    backproject(replace(profiles, values=profiles.values[:, :1], antenna_m=antenna_m[:1]), grid)
    range_migration(profiles, grid)
    polar_format(profiles, ImageGrid(np.linspace(-0.5, 0.5, 8), np.linspace(9.5, 10.5, 8), -1.0))
    # Enough pulses and pixels that parts of the aperture are merged.
    track_m = np.zeros((96, 3))
    track_m[:, 0] = np.linspace(-0.4, 0.4, 96)
    many = replace(profiles, values=np.tile(profiles.values, (1, 6, 1)), antenna_m=track_m)
    factorized(many, ImageGrid(np.linspace(-1.0, 1.0, 64), np.linspace(4.0, 8.0, 64), -1.0))
    beat_along_track(np.full(4, 2.4e9), np.zeros(4), antenna_m[:4], [[0.0, 5.0, 0.0]], [1.0])


def _optics() -> None:
    """Frames and what is made of them, reflectors, classes and tracks."""
    angles = np.radians([0.0, 45.0, 90.0, 135.0])
    series = PolarizerSeries(
        angles_rad=tuple(angles), frames=(1, 1, 1, 1), angle_sd_rad=(0.0,) * 4, noise=SensorNoise(1.0, 1.0)
    )
    for sample in (np.float32, np.float64):
        stokes_planes(np.full((4, 4, 4), 100.0, dtype=sample), np.zeros((4, 4), dtype=bool), series)
    for counts in (np.uint8, np.uint16):
        bin_frame(np.ones((4, 4), dtype=counts), 2, 255)
    for counts in (np.uint8, np.uint16):
        for solution in (None, np.full((3, 4), 0.3)):  # ideal polarizers, and calibrated ones
            mosaic_stokes(np.full((4, 16), 100, dtype=counts), parse_mosaic("90-45-135-0"), solution=solution)
    demosaic(np.ones((4, 4)), parse_mosaic("90-45-135-0"))
    physical_optics_scattering(plate_facets(0.2, 0.2), Antennas.at([[3.0, 0.0, 0.0]]), 0.125)
    kmeans(np.arange(24.0).reshape(8, 3), 2)
    local_reed_xiaoli(np.arange(24.0).reshape(1, 4, 6), guard=0, reach=2)
    best_path(np.ones((4, 8)), np.array([-1.0, 0.0, 1.0]))


def _rays() -> None:
    """Pictures of a corner, and its echoes: rays, their sum, a phase history of footprints and points."""
    mirrors = world(dihedral(1.0), [Fresnel(1.5, 0.2)], [Sun((0.0, 1.0, 1.0))])
    view = View((0.0, 3.0, 3.0), (0.0, 0.5, 0.5), 4, 4, 0.3)
    backward(mirrors, view, samples=1)
    forward(mirrors, view, rays=2)
    lit_points(mirrors, 0, rays=2)

    surfaces = [RadarSurface(5 - 0.2j, 0.001)]
    target = radar_target(dihedral(0.5), surfaces, 0.125)
    antenna_m = np.array([0.0, 5.0, 5.0])
    found = shoot(target, antenna_m, np.zeros(3), Density(0.25, 1, 2)).contributions
    found.scattering(antenna_m, 0.125, np.zeros(3))
    both = together([found, rough_points(target, surfaces, antenna_m, 10.0)])
    phase_history(lambda _: both, antenna_m[None], np.zeros(3), Sweep(2.4e9, 80e6, 16))
    rail_echoes(lambda _: both, (0.0, 0.0), RailRadar(2.4e9, 80e6))


def _polarimetry() -> None:
    """Decompositions, filters and detectors, on float32 planes as products files have them."""
    rng = np.random.default_rng(0)
    k = rng.normal(size=(3, 24, 24)) + 1j * rng.normal(size=(3, 24, 24))
    planes = window_average(planes_of_vector(k.astype(np.complex64)), 3)
    for decomposition in (freeman_durden, h_a_alpha, touzi, yamaguchi):
        decomposition(planes)
    hermitian_eigen_of(np.eye(3, dtype=np.complex128)[None])
    cameron(np.ones((4, 4, 4), dtype=np.complex64))
    refined_lee(planes, looks=4.0)
    nonlocal_means(planes, looks=4, search=5)
    wishart_classify(planes, np.ones((24, 24), dtype=np.uint8), iterations=1)
    ring = Ring(9, 3)
    ring_average(planes, ring)
    cfar(planes[0], false_alarm=1e-2, looks=4.0, ring=ring)
    cfar(planes[0], false_alarm=1e-2, looks=4.0, ring=ring, kind="os")


PARTS = (_focusing, _rays, _polarimetry, _optics)
"""What is compiled apart, so that two processes can share it; the longest first."""


def main() -> None:
    """:func:`warm_up` by two processes where there are two cores."""
    if (os.cpu_count() or 1) < 2:
        return warm_up()
    with ProcessPoolExecutor(2, mp_context=multiprocessing.get_context("spawn")) as pool:
        for done in [pool.submit(part) for part in PARTS]:
            done.result()


if __name__ == "__main__":
    main()

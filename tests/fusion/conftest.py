"""A small scene made into products by closed-form range profiles, back-projection and a rendered camera picture."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from polfuse_lab.products.store import Products
from processing.optics.camera_model import Pinhole
from processing.radar.antenna import boresight, one_way_gain
from processing.radar.profiles import SPEED_OF_LIGHT_M_S, RangeProfiles
from processing.sar.backprojection import backproject
from processing.sar.grid import ImageGrid
from processing.scene.model import Bush, Point, Reflector, Scene
from processing.scene.radar_response import scatterers

CENTRE_HZ, BANDWIDTH_HZ, GROUND_Z_M = 2.4e9, 80e6, -1.07
WAVELENGTH_M = SPEED_OF_LIGHT_M_S / CENTRE_HZ
CHANNELS = ("HH", "HV", "VH", "VV")
AMPLITUDE = 0.02
DEPRESSION_RAD = float(np.radians(17))
CAMERA = Pinhole(0.008, 33.2e-6, 196, 146, (0.0, 0.0, 0.0), np.radians(9.0))


def deg(value: float) -> float:
    return float(np.radians(value))


TRIHEDRAL = Reflector("trihedral", "trihedral", (0.3, 8.0, GROUND_Z_M), 0.61, deg(42), deg(33))
DIHEDRAL = Reflector("dihedral", "dihedral", (-2.0, 12.0, GROUND_Z_M), 0.61, fold_rad=np.pi / 2)
PLATE = Reflector("plate", "plate", (2.6, 12.5, GROUND_Z_M), 0.61)
BUSH = Bush("bush", (0.0, 16.5, GROUND_Z_M), 0.8, 60, 2.0, seed=5)
POINT = Point("point", (-3.0, 7.0, GROUND_Z_M), np.eye(2, dtype=np.complex128))
SCENE = Scene("test", points=(POINT,), reflectors=(TRIHEDRAL, DIHEDRAL, PLATE), bushes=(BUSH,))


def antennas(positions: int = 61, step_m: float = 0.0508) -> np.ndarray:
    x = (np.arange(positions) - (positions - 1) / 2) * step_m
    return np.stack([x, np.zeros(positions), np.zeros(positions)], axis=1)


def hann_envelope(cells: np.ndarray) -> np.ndarray:
    """Transform of a hann window over the ramp, 1 at 0: closed form (Harris 1978)."""
    return np.sinc(cells) + 0.5 * (np.sinc(cells - 1) + np.sinc(cells + 1))


def range_profiles(scene, receive, transmit, *, noise=0.0, seed=0, antenna_m=None, beamwidth_rad=None) -> RangeProfiles:
    """Range-compensated profiles of a scene, by the convention of RangeProfiles; white beat noise grows as R^2."""
    antenna_m = antennas() if antenna_m is None else antenna_m
    resolution = SPEED_OF_LIGHT_M_S / (2 * BANDWIDTH_HZ)
    range_m = np.arange(0, 26, resolution / 8)
    values = np.zeros((4, len(antenna_m), len(range_m)), dtype=np.complex128)
    for p, place in enumerate(antenna_m):
        centres, s = scatterers(scene, place, WAVELENGTH_M)
        distance = np.linalg.norm(centres - place, axis=1)
        m = receive @ s @ transmit
        if beamwidth_rad is not None:
            cosine = (centres - place) @ boresight(DEPRESSION_RAD) / distance
            m = m * one_way_gain(cosine, beamwidth_rad)[:, None, None]
        phase = np.exp(-4j * np.pi * CENTRE_HZ * distance / SPEED_OF_LIGHT_M_S)
        envelope = hann_envelope((range_m[None, :] - distance[:, None]) / resolution)
        for c, name in enumerate(CHANNELS):
            element = m[:, "HV".index(name[1]), "HV".index(name[0])]
            echoes = np.sum((element * phase / distance**2)[:, None] * envelope, axis=0)
            # Compensated bin by bin, as from a recording: each bin by its own range.
            values[c, p] = AMPLITUDE * echoes * range_m**2
    random = np.random.default_rng(seed)
    white = random.normal(size=(2, *values.shape)) * noise / np.sqrt(2)
    values += (white[0] + 1j * white[1]) * range_m**2
    return RangeProfiles(values, range_m, antenna_m, CHANNELS, CENTRE_HZ, BANDWIDTH_HZ, "hann", True)


def write_radar(path: Path, profiles: RangeProfiles, grid: ImageGrid, **settings) -> Products:
    products = Products(path)
    beamwidth, depression = settings.get("beamwidth_rad"), settings.get("depression_rad", 0.0)
    image = backproject(profiles, grid, beamwidth_rad=beamwidth, depression_rad=depression)
    products.write(
        "ranging",
        {
            "profiles": profiles.values.astype(np.complex64),
            "range_m": profiles.range_m,
            "antenna_m": profiles.antenna_m,
        },
        settings={"channels": CHANNELS, "range_compensated": True, "window": "hann", "oversampling": 8},
        inputs=[],
        units={},
    )
    products.write(
        "focus",
        {"image": image, "x_m": grid.x_m, "y_m": grid.y_m},
        settings={
            "channels": CHANNELS,
            "z_m": grid.z_m,
            "centre_hz": CENTRE_HZ,
            "bandwidth_hz": BANDWIDTH_HZ,
            **settings,
        },
        inputs=[],
        units={},
    )
    return products


def write_optics(products: Products) -> None:
    """Ground with DOLP 0.1, a square metre of 0.5 around the dihedral, and a masked corner of the picture."""
    columns, rows = np.meshgrid(np.arange(CAMERA.width_px), np.arange(CAMERA.height_px))
    ground = CAMERA.on_plane(columns, rows, GROUND_Z_M)
    near = (np.abs(ground[..., 0] - DIHEDRAL.position_m[0]) < 1) & (np.abs(ground[..., 1] - 12.0) < 1.2)
    random = np.random.default_rng(11)
    dolp = np.where(near, 0.5, 0.1) + 0.01 * random.normal(size=near.shape)
    s0 = np.where(near, 9000.0, 4000.0) + 20 * random.normal(size=near.shape)
    s1, s2 = s0 * dolp * np.cos(0.6), s0 * dolp * np.sin(0.6)
    shown = dolp.copy()
    shown[:8, :8] = np.nan
    products.write(
        "optics",
        # Behind evenly spread angles the DOLP's sd is sqrt 2 times that of S0 over S0.
        {
            "s0": s0,
            "s1": s1,
            "s2": s2,
            "s0_sd": s0 * (0.01 / np.sqrt(2)),
            "dolp": shown,
            "dolp_sd": np.full(s0.shape, 0.01),
        },
        settings={
            "camera": {
                "focal_length_m": CAMERA.focal_length_m,
                "pixel_pitch_m": CAMERA.pixel_pitch_m,
                "width_px": CAMERA.width_px,
                "height_px": CAMERA.height_px,
                "position_m": CAMERA.position_m,
                "depression_rad": CAMERA.depression_rad,
            }
        },
        inputs=[],
        units={},
    )


GRID = ImageGrid(np.arange(-5, 5.001, 0.1), np.arange(3.5, 20.001, 0.2), GROUND_Z_M)
RECEIVE = np.array([[1.0, 0.03 * np.exp(1j)], [0.02j, 1.12 * np.exp(0.35j)]])
"""Crosstalk -30 to -34 dB, V over H +0.98 dB and 20 degrees."""
TRANSMIT = np.array([[1.0, 0.02], [0.025 * np.exp(2j), 0.93 * np.exp(-0.1j)]])
NOISE = 2e-6


@pytest.fixture(scope="session")
def focused_path(tmp_path_factory) -> Path:
    """A products file with stages "ranging", "focus" and "optics"; tests copy it before they write."""
    path = tmp_path_factory.mktemp("fusion") / "scene.h5"
    products = write_radar(path, range_profiles(SCENE, RECEIVE, TRANSMIT, noise=NOISE), GRID)
    write_optics(products)
    return path


@pytest.fixture(scope="session")
def sky_path(tmp_path_factory) -> Path:
    """A products file with a look at the empty sky: noise alone, one position."""
    path = tmp_path_factory.mktemp("sky") / "sky.h5"
    one = antennas(1)
    profiles = range_profiles(Scene("sky"), RECEIVE, TRANSMIT, noise=NOISE, seed=1, antenna_m=one)
    products = Products(path)
    products.write(
        "ranging",
        {"profiles": profiles.values, "range_m": profiles.range_m, "antenna_m": one},
        settings={"channels": CHANNELS, "range_compensated": True},
        inputs=[],
        units={},
    )
    return path

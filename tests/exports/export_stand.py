"""Products files with known content, as focusing and calibration leave them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from polfuse_lab.products.store import Products
from processing.radar.profiles import SPEED_OF_LIGHT_M_S

CHANNELS = ("HH", "HV", "VH", "VV")
CENTRE_HZ, BANDWIDTH_HZ = 2.4e9, 80e6
SITE = """
[site]
latitude_deg = 39.78
longitude_deg = -84.08
height_m = 240.0
heading_deg = {heading}
"""


def rig_file(path: Path, heading: float | None = 30.0) -> Path:
    """The example rig, standing somewhere or (None) nowhere."""
    from polfuse_lab.rig.examples import write_examples

    write_examples(path.parent / f"{path.stem}_init")
    text = (path.parent / f"{path.stem}_init" / "rig.toml").read_text(encoding="utf-8")
    path.write_text(text if heading is None else text + SITE.format(heading=heading), encoding="utf-8")
    return path


def products_file(path: Path, *, calibrated: bool = True) -> Path:
    """Stages "ranging", "focus", "calibration": 41 positions, an image of 30 x 24 pixels, a corner of it undefined."""
    rng = np.random.default_rng(4)
    x, y, z = -1.2 + 0.1 * np.arange(24), 8.0 + 0.3 * np.arange(30), -1.07
    image = (rng.normal(size=(4, 30, 24)) + 1j * rng.normal(size=(4, 30, 24))).astype(np.complex64)
    image[:, :4, :3] = np.nan
    antenna = np.zeros((41, 3))
    antenna[:, 0] = np.linspace(-1.0, 1.0, 41)
    products = Products(path)
    range_m = np.arange(128) * 0.25
    products.write(
        "ranging",
        {"profiles": point_profiles(antenna, range_m, (0.5, 9.2, z)), "range_m": range_m, "antenna_m": antenna},
        settings={
            "channels": list(CHANNELS), "centre_hz": CENTRE_HZ, "bandwidth_hz": BANDWIDTH_HZ, "window": "hann",
            "range_compensated": True,
        },
        inputs=[],
        units={},
    )  # fmt: skip
    products.write(
        "focus",
        {"image": image * 2, "flags": np.zeros((30, 24), dtype=np.uint8), "x_m": x, "y_m": y},
        settings={
            "channels": list(CHANNELS), "z_m": z, "centre_hz": CENTRE_HZ, "bandwidth_hz": BANDWIDTH_HZ,
            "window": "hann", "aperture_window": "rectangular", "method": "bp", "autofocus": None,
        },
        inputs=[],
        units={"image": "full scale * m^2"},
    )  # fmt: skip
    if calibrated:
        products.write(
            "calibration",
            {"scattering": image, "x_m": x, "y_m": y},
            settings={"channels": list(CHANNELS)},
            inputs=[path],
            units={"scattering": "sqrt(m^2)"},
        )
    return path


def point_profiles(antenna_m: np.ndarray, range_m: np.ndarray, place_m: tuple[float, float, float]) -> np.ndarray:
    """Range-compensated profiles (4, positions, bins) of a point: Hann envelope, phase of the ramp's centre."""
    distance = np.linalg.norm(antenna_m - np.array(place_m), axis=1)[:, None]
    u = 2 * BANDWIDTH_HZ / SPEED_OF_LIGHT_M_S * (range_m - distance)
    envelope = np.sinc(u) + 0.5 * (np.sinc(u - 1) + np.sinc(u + 1))
    one = envelope * np.exp(-4j * np.pi * CENTRE_HZ / SPEED_OF_LIGHT_M_S * distance)
    return (np.array([1.0, 0.3j, 0.3j, -0.8])[:, None, None] * one).astype(np.complex64)

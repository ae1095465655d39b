"""Random polarized scenes on which planners are judged: spectra of any slope, edges, texture, contrast of polarization.

Shapes have closed forms (their edges are error functions of the distance), so that a scene is known anywhere.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from processing.optics.mosaic import ANGLES_DEG, Mosaic, parse_mosaic, through_planes

Floats = NDArray[np.float64]

MOSAICS = ("90-45-135-0", "0-45-135-90", "0-90-45-135", "135-0-90-45")


def random_field(rng: np.random.Generator, size: int, slope: float, blur_px: float) -> Floats:
    """(size, size) of mean 0 and variance 1 whose power falls as frequency to the ``slope``, seen by a blurred lens."""
    count = 2 * size  # what is kept does not go round
    frequency = np.hypot(np.fft.fftfreq(count)[:, None], np.fft.rfftfreq(count))
    frequency[0, 0] = np.inf
    shape = frequency ** (-slope / 2) * np.exp(-2 * (np.pi * np.where(frequency < 1, frequency, 0) * blur_px) ** 2)
    white = np.fft.rfft2(rng.normal(size=(count, count)))
    field = np.fft.irfft2(white * shape, s=(count, count))[:size, :size]
    return np.asarray((field - field.mean()) / field.std())


@dataclass(frozen=True)
class Shape:
    """An ellipse or a rectangle of one light before what is behind it."""

    centre: tuple[float, float]
    half: tuple[float, float]
    turn_rad: float
    straight: bool
    light: Floats
    """S0, S1, S2."""

    def cover(self, x: Floats, y: Floats, blur_px: float) -> Floats:
        """Share of it in what is seen at these places."""
        right, down = x - self.centre[0], y - self.centre[1]
        u = right * np.cos(self.turn_rad) + down * np.sin(self.turn_rad)
        v = down * np.cos(self.turn_rad) - right * np.sin(self.turn_rad)
        if self.straight:
            inside = np.minimum(self.half[0] - np.abs(u), self.half[1] - np.abs(v))
        else:
            away = np.hypot(u / self.half[0], v / self.half[1]) + 1e-9
            inside = (1 - away) / away * np.hypot(u, v)
        return np.asarray(ndtr(inside / blur_px))


def random_shapes(rng: np.random.Generator, size: int, strongest: float) -> list[Shape]:
    """Few or many, from 3 to 30 pixels, with polarization up to ``strongest``."""
    found = []
    for _ in range(int(size * size / rng.uniform(400, 4000)) + 3):
        dolp, angle = strongest * rng.uniform() ** 1.5, 2 * rng.uniform(0, np.pi)
        light = rng.uniform(0.1, 2.5) * np.array([1.0, dolp * np.cos(angle), dolp * np.sin(angle)])
        centre, half = rng.uniform(0, size, 2), rng.uniform(3, 30, 2)
        middle, size_px = (float(centre[0]), float(centre[1])), (float(half[0]), float(half[1]))
        found.append(Shape(middle, size_px, float(rng.uniform(0, np.pi)), bool(rng.random() < 0.5), light))
    return found


def painted(shapes: list[Shape], x: Floats, y: Floats, blur_px: float) -> Floats:
    """S0, S1, S2 (3, ...) at these places: the shapes in their order before unpolarized light of 1."""
    stokes = np.zeros((3, *x.shape))
    stokes[0] = 1.0
    for shape in shapes:
        share = shape.cover(x, y, blur_px)
        stokes += share * (shape.light.reshape(3, *(1,) * x.ndim) - stokes)
    return stokes


def random_stokes(rng: np.random.Generator, size: int) -> Floats:
    """(3, size, size): texture of a random spectrum, shapes, or both; DOLP below 0.95."""
    y, x = np.mgrid[0:size, 0:size].astype(np.float64)
    kind = str(rng.choice(["texture", "shapes", "both"]))
    shapes = [] if kind == "texture" else random_shapes(rng, size, float(rng.uniform(0.05, 0.9)))
    stokes = painted(shapes, x, y, float(rng.uniform(0.35, 1.2)))
    if kind == "shapes":
        return stokes
    slope, blur = float(rng.uniform(1, 4)), float(rng.uniform(0.3, 1.0))
    stokes *= np.clip(1 + rng.uniform(0.03, 0.4) * random_field(rng, size, slope, blur), 0.05, None)
    contrast = 0.4 * rng.uniform() * rng.uniform() ** 1.5
    return polarized(stokes, [contrast * random_field(rng, size, slope, blur) for _ in range(2)])


def polarized(stokes: Floats, more: Sequence[Floats]) -> Floats:
    """Stokes parameters (3, rows, columns) with so much added to S1 / S0 and S2 / S0; DOLP stays below 0.95."""
    parts = [own / stokes[0] + added for own, added in zip(stokes[1:], more, strict=True)]
    limit = stokes[0] * np.minimum(1.0, 0.95 / np.maximum(np.hypot(*parts), 1e-9))
    return np.stack([stokes[0], parts[0] * limit, parts[1] * limit])


@dataclass(frozen=True)
class MosaicPicture:
    """What a camera with polarizers on its pixels makes of a random scene."""

    image: Floats
    """(rows, columns) counts above black."""
    truth: Floats
    """(4, rows, columns) counts behind each angle without noise."""
    mosaic: Mosaic
    variance: Floats
    """(rows, columns) of the noise, counts^2, as it follows from the counts."""


def random_mosaic(seed: int, sizes: tuple[int, ...] = (96, 128, 256)) -> MosaicPicture:
    """A scene, its light (200 to 30 000 counts), a camera (0.3 to 100 electrons a count, read noise up to 5 counts)."""
    rng = np.random.default_rng(seed)
    stokes = random_stokes(rng, int(rng.choice(sizes)))
    turn = np.radians(ANGLES_DEG)[:, None, None]
    truth = 0.5 * (stokes[0] + stokes[1] * np.cos(2 * turn) + stokes[2] * np.sin(2 * turn))
    truth *= 10 ** rng.uniform(2.3, 4.5)
    mosaic = parse_mosaic(str(rng.choice(MOSAICS)))
    electrons, read = 10 ** rng.uniform(-0.5, 2.0), rng.uniform(0, 5)
    light = through_planes(truth, mosaic)
    image = np.rint(light + np.sqrt(light / electrons + read**2) * rng.normal(size=light.shape))
    return MosaicPicture(image, truth, mosaic, np.maximum(image, 0) / electrons + read**2 + 1 / 12)


@dataclass(frozen=True)
class PlacesBetween:
    """Planes of a random scene, and what the scene holds at places between their pixels."""

    planes: Floats
    """(3, rows, columns) S0, S1, S2 with noise."""
    u: Floats
    v: Floats
    """(places,) columns and rows."""
    truth: Floats
    """(3, places) without noise."""
    variance: float
    """Of the noise in each plane."""


FINE = 8
"""Places between two pixels."""


def random_places(seed: int, size: int = 96, places: int = 4000) -> PlacesBetween:
    """A scene known at eighths of a pixel: shapes by their closed forms, texture as a sum of waves."""
    rng = np.random.default_rng(seed)
    kind = str(rng.choice(["texture", "shapes", "both"]))
    fine_x, fine_y = rng.integers(8 * FINE, (size - 8) * FINE, (2, places))
    row, column = (axis * FINE for axis in np.mgrid[0:size, 0:size])
    shapes = [] if kind == "texture" else random_shapes(rng, size, 0.5)
    blur = float(rng.uniform(0.35, 1.2))
    planes, truth = (painted(shapes, x / FINE, y / FINE, blur) for x, y in ((column, row), (fine_x, fine_y)))
    if kind != "shapes":
        waves = random_field(rng, size * FINE, float(rng.uniform(1, 4)), FINE * float(rng.uniform(0.3, 1.0)))
        texture = 1 + rng.uniform(0.03, 0.4) * waves
        planes, truth = planes * texture[row, column], truth * texture[fine_y, fine_x]
    level = 10 ** rng.uniform(2.3, 4.5)
    sd = level * 10 ** rng.uniform(-4, -1.5)
    noisy = level * planes + sd * rng.normal(size=planes.shape)
    return PlacesBetween(noisy, fine_x / FINE, fine_y / FINE, level * truth, sd**2)

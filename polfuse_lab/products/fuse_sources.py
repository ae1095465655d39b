"""Radar and camera on one grid, before they are fused: from a session's stages, or from a simulation's."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polfuse_lab.errors import PolfuseError
from polfuse_lab.products.camera_lens import with_lens
from polfuse_lab.products.fuse_resampling import chosen_resampling, stokes_on_ground
from polfuse_lab.products.heights_file import height_map
from polfuse_lab.products.optics import pinhole_of
from polfuse_lab.products.store import Products
from processing.errors import DataError
from processing.fusion.height_map import HeightMap
from processing.fusion.registration import (
    GeometryErrors,
    RegistrationError,
    ground_to_camera,
    registration_error,
)
from processing.fusion.registration_refine import PictureShift, shift_by_pictures
from processing.fusion.resampling_planner import ResamplingChoice
from processing.fusion.surface_registration import SurfacePixels, focused_to_camera, surface_to_camera
from processing.optics.camera_model import Pinhole
from processing.radar.profiles import SPEED_OF_LIGHT_M_S

Floats = NDArray[np.float64]

GEOMETRY, IDENTITY = "geometry", "identity"
"""How pictures were registered: by the rig's geometry, or not at all since both are on one grid already."""
ONE_GRID = (
    "registration is the identity: the simulation put both pictures on one ground grid, where what stands above the "
    "ground leans towards the radar and away from the camera"
)


@dataclass(frozen=True)
class Registered:
    """Both pictures on the radar's grid."""

    x_m: Floats
    y_m: Floats
    z_m: float
    pauli: NDArray[np.complexfloating]
    """(3, ny, nx) sqrt(m^2)."""
    span_m2: Floats
    """(ny, nx)."""
    noise_m2: Floats
    """Span of noise alone, (ny, 1) or (1, 1)."""
    s0: Floats
    """(ny, nx)."""
    dolp: Floats
    """(ny, nx), debiased."""
    u_px: Floats
    """(ny, nx) column of the camera's picture; NaN outside it. Of a simulation, the grid's own."""
    v_px: Floats
    error_px: Floats
    """(ny, nx) standard deviation of the registration."""
    registration: str
    """:data:`GEOMETRY` or :data:`IDENTITY`."""
    light_unit: str
    """Of S0."""
    errors: GeometryErrors | None = None
    shift: PictureShift | None = None
    bodies: Mapping[str, NDArray[np.bool_]] = field(default_factory=dict)
    """Where (ny, nx) each kind of body stands, where that is known."""
    resampling: ResamplingChoice | None = None
    """How a tolerance chose to look between the camera's pixels."""
    camera: Pinhole | None = None
    """Which the pictures were registered with."""
    relief: bool = False
    """Whether the ground was a height map, and not a plane."""


@dataclass(frozen=True)
class Geometry:
    """What the registration by geometry relies on; see :func:`polfuse_lab.products.fuse.fuse`."""

    angle_sd_rad: float
    height_sd_m: float
    refine: bool = False
    heights: Path | str | None = None
    camera: Path | str | None = None
    tolerance_db: float | None = None


def is_simulated(products: Products) -> bool:
    """Whether a file's polarimetry is that of a simulated scene, and not of a calibrated measurement."""
    stages = products.stages()
    return "simulation" in stages and "calibration" not in stages


def of_simulation(products: Products, notes: list[str], *, refine: bool) -> Registered:
    """Stages "polarimetry" and "simulation", which share a grid.

    Args:
        products: the file.
        notes: added to.
        refine: whether a correction was asked for; there is nothing to correct.

    Raises:
        PolfuseError: a stage that is missing.
    """
    polarimetry, seen = products.read("polarimetry"), products.read("simulation")
    settings = products.settings("simulation")
    notes.append(ONE_GRID)
    if refine:
        notes.append("nothing to refine: there is no error of registration in a simulation")
    kinds: dict[str, NDArray[np.bool_]] = {}
    for number, body in enumerate(settings["bodies"]):
        stands = seen["body"] == number
        kinds[body["kind"]] = kinds.get(body["kind"], np.zeros_like(stands)) | stands
    defined = np.isfinite(seen["dolp"])
    v, u = np.indices(defined.shape).astype(np.float64)
    return Registered(
        x_m=polarimetry["x_m"],
        y_m=polarimetry["y_m"],
        z_m=float(products.settings("polarimetry")["z_m"]),
        pauli=polarimetry["pauli"],
        span_m2=polarimetry["span"],
        noise_m2=np.array([[float(settings["noise_span_m2"])]]),
        s0=seen["s0"].astype(np.float64),
        dolp=seen["dolp"].astype(np.float64),
        u_px=np.where(defined, u, np.nan),
        v_px=np.where(defined, v, np.nan),
        error_px=np.where(defined, 0.0, np.nan),
        registration=IDENTITY,
        light_unit="1",
        bodies=kinds,
    )


def of_session(products: Products, notes: list[str], geometry: Geometry) -> Registered:
    """Stages "calibration", "polarimetry" and "optics", registered by the rig's geometry.

    Args:
        products: the file.
        notes: added to.
        geometry: what the registration relies on.

    Raises:
        PolfuseError: a stage that is missing, or a file that cannot be used.
        DataError: a height map that the picture does not lie on.
    """
    polarimetry, calibration = products.read("polarimetry"), products.read("calibration")
    settings = products.settings("calibration")
    optics, camera = products.read("optics"), pinhole_of(products.settings("optics"))
    if geometry.camera is not None:
        camera = with_lens(camera, geometry.camera)
    x_m, y_m, z_m = polarimetry["x_m"], polarimetry["y_m"], float(settings["z_m"])
    angle_sd_rad, refine = geometry.angle_sd_rad, geometry.refine
    errors = _geometry_errors(products, settings, angle_sd_rad, geometry.height_sd_m)
    surface = _surface(products, camera, (x_m, y_m, z_m), geometry)
    if surface is None:
        u, v = ground_to_camera(camera, x_m, y_m, z_m)
    else:
        u, v = surface.u, surface.v
        notes.append(_relief(surface))

    def error_of(errors: GeometryErrors) -> RegistrationError:
        if surface is None:
            return registration_error(camera, x_m, y_m, z_m, errors)
        return surface.error(camera, errors)

    budget = error_of(errors)
    shift: PictureShift | None = None
    if refine:
        seen = np.isfinite(u)
        # A whole cell: its length is sqrt 12 standard deviations of a place in it.
        cells = np.sqrt(12) * np.hypot(budget.range_cell, budget.cross_range_cell)[seen]
        cell_px = float(np.median(cells)) if seen.any() else np.inf
        known_px = camera.focal_length_px * angle_sd_rad
        shift = shift_of_pictures(polarimetry["span"], optics["s0"], (u, v), cell_px, known_px, notes)
    if shift is not None:
        told = float(np.hypot(max(shift.right_sd_px, shift.down_sd_px), cell_px / np.sqrt(12))) / camera.focal_length_px
        errors = replace(errors, angle_rad=told)
        budget = error_of(errors)
        u, v = u + shift.right_px, v + shift.down_px
    asked = geometry.tolerance_db
    choice = None if asked is None else chosen_resampling(optics, u, v, asked)
    s0, dolp = stokes_on_ground(optics, u, v, 1 if choice is None else choice.degree)
    return Registered(
        x_m=x_m,
        y_m=y_m,
        z_m=z_m,
        pauli=polarimetry["pauli"],
        span_m2=polarimetry["span"],
        noise_m2=_noise_span(calibration["noise_equivalent_rcs_m2"], settings),
        s0=s0,
        dolp=dolp,
        u_px=u,
        v_px=v,
        error_px=np.where(np.isfinite(u), budget.total, np.nan),
        registration=GEOMETRY,
        light_unit="counts",
        errors=errors,
        shift=shift,
        resampling=choice,
        camera=camera,
        relief=surface is not None,
    )


def _surface(
    products: Products, camera: Pinhole, plane: tuple[Floats, Floats, float], geometry: Geometry
) -> SurfacePixels | None:
    """The ground as a height map: a file's, or the one that the picture was focused on; None: it is a plane."""
    x_m, y_m, z_m = plane
    on_heights = products.settings("focus").get("grid") == "heights"
    if geometry.heights is None:
        if not on_heights:
            return None
        own = HeightMap(x_m, y_m, products.read("focus")["height_m"] - z_m)
        return focused_to_camera(camera, own, *plane, geometry.height_sd_m)
    if on_heights:
        raise PolfuseError(
            "was focused on heights of its own, which are used", where=str(products.path), advice="leave --heights out"
        )
    return surface_to_camera(camera, height_map(geometry.heights, z_m), *plane, geometry.height_sd_m)


def _relief(surface: SurfacePixels) -> str:
    """What the height map takes away, in words."""
    empty = int(np.count_nonzero(np.isnan(surface.points_m[..., 1])))
    folded = int(np.count_nonzero(surface.layover_px > 0))
    return (
        f"height map: {int(surface.hidden.sum())} pixels are hidden from the camera, {empty} lie in the radar's shadow "
        f"or outside the map, {folded} show several places at once"
    )


def shift_of_pictures(
    span_m2: NDArray[Any],
    s0: NDArray[Any],
    at: tuple[Floats, Floats],
    cell_px: float,
    known_px: float,
    notes: list[str],
) -> PictureShift | None:
    """Displacement of the camera's picture, if both pictures tell it better than ``known_px``.

    They do not where the radar's cell, as long as the camera sees it (``cell_px``), is longer than that: the best shift
    follows single bright cells then.
    """
    if not cell_px < known_px:
        notes.append(
            f"registration by geometry alone: the radar's cell spans {cell_px:.1f} px of the camera's picture, whose "
            f"direction is known to {known_px:.1f} px already"
        )
        return None
    with np.errstate(divide="ignore", invalid="ignore"):
        level_db = np.where(span_m2 > 0, 10 * np.log10(span_m2), np.nan)
    try:
        shift = shift_by_pictures(level_db, s0, *at, largest_px=max(3 * known_px, 6.0), step_px=max(known_px / 3, 1.0))
    except DataError as error:
        notes.append(f"registration by geometry alone: {error}")
        return None
    if not max(shift.right_sd_px, shift.down_sd_px) < known_px:
        notes.append("registration by geometry alone: both pictures have too little in common")
        return None
    return shift


def _geometry_errors(
    products: Products, settings: Mapping[str, Any], angle_sd_rad: float, height_sd_m: float
) -> GeometryErrors:
    """A scatterer may lie anywhere in its resolution cell: sd is the cell over sqrt 12."""
    antenna = products.read("ranging")["antenna_m"]
    y_m = products.read("polarimetry")["y_m"]
    aperture = float(np.ptp(antenna[:, 0]))
    range_cell = SPEED_OF_LIGHT_M_S / (2 * float(settings["bandwidth_hz"]))
    slant = float(np.hypot(np.median(y_m), float(settings["z_m"])))
    wavelength = SPEED_OF_LIGHT_M_S / float(settings["centre_hz"])
    # Exact for any aperture: lambda / (4 sin(half the aperture's angle)).
    cross_cell = wavelength / (4 * np.sin(np.arctan2(aperture / 2, slant))) if aperture > 0 else slant
    return GeometryErrors(range_cell / np.sqrt(12), float(cross_cell) / np.sqrt(12), angle_sd_rad, height_sd_m)


def _noise_span(noise: NDArray[Any], settings: Mapping[str, Any]) -> Floats:
    by_name = dict(zip(settings["channels"], noise, strict=True))
    crosses = [by_name[name] for name in ("HV", "VH") if name in by_name]
    # The cross-polarized element is the mean of its channels and counts twice in the span.
    level = by_name["HH"] + by_name["VV"] + 2 * sum(crosses) / len(crosses) ** 2
    return np.asarray(level, dtype=np.float64)[:, None]

"""From a scene file to both eyes' pictures: the stages ``"matrices"``, ``"polarimetry"`` and ``"simulation"``."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polfuse_lab.errors import PolfuseError
from polfuse_lab.products.calibration_write import write_polarimetry
from polfuse_lab.products.store import Products
from polfuse_lab.simulation.scene_file import SolidSceneFile, read_solid_scene
from processing.optics import stokes_vectors
from processing.radar.profiles import SPEED_OF_LIGHT_M_S
from processing.sar.grid import ImageGrid
from processing.scene.both_eyes import (
    ANGLES_RAD,
    CHANNELS,
    Exposures,
    OpticalPicture,
    RadarPicture,
    bodies_from_above,
    optical_picture,
    radar_picture,
    recorded_echoes,
)
from processing.scene.radar_simulation import MECHANISMS
from processing.scene.solids import SolidScene

Floats = NDArray[np.float64]
Progress = Callable[[str, float], None]
"""Told which eye ("radar" or "light") and the fraction of it that is done."""

STAGE = "simulation"
MEASURED = ("ranging", "focus", "calibration")
"""Stages of a file that a simulation does not belong into."""
NOT_MODELLED = (
    "diffraction by edges",
    "extinction in crowns and their bounces off the ground",
    "what rough ground scatters by way of a second bounce",
    "waves inside bodies",
    "turning bodies, and motion within a pulse",
)
UNITS = {
    "s0": "1",
    "s1": "1",
    "s2": "1",
    "dolp": "1",
    "dolp_sd": "1",
    "aop": "rad",
    **{f"{name}_m2": "m^2" for name in MECHANISMS},
    "x_m": "m",
    "y_m": "m",
}
"""Unit of each array of the stage "simulation" that has one."""


@dataclass(frozen=True)
class LeftOut:
    """What the simulation did not follow, by the sizes of it that are known."""

    bounces: int
    """Bounces that were followed."""
    next_bounce_db: float
    """Strongest element of the bounce after those over the strongest of all, dB (antenna's places that sent rays)."""
    parted: float
    """Largest share of the lit area whose rays met edges that a finer density would part."""
    wavefront_rad: float
    """Largest phase by which a wavefront bends within a footprint, where it is taken as flat: the near field's term.

    It is largest on faces seen nearly edge-on, which return little."""
    not_modelled: tuple[str, ...] = NOT_MODELLED


@dataclass(frozen=True)
class SolidSimulation:
    """What was made of a scene file."""

    products: Path
    figure: Path | None
    scene: SolidScene
    grid: ImageGrid
    radar: RadarPicture
    optics: OpticalPicture
    bodies: NDArray[np.int64]
    """(ny, nx) number of the body that stands on each pixel; -1: none."""
    left_out: LeftOut
    notes: tuple[str, ...]
    """What a reader of the pictures should know."""


def simulate(
    scene_path: Path | str,
    products: Path | str,
    *,
    figure: Path | str | None = None,
    tolerance_db: float | None = None,
    progress: Progress | None = None,
) -> SolidSimulation:
    """Simulate what radar and camera see of a scene file, both on its ground grid.

    Writes stage "matrices" (``planes`` (4, ny, nx) complex64 HH, HV, VH, VV, sqrt(m^2), with noise; ``x_m``, ``y_m``),
    which decompositions, detectors and exports read; stage "polarimetry" (``pauli``, ``span``); and stage "simulation":
    ``s0, s1, s2`` of a white surface that faces the sun, in the camera's frame, ``dolp`` (debiased), ``dolp_sd``,
    ``aop`` (rad; NaN within 2 standard deviations of no polarization), ``single_m2, double_m2, multiple_m2`` (span that
    each mechanism alone returns), ``body`` (ny, nx) int32, an index of the settings' ``bodies``, -1 for none.

    Where a body moves, these are pictures of what stands (truth is that of time 0, with every ``velocity_m_s``), and
    the stage "history" keeps the radar's noisy ``echoes`` (4, pulses, frequencies) for ``polfuse motion``, with
    ``antenna_m``, ``reference_m`` and ``time_s``. Of a polarizer that turns meanwhile (``exposure_interval_s``) stage
    "exposures" keeps ``electrons`` (4, rows, columns) and ``time_s``.

    Args:
        scene_path: the scene file.
        products: the products file; its other stages are kept.
        figure: where to draw both pictures; nothing is drawn when left out.
        tolerance_db: largest error, dB below each eye's picture: chooses bounces, rays and segments in place of the
            file's, and its planners tell of themselves in the settings.
        progress: called as it goes on.

    Raises:
        PolfuseError: a file that cannot be used, or a products file of a measurement.
        DataError: a scene that cannot be simulated.
    """
    path, store = Path(scene_path), Products(products)
    given = read_solid_scene(path)
    if measured := [name for name in MEASURED if name in store.stages()]:
        raise PolfuseError(
            f"holds a measurement (stage '{measured[0]}'), whose polarimetry a simulation would replace",
            where=str(store.path),
            advice="give another products file",
        )
    scene, grid, air = given.scene(path), given.grid.grid(), given.airborne()
    radar = radar_picture(
        scene,
        grid,
        air,
        density=given.radar.density,
        tolerance_db=tolerance_db,
        points_per_m2=given.radar.points_per_m2,
        seed=given.radar.seed,
        move_m=given.radar.move_m,
        progress=_told(progress, "radar"),
    )
    optics = optical_picture(
        scene,
        grid,
        given.light.sources(),
        air,
        samples=given.camera.samples,
        tolerance_db=tolerance_db,
        seed=given.camera.seed,
        progress=_told(progress, "light"),
    )
    bodies = bodies_from_above(scene, grid)
    seen = radar.simulated
    followed = given.radar.bounces if radar.plan is None else radar.plan.density.bounces
    left_out = LeftOut(followed, seen.beyond_db, seen.parted, seen.curvature_rad)
    notes = _notes(given, scene, left_out)
    for eye, plan in (("radar", radar.plan), ("light", optics.plan)):
        if plan is not None and not plan.reached:
            notes += (f"{eye}: the tolerance was not reached, {plan.predicted_error_db:.1f} dB are expected",)
    made = SolidSimulation(store.path, None, scene, grid, radar, optics, bodies, left_out, notes)
    _write(store, path, given, made)
    if figure is None:
        return made
    from polfuse_lab.products.style import save
    from polfuse_lab.simulation.figures import both_eyes_figure

    shown = both_eyes_figure(radar, optics, grid, _kinds(scene, bodies), given.title or path.stem)
    return replace(made, figure=save(shown, figure))


def _told(progress: Progress | None, eye: str) -> Callable[[float], None] | None:
    return None if progress is None else lambda done: progress(eye, done)


def _kinds(scene: SolidScene, bodies: NDArray[np.int64]) -> dict[str, NDArray[np.bool_]]:
    """Where each kind of body stands."""
    found: dict[str, NDArray[np.bool_]] = {}
    for number, solid in enumerate(scene.solids):
        found[solid.kind] = found.get(solid.kind, np.zeros(bodies.shape, dtype=bool)) | (bodies == number)
    return found


def planned(made: SolidSimulation) -> dict[str, Any]:
    """What a tolerance chose for both eyes, as products and JSON keep it; None where an error is none at all."""
    found: dict[str, Any] = {}
    if made.radar.plan is not None:
        plan = made.radar.plan
        names = ("predicted_error_db", "bounces_db", "rays_db", "segments_db", "truth_db")
        found["radar_plan"] = {
            "tolerance_db": plan.tolerance_db, **asdict(plan.density), "segments": plan.segments,
            **{name: _finite(getattr(plan, name)) for name in names}, "reached": plan.reached,
            "explanation": plan.explain(),
        }  # fmt: skip
    if made.optics.plan is not None:
        trace = made.optics.plan
        errors = {name: _finite(getattr(trace, name)) for name in ("predicted_error_db", "noise_db", "left_out_db")}
        found["light_plan"] = {
            "tolerance_db": trace.tolerance_db, "bounces": trace.bounces, "samples": trace.samples, **errors,
            "reached": trace.reached, "explanation": trace.explain(),
        }  # fmt: skip
    return found


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _notes(given: SolidSceneFile, scene: SolidScene, left_out: LeftOut) -> tuple[str, ...]:
    """Where the pictures are less than they look."""
    found: list[str] = []
    if left_out.next_bounce_db > -20:
        found.append(
            f"bounce {left_out.bounces + 1} is as strong as {left_out.next_bounce_db:.0f} dB and left out; "
            "raise radar.bounces"
        )
    wavelength = SPEED_OF_LIGHT_M_S / given.radar.centre_hz
    spacing = given.flight.track_m / (given.flight.pulses - 1)
    # Echoes of two pulses differ by a whole turn: lambda R / 2 d, as far as the track is short beside R.
    alias = wavelength * given.slant_m / (2 * spacing)
    corners = scene.mesh()[0].corners_m
    wide = max(float(np.ptp(corners[..., 0])), given.grid.width_m)
    if wide > alias:
        found.append(
            f"pulses {spacing:.3g} m apart repeat the scene every {alias:.3g} m along the track, and it is "
            f"{wide:.3g} m wide; raise flight.pulses"
        )
    across = SPEED_OF_LIGHT_M_S / (2 * given.radar.bandwidth_hz * math.sin(math.radians(given.flight.look_deg)))
    along = wavelength * given.slant_m / (2 * given.airborne().aperture_m)
    for name, step, cell in (("step_x_m", given.grid.step_x_m, along), ("step_y_m", given.grid.step_y_m, across)):
        # Hann's window makes cells half as wide again.
        if step > 1.5 * cell:
            found.append(f"grid.{name} is {step:g}, resolution {1.5 * cell:.3g} m: pixels miss what lies between them")
    return tuple(found)


def _write(store: Products, path: Path, given: SolidSceneFile, made: SolidSimulation) -> None:
    inputs = [path, *given.files(path.parent)]
    radar, optics = made.radar, made.optics
    axes = {"x_m": made.grid.x_m, "y_m": made.grid.y_m}
    store.write(
        "matrices",
        {"planes": radar.channels.astype(np.complex64), **axes},
        settings={
            "matrix": "S2",
            "planes": list(CHANNELS),
            "z_m": made.grid.z_m,
            "centre_hz": given.radar.centre_hz,
            "bandwidth_hz": given.radar.bandwidth_hz,
            "noise_equivalent_rcs_m2": radar.noise / 3,
            "simulated": path.name,
        },
        inputs=inputs,
        units={"planes": "sqrt(m^2)", "x_m": "m", "y_m": "m"},
    )
    write_polarimetry(store, dict(zip(CHANNELS, radar.channels, strict=True)), axes, made.grid.z_m)
    light = {name: getattr(optics, name).astype(np.float32) for name in ("s0", "s1", "s2", "dolp", "dolp_sd")}
    alone = {f"{name}_m2": plane.astype(np.float32) for name, plane in zip(MECHANISMS, radar.powers, strict=True)}
    angle = _angle(optics).astype(np.float32)
    store.write(
        STAGE,
        {**light, "aop": angle, **alone, "body": made.bodies.astype(np.int32), **axes},
        settings={
            "scene": given.model_dump(),
            "bodies": [
                {"name": solid.name, "kind": solid.kind, "velocity_m_s": solid.velocity_m_s}
                for solid in made.scene.solids
            ],
            "rays": radar.simulated.rays,
            "footprints": radar.simulated.footprints,
            "segments": radar.simulated.segments,
            "noise_span_m2": radar.noise,
            "trace_error": optics.picture.error,
            "left_out": made.left_out,
            "notes": made.notes,
            **({} if radar.plan is None else planned(made)),
        },
        inputs=inputs,
        units=UNITS,
    )
    if made.scene.speed_m_s > 0:
        _write_history(store, given, made, inputs)
    if optics.exposures is not None:
        _write_exposures(store, optics.exposures, inputs)


def _write_history(store: Products, given: SolidSceneFile, made: SolidSimulation, inputs: list[Path]) -> None:
    air = given.airborne()
    history = recorded_echoes(made.radar, air, seed=given.radar.seed)
    arrays = {
        "echoes": history.echoes,
        "antenna_m": history.antenna_m,
        "reference_m": history.reference_m,
        "time_s": air.time_s,
    }
    store.write(
        "history",
        arrays,
        settings={
            "channels": list(history.channels),
            "first_hz": history.first_hz,
            "step_hz": history.step_hz,
            "beamwidth_rad": air.beamwidth_rad,
            "z_m": made.grid.z_m,
        },
        inputs=inputs,
        units={"antenna_m": "m", "reference_m": "m", "time_s": "s"},
    )


def _write_exposures(store: Products, exposures: Exposures, inputs: list[Path]) -> None:
    store.write(
        "exposures",
        {"electrons": exposures.electrons.astype(np.float32), "time_s": np.asarray(exposures.time_s)},
        settings={"camera": asdict(exposures.camera), "angles_rad": list(ANGLES_RAD), "frames": exposures.frames},
        inputs=inputs,
        units={"electrons": "1", "time_s": "s"},
    )


def _angle(optics: OpticalPicture) -> Floats:
    """Angle of polarization (ny, nx), rad; NaN where noise decides it."""
    stokes = np.stack([optics.s0, optics.s1, optics.s2, np.zeros_like(optics.s0)], axis=-1)
    with np.errstate(invalid="ignore"):
        sure = np.hypot(optics.s1, optics.s2) > 2 * optics.dolp_sd * optics.s0
    return np.where(sure, stokes_vectors.aop(np.nan_to_num(stokes)), np.nan)

"""Polarizer frames of a session to Stokes parameters, DOLP and AOP: the stage ``"optics"``."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from polfuse_lab.errors import PolfuseError
from polfuse_lab.products.camera_lens import holds_lens, with_lens
from polfuse_lab.products.optics_calibration import load_corrections
from polfuse_lab.products.optics_frames import camera_of, is_active, refuse_changes, stacked, usable_frames
from polfuse_lab.products.store import Products
from polfuse_lab.rig import CameraSection
from polfuse_lab.session import open_session
from processing.optics.analyser_calibration import AnalyserCalibration
from processing.optics.camera_model import Pinhole
from processing.optics.demosaic_planner import DemosaicChoice
from processing.optics.flat import Corrections
from processing.optics.mosaic import parse_mosaic
from processing.optics.series import PolarizerSeries, SensorNoise
from processing.optics.shift_planner import RegistrationChoice
from processing.optics.shifts import Shift
from processing.optics.stack import AveragedSeries
from processing.optics.stokes import Flag, StokesImage

STAGE = "optics"
UNITS = {
    "s0": "counts",
    "s1": "counts",
    "s2": "counts",
    "s0_sd": "counts",
    "dolp": "1",
    "dolp_raw": "1",
    "dolp_sd": "1",
    "aop": "rad",
    "aop_sd": "rad",
    "flags": "bits",
}
"""Unit of each array of the stage."""


@dataclass(frozen=True)
class OpticsResult:
    """What was made of a session's polarizer series."""

    products: Path
    figure: Path | None
    image: StokesImage
    series: PolarizerSeries
    frames: int
    """Complete frames used, dark ones not counted."""
    incomplete_frames: int
    shifts: tuple[Shift, ...] = ()
    """Shift of each angle's image against the first one's; empty where it was not measured."""
    composite: Path | None = None
    """Picture of S1, S0 and S2 as colours (thesis 7.7)."""
    choice: DemosaicChoice | RegistrationChoice | None = None
    """Which demosaicer a tolerance chose, or how it had the images of a turning polarizer put in place, and why."""

    @property
    def dolp_median(self) -> float:
        """Median of the defined DOLP; NaN when every pixel is masked."""
        return self.image.dolp_median

    @property
    def masked_fraction(self) -> float:
        """Fraction of pixels whose DOLP is undefined."""
        return self.image.masked_fraction


def optics(
    session_path: Path | str,
    products_path: Path | str,
    *,
    figure: Path | str | None = None,
    zero_sd_rad: float = math.radians(0.5),
    intensity_stability: float = 1e-3,
    corrections: Path | str | None = None,
    register: str | None = None,
    demosaic: str | None = None,
    tolerance_db: float | None = None,
) -> OpticsResult:
    """Make Stokes parameters of a session's polarizer series and write the stage ``"optics"``.

    Arrays (rows, columns): ``s0, s1, s2, s0_sd`` (counts above black), ``dolp`` (debiased), ``dolp_raw``, ``dolp_sd``,
    ``aop, aop_sd`` (rad), ``flags`` (bits of :class:`processing.optics.stokes.Flag`, named in the settings). Undefined
    pixels are NaN. Settings: ``camera`` (see :func:`pinhole`), ``series`` (see :func:`series_of`), ``flags``.

    Args:
        session_path: the session.
        products_path: the products file; made if it is not there, its other stages are kept.
        figure: where to draw the picture, and beside it (``_stokes``) the composite of thesis 7.7; none is drawn when
            left out.
        zero_sd_rad: standard deviation of the polarizer's zero mark, radians (turns AOP as a whole).
        intensity_stability: relative standard deviation of light and exposure from one angle to another; of the pixels'
            response for a camera with a mosaic.
        corrections: a products file with stages "flat", "linearity" or "analyser"
            (:mod:`polfuse_lab.products.optics_calibration`) or "camera" (:mod:`polfuse_lab.products.camera_lens`),
            which are applied.
        register: ``"off"``, ``"auto"`` or ``"on"``: whether shifts between the images of a turning polarizer are
            measured and undone (:func:`processing.optics.shifts.registered`); off if left out.
        demosaic: of :data:`processing.optics.demosaic.METHODS`; bilinear if left out.
        tolerance_db: largest error of the images behind each angle, dB below them, and the settings keep why: of a
            mosaic it chooses the demosaicer (:func:`processing.optics.demosaic_planner.choose_demosaicer`), of a
            turning polarizer how shifts between the images are measured and undone
            (:func:`processing.optics.shift_planner.choose_registration`).

    Raises:
        PolfuseError: a file that cannot be used, a session without camera or without frames, one of the active mode
            (:func:`polfuse_lab.products.optics_active.active_optics`), or an option that is nothing to its camera.
        DataError: frames that do not determine S0, S1 and S2.
    """
    if demosaic is not None and tolerance_db is not None:
        raise PolfuseError("a tolerance chooses the demosaicer", where="optics", advice="leave --demosaic out")
    if register is not None and tolerance_db is not None:
        raise PolfuseError(
            "a tolerance chooses how images are put in place", where="optics", advice="leave --register out"
        )
    with open_session(session_path) as session:
        camera = camera_of(session)
        if is_active(session):
            raise PolfuseError(
                "was taken with a polarizer before the light source",
                where=str(session.path),
                advice="make the active mode's channels of it, as 'polfuse optics' does by itself",
            )
        _refuse_what_does_not_apply(camera, session.path, register, demosaic)
        refuse_changes(session)
        stack = stacked(session, camera, usable_frames(session))
        found, analysers = (Corrections(), None) if corrections is None else load_corrections(corrections)
        assert session.rig is not None
        noise = SensorNoise(camera.read_noise_counts, camera.electrons_per_count)
        if camera.has_mosaic:
            averaged = stack.averaged_mosaic(
                parse_mosaic(camera.mosaic),
                noise=noise,
                extinction_ratio=camera.mosaic_extinction_ratio,
                zero_sd_rad=zero_sd_rad,
                response_sd=intensity_stability,
                corrections=found,
                analysers=analysers,
                method=demosaic or "bilinear",
                tolerance_db=tolerance_db,
            )
        else:
            assert session.rig.polarizer is not None
            averaged = stack.averaged(
                noise=noise,
                extinction_ratio=session.rig.polarizer.extinction_ratio,
                zero_sd_rad=zero_sd_rad,
                intensity_stability=intensity_stability,
                corrections=found,
                analysers=analysers,
                register=register or "off",
                tolerance_db=tolerance_db,
            )
    image = averaged.stokes()
    choice: DemosaicChoice | RegistrationChoice | None = averaged.demosaicer or averaged.registration
    used = averaged.demosaicer.method if averaged.demosaicer else demosaic or "bilinear"
    placed = averaged.registration.way.name if averaged.registration else register or "off"
    seen, lens = pinhole(camera), corrections is not None and holds_lens(corrections)
    if corrections is not None and lens:
        seen = with_lens(seen, corrections)
    products = Products(products_path)
    products.write(
        STAGE,
        {name: getattr(image, name) for name in UNITS},
        settings={
            **_settings(camera, averaged, stack.incomplete_frames),
            "camera": asdict(seen),
            "demosaic": used if camera.has_mosaic else None,
            "registration": None if camera.has_mosaic else placed,
            **({} if choice is None else _told(choice)),
            "corrected": [name for name, done in {**_corrected(found, analysers), "lens": lens}.items() if done],
        },
        inputs=[Path(session_path), *([] if corrections is None else [Path(corrections)])],
        units=UNITS,
    )
    drawn = composite = None
    if figure is not None:
        from polfuse_lab.products.figures_optics import composite_figure, optics_figure
        from polfuse_lab.products.style import save

        drawn = save(optics_figure(image, averaged.series), figure)
        composite = save(composite_figure(image), drawn.with_name(f"{drawn.stem}_stokes{drawn.suffix}"))
    return OpticsResult(
        products=products.path,
        figure=drawn,
        image=image,
        series=averaged.series,
        frames=averaged.series.frames[0] if camera.has_mosaic else sum(averaged.series.frames),
        incomplete_frames=stack.incomplete_frames,
        shifts=averaged.shifts,
        composite=composite,
        choice=choice,
    )


def _refuse_what_does_not_apply(camera: CameraSection, path: Path, register: str | None, demosaic: str | None) -> None:
    if camera.has_mosaic and register not in (None, "off"):
        raise PolfuseError(
            "a mosaic sees every angle at once: there are no images to put in place",
            where=str(path),
            advice="leave --register out",
        )
    if not camera.has_mosaic and demosaic is not None:
        raise PolfuseError(
            "was taken with a turning polarizer: there is no mosaic to interpolate",
            where=str(path),
            advice="leave --demosaic out",
        )


def pinhole(camera: CameraSection) -> Pinhole:
    """The camera of a rig file as a pinhole in rig coordinates."""
    return Pinhole(
        focal_length_m=camera.focal_length_m,
        pixel_pitch_m=camera.pixel_pitch_m,
        width_px=camera.width_px,
        height_px=camera.height_px,
        position_m=camera.position_m,
        depression_rad=math.radians(camera.depression_deg),
        distortion=camera.distortion,
        principal_offset_px=camera.principal_offset_px,
    )


def pinhole_of(settings: Mapping[str, Any]) -> Pinhole:
    """The camera that a stage ``"optics"`` was taken with, from its settings."""
    values = dict(settings["camera"])
    # Files that were written before lenses were calibrated tell none of their numbers.
    points = ("position_m", "distortion", "principal_offset_px")
    return Pinhole(**{**values, **{name: tuple(values[name]) for name in points if name in values}})


def series_of(settings: Mapping[str, Any]) -> PolarizerSeries:
    """The polarizer series that a stage ``"optics"`` was made from, from its settings."""
    values = dict(settings["series"])
    ratio = values["extinction_ratio"]
    return PolarizerSeries(
        **{
            **values,
            **{name: tuple(values[name]) for name in ("angles_rad", "frames", "angle_sd_rad")},
            "extinction_ratio": math.inf if ratio is None else ratio,
            "noise": SensorNoise(**values["noise"]),
        }
    )


def _settings(camera: CameraSection, averaged: AveragedSeries, incomplete_frames: int) -> dict[str, Any]:
    return {
        "series": asdict(averaged.series),
        "condition_number": averaged.series.condition,
        "incomplete_frames": incomplete_frames,
        "mosaic": camera.mosaic,
        "saturation_counts": camera.saturation_counts,
        "black_level_counts": camera.black_level_counts,
        "flags": {flag.name: flag.value for flag in Flag},
        "shifts_px": [{**asdict(shift), "undone": undone} for shift, undone in _shifts(averaged)],
    }


def _told(choice: DemosaicChoice | RegistrationChoice) -> dict[str, Any]:
    """The choice and what it foretells, for the product."""
    return {
        "tolerance_db": choice.tolerance_db,
        "predicted_error_db": choice.predicted_error_db,
        "tolerance_kept": choice.kept,
        "reason": choice.reason,
        "considered": choice.considered,
    }


def _shifts(averaged: AveragedSeries) -> list[tuple[Shift, bool]]:
    """Shifts whose size is known, and whether they were undone."""
    both = zip(averaged.shifts, averaged.shifted_back, strict=True)
    return [(shift, undone) for shift, undone in both if math.isfinite(shift.down_sd + shift.right_sd)]


def _corrected(corrections: Corrections, analysers: AnalyserCalibration | None) -> dict[str, bool]:
    return {
        "linearity": bool(corrections.linearity.coefficients),
        "flat": corrections.flat is not None,
        "analyser": analysers is not None,
    }

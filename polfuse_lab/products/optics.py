"""Polarizer frames of a session to Stokes parameters, DOLP and AOP: the stage ``"optics"``."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from polfuse_lab.errors import PolfuseError
from polfuse_lab.products.store import Products
from polfuse_lab.records import FrameFlag
from polfuse_lab.rig import CameraSection
from polfuse_lab.session import Session, open_session
from processing.optics.camera_model import Pinhole
from processing.optics.mosaic import parse_mosaic
from processing.optics.series import PolarizerSeries, SensorNoise
from processing.optics.stack import AveragedSeries, FrameStack
from processing.optics.stokes import Flag, StokesImage, stokes_image

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
) -> OpticsResult:
    """Make Stokes parameters of a session's polarizer series and write the stage ``"optics"``.

    Arrays (rows, columns): ``s0, s1, s2, s0_sd`` (counts above black), ``dolp`` (debiased), ``dolp_raw``, ``dolp_sd``,
    ``aop, aop_sd`` (rad), ``flags`` (bits of :class:`processing.optics.stokes.Flag`, named in the settings). Undefined
    pixels are NaN. Settings: ``camera`` (see :func:`pinhole`), ``series`` (see :func:`series_of`), ``flags``.

    Args:
        session_path: the session.
        products_path: the products file; made if it is not there, its other stages are kept.
        figure: where to draw the picture; none is drawn when left out.
        zero_sd_rad: standard deviation of the polarizer's zero mark, radians (turns AOP as a whole).
        intensity_stability: relative standard deviation of light and exposure from one angle to another; of the pixels'
            response for a camera with a mosaic.

    Raises:
        PolfuseError: a file that cannot be used, or a session without camera or without frames.
        DataError: frames that do not determine S0, S1 and S2.
    """
    with open_session(session_path) as session:
        camera = _camera(session)
        stack = _stacked(session, camera)
        assert session.rig is not None
        noise = SensorNoise(camera.read_noise_counts, camera.electrons_per_count)
        if camera.has_mosaic:
            averaged = stack.averaged_mosaic(
                parse_mosaic(camera.mosaic),
                noise=noise,
                extinction_ratio=camera.mosaic_extinction_ratio,
                zero_sd_rad=zero_sd_rad,
                response_sd=intensity_stability,
            )
        else:
            assert session.rig.polarizer is not None
            averaged = stack.averaged(
                noise=noise,
                extinction_ratio=session.rig.polarizer.extinction_ratio,
                zero_sd_rad=zero_sd_rad,
                intensity_stability=intensity_stability,
            )
    image = stokes_image(averaged.light, averaged.saturated, averaged.series, incomplete=averaged.incomplete)
    products = Products(products_path)
    products.write(
        STAGE,
        {name: getattr(image, name) for name in UNITS},
        settings=_settings(camera, averaged, stack.incomplete_frames),
        inputs=[Path(session_path)],
        units=UNITS,
    )
    drawn = None
    if figure is not None:
        from polfuse_lab.products.figures_optics import optics_figure
        from polfuse_lab.products.style import save

        drawn = save(optics_figure(image, averaged.series), figure)
    return OpticsResult(
        products=products.path,
        figure=drawn,
        image=image,
        series=averaged.series,
        frames=averaged.series.frames[0] if camera.has_mosaic else sum(averaged.series.frames),
        incomplete_frames=stack.incomplete_frames,
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
    )


def pinhole_of(settings: Mapping[str, Any]) -> Pinhole:
    """The camera that a stage ``"optics"`` was taken with, from its settings."""
    values = dict(settings["camera"])
    return Pinhole(**{**values, "position_m": tuple(values["position_m"])})


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
        "camera": asdict(pinhole(camera)),
        "series": asdict(averaged.series),
        "condition_number": averaged.series.condition,
        "incomplete_frames": incomplete_frames,
        "mosaic": camera.mosaic,
        "saturation_counts": camera.saturation_counts,
        "black_level_counts": camera.black_level_counts,
        "flags": {flag.name: flag.value for flag in Flag},
    }


def _camera(session: Session) -> CameraSection:
    """The session's camera. Raises :class:`PolfuseError` where there is none, or nothing that it took."""
    if session.rig is None or session.rig.camera is None:
        raise PolfuseError(
            "was taken without a camera",
            where=str(session.path),
            advice="collect with [camera] and [polarizer] in the rig file and [optics] in the plan",
        )
    if len(session.frames) == 0:
        raise PolfuseError(
            "holds no camera frames", where=str(session.path), advice="collect with [optics] in the plan file"
        )
    return session.rig.camera


def _stacked(session: Session, camera: CameraSection) -> FrameStack:
    """All frames of the session, averaged by angle."""
    rows = session.frames
    for name, unit in (("exposure_s", "s"), ("gain_db", "dB")):
        values = np.unique(rows[name])
        if len(values) > 1:
            raise PolfuseError(
                f"its frames were taken with different {name}: {values[0]:g} to {values[-1]:g} {unit}",
                where=str(session.path),
                advice="switch automatic exposure and gain off and take the series again",
            )
    stack = FrameStack(saturation_counts=camera.saturation_counts, black_level_counts=camera.black_level_counts)
    for index, row in enumerate(rows):
        if int(row["flags"]) & int(FrameFlag.MOVED):
            continue  # at no angle in particular, and taken again
        image = session.frame(index)
        if image.shape != (camera.height_px, camera.width_px):
            raise PolfuseError(
                f"frame {index} has {image.shape[1]} x {image.shape[0]} pixels, "
                f"its rig file says {camera.width_px} x {camera.height_px}",
                where=str(session.path),
                advice="give the rig file's [camera] the size that the camera delivers",
            )
        stack.add(
            image,
            float(row["angle_rad"]),
            angle_sd_rad=float(row["angle_sd_rad"]),
            dark=bool(row["dark"]),
            incomplete=bool(row["incomplete"]),
        )
    return stack

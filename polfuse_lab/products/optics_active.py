"""Frames of the active mode (thesis 6.3) to I_HH, I_HV, I_VH, I_VV: the stage ``"active_optics"``."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polfuse_lab.products.optics import pinhole
from polfuse_lab.products.optics_calibration import load_corrections
from polfuse_lab.products.optics_frames import camera_of
from polfuse_lab.products.optics_source import SourceSeries
from polfuse_lab.products.store import Products
from polfuse_lab.session import open_session
from processing.optics.active import CHANNELS, ActiveImage, active_image, channel_weights
from processing.optics.flat import Corrections
from processing.optics.series import SensorNoise
from processing.optics.stokes import Flag

STAGE = "active_optics"
UNITS = {"intensities": "counts", "sds": "counts", "dolp": "1", "dolp_sd": "1", "flags": "bits", "pauli": "counts"}
"""Unit of each array of the stage."""


@dataclass(frozen=True)
class ActiveResult:
    """What was made of a session of the active mode."""

    products: Path
    figure: Path | None
    image: ActiveImage
    source_rad: tuple[float, ...]
    sensor_rad: tuple[float, ...]
    frames: int
    ambient_frames: int

    @property
    def masked_fraction(self) -> float:
        """Fraction of pixels whose DOLP is undefined."""
        return float(np.mean(~np.isfinite(self.image.dolp)))

    @property
    def dolp_median(self) -> float:
        """Median of the size of the defined DOLP (thesis 6.8); NaN when every pixel is masked."""
        defined = np.abs(self.image.dolp[np.isfinite(self.image.dolp)])
        return float(np.median(defined)) if defined.size else math.nan


def image_of(products: Products) -> ActiveImage:
    """The image of a stage ``"active_optics"``. Raises :class:`polfuse_lab.errors.PolfuseError` where it is missing."""
    arrays = products.read(STAGE)
    return ActiveImage(**{name: arrays[name] for name in UNITS if name != "pauli"})


def active_optics(
    session_path: Path | str,
    products_path: Path | str,
    *,
    figure: Path | str | None = None,
    corrections: Path | str | None = None,
) -> ActiveResult:
    """Make the four channels of a session of plan kind ``active_optical`` and write the stage ``"active_optics"``.

    Arrays: ``intensities`` and ``sds`` (4, rows, columns) HH, HV, VH, VV, source then sensor, counts behind ideal
    polarizers, ambient light subtracted; ``pauli`` (3, rows, columns) |HH - VV|, mean of HV and VH, HH + VV, of powers;
    ``dolp`` (thesis 6.8), ``dolp_sd``, ``flags``. Undefined pixels are NaN.

    Args:
        session_path: the session.
        products_path: the products file; made if it is not there, its other stages are kept.
        figure: where to draw the picture; none is drawn when left out.
        corrections: a products file with stages "flat", "linearity" or "analyser".

    Raises:
        PolfuseError: a file that cannot be used, or frames that are not a whole series.
        DataError: angles that do not tell horizontal from vertical.
    """
    with open_session(session_path) as session:
        camera = camera_of(session)
        found, analysers = (Corrections(), None) if corrections is None else load_corrections(corrections)
        series = SourceSeries(session, camera, found)
        light, ambient = series.light, series.ambient
        sensor_extinction = series.sensor_extinction
        if analysers is not None:
            light = np.stack([analysers.idealised(planes, series.sensor_rad) for planes in light])
            ambient = None if ambient is None else analysers.idealised(ambient)
            sensor_extinction = math.inf
        weights = channel_weights(
            series.source_rad,
            series.sensor_rad,
            source_extinction=series.source_extinction,
            sensor_extinction=sensor_extinction,
        )
        image = active_image(
            light,
            series.saturated,
            weights,
            series.frames,
            SensorNoise(camera.read_noise_counts, camera.electrons_per_count),
            ambient=ambient,
            ambient_frames=series.ambient_frames,
            dark_frames=series.dark_frames,
        )
    arrays: dict[str, NDArray[Any]] = {
        "intensities": image.intensities.astype(np.float32),
        "sds": image.sds.astype(np.float32),
        "dolp": image.dolp.astype(np.float32),
        "dolp_sd": image.dolp_sd.astype(np.float32),
        "flags": image.flags,
        "pauli": image.pauli.astype(np.float32),
    }
    settings = {
        "camera": asdict(pinhole(camera)),
        "channels": list(CHANNELS),
        "pauli": "of received powers (thesis 6.11), not of complex amplitudes",
        "source_rad": list(series.source_rad),
        "sensor_rad": list(series.sensor_rad),
        "frames": series.frames.tolist(),
        "mosaic": camera.mosaic,
        "flags": {flag.name: flag.value for flag in Flag},
    }
    inputs = [Path(session_path), *([] if corrections is None else [Path(corrections)])]
    products = Products(products_path)
    products.write(STAGE, arrays, settings=settings, inputs=inputs, units=UNITS)
    drawn = None
    if figure is not None:
        from polfuse_lab.products.figures_optics_active import active_figure
        from polfuse_lab.products.style import save

        drawn = save(active_figure(image), figure)
    return ActiveResult(
        products=products.path,
        figure=drawn,
        image=image,
        source_rad=series.source_rad,
        sensor_rad=series.sensor_rad,
        frames=series.frames_taken,
        ambient_frames=series.ambient_taken,
    )

"""What a calibration starts from: the stated target, the focused image, and the noise seen in the sky."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polfuse_lab.errors import PolfuseError
from polfuse_lab.plans import SeriesTarget
from polfuse_lab.products.store import Products, is_products
from processing.calibration.noise import focused_noise, noise_floor
from processing.errors import DataError
from processing.radar.antenna import boresight, one_way_gain
from processing.radar.profiles import SPEED_OF_LIGHT_M_S
from processing.sar.aperture import aperture_window
from processing.sar.quality import range_gain
from processing.scene.model import Reflector
from processing.scene.radar_response import KINDS

Floats = NDArray[np.float64]

SKY_WINDOW_CELLS = 15
"""Range cells over which the sky's noise is taken as equal."""

SKY_NOISE_SD_DB = float(10 / np.log(10) / np.log(2) / np.sqrt(SKY_WINDOW_CELLS / 1.5))
"""Standard deviation of the noise from one look at the sky, dB: the median of n exponentially distributed powers has
the relative standard deviation 1 / (ln 2 sqrt n), and a Hann window leaves n = cells / 1.5 independent."""


@dataclass(frozen=True)
class TargetSpec:
    """A reflector that stands in the scene, as its owner states it."""

    kind: str
    """``"trihedral"`` (square faces), ``"trihedral_triangular"``, ``"dihedral"``, ``"plate"`` or ``"sphere"``."""
    x_m: float
    """Place along the rail, m."""
    y_m: float
    """Ground range from the rail, m."""
    edge_m: float
    """Edge of its faces, m (a triangular trihedral's: from the corner to a tip); a sphere's diameter."""
    azimuth_rad: float = 0.0
    """Direction to the aperture's centre in its own frame: from the edges (trihedral) or the boresight, rad."""
    elevation_rad: float = 0.0
    """Likewise, rad."""
    fold_rad: float = 0.0
    """Angle of a dihedral's fold from horizontal, rad."""
    height_m: float = 0.0
    """Height of its phase centre (apex, fold's or face's centre) above the ground, m."""
    angle_sd_rad: float = 0.0
    """Standard deviation of the stated angles, rad (the thesis: 5 degrees)."""
    position_sd_m: float = 0.0
    """Standard deviation of the stated place along x and y, m: how far its direction may be off."""
    edge_sd_m: float = 0.0
    """Standard deviation of the stated edge, m."""
    name: str = ""
    """What it is called in results; its kind where left out."""
    near_field: bool = False
    """Whether its response is expected as physical optics has it at its distance, and not as its closed form."""

    def __post_init__(self) -> None:
        numbers = (self.x_m, self.y_m, self.edge_m, self.azimuth_rad, self.elevation_rad, self.fold_rad)
        if self.kind not in KINDS:
            raise DataError(f"there is no target of kind {self.kind!r}", f"use one of {', '.join(KINDS)}")
        sds = (self.angle_sd_rad, self.position_sd_m, self.edge_sd_m)
        if not np.isfinite([*numbers, self.height_m, *sds]).all():
            raise DataError(f"the {self.kind} is described with a number that is not finite", "give finite numbers")
        if self.edge_m <= 0 or self.y_m <= 0 or min(sds) < 0:
            raise DataError(
                f"the {self.kind} has edge {self.edge_m} m, ground range {self.y_m} m and standard deviations {sds}",
                "edge and ground range are positive, standard deviations are not negative",
            )

    @property
    def label(self) -> str:
        """What it is called in results."""
        return self.name or self.kind

    @classmethod
    def of(cls, target: SeriesTarget) -> TargetSpec:
        """A target of a calibration series."""
        kinds = {"trihedral": "trihedral_triangular", "trihedral_square": "trihedral", "dihedral_45": "dihedral"}
        folds_deg = {"dihedral": 90.0, "dihedral_45": 45.0}
        return cls(
            kind=kinds.get(target.kind, target.kind),
            x_m=target.x_m,
            y_m=target.range_m,
            edge_m=target.edge_m,
            azimuth_rad=math.radians(target.azimuth_deg),
            elevation_rad=math.radians(target.elevation_deg),
            fold_rad=math.radians(folds_deg.get(target.kind, 0.0)),
            height_m=target.height_m,
            angle_sd_rad=math.radians(target.angle_sd_deg),
            position_sd_m=target.position_sd_m,
            edge_sd_m=target.edge_sd_m,
            name=target.name,
        )

    def reflector(self, ground_z_m: float) -> Reflector:
        """The reflector, standing on (or above) the ground plane ``z = ground_z_m``."""
        return Reflector(
            name=self.kind,
            kind=self.kind,
            position_m=(self.x_m, self.y_m, ground_z_m + self.height_m),
            edge_m=self.edge_m,
            azimuth_rad=self.azimuth_rad,
            elevation_rad=self.elevation_rad,
            fold_rad=self.fold_rad,
        )

    def image_place(self, ground_z_m: float) -> tuple[float, float]:
        """Where it shows in an image on the ground plane: layover brings what is higher nearer to the rail."""
        square = self.y_m**2 + (ground_z_m + self.height_m) ** 2 - ground_z_m**2
        return self.x_m, float(np.sqrt(square)) if square > 0 else float("nan")

    def summary(self) -> dict[str, Any]:
        """For settings and reports: lengths in m, angles in degrees."""
        return {
            "kind": self.kind,
            "x_m": self.x_m,
            "y_m": self.y_m,
            "height_m": self.height_m,
            "edge_m": self.edge_m,
            "azimuth_deg": float(np.degrees(self.azimuth_rad)),
            "elevation_deg": float(np.degrees(self.elevation_rad)),
            "fold_deg": float(np.degrees(self.fold_rad)),
            "angle_sd_deg": float(np.degrees(self.angle_sd_rad)),
            "position_sd_m": self.position_sd_m,
            "edge_sd_m": self.edge_sd_m,
            "near_field": self.near_field,
        }


@dataclass(frozen=True)
class FocusedImage:
    """The focused image and what is known of its making."""

    image: NDArray[np.complexfloating]
    """(channels, ny, nx)."""
    x_m: Floats
    y_m: Floats
    z_m: float
    channels: tuple[str, ...]
    centre_hz: float
    bandwidth_hz: float
    antenna_m: Floats
    """(positions, 3)."""
    settings: Mapping[str, Any]
    """Of the stage "focus"."""
    ranging: Mapping[str, Any]
    """Settings of the stage "ranging"."""

    @property
    def wavelength_m(self) -> float:
        """Wavelength at the centre frequency, m."""
        return SPEED_OF_LIGHT_M_S / self.centre_hz

    @property
    def range_gain(self) -> Floats:
        """(ny, nx) gain of the range compensation over the image, m^2."""
        return range_gain(self.x_m, self.y_m[:, None], self.z_m)

    def pulse_weights(self, place_m: Floats) -> Floats:
        """(positions,) relative weights with which the image sums a target's scattering at ``place_m``.

        The aperture's window, times the squared two-way pattern where the processor compensated for it.
        """
        return self.window() * self.pattern(place_m) ** 2

    def noise_averaging(self) -> Floats:
        """(ny,) noise power in the image over that of one profile, abreast of the rail's middle, row by row.

        The image is ``sum w g s / sum w g^2`` over the positions; independent noise adds in power. 1 / positions for a
        rectangular window without pattern compensation.
        """
        window = self.window()
        factors = np.empty(len(self.y_m))
        for row, y in enumerate(self.y_m):
            gain = self.pattern(np.array([0.0, y, self.z_m]))
            total = np.sum(window * gain**2)
            factors[row] = np.sum((window * gain) ** 2) / total**2 if total > 0 else np.nan
        return factors

    def window(self) -> Floats:
        """(positions,) window along the aperture."""
        if len(self.antenna_m) == 1:
            return np.ones(1)
        return aperture_window(str(self.settings.get("aperture_window", "rectangular")), len(self.antenna_m))

    def pattern(self, place_m: Floats) -> Floats:
        """(positions,) two-way amplitude pattern towards a place, where the processor compensated for it; else 1."""
        beamwidth = self.settings.get("beamwidth_rad")
        if beamwidth is None:
            return np.ones(len(self.antenna_m))
        sight = place_m - self.antenna_m
        cosine = sight @ boresight(float(self.settings.get("depression_rad", 0.0))) / np.linalg.norm(sight, axis=1)
        return one_way_gain(cosine, float(beamwidth))


def read_focused(products: Products) -> FocusedImage:
    """The focused image of a products file.

    Raises:
        PolfuseError: stages are missing, there is no channel HH, or amplitudes were not compensated for range.
    """
    focus, settings = products.read("focus"), products.settings("focus")
    ranging, ranging_settings = products.read("ranging"), products.settings("ranging")
    channels = tuple(str(name) for name in settings["channels"])
    if "HH" not in channels:
        raise PolfuseError(
            f"has no channel HH to calibrate on (channels: {', '.join(channels)})",
            where=str(products.path),
            advice="collect HH as well",
        )
    if not ranging_settings.get("range_compensated", settings.get("range_compensated", True)):
        raise PolfuseError(
            "was focused from amplitudes that fall with range, so that one constant does not fit all of it",
            where=str(products.path),
            advice="focus it again with range compensation",
        )
    return FocusedImage(
        image=focus["image"],
        x_m=focus["x_m"].astype(np.float64),
        y_m=focus["y_m"].astype(np.float64),
        z_m=float(settings["z_m"]),
        channels=channels,
        centre_hz=float(settings["centre_hz"]),
        bandwidth_hz=float(settings["bandwidth_hz"]),
        antenna_m=ranging["antenna_m"].astype(np.float64),
        settings=settings,
        ranging=ranging_settings,
    )


def read_reference(products: Products, focused: FocusedImage) -> FocusedImage:
    """The focused image of a calibration target by itself, to calibrate ``focused`` with.

    Raises:
        PolfuseError: as :func:`read_focused`, or it was not made as ``focused`` was.
    """
    found = read_focused(products)
    same = ("window", "beamwidth_rad", "depression_rad", "centre_hz", "bandwidth_hz", "z_m")
    other = [name for name in same if found.settings.get(name) != focused.settings.get(name)]
    if missing := [name for name in focused.channels if name not in found.channels]:
        other.append(f"channels (it lacks {', '.join(missing)})")
    if other:
        raise PolfuseError(
            f"was focused with another {', '.join(other)} than the image that it is to calibrate",
            where=str(products.path),
            advice="focus both with the same settings, from the same rig",
        )
    return found


def sky_noise(sky: Path | str, focused: FocusedImage) -> Floats:
    """Noise power (channels, ny) of the focused image from a look at the clear sky.

    The sky's profiles are made as the collect's were; independent noise then averages over the antenna positions.

    Args:
        sky: a session, or a products file with a stage "ranging".
        focused: the image that the noise is wanted for.

    Raises:
        PolfuseError: the sky lacks a channel of the image, or cannot be read.
    """
    values, range_m, channels = _sky_profiles(Path(sky), focused.ranging)
    if missing := [name for name in focused.channels if name not in channels]:
        raise PolfuseError(
            f"lacks channel {', '.join(missing)}",
            where=str(sky),
            advice="record the sky in all channels of the collect",
        )
    window_m = SKY_WINDOW_CELLS * SPEED_OF_LIGHT_M_S / (2 * focused.bandwidth_hz)
    floor = noise_floor(
        values[[channels.index(name) for name in focused.channels]], range_m, window_m=window_m, range_compensated=True
    )
    return focused_noise(floor, range_m, focused.y_m, focused.z_m, focused.noise_averaging())


def _sky_profiles(path: Path, settings: Mapping[str, Any]) -> tuple[NDArray[Any], Floats, tuple[str, ...]]:
    if is_products(path):
        stage = Products(path).read("ranging")
        return stage["profiles"], stage["range_m"], tuple(Products(path).settings("ranging")["channels"])
    from polfuse_lab.products.ranging import range_profiles
    from polfuse_lab.session import open_session

    same = {name: settings[name] for name in ("window", "oversampling", "max_range_m") if name in settings}
    with open_session(path) as session:
        profiles = range_profiles(session, range_compensated=True, **same)
    return profiles.values, profiles.range_m, profiles.channels

"""The SAR image that forms as the trolley moves: every record adds its back-projection; and its Pauli colours."""

from __future__ import annotations

import math
import time
from collections import deque
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.records import TrolleyFix
from polfuse_lab.live.board import Board
from polfuse_lab.live.listening import level_db
from polfuse_lab.plans import Plan
from polfuse_lab.products.antennas import antenna_pairs
from polfuse_lab.products.focus import DEFAULT_X_M, DEFAULT_Y_M, PIXELS_PER_CELL
from polfuse_lab.products.rail_options import FAR_MARGIN_CELLS
from polfuse_lab.records import SUPERSEDED, SweepFlag, Sweeps
from polfuse_lab.rig import Rig
from processing.polarimetry.pauli import display_components, pauli_vector
from processing.radar.profiles import RangeProfiles
from processing.radar.ranging import average, compress, cut_sweeps, range_axis, unambiguous_range_m
from processing.radar.sync import find_sync
from processing.sar.backprojection import LiveImage
from processing.sar.footprint import ImageFlag, footprint_flags
from processing.sar.grid import ImageGrid
from processing.sar.resolution import point_resolution

ORDER = ("HH", "HV", "VH", "VV")
PIXELS = 120_000
"""Pixels of the image, about: what a picture on the screen has."""
OVERSAMPLING = 8
INTERPOLATOR = "cubic"
"""-71 dB at 8 bins per cell: far below what a screen shows."""
SHOW_EVERY_S = 0.2
TOP_PERCENT, RANGE_DB = 99.9, 40.0
"""A colour scale ends at that percentile of the defined pixels and begins so far below."""


@dataclass(frozen=True)
class Formed:
    """The image so far."""

    grid: ImageGrid
    channels: tuple[str, ...]
    image: NDArray[np.complex64]
    """(channels, ny, nx); NaN where it is undefined."""
    low_db: float
    high_db: float
    t_sample_ns: int


def display_grid(rig: Rig, places_m: NDArray[np.float64]) -> ImageGrid:
    """A grid on the ground for the places that a plan visits: as fine as they resolve, as far as a screen shows."""
    z = -rig.geometry.antenna_height_m
    (x0, x1), (y0, y1) = DEFAULT_X_M, DEFAULT_Y_M
    antenna = np.column_stack([places_m, np.zeros((len(places_m), 2))])
    wave = rig.waveform
    cell = point_resolution(
        antenna,
        (float(np.median(places_m)), y0, z),
        centre_hz=wave.centre_hz,
        bandwidth_hz=wave.bandwidth_hz,
    )
    steps = [min(cell.x_m, 1.0) / PIXELS_PER_CELL, min(cell.y_m, wave.range_resolution_m) / PIXELS_PER_CELL]
    pixels = (x1 - x0) / steps[0] * (y1 - y0) / steps[1]
    coarser = max(math.sqrt(pixels / PIXELS), 1.0)
    steps = [coarser * step for step in steps]
    x, y = np.arange(x0, x1 + 1e-9, steps[0]), np.arange(y0, y1 + 1e-9, steps[1])
    return ImageGrid(x, y, z)


class Former:
    """Forms the image of a collect along a rail. Used by one thread.

    Args:
        rig: the rig.
        plan: the plan, which tells the places and the channels.
        board: where pictures go.
    """

    def __init__(self, rig: Rig, plan: Plan, board: Board) -> None:
        self._rig, self._board = rig, board
        planned = plan.positions_m or _aperture(plan)
        places = np.unique(np.asarray(planned, dtype=np.float64))
        self.useful = len(places) >= 2
        """Whether the plan makes an image at all."""
        self._planned = len(plan.positions_m)
        self._grid = display_grid(rig, places) if self.useful else None
        self._axis: NDArray[np.float64] | None = None
        self._images: dict[str, LiveImage] = {}
        self._added: set[tuple[str, int]] = set()
        self._track: deque[tuple[int, float]] = deque(maxlen=400)
        self._shown = 0.0
        self._newest_ns = 0
        self._pending = False
        self._masked: NDArray[np.bool_] | None = None
        self.formed: Formed | None = None
        """The newest image."""

    def moved(self, fix: TrolleyFix) -> None:
        """Where the trolley was, for records of a pass."""
        self._track.append((fix.t_host_ns, fix.x_m))

    def take(self, record: Sweeps) -> None:
        """Add a record that counts; others and those that were added before are left out.

        Raises:
            DataError: its sync cannot be found.
        """
        key = record.channel.name, record.position
        running = bool(record.flags & SweepFlag.CONTINUOUS)
        if self._grid is None or record.flags & SUPERSEDED or (key in self._added and not running):
            return
        values, offsets_s = self._compressed(record, apart=running)
        if running:
            speed = self._speed(record)
            middle = len(record.block.samples) / record.block.sample_rate_hz / 2
            x = record.x_m + speed * (offsets_s - middle)
        else:
            x = np.array([record.x_m])
        self._add(record.channel.name, values, x)
        self._added.add(key)
        self._newest_ns = record.block.t_host_ns + round(
            len(record.block.samples) / record.block.sample_rate_hz * 1e9
        )  # fmt: skip
        self._pending = True
        self.show()

    def show(self, *, now: bool = False) -> None:
        """Make pictures of what was added since the last ones, not too often."""
        if not self._pending or (not now and time.monotonic() - self._shown < SHOW_EVERY_S):
            return
        self._pending, self._shown = False, time.monotonic()
        grid = self._grid
        assert grid is not None
        channels = tuple(name for name in ORDER if name in self._images)
        image = np.concatenate([self._images[name].image() for name in channels])
        image[:, self._outside(grid)] = np.nan
        levels = level_db(image)
        low, high = colour_scale(levels)
        self.formed = Formed(grid, channels, image, low, high, self._newest_ns)
        axes = {"x_m": grid.x_m, "y_m": grid.y_m}
        units = {"x_m": "m", "y_m": "m", "low_db": "dB", "high_db": "dB"}
        scale: dict[str, Any] = {"low_db": low, "high_db": high}
        self._board.put(
            "sar",
            {**axes, "image": image, "level_db": levels},
            t_sample_ns=self._newest_ns,
            units={**units, "image": "full scale * m^2", "level_db": "dB of full scale * m^2"},
            values={
                **scale,
                "channels": list(channels),
                "positions": len({position for _, position in self._added}),
                "planned": self._planned,
            },
            slots=2,
        )
        colours = pauli_rgb(self.formed)
        if colours is not None:
            self._board.put(
                "pauli",
                {**axes, "rgb": colours},
                t_sample_ns=self._newest_ns,
                units=units,
                values={**scale, "note": "amplitudes are not calibrated"},
                slots=2,
            )

    def _compressed(self, record: Sweeps, *, apart: bool) -> tuple[NDArray[np.complex128], NDArray[np.float64]]:
        """Profiles (positions, bins), mean of the sweeps or one for each, and the time of each ramp in the record."""
        rig, block = self._rig, record.block
        wave = rig.waveform
        sync = find_sync(
            block.samples,
            block.sample_rate_hz,
            nominal_period_s=wave.sweep_period_s,
            ramp_up_s=wave.ramp_up_s,
        )
        wanted = record.sweeps_requested
        count = min(wanted, len(sync.starts)) if wanted > 0 else None
        sweeps = cut_sweeps(block.samples, sync, count=count)
        if self._axis is None:
            grid = self._grid
            assert grid is not None
            aside = max(abs(float(grid.x_m[0])), abs(float(grid.x_m[-1]))) + rig.trolley.length_m / 2
            far = math.sqrt(aside**2 + float(grid.y_m[-1]) ** 2 + grid.z_m**2)
            reach = unambiguous_range_m(wave.bandwidth_hz, sweeps.ramp_samples) - rig.geometry.range_offset_m
            margin = FAR_MARGIN_CELLS * wave.range_resolution_m
            self._axis = range_axis(
                wave.bandwidth_hz, min(far + margin, reach - wave.range_resolution_m), OVERSAMPLING
            )  # fmt: skip
        profiles = compress(
            sweeps,
            self._axis,
            centre_hz=wave.centre_hz,
            bandwidth_hz=wave.bandwidth_hz,
            range_offset_m=rig.geometry.range_offset_m,
        )
        if not apart:
            profiles = average(profiles)[None, :]
        return profiles * self._axis**2, sweeps.start_s + sweeps.ramp_s / 2

    def _add(self, channel: str, values: NDArray[np.complex128], x_m: NDArray[np.float64]) -> None:
        rig, wave = self._rig, self._rig.waveform
        assert self._grid is not None
        assert self._axis is not None
        if channel not in self._images:
            self._images[channel] = LiveImage(
                self._grid,
                interpolator=INTERPOLATOR,
                beamwidth_rad=math.radians(rig.geometry.beamwidth_deg),
                depression_rad=math.radians(rig.geometry.antenna_elevation_deg),
            )
        self._images[channel].add(
            RangeProfiles(
                values=values[None].astype(np.complex64),
                range_m=self._axis,
                antenna_m=np.column_stack([x_m, np.zeros((len(x_m), 2))]),
                channels=(channel,),
                centre_hz=wave.centre_hz,
                bandwidth_hz=wave.bandwidth_hz,
                range_compensated=True,
                pairs=antenna_pairs(rig, (channel,)),
            )
        )

    def _speed(self, record: Sweeps) -> float:
        """Of the trolley during a record of a pass, m/s, by the fixes around it."""
        begun = record.block.t_host_ns
        ended = begun + round(len(record.block.samples) / record.block.sample_rate_hz * 1e9)
        near = [(t, x) for t, x in self._track if begun - 1_000_000_000 <= t <= ended + 1_000_000_000]
        if len(near) < 2:
            return 0.0
        t, x = np.array([item[0] for item in near], dtype=np.float64) * 1e-9, np.array([item[1] for item in near])
        t -= t.mean()
        scatter = float(t @ t)
        return float(t @ (x - x.mean())) / scatter if scatter > 0 else 0.0

    def _outside(self, grid: ImageGrid) -> NDArray[np.bool_]:
        if self._masked is None:
            flags = footprint_flags(
                grid,
                beamwidth_rad=math.radians(self._rig.geometry.beamwidth_deg),
                depression_rad=math.radians(self._rig.geometry.antenna_elevation_deg),
                alias_free_rad=math.pi / 2,
                undefined=np.zeros(grid.shape, dtype=np.bool_),
            )
            self._masked = (flags & int(ImageFlag.OUTSIDE_BEAM)) != 0
        return self._masked


def _aperture(plan: Plan) -> tuple[float, ...]:
    """Places along the aperture of a plan without stops; none for plans without an aperture."""
    from polfuse_lab.plans.continuous import ContinuousSarPlan
    from polfuse_lab.plans.rail import places_along

    return places_along(plan.aperture_m, 0.05) if isinstance(plan, ContinuousSarPlan) else ()


def colour_scale(levels_db: NDArray[np.float32]) -> tuple[float, float]:
    """Ends of a colour scale, dB, by the percentiles of what is defined; 0 to 1 where nothing is."""
    defined = levels_db[np.isfinite(levels_db)]
    if not defined.size:
        return 0.0, 1.0
    high = float(np.percentile(defined, TOP_PERCENT))
    return high - RANGE_DB, high


def pauli_rgb(formed: Formed) -> NDArray[np.uint8] | None:
    """(ny, nx, 3) red HH-VV, green HV, blue HH+VV on the scale of the image; undefined pixels black.

    None where the channels are not all there.
    """
    planes = dict(zip(formed.channels, formed.image, strict=True))
    crosses = [planes[name] for name in ("HV", "VH") if name in planes]
    if "HH" not in planes or "VV" not in planes or not crosses:
        return None
    amplitudes = display_components(pauli_vector(planes["HH"], np.mean(crosses, axis=0), planes["VV"]))
    share = (level_db(amplitudes) - formed.low_db) / max(formed.high_db - formed.low_db, 1e-6)
    rgb: NDArray[np.uint8] = np.moveaxis(np.nan_to_num(np.clip(share, 0, 1)) * 255, 0, -1).astype(np.uint8)
    return rgb

"""What devices report. Each record is made once, by a driver, and never changed.

Every record carries ``t_host_ns``, the host's monotonic clock (``time.monotonic_ns``), and, where the device has a
clock, ``t_device_s``, the device's own raw stamp. Clocks are fitted when a session is read, never here.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray


class Channel(enum.IntEnum):
    """Polarimetric channel, named transmit-then-receive as in the thesis: HV transmits H and receives V (S_vh)."""

    HH = 0
    HV = 1
    VH = 2
    VV = 3

    @property
    def transmit(self) -> str:
        """Transmit polarization, ``"H"`` or ``"V"``."""
        return self.name[0]

    @property
    def receive(self) -> str:
        """Receive polarization, ``"H"`` or ``"V"``."""
        return self.name[1]


@dataclass(frozen=True)
class Identity:
    """Who answered when a device was opened; goes into the session's snapshot."""

    kind: str
    driver: str
    name: str
    detail: str = ""


@dataclass(frozen=True)
class ClockFix:
    """One pair of clock readings: the device's clock against the host's.

    ``t_host_ns`` is the midpoint of the exchange and ``round_trip_ns`` its length, so that the device's stamp was
    taken within half a round trip of the midpoint.
    """

    device: str
    t_device_s: float
    t_host_ns: int
    round_trip_ns: int


@dataclass(frozen=True)
class AudioBlock:
    """Contiguous samples from the radar's audio port.

    ``samples`` has shape (frames, channels) and the device's own sample type, exactly as sampled.
    ``first_frame`` counts frames since the stream was opened (lost frames counted too); ``t_device_s`` is the ADC time
    of the first frame on the stream's clock and ``t_host_ns`` the driver's best estimate of the same instant on the
    host's monotonic clock. ``lost_frames`` is the number known to be missing inside this block (0 when whole).
    """

    samples: NDArray[np.generic]
    sample_rate_hz: float
    first_frame: int
    t_device_s: float
    t_host_ns: int
    lost_frames: int = 0
    overflow: bool = False


@dataclass(frozen=True)
class TrolleyFix:
    """Where the trolley is along the rail, x = 0 at the aperture's centre."""

    x_m: float
    sd_m: float
    moving: bool
    t_host_ns: int
    state: str = ""


@dataclass(frozen=True)
class SwitchState:
    """Polarizations that the two transfer switches route, and whether the device itself verified them."""

    transmit: str
    receive: str
    verified: bool
    t_host_ns: int


@dataclass(frozen=True)
class PolarizerFix:
    """Angle of the polarizer's transmission axis from horizontal, radians, counter-clockwise looking into the beam."""

    angle_rad: float
    sd_rad: float
    moving: bool
    t_host_ns: int


@dataclass(frozen=True)
class Frame:
    """One camera frame: ``image`` (rows, columns), unsigned counts, as delivered by the camera."""

    image: NDArray[np.unsignedinteger]
    frame_id: int
    exposure_s: float
    gain_db: float
    t_device_s: float
    t_host_ns: int
    incomplete: bool = False
    lost_before: int = 0


@dataclass(frozen=True)
class Level:
    """Signal level of the radar's two audio channels, as fractions of full scale (for meters and checks)."""

    peak: tuple[float, ...] = field(default=(0.0, 0.0))
    rms: tuple[float, ...] = field(default=(0.0, 0.0))

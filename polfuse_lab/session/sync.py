"""When each record of a session was, on the host's clock, and how well two devices' times compare.

The file holds raw stamps and pairs of clock readings; the fit is made here, when it is asked for::

    radar = session.sync.device("radar")
    radar.host_ns[4], radar.sd_s[4]             # first sample of audio record 4, and its standard uncertainty
    pair = session.sync.pair("radar", "camera")
    pair.between(4, pair.nearest(4))            # from that sweep to the nearest frame: seconds, and their uncertainty
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from polfuse_lab.clocks import DeviceClock, fit_clocks, largest_residual_s
from polfuse_lab.errors import PolfuseError

if TYPE_CHECKING:
    from polfuse_lab.session.reader import Session

CLOCKED = {"radar": "sweeps", "camera": "frames"}
"""Devices whose records carry a stamp of their own, and the tables of these records."""
STAMPED = ("trolley", "switches", "polarizer", "source_polarizer")
"""Devices without a clock: the host stamps the middle of each question and answer, and what the device did meanwhile is
in the fix's own uncertainty (``sd_m``, ``sd_rad``). Their tables are called as they are."""
UNLIKE_S = 1.0
"""A record's own stamp that comes to lie so far from the host's is of another clock than the pairs are."""


@dataclass(frozen=True)
class DeviceTimes:
    """Times of a device's records on the host's clock."""

    device: str
    clock: DeviceClock | None
    """The fitted clock; None where the device has none or no pair was stored."""
    host_ns: NDArray[np.int64]
    """(n,) fitted times, ns; the host's own stamp where there is no clock or its stamp does not fit it."""
    sd_s: NDArray[np.float64]
    """(n,) standard uncertainty of these, s; NaN where it is not known; 0 for fixes stamped by the host."""

    @property
    def rms_s(self) -> float | None:
        """Sync uncertainty of the device: rms of :attr:`sd_s`; None where that of a record is not known, or none is."""
        if not len(self.sd_s) or not np.isfinite(self.sd_s).all():
            return None
        return float(np.sqrt(np.mean(self.sd_s**2)))


@dataclass(frozen=True)
class PairTimes:
    """Two devices, whose records are compared in time. Their clocks' errors are independent."""

    first: DeviceTimes
    second: DeviceTimes

    @property
    def rms_s(self) -> float | None:
        """Sync uncertainty of the pair: rms over all records of both; None where that of one device is not known."""
        a, b = self.first.rms_s, self.second.rms_s
        return None if a is None or b is None else float(np.hypot(a, b))

    def between(self, first: int, second: int) -> tuple[float, float]:
        """Seconds from record ``first`` of the first device to record ``second`` of the second; their uncertainty, s.

        Raises:
            IndexError: there is no such record.
        """
        passed_ns = int(self.second.host_ns[second]) - int(self.first.host_ns[first])
        return passed_ns * 1e-9, float(np.hypot(self.first.sd_s[first], self.second.sd_s[second]))

    def nearest(self, first: int) -> int:
        """Number of the second device's record nearest in time to record ``first`` of the first.

        Raises:
            IndexError: there is no such record, or the second device has none.
        """
        if not len(self.second.host_ns):
            raise IndexError(f"the {self.second.device} has no record")
        return int(np.argmin(np.abs(self.second.host_ns - self.first.host_ns[first])))


class SessionSync:
    """The clocks of a session, fitted to the host's."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._times: dict[str, DeviceTimes] = {}

    @cached_property
    def clocks(self) -> dict[str, DeviceClock]:
        """The fitted clock of each device that stored pairs of readings, by name."""
        return fit_clocks(self._session.clocks)

    @cached_property
    def residual_rms_s(self) -> float | None:
        """Largest residual of a device's clock, s; None where no device has a clock."""
        return largest_residual_s(self.clocks)

    @property
    def devices(self) -> tuple[str, ...]:
        """Devices with records in the session."""
        tables = {**CLOCKED, **{name: name for name in STAMPED}}
        return tuple(name for name, table in tables.items() if len(getattr(self._session, table)))

    def device(self, name: str) -> DeviceTimes:
        """Times of a device's records: ``"radar"`` (audio records, in the order of :attr:`Session.sweeps`),
        ``"camera"`` (frames), or one of :data:`STAMPED` (fixes).

        Raises:
            PolfuseError: there is no such device.
        """
        if name not in (*CLOCKED, *STAMPED):
            raise PolfuseError(
                f"there is no device {name!r}",
                where=str(self._session.path),
                advice=f"choose from {', '.join((*CLOCKED, *STAMPED))}",
            )
        if name not in self._times:
            self._times[name] = self._clocked(name) if name in CLOCKED else self._stamped(name)
        return self._times[name]

    def pair(self, first: str, second: str) -> PairTimes:
        """Two devices' records, to be compared in time: a sweep to a frame, a sweep to a position.

        Raises:
            PolfuseError: there is no such device, or both are the same.
        """
        if first == second:
            raise PolfuseError(
                f"{first!r} and {second!r} are the same device", where=str(self._session.path), advice="choose another"
            )
        return PairTimes(self.device(first), self.device(second))

    def summary(self) -> dict[str, Any]:
        """What is known of the clocks, as plain values: ``devices`` and ``pairs`` by name, uncertainties in s.

        A device has ``rms_s``, ``records``, and with a clock ``residual_rms_s``, ``drift_ppm``, ``drift_sd_ppm``,
        ``pairs``, ``rejected`` and ``jumps_s``. A pair is its ``rms_s``, None where it is not known.
        """
        present = self.devices
        pairs = [("radar", name) for name in present if name != "radar"] if "radar" in present else []
        pairs += [("camera", name) for name in present if name in STAMPED] if "camera" in present else []
        names = [*present, *(name for name in self.clocks if name not in present and name in CLOCKED)]
        return {
            "devices": {name: self._summary_of(self.device(name)) for name in names},
            "pairs": {f"{a}-{b}": self.pair(a, b).rms_s for a, b in pairs},
        }

    @staticmethod
    def _summary_of(times: DeviceTimes) -> dict[str, Any]:
        found: dict[str, Any] = {"records": len(times.host_ns), "rms_s": times.rms_s}
        if (clock := times.clock) is not None:
            found |= {
                "residual_rms_s": clock.residual_rms_s,
                "drift_ppm": clock.drift_ppm,
                "drift_sd_ppm": clock.drift_sd_ppm,
                "pairs": clock.pairs,
                "rejected": clock.rejected,
                "jumps_s": list(clock.jumps_s),
            }
        return found

    def _stamped(self, name: str) -> DeviceTimes:
        stamps = getattr(self._session, name)["t_host_ns"]
        return DeviceTimes(name, None, stamps, np.zeros(len(stamps)))

    def _clocked(self, name: str) -> DeviceTimes:
        rows = getattr(self._session, CLOCKED[name])
        stamped, raw = rows["t_host_ns"], rows["t_device_s"]
        clock = self.clocks.get(name)
        if clock is None or not len(rows):
            return DeviceTimes(name, clock, stamped, np.full(len(rows), np.nan))
        finite = np.isfinite(raw)
        device_s = np.where(finite, raw, clock.pieces[0].reference_device_s)
        # Stamps of records come late by a usual delay (a frame's way to the computer), which must not decide on which
        # side of a jump a record lies.
        late_ns = np.median((stamped - clock.host_ns(device_s, near_ns=stamped))[finite]) if finite.any() else 0
        near = stamped - np.int64(round(float(np.clip(late_ns, -UNLIKE_S * 1e9, UNLIKE_S * 1e9))))
        fitted, sd = clock.host_ns(device_s, near_ns=near), clock.sd_s(device_s, near_ns=near)
        sound = finite & (np.abs(fitted - near) < UNLIKE_S * 1e9)
        return DeviceTimes(name, clock, np.where(sound, fitted, stamped), np.where(sound, sd, np.nan))

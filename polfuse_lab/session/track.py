"""Where the trolley was at any instant of a session, and how well that is known."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from polfuse_lab.clocks import fit_clocks

if TYPE_CHECKING:
    from polfuse_lab.session.reader import Session

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class TrolleyTrack:
    """The trolley's fixes as a way in time; between two fixes it is taken to go straight on."""

    t_host_ns: NDArray[np.int64]
    """(fixes,) increasing."""
    x_m: Floats
    sd_m: Floats

    @classmethod
    def of(cls, session: Session) -> TrolleyTrack:
        """The track of a session. Of several fixes with one time the last one counts."""
        rows = session.trolley
        rows = rows[np.argsort(rows["t_host_ns"], kind="stable")]
        if len(rows):
            rows = rows[np.append(np.diff(rows["t_host_ns"]) > 0, True)]
        return cls(rows["t_host_ns"].astype(np.int64), rows["x_m"].astype(np.float64), rows["sd_m"].astype(np.float64))

    def at(self, t_host_ns: NDArray[np.int64], time_sd_s: Floats | float = 0.0) -> tuple[Floats, Floats]:
        """Positions and their standard uncertainties, m; NaN before the first fix and after the last one.

        The uncertainty is that of the fixes, of the time (``time_sd_s`` times the speed), and of the way between two
        fixes: a trolley whose speed changes by dv from the stretch before to the stretch behind deviates from the
        straight by at most about dv times a quarter of the gap; a uniform distribution within that is taken.

        Args:
            t_host_ns: host times, any shape.
            time_sd_s: standard uncertainty of the times against the host's clock, s.
        """
        t = np.asarray(t_host_ns, dtype=np.int64)
        if len(self.x_m) < 2:
            unknown = np.full(t.shape, np.nan)
            return unknown, unknown.copy()
        # Differences of integers first: the host's clock has too many digits for a float.
        origin = int(self.t_host_ns[0])
        fixes_s, at_s = (self.t_host_ns - origin) * 1e-9, (t - origin) * 1e-9
        gap = np.clip(np.searchsorted(fixes_s, at_s, side="right") - 1, 0, len(fixes_s) - 2)
        lengths_s = np.diff(fixes_s)
        speeds = np.diff(self.x_m) / lengths_s
        x = np.interp(at_s, fixes_s, self.x_m, left=np.nan, right=np.nan)
        change = np.abs(speeds[np.minimum(gap + 1, len(speeds) - 1)] - speeds[np.maximum(gap - 1, 0)])
        part = (at_s - fixes_s[gap]) / lengths_s[gap]
        bend = change * lengths_s[gap] * np.clip(part * (1 - part), 0, None) / np.sqrt(3)
        fix_sd = np.maximum(self.sd_m[gap], self.sd_m[gap + 1])
        sd = np.sqrt(fix_sd**2 + bend**2 + (speeds[gap] * time_sd_s) ** 2)
        return x, np.where(np.isnan(x), np.nan, sd)

    def speed_m_s(self, t_host_ns: NDArray[np.int64]) -> Floats:
        """Speeds between the fixes around given times, m/s, positive towards positive x; 0 outside the fixes."""
        t = np.asarray(t_host_ns, dtype=np.int64)
        if len(self.x_m) < 2:
            return np.zeros(t.shape)
        gap = np.searchsorted(self.t_host_ns, t, side="right") - 1
        inside = (gap >= 0) & (gap < len(self.x_m) - 1)
        gap = np.clip(gap, 0, len(self.x_m) - 2)
        speeds = np.diff(self.x_m) / (np.diff(self.t_host_ns) * 1e-9)
        found: Floats = np.where(inside, speeds[gap], 0.0)
        return found


def sample_times(session: Session, index: int, samples: Floats) -> tuple[NDArray[np.int64], Floats]:
    """Host times of samples of an audio record, through the fitted clock of the radar's stream.

    Args:
        session: an open session.
        index: number of the audio record.
        samples: sample numbers since the record's first, fractions included.

    Returns:
        Host times, ns, and their standard uncertainties, s. Without clock fixes the record's own stamp and the nominal
        rate stand, with an unknown (NaN) uncertainty.
    """
    row = session.sweeps[index]
    since_s = np.asarray(samples, dtype=np.float64) / session.sample_rate_hz
    stamped: NDArray[np.int64] = int(row["t_host_ns"]) + np.round(since_s * 1e9).astype(np.int64)
    clock = fit_clocks(session.clocks).get("radar")
    if clock is None:
        return stamped, np.full(since_s.shape, np.nan)
    device_s = float(row["t_device_s"]) + since_s
    return clock.host_ns(device_s, stamped), clock.sd_s(device_s, stamped)

"""The clock of one device: pieces of a line to the host's clock, and how far they can be trusted."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from polfuse_lab.clocks.line import CommonRate, fit_lines
from polfuse_lab.clocks.pieces import LEAST_APART_S, LEAST_JUMP_S, clock_pieces

REJECT_SIGMA = 4.0
"""Pairs so many robust standard deviations from the line are left out, unless the round trips explain it."""
ROUNDING_S = 2e-9
"""Rounding of the readings must not reject a pair of a perfect line."""
EDGE_NS = 200_000_000
"""A record may be stamped so much before or after the pairs of its piece and still be looked for there, ns."""

Floats = NDArray[np.float64]
Nanoseconds = NDArray[np.int64]


@dataclass(frozen=True)
class ClockPiece:
    """A stretch in which the clock ran on: ``host_ns = reference_host_ns + 1e9 (offset_s + rate (t - reference))``."""

    reference_device_s: float
    reference_host_ns: int
    offset_s: float
    first_host_ns: int
    """Host time of its first pair of readings that is no outlier."""
    last_host_ns: int
    """Host time of its last such pair."""
    pairs: int
    step_s: float = float("nan")
    """How much the device's clock had leapt ahead of the host's when this piece began; NaN for the first."""


@dataclass(frozen=True)
class DeviceClock:
    """A device's clock, fitted to the host's."""

    device: str
    rate: float
    """Host seconds for one second of the device (1 + drift)."""
    residual_rms_s: float
    """Rms of what the pairs miss the line by, over n - 2; half the longest round trip for fewer than 4 pairs."""
    pairs: int
    rejected: int
    """Pairs left out as outliers."""
    pieces: tuple[ClockPiece, ...]
    lines: CommonRate

    @property
    def drift_ppm(self) -> float:
        """How much faster the host's clock runs than the device's, parts per million."""
        return (self.rate - 1) * 1e6

    @property
    def drift_sd_ppm(self) -> float:
        """Standard uncertainty of :attr:`drift_ppm`."""
        return float(np.sqrt(self.lines.rate_var)) * 1e6

    @property
    def jumps_s(self) -> tuple[float, ...]:
        """Steps of the device's clock between its pieces, s: it was set, wrapped round or began anew."""
        return tuple(piece.step_s for piece in self.pieces[1:])

    def host_ns(self, t_device_s: ArrayLike, near_ns: ArrayLike | None = None) -> Nanoseconds:
        """The host's monotonic nanoseconds at readings of the device's clock.

        Args:
            t_device_s: readings, s; a number or an array.
            near_ns: host time of about the same instants (a record's own stamp), by which the piece is chosen where
                the clock jumped. Without it, a reading goes to the piece whose own readings are nearest.

        Returns:
            An array of the readings' shape.
        """
        t, piece, _ = self._place(t_device_s, near_ns)
        return self._on_piece(t, piece)

    def sd_s(self, t_device_s: ArrayLike, near_ns: ArrayLike | None = None) -> Floats:
        """Standard uncertainty (1 sigma) of :meth:`host_ns`, s, with half the jump where the piece is doubtful."""
        t, piece, doubt_s = self._place(t_device_s, near_ns)
        from_reference = t - np.array([item.reference_device_s for item in self.pieces])[piece]
        sd: Floats = np.sqrt(self.lines.variance(piece, from_reference) + doubt_s**2)
        return sd

    def _on_piece(self, t: Floats, piece: NDArray[np.intp]) -> Nanoseconds:
        from_reference = t - np.array([item.reference_device_s for item in self.pieces])[piece]
        since = self.lines.offset_s[piece] + from_reference + self.lines.excess_rate * from_reference
        references = np.array([item.reference_host_ns for item in self.pieces], dtype=np.int64)
        found: Nanoseconds = references[piece] + np.round(since * 1e9).astype(np.int64)
        return found

    def _place(self, t_device_s: ArrayLike, near_ns: ArrayLike | None) -> tuple[Floats, NDArray[np.intp], Floats]:
        """Readings as an array, the piece of each, and how far off it may be if that is the wrong one, s."""
        t = np.asarray(t_device_s, dtype=np.float64)
        if len(self.pieces) == 1:
            shape = t.shape if near_ns is None else np.broadcast_shapes(t.shape, np.shape(near_ns))
            return np.broadcast_to(t, shape), np.zeros(shape, np.intp), np.zeros(shape)
        if near_ns is None:
            starts = np.array([item.reference_device_s for item in self.pieces])
            spans = np.array([(item.last_host_ns - item.first_host_ns) * 1e-9 for item in self.pieces])
            away = np.maximum(starts - t[..., None], t[..., None] - (starts + spans))
            return t, np.argmin(np.maximum(away, 0), axis=-1), np.zeros(t.shape)
        t, near = np.broadcast_arrays(t, np.asarray(near_ns, dtype=np.int64))
        every = np.arange(len(self.pieces))
        told = np.stack([self._on_piece(t, np.full(t.shape, p)) for p in every], axis=-1)
        first = np.array([item.first_host_ns for item in self.pieces], dtype=np.int64)
        last = np.array([item.last_host_ns for item in self.pieces], dtype=np.int64)
        # A piece can reach from the last pair of the one before it to the first pair of the one after it.
        least = np.concatenate([[np.iinfo(np.int64).min], last[:-1] - EDGE_NS])
        most = np.concatenate([first[1:] + EDGE_NS, [np.iinfo(np.int64).max]])
        possible = (near[..., None] >= least) & (near[..., None] <= most)
        misfit = np.where(possible, np.abs(told - near[..., None]) * 1e-9, np.inf)
        order = np.argsort(misfit, axis=-1)
        best, second = (np.take_along_axis(misfit, order[..., k : k + 1], -1)[..., 0] for k in (0, 1))
        apart = np.ptp(np.take_along_axis(told, order[..., :2], -1), axis=-1) * 1e-9
        # A stamp that lies between both says little of which it belongs to.
        doubt = np.where(np.isfinite(second) & (best > second / 3), apart / 2, 0.0)
        return t, order[..., 0], doubt


def fit_clock(
    device: str,
    t_device_s: NDArray[np.float64],
    t_host_ns: NDArray[np.int64],
    round_trip_ns: NDArray[np.int64],
) -> DeviceClock | None:
    """Fit a device's clock to the host's, robustly: pieces of one rate, parted where the clock jumped.

    Args:
        device: its name.
        t_device_s: (n,) readings of the device's clock, s.
        t_host_ns: (n,) readings of the host's clock at the middle of each exchange, ns.
        round_trip_ns: (n,) length of each exchange, ns.

    Returns:
        The clock, or None without any pair.
    """
    order = np.argsort(t_host_ns, kind="stable")
    device_s = np.asarray(t_device_s, dtype=np.float64)[order]
    host_ns = np.asarray(t_host_ns, dtype=np.int64)[order]
    trip_ns = np.asarray(round_trip_ns, dtype=np.int64)[order]
    n = len(device_s)
    if n == 0:
        return None
    slices = clock_pieces(device_s, host_ns, trip_ns)
    clock = _fit(device, slices, device_s, host_ns, trip_ns)
    # With all pairs in one fit a jump may turn out to be none.
    small = {p for p, piece in enumerate(clock.pieces) if abs(piece.step_s) < LEAST_JUMP_S}
    if small:
        starts = [part.start for p, part in enumerate(slices) if p not in small]
        slices = [slice(a, b) for a, b in itertools.pairwise([*starts, n])]
        clock = _fit(device, slices, device_s, host_ns, trip_ns)
    return clock


def _fit(device: str, slices: list[slice], device_s: Floats, host_ns: Nanoseconds, trip_ns: Nanoseconds) -> DeviceClock:
    """Fit lines of one rate to pairs in order of time, a line for each slice."""
    piece = np.repeat(np.arange(len(slices)), [part.stop - part.start for part in slices])
    starts = np.array([part.start for part in slices])
    x = device_s - device_s[starts][piece]
    y = (host_ns - host_ns[starts][piece]) * 1e-9 - x
    trip = np.maximum(trip_ns, 0) * 1e-9
    keep = _good(x, y, trip, piece)
    lines = fit_lines(x[keep], y[keep], trip[keep], piece[keep])
    n, good = len(x), int(keep.sum())
    rms = float(np.sqrt(np.sum(lines.residual_s**2) / max(good - len(slices) - 1, 1)))
    pieces: list[ClockPiece] = []
    for p, start in enumerate(starts.tolist()):
        used = host_ns[keep & (piece == p)]
        step = float("nan")
        if p:
            # Where the line of the piece before stands at this one's reference: the clock leapt from there.
            passed = int(host_ns[start] - host_ns[starts[p - 1]]) * 1e-9 + lines.offset_s[p] - lines.offset_s[p - 1]
            step = float(device_s[start] - device_s[starts[p - 1]] - passed / (1 + lines.excess_rate))
        pieces.append(
            ClockPiece(
                reference_device_s=float(device_s[start]),
                reference_host_ns=int(host_ns[start]),
                offset_s=float(lines.offset_s[p]),
                first_host_ns=int(used[0]),
                last_host_ns=int(used[-1]),
                pairs=int(np.count_nonzero(piece == p)),
                step_s=step,
            )
        )
    return DeviceClock(
        device=device,
        rate=1 + lines.excess_rate,
        residual_rms_s=rms if n >= 4 else float(trip.max()) / 2,
        pairs=n,
        rejected=n - good,
        pieces=tuple(pieces),
        lines=lines,
    )


def _good(x: Floats, y: Floats, trip: Floats, piece: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Pairs that are no outliers: near the parallel lines of Theil and Sen, or explained by the round trips.

    A device reads its clock within the exchange, so that a pair is right to half its round trip; and so are those that
    the line follows, to half of theirs. A short exchange among long ones that are all late on the same way lies off
    their line, and is the best pair of all.
    """
    keep: NDArray[np.bool_] = np.ones(len(x), bool)
    if len(x) < 4:
        return keep
    rate = _theil_sen(x, y, piece)
    count = int(piece[-1]) + 1
    level = np.array([np.median((y - rate * x)[piece == p]) for p in range(count)])
    away = np.abs(y - rate * x - level[piece])
    # Medians of few residuals are too small: so many of them are spent on the lines.
    spread = 1.4826 * float(np.median(away)) * len(x) / max(len(x) - count - 1, 1)
    keep = (away <= max(REJECT_SIGMA * spread, ROUNDING_S)) | (away <= (trip + np.median(trip)) / 2)
    for p in range(count):
        if not keep[piece == p].any():
            keep[piece == p] = True
    return keep


def _theil_sen(x: Floats, y: Floats, piece: NDArray[np.intp]) -> float:
    """Median slope of all pairs of points of one piece (at most 400 points are paired, evenly picked)."""
    if len(x) > 400:
        pick = np.linspace(0, len(x) - 1, 400).round().astype(int)
        x, y, piece = x[pick], y[pick], piece[pick]
    i, j = np.triu_indices(len(x), 1)
    dx = x[j] - x[i]
    apart = (np.abs(dx) > LEAST_APART_S) & (piece[i] == piece[j])
    return float(np.median((y[j] - y[i])[apart] / dx[apart])) if apart.any() else 0.0


def fit_clocks(clocks: NDArray[np.void]) -> dict[str, DeviceClock]:
    """The clock of each device in a session's table of clock fixes, by name."""
    found = {}
    for name in np.unique(clocks["device"]):
        rows = clocks[clocks["device"] == name]
        clock = fit_clock(name.decode(), rows["t_device_s"], rows["t_host_ns"], rows["round_trip_ns"])
        if clock is not None:
            found[name.decode()] = clock
    return found


def largest_residual_s(clocks: Mapping[str, DeviceClock]) -> float | None:
    """The largest residual of several clocks, s; None where there is none."""
    return max((clock.residual_rms_s for clock in clocks.values()), default=None)


def sync_rms_s(clocks: NDArray[np.void]) -> float | None:
    """:func:`largest_residual_s` of a session's table of clock fixes."""
    return largest_residual_s(fit_clocks(clocks))

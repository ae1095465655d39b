"""Clocks: from pairs of readings to a line between a device's clock and the host's, and how well it holds.

Raw stamps are stored as they came; everything here happens when a session is read. A clock is a straight line, or
several with one common rate where it was set, wrapped round or began anew (:mod:`polfuse_lab.clocks.pieces`); its
uncertainty holds for the place where the line is used, not for the pairs (:mod:`polfuse_lab.clocks.line`).
"""

from polfuse_lab.clocks.device import ClockPiece, DeviceClock, fit_clock, fit_clocks, largest_residual_s, sync_rms_s
from polfuse_lab.clocks.line import CommonRate, fit_lines
from polfuse_lab.clocks.pieces import clock_pieces, clock_runs

__all__ = [
    "ClockPiece",
    "CommonRate",
    "DeviceClock",
    "clock_pieces",
    "clock_runs",
    "fit_clock",
    "fit_clocks",
    "fit_lines",
    "largest_residual_s",
    "sync_rms_s",
]

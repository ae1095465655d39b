"""What a benchmark reports."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Row:
    """One comparison: with a peer, or of a campaign's measure with its limit.

    ``ratio`` is ours over the peer's (or over the limit), with its range over repetitions where there is one;
    ``error`` and ``peer_error`` are deviations from the truth, or what went wrong in words. None: does not apply.
    """

    name: str
    peer: str
    ratio: float | None
    ok: bool
    target: str = ""
    ratio_min: float | None = None
    ratio_max: float | None = None
    error: float | str | None = None
    peer_error: float | str | None = None

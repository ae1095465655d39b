"""The sync of a session's audio, by what the session knows of it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polfuse_lab.session import Session
from processing.radar.sync import Polarity, Sync, find_sync


def find_record_sync(session: Session, samples: NDArray[np.generic]) -> Sync:
    """Sync of one record, by the session's waveform and what is known of its polarity. Raises :class:`DataError`."""
    known = session.config["extra"].get("sync_inverted")
    polarity: Polarity = "auto" if known is None else "low" if known else "high"
    return find_sync(
        samples,
        session.sample_rate_hz,
        nominal_period_s=session.waveform.sweep_period_s,
        ramp_up_s=session.waveform.ramp_up_s,
        polarity=polarity,
    )

"""The session file: every raw byte of a collect, in a form that survives crashes.

Writing::

    config = SessionConfig(source="import:wav", waveform=waveform, sample_rate_hz=44_100.0, sample_dtype="int16")
    with SessionWriter.create("walk.h5", config) as writer:
        writer.write(Sweeps(block, Channel.HH, position=0))
    # a clean end renames walk.h5.partial to walk.h5; an exception closes it as "failed" with the reason

Reading::

    with open_session("walk.h5") as session:
        for index, row in enumerate(session.sweeps):
            samples = session.audio(index)          # (row["samples"], 2), exactly as sampled
"""

from polfuse_lab.session.join import JoinResult, join
from polfuse_lab.session.layout import SCHEMA, VERSION, SessionConfig
from polfuse_lab.session.reader import Session, open_session
from polfuse_lab.session.recovery import RecoverResult, recover
from polfuse_lab.session.selection import AudioRecord, FrameRecord, Selection
from polfuse_lab.session.summary import info
from polfuse_lab.session.writer import SessionWriter

__all__ = [
    "SCHEMA",
    "VERSION",
    "AudioRecord",
    "FrameRecord",
    "JoinResult",
    "RecoverResult",
    "Selection",
    "Session",
    "SessionConfig",
    "SessionWriter",
    "info",
    "join",
    "open_session",
    "recover",
]

"""``python -m polfuse_lab.live``: the live process, started by an engine."""

from __future__ import annotations

import contextlib
import faulthandler
import os
import signal

from polfuse_lab.engine.children import SIGNALS

if __name__ == "__main__":
    faulthandler.enable()
    if hasattr(os, "SCHED_BATCH"):
        # Nor does it take the processor from anybody in the middle of something.
        with contextlib.suppress(OSError):
            os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))
    # One core for pictures at most; the others are for whoever records. Read when numba is imported.
    os.environ["NUMBA_NUM_THREADS"] = "1"
    from polfuse_lab.live.process import main

    for number in SIGNALS:
        # The engine decides when it is over; the only cue is the pipe.
        signal.signal(number, signal.SIG_IGN)
    code = 1
    try:
        main()
        code = 0
    finally:
        # A kernel in another thread must not keep it.
        os._exit(code)

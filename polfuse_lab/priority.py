"""How work that can wait gives way to work that cannot."""

from __future__ import annotations

import contextlib
import os


def give_way(nice: int) -> None:
    """Let others go first from now on, by so much of niceness, as far as the system lets a process say so.

    Linux shares processors out among sessions first (autogroups), and among the processes of each by their niceness
    then: a process with a session of its own would give way to nobody. So who leads a session lowers all of it.
    """
    if hasattr(os, "nice"):
        with contextlib.suppress(OSError):
            os.nice(nice)
    if hasattr(os, "getsid") and os.getsid(0) == os.getpid():
        with contextlib.suppress(OSError), open("/proc/self/autogroup", "w", encoding="ascii") as group:
            group.write(str(nice))

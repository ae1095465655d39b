"""How the engine starts the processes that must outlive it, or bring something to its end."""

from __future__ import annotations

import signal
import subprocess
import sys

SIGNALS = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))
"""What the engine answers, and its children leave to it."""


def start_child(module: str, *, answers: bool) -> subprocess.Popen[bytes]:
    """Start ``python -m module`` with a pipe to its standard input, deaf to :data:`SIGNALS` from its first instant.

    Args:
        module: the program.
        answers: whether its standard output is a pipe to here; else it goes nowhere.
    """
    blocks = hasattr(signal, "pthread_sigmask")
    # Inherited: a signal that comes while the child still imports would end it otherwise.
    before = signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS) if blocks else set()
    try:
        return subprocess.Popen(
            [sys.executable, "-m", module],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE if answers else subprocess.DEVNULL,
            # A session of its own: who kills the engine's process group does not kill it.
            start_new_session=True,
        )
    finally:
        if blocks:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)

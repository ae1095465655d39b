"""What the program remembers of its user from one day to the next: rigs and sessions, and settings."""

from polfuse_lab.remembered.recent import (
    Recent,
    forget,
    recent_rigs,
    recent_sessions,
    remember_rig,
    remember_session,
)
from polfuse_lab.remembered.settings import Settings

__all__ = [
    "Recent",
    "Settings",
    "forget",
    "recent_rigs",
    "recent_sessions",
    "remember_rig",
    "remember_session",
]

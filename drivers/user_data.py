"""The folder in which drivers keep what must outlive a session (cycle counters of switches)."""

from __future__ import annotations

import os
from pathlib import Path

import platformdirs

FOLDER_VARIABLE = "POLFUSE_USER_DATA"
"""Environment variable that names another folder."""


def user_data_folder() -> Path:
    """The user's data folder of this program (not made here): ``$POLFUSE_USER_DATA``, else the system's usual place."""
    named = os.environ.get(FOLDER_VARIABLE, "")
    return Path(named) if named else Path(platformdirs.user_data_path("polfuse-lab", appauthor=False))

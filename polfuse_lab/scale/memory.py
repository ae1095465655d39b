"""How much memory there is, how much is used, and sizes as people write them."""

from __future__ import annotations

import math
import os
import re
from pathlib import Path

from polfuse_lab.errors import PolfuseError

MEGABYTE = 1_000_000
_UNITS = {"": 1, "k": 1e3, "m": 1e6, "g": 1e9, "t": 1e12, "ki": 2**10, "mi": 2**20, "gi": 2**30, "ti": 2**40}
_SIZE = re.compile(r"\s*([0-9.]+)\s*([kmgt]i?)?b?\s*", re.IGNORECASE)

SHARE = 0.5
"""Of the memory that is available, what is used unless a limit is given."""


def parse_size(text: str) -> int:
    """Bytes of a size such as ``500MB``, ``1.5 GB``, ``2GiB`` or ``1000000``.

    Raises:
        PolfuseError: it is none, or not above zero.
    """
    told = _SIZE.fullmatch(text)
    try:
        value = float(told[1]) * _UNITS[(told[2] or "").lower()] if told else math.nan
    except ValueError:
        value = math.nan
    if not (math.isfinite(value) and value >= 1):
        raise PolfuseError(f"{text!r} is no size", where="memory limit", advice="write it like 500MB or 2GB")
    return int(value)


def available_bytes() -> int | None:
    """Memory that can be had without swapping: the system's, and no more than the control group leaves (Linux).

    None where the system does not tell.
    """
    found: list[int] = []
    try:
        lines = Path("/proc/meminfo").read_text(encoding="ascii").splitlines()
        found.extend(int(line.split()[1]) * 1024 for line in lines if line.startswith("MemAvailable:"))
    except OSError:
        if hasattr(os, "sysconf") and "SC_AVPHYS_PAGES" in os.sysconf_names:
            found.append(os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    try:
        limit, used = (
            Path(f"/sys/fs/cgroup/{name}").read_text(encoding="ascii").strip()
            for name in ("memory.max", "memory.current")
        )
        if limit != "max":
            found.append(max(int(limit) - int(used), 0))
    except (OSError, ValueError):
        pass
    return min(found, default=None)


def resident_bytes() -> int:
    """Memory that this process holds; 300 MB where the system does not tell (what the program takes by itself)."""
    try:
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    except (OSError, ValueError, IndexError):
        return 300 * MEGABYTE
    return pages * os.sysconf("SC_PAGE_SIZE")

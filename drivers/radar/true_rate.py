"""Does the sound system resample between the sound card and this program? Asked of a running stream on Linux.

ALSA's plug-ins, PulseAudio and PipeWire resample without a word, and PortAudio cannot tell. A running stream can be
looked up, though: PulseAudio and PipeWire list each recording stream with the process that it belongs to and the
source's own rate, and the kernel lists each open sound card with its owner and rate.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

TIMEOUT_S = 2.0
SERVER_PLUGINS = ("libasound_module_pcm_pulse", "libasound_module_pcm_pipewire", "libpulse.so")


def card_rate_hz(proc: Path = Path("/proc")) -> float | None:
    """Rate at which the sound card behind this process's recording stream runs; None where it cannot be told.

    Args:
        proc: the kernel's process information.
    """
    rates = (
        server_rates(_server_list("source-outputs"), _server_list("sources"), os.getpid()) if _by_server(proc) else []
    )
    rates = rates or kernel_rates(proc, os.getpid())
    # Several streams of one process: which is the radar's is not known.
    return rates[0] if len(set(rates)) == 1 else None


def server_rates(streams: list[dict[str, Any]], sources: list[dict[str, Any]], pid: int) -> list[float]:
    """Rates of the sources that a sound server records from for a process.

    Args:
        streams: what ``pactl --format=json list source-outputs`` says.
        sources: what ``pactl --format=json list sources`` says.
        pid: the process.
    """
    rates_by_index: dict[Any, float] = {}
    for source in sources:
        match = re.search(r"(\d+)\s*Hz", str(source.get("sample_specification", "")))
        if match:
            rates_by_index[source.get("index")] = float(match[1])
    own = [s for s in streams if str((s.get("properties") or {}).get("application.process.id")) == str(pid)]
    return [rates_by_index[s["source"]] for s in own if s.get("source") in rates_by_index]


def kernel_rates(proc: Path, pid: int) -> list[float]:
    """Rates of the sound cards that a process itself has open for recording."""
    rates = []
    for status in sorted(proc.glob("asound/card*/pcm*c/sub*/status")):
        try:
            owner = re.search(r"owner_pid\s*:\s*(\d+)", status.read_text(encoding="ascii", errors="replace"))
            # The owner is the thread that opened the card.
            if owner is None or not (int(owner[1]) == pid or (proc / str(pid) / "task" / owner[1]).exists()):
                continue
            settings = (status.parent / "hw_params").read_text(encoding="ascii", errors="replace")
        except OSError:
            continue
        rate = re.search(r"^rate:\s*(\d+)", settings, re.MULTILINE)
        if rate:
            rates.append(float(rate[1]))
    return rates


def _by_server(proc: Path) -> bool:
    """Whether this process talks to a sound server (asking one that does not run might start it)."""
    try:
        maps = (proc / "self" / "maps").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return False
    return any(name in maps for name in SERVER_PLUGINS)


def _server_list(what: str) -> list[dict[str, Any]]:
    """One of the sound server's lists; empty where it cannot be had."""
    if shutil.which("pactl") is None:
        return []
    try:
        run = subprocess.run(
            ["pactl", "--format=json", "list", what],
            capture_output=True,
            timeout=TIMEOUT_S,
            check=True,
            stdin=subprocess.DEVNULL,
        )
        entries = json.loads(run.stdout)
    except (OSError, subprocess.SubprocessError, ValueError):
        return []
    return [entry for entry in entries if isinstance(entry, dict)] if isinstance(entries, list) else []

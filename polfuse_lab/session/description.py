"""A session's summary as lines for people."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

_FLAGS = {
    "SWEEP_LOST": "lost samples",
    "SWEEP_OVERFLOW": "overflow told by the sound card",
    "SWEEP_SWITCH_CHANGED": "switches changed",
    "SWEEP_SWITCH_UNVERIFIED": "switches not verified",
    "SWEEP_RETRY": "taken again",
    "SWEEP_REPEATED": "repeated after a pause",
    "SWEEP_MOVED": "trolley moved",
    "SWEEP_CONTINUOUS": "part of a pass",
    "FRAME_MOVED": "frames with a polarizer moving",
    "FRAME_RETRY": "frames taken again",
}

_PAIRS = ("radar-camera", "radar-trolley", "camera-polarizer")
"""Pairs of devices whose times have to agree for the products."""


def describe(name: str, found: Mapping[str, Any]) -> str:
    """What :func:`polfuse_lab.session.info` found (and ``disk``, if it is there), a few lines."""
    whole = "whole" if found["complete"] else "NOT whole"
    lines = [f"{name}: {whole}, {found['state']}" + (f" ({found['reason']})" if found["reason"] else "")]
    what = f"{found['source']}, {found['schema']}"
    if found["started"]:
        what += f", begun {found['started'][:19].replace('T', ' ')} UTC"
    rows = [("what", what)]
    if found["devices"]:
        rows.append(("devices", "; ".join(f"{item['kind']} {item['name']}".strip() for item in found["devices"])))
    rows.append(("radar", _radar(found)))
    if found["frames"]:
        rows.append(("camera", f"{found['frames']} frames"))
    rows += [("time", duration_text(found["duration_s"])), ("lost", _lost(found))]
    if found["flags"]:
        rows.append(
            ("flags", ", ".join(f"{count} {_FLAGS.get(flag, flag.lower())}" for flag, count in found["flags"].items()))
        )
    rows += [("pause", f"{duration_text(gap['seconds'])} at {clock_text(gap['time_s'])}") for gap in found["gaps"]]
    rows += [("clock", text) for text in _clocks(found)]
    if "disk" in found:
        rows.append(("disk", _disk(found["disk"])))
    rows += [(item["kind"], f"{clock_text(item['time_s'])}  {item['text']}") for item in found["notes"]]
    rows += [("problem", problem) for problem in found["problems"]]
    return "\n".join([*lines, *(f"  {head:8} {text}" for head, text in rows)])


def duration_text(seconds: float) -> str:
    """A duration as people say it: ``"850 ms"``, ``"12.3 s"``, ``"4 min 05 s"``, ``"2 h 03 min"``."""
    if abs(seconds) < 1:
        return f"{seconds * 1e3:.0f} ms"
    if abs(seconds) < 99.95:
        return f"{seconds:.1f} s"
    whole = round(seconds)
    if whole < 3600:
        return f"{whole // 60} min {whole % 60:02d} s"
    minutes = round(seconds / 60)
    return f"{minutes // 60} h {minutes % 60:02d} min"


def clock_text(seconds: float) -> str:
    """Time since the first record: ``"0:04:05"``; before it with a minus sign."""
    whole = round(abs(seconds))
    sign = "-" if seconds < 0 and whole else ""
    return f"{sign}{whole // 3600}:{whole // 60 % 60:02d}:{whole % 60:02d}"


def precision_text(seconds: float | None) -> str:
    """An uncertainty of times: ``"35 us"``, ``"1.2 ms"``, ``"unknown"``."""
    if seconds is None:
        return "unknown"
    for unit, scale in (("s", 1.0), ("ms", 1e-3), ("us", 1e-6)):
        if seconds >= scale:
            return f"{seconds / scale:.3g} {unit}"
    return f"{seconds * 1e9:.3g} ns"


def bytes_text(count: float) -> str:
    """A number of bytes, powers of ten: ``"12.3 MB"``."""
    for unit, scale in (("TB", 1e12), ("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if count >= scale:
            return f"{count / scale:.3g} {unit}"
    return f"{count:.0f} bytes"


def _radar(found: Mapping[str, Any]) -> str:
    channels = ", ".join(found["channels"]) or "no channel"
    positions = f"{found['positions']} position" + ("" if found["positions"] == 1 else "s")
    return f"{found['sweeps']} records at {positions}, {channels}"


def _lost(found: Mapping[str, Any]) -> str:
    if not found["samples_lost"] and not found["frames_lost"]:
        return "nothing"
    return f"{found['samples_lost']} audio samples, {found['frames_lost']} camera frames"


def _clocks(found: Mapping[str, Any]) -> list[str]:
    texts = []
    for name, item in found["sync"]["devices"].items():
        if "drift_ppm" in item:
            text = f"{name} {precision_text(item['rms_s'])} against the computer, {item['drift_ppm']:+.1f} ppm, "
            text += f"{item['pairs']} readings"
            if item["rejected"]:
                text += f" ({item['rejected']} left out)"
            texts.append(text)
    pairs = found["sync"]["pairs"]
    known = {name: pairs[name] for name in _PAIRS if pairs.get(name) is not None}
    if known:
        told = (f"{name.replace('-', ' to ')} {precision_text(rms)}" for name, rms in known.items())
        texts.append(f"{', '.join(told)} (1 sigma)")
    return texts or ["no device with a clock of its own: times are the computer's stamps"]


def _disk(disk: Mapping[str, int]) -> str:
    parts = [f"{bytes_text(disk['file'])} file"]
    for name in ("audio", "images"):
        if disk.get(f"{name}_raw"):
            share = disk[name] / disk[f"{name}_raw"]
            parts.append(f"{name} {bytes_text(disk[name])} ({share:.0%} of raw)")
    return f"{', '.join(parts)}; {bytes_text(disk['free'])} free"

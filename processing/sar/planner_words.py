"""What the focusing planner chose and why, in words."""

from __future__ import annotations

from processing.sar.focus_costs import cores, machine_scale
from processing.sar.planner import Choice, Task, fits


def explain(task: Task, choice: Choice, tolerance_db: float) -> list[str]:
    """The choice in words: what it is, what it will cost here, and why nothing else was taken."""
    scale = machine_scale()
    lines = [
        f"{_name(choice)}: {choice.reason}",
        f"expected error {choice.predicted_error_db:.0f} dB, tolerance {tolerance_db:g} dB; precision: "
        f"{choice.precision}",
        f"{task.pixels} pixels, {task.pulses} positions, {task.channels} channels: about "
        f"{_time(choice.seconds * scale)} of core time, {_time(choice.seconds * scale / cores())} on {cores()} cores "
        f"(this core takes {scale:.2g} times as long as the one that the tables are from)",
    ]
    for other in _best_of_each(choice.considered):
        far = not fits(other, tolerance_db)
        why = "not exact enough" if far else f"{other.seconds / max(choice.seconds, 1e-12):.2g} times the time"
        if not far and other.method == "ffbp" and other.seconds < choice.seconds:
            why = "pays for larger images and apertures only"
        lines.append(
            f"not {_name(other)}: {why} ({other.predicted_error_db:.0f} dB, {_time(other.seconds * scale)} of core "
            "time expected)"
        )
    return lines


def _best_of_each(others: tuple[Choice, ...]) -> list[Choice]:
    """Of every method and interpolator the cheapest entry, in order of time."""
    found: dict[tuple[str, str], Choice] = {}
    for other in others:
        found.setdefault((other.method, other.interpolator), other)
    return list(found.values())


def _name(choice: Choice) -> str:
    bins = f"{choice.oversampling:g} bins per cell"
    words = {
        "bp": f"back-projection with {choice.interpolator} interpolation at {bins}",
        "ffbp": f"factorized back-projection at {bins}",
        "rma": f"range migration at {bins}",
        "pfa": f"polar format at {bins}",
        "reference": f"plain float64 back-projection with {choice.interpolator} interpolation at {bins}",
    }
    return words[choice.method]


def _time(seconds: float) -> str:
    return f"{seconds * 1e3:.2g} ms" if seconds < 1 else f"{seconds:.2g} s" if seconds < 600 else f"{seconds:.0f} s"

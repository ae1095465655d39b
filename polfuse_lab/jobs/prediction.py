"""What focusing will cost and how exact it will be, before it begins: for a slider between speed and accuracy."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from polfuse_lab.errors import PolfuseError
from polfuse_lab.session import Session, open_session

READING_NS = 350.0
"""Reading one audio frame and finding its sweep, on the core that the planner's tables were measured on."""


@dataclass(frozen=True)
class Prediction:
    """The way that will be taken."""

    seconds: float
    """Expected time on this computer, s, without starting the job."""
    error_db: float
    """Expected error of the method, dB below the image."""
    method: str
    """``"rma"``, ``"pfa"``, ``"bp"``, ``"ffbp"`` or ``"reference"``."""
    why: tuple[str, ...]
    """The choice in words: what, why, and what else there was."""
    interpolator: str
    oversampling: float
    pixels: int
    pulses: int
    channels: int
    within_tolerance: bool
    """Whether the expected error is within the tolerance."""


def predict_focus(
    session: Session | Path | str,
    tolerance_db: float = -50.0,
    *,
    method: str = "auto",
    x_m: tuple[float, float] | None = None,
    y_m: tuple[float, float] | None = None,
    pixel_m: tuple[float, float] | None = None,
    window: str | None = None,
    oversampling: int | None = None,
    compensate_pattern: bool = True,
) -> Prediction:
    """What ``polfuse focus`` with the same options will do. Takes some milliseconds; nothing is focused.

    Args:
        session: an open session, or its path.
        tolerance_db: largest error of the method, dB below the image.
        method: as in :func:`polfuse_lab.products.focus.focus`.
        x_m: extent of the image along the rail.
        y_m: extent away from it.
        pixel_m: size of a pixel.
        window: over the ramp.
        oversampling: range bins per resolution cell; the planner's choice where left out.
        compensate_pattern: whether the antennas' pattern is divided out.

    Raises:
        PolfuseError: the session cannot be focused.
        DataError: wrong method or tolerance.
    """
    from processing.sar.focus_costs import cores, machine_scale
    from processing.sar.planner import choose
    from processing.sar.planner_words import explain

    if not isinstance(session, Session):
        with open_session(session) as opened:
            return predict_focus(
                opened,
                tolerance_db,
                method=method,
                x_m=x_m,
                y_m=y_m,
                pixel_m=pixel_m,
                window=window,
                oversampling=oversampling,
                compensate_pattern=compensate_pattern,
            )
    from polfuse_lab.products.focus import default_grid
    from polfuse_lab.products.focus_history import holds_history
    from polfuse_lab.products.focus_parts import furthest_m
    from polfuse_lab.products.focus_plan import task_before

    if holds_history(session):
        raise PolfuseError(
            "holds a phase history, whose cost is not told beforehand",
            where=str(session.path),
            advice="focus it without a prediction",
        )
    grid = default_grid(session, x_m=x_m, y_m=y_m, step_m=pixel_m)
    task = task_before(session, grid, window or "hann", compensate_pattern, furthest_m(session, grid))
    if oversampling is not None:
        task = replace(task, oversampling=oversampling)
    choice = choose(task, tolerance_db, method)
    # One core reads the records, all of them form the image.
    reading_s = 1e-9 * READING_NS * float(session.sweeps["samples"].sum())
    return Prediction(
        seconds=(choice.seconds / cores() + reading_s) * machine_scale(),
        error_db=choice.predicted_error_db,
        method=choice.method,
        why=tuple(explain(task, choice, tolerance_db)),
        interpolator=choice.interpolator,
        oversampling=choice.oversampling,
        pixels=task.pixels,
        pulses=task.pulses,
        channels=task.channels,
        within_tolerance=choice.predicted_error_db <= tolerance_db,
    )

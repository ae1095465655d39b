"""From a session to a complex image of every channel: stages "ranging" and "focus"."""

from __future__ import annotations

import contextlib
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from polfuse_lab.errors import PolfuseError
from polfuse_lab.products.focus_history import focus_history, holds_history, read_history, scene_grid
from polfuse_lab.products.focus_rail import focus_rail
from polfuse_lab.products.focus_result import FocusResult
from polfuse_lab.products.rail_options import RailOptions
from polfuse_lab.session import Session, open_session
from processing.sar.grid import Grid, ImageGrid
from processing.sar.resolution import point_resolution

if TYPE_CHECKING:
    from polfuse_lab.scale.focus_tiles import Scale

DEFAULT_X_M = (-8.0, 8.0)
DEFAULT_Y_M = (3.0, 20.0)
MOST_PIXELS = 10_000_000_000
"""Pixels of an image, at most: beyond is a slip of the pen."""
PIXELS_PER_CELL = 4
"""Pixels in the narrowest -3 dB width of the grid, at least."""


def default_grid(
    session: Session,
    *,
    x_m: tuple[float, float] | None = None,
    y_m: tuple[float, float] | None = None,
    step_m: tuple[float, float] | None = None,
) -> ImageGrid:
    """A grid on the ground with a quarter of the narrowest resolution cell, or ``step_m`` (x, y), from pixel to pixel.

    The cell is narrowest in the middle of the nearest row, where the aperture is seen under the widest angle. Extents
    that are left out are ``DEFAULT_X_M`` and ``DEFAULT_Y_M``; for a phase history, see
    :func:`polfuse_lab.products.focus_history.scene_grid`.

    Raises:
        PolfuseError: the session has no rig, or the extents are empty or not in front of the rail.
    """
    if holds_history(session):
        return scene_grid(read_history(session), x_m=x_m, y_m=y_m, step_m=step_m)
    x_m, y_m = DEFAULT_X_M if x_m is None else x_m, DEFAULT_Y_M if y_m is None else y_m
    rig = session.rig
    if rig is None:
        raise PolfuseError(
            "has no rig file, so nothing is known of heights and the rail",
            where=str(session.path),
            advice="focus a session that was collected along a rail",
        )
    if not (x_m[0] < x_m[1] and 0 < y_m[0] < y_m[1]):
        raise PolfuseError(
            f"x from {x_m[0]:g} to {x_m[1]:g} m and y from {y_m[0]:g} to {y_m[1]:g} m are no image ahead of the rail",
            where="image grid",
            advice="give increasing extents with y above 0",
        )
    z = -rig.geometry.antenna_height_m
    if step_m is None:
        step_m = _steps(session, (0.5 * (x_m[0] + x_m[1]), y_m[0], z))
    if not all(np.isfinite(step) and step > 0 for step in step_m):
        raise PolfuseError(
            f"pixels of {step_m[0]:g} x {step_m[1]:g} m", where="image grid", advice="give positive sizes"
        )
    counts = [math.floor((b - a) / step + 1e-9) + 1 for (a, b), step in zip((x_m, y_m), step_m, strict=True)]
    if counts[0] * counts[1] > MOST_PIXELS:
        raise PolfuseError(
            f"{counts[0]} x {counts[1]} pixels are more than {MOST_PIXELS:.0e}",
            where="image grid",
            advice="give larger pixels",
        )
    x, y = (
        a + step * np.arange(n, dtype=np.float64) for a, step, n in zip((x_m[0], y_m[0]), step_m, counts, strict=True)
    )
    return ImageGrid(x, y, z)


def _steps(session: Session, nearest: tuple[float, float, float]) -> tuple[float, float]:
    x = np.unique(np.asarray(session.sweeps["x_m"], dtype=np.float64))
    antenna = np.column_stack([x, np.zeros(len(x)), np.zeros(len(x))])
    waveform = session.waveform
    cell = point_resolution(
        antenna, (float(np.median(x)), *nearest[1:]), centre_hz=waveform.centre_hz, bandwidth_hz=waveform.bandwidth_hz
    )
    cells = min(cell.x_m, 1.0), min(cell.y_m, waveform.range_resolution_m)
    return _round_down(cells[0] / PIXELS_PER_CELL), _round_down(cells[1] / PIXELS_PER_CELL)


def _round_down(step: float) -> float:
    """To 1, 2, 2.5 or 5 times a power of ten, so that pixels stand at plain numbers."""
    power = 10.0 ** math.floor(math.log10(step))
    return power * max(factor for factor in (1.0, 2.0, 2.5, 5.0) if factor * power <= step * (1 + 1e-9))


def focus(
    session: Session | Path | str,
    products_path: Path | str,
    *,
    method: str = "auto",
    tolerance_db: float = -50.0,
    grid: Grid | None = None,
    window: str | None = None,
    aperture: str | None = None,
    oversampling: int | None = None,
    compensate_pattern: bool = True,
    sky: Path | str | None = None,
    peaks: int = 10,
    target: str | None = None,
    autofocus: str | None = None,
    scale: Scale | None = None,
) -> FocusResult:
    """Focus a session and write stages "ranging" and "focus" of a products file.

    A session that holds a phase history is focused by :func:`polfuse_lab.products.focus_history.focus_history`. Where
    the pattern is compensated, pixels outside the antennas' half-power beam are NaN; ``flags`` tells why.

    Args:
        session: an open session, or its path.
        products_path: file to write to; other stages in it are kept.
        method: ``"auto"``, ``"rma"``, ``"pfa"``, ``"bp"``, ``"ffbp"`` or ``"reference"``, see
            :mod:`processing.sar.planner`.
        tolerance_db: largest error of the method, dB below the image.
        grid: where to form the image; :func:`default_grid` where left out. Heights and polar grids
            (:mod:`polfuse_lab.products.focus_grids`) are focused by back-projection, in one piece; polar images are
            stage "focus_polar".
        window: over the ramp: ``"hann"`` (where left out), ``"taylor"`` or ``"rectangular"``; of a phase history
            ``"taylor"`` where left out.
        aperture: window along the aperture, same names; ``"rectangular"`` where left out, of a phase history
            ``"taylor"``.
        oversampling: range bins per resolution cell; the planner's choice where left out, of a phase history 4.
        compensate_pattern: whether to divide by the antennas' two-way pattern (the rig file's beam width and angle).
        sky: session of the clear sky, whose mean profile (coupling between the antennas) is taken off.
        peaks: how many of the strongest peaks to report.
        target: in a calibration series, the name of the target whose records are focused.
        autofocus: ``"auto"``, ``"phase-gradient"``, ``"minimum-entropy"`` or ``"track"``: correct errors along the
            aperture where that does good, see :mod:`processing.sar.autofocus`; no autofocus where left out.
        scale: form the image in tiles, within a limit of memory or on several processes
            (:func:`polfuse_lab.scale.focus_tiles.focus_in_tiles`); where left out, where memory is short.

    Raises:
        PolfuseError: the session cannot be focused (no rig, one position, nothing usable), or files fail.
        DataError: wrong method, window or tolerance, or range migration on an uneven rail.
    """
    with contextlib.ExitStack() as stack:
        if not isinstance(session, Session):
            session = stack.enter_context(open_session(session))
        if not holds_history(session):
            window, aperture = window or "hann", aperture or "rectangular"
            asked = RailOptions(
                method, tolerance_db, window, aperture, oversampling, compensate_pattern, sky, peaks, target, autofocus
            )
            return focus_rail(session, products_path, default_grid(session) if grid is None else grid, asked, scale)
        plane = _plane_of_history(session, grid, sky=sky, target=target, autofocus=autofocus, scale=scale)
        given = {"window": window, "aperture": aperture, "oversampling": oversampling}
        chosen: dict[str, Any] = {name: value for name, value in given.items() if value is not None}
        return focus_history(
            session, products_path, method=method, tolerance_db=tolerance_db, grid=plane, peaks=peaks, **chosen
        )


def _plane_of_history(session: Session, grid: Grid | None, **options: object) -> ImageGrid | None:
    """The grid, which a phase history wants to be plane. Raises :class:`PolfuseError` for what does not go with one."""
    advice = {
        "scale": ("is focused in one piece", "leave limits of memory, tiles and --dask out"),
        "sky": ("has no sky session", "leave the sky out"),
        "target": ("has no calibration targets", "leave the target out"),
        "autofocus": ("is focused with the places that its import told", "leave --autofocus out"),
    }
    for name, (why, what) in advice.items():
        if options[name] is not None:
            raise PolfuseError(f"holds a phase history, which {why}", where=str(session.path), advice=what)
    if grid is None or isinstance(grid, ImageGrid):
        return grid
    raise PolfuseError(
        "holds a phase history, which is focused onto a plane",
        where=str(session.path),
        advice="leave polar grids and heights out",
    )

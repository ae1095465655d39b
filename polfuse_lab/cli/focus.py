"""``polfuse focus``: a session's sweeps to range profiles and a complex image of every channel."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from polfuse_lab.cli.output import Debug, Json, counted, guarded, progress, result

METHODS = ("auto", "rma", "pfa", "bp", "ffbp", "reference")
WINDOWS = ("hann", "taylor", "rectangular")
AUTOFOCUS_METHODS = ("auto", "phase-gradient", "minimum-entropy", "track")


@guarded
def focus(
    sessions: Annotated[list[Path], typer.Argument(help="Session collected along a rail, or several.")],
    output: Annotated[
        Path,
        typer.Option(
            "--output", "-o", help="Products file; other stages in it are kept. With several sessions a folder."
        ),
    ],
    method: Annotated[
        str,
        typer.Option(
            help="auto, rma (range migration), pfa (polar format), bp (back-projection), ffbp (factorized) or "
            "reference (plain float64)."
        ),
    ] = "auto",
    tolerance_db: Annotated[float, typer.Option(help="Largest error of the method, dB below the image.")] = -50.0,
    tolerance: Annotated[
        str | None, typer.Option(help="The same by name: preview (-30 dB), field (-50 dB), paper (-80 dB).")
    ] = None,
    window: Annotated[
        str | None,
        typer.Option(help="Over the ramp: hann, taylor or rectangular; default hann (phase histories: taylor)."),
    ] = None,
    aperture: Annotated[
        str | None,
        typer.Option(help="Along the rail: rectangular (default; phase histories: taylor), hann or taylor."),
    ] = None,
    oversampling: Annotated[
        int | None,
        typer.Option(
            min=2, max=64, help="Range bins per resolution cell; chosen by the tolerance (phase histories: 4)."
        ),
    ] = None,
    x: Annotated[
        str | None,
        typer.Option("--x", help="Extent along the rail, m: FROM,TO; -8,8 (phase histories: what is unambiguous)."),
    ] = None,
    y: Annotated[
        str | None, typer.Option("--y", help="Extent away from the rail on the ground, m: FROM,TO; 3,20 (the same).")
    ] = None,
    pixel: Annotated[str | None, typer.Option(help="Pixel size, m: X,Y; default a quarter of the finest cell.")] = None,
    grid_kind: Annotated[
        str,
        typer.Option(
            "--grid",
            help="plane, or polar: ranges and angles around the rail's centre (--pixel: degrees,m; stage focus_polar).",
        ),
    ] = "plane",
    heights: Annotated[
        Path | None,
        typer.Option(help="Map of the ground's heights (table with commas, or .npz): the image's x, y and z."),
    ] = None,
    pattern: Annotated[bool, typer.Option(help="Compensate the antennas' pattern.")] = True,
    sky: Annotated[
        Path | None, typer.Option(help="Session of the clear sky: takes the antennas' coupling off.")
    ] = None,
    target: Annotated[
        str | None, typer.Option(help="In a calibration series: the target whose records are focused.")
    ] = None,
    autofocus: Annotated[
        bool, typer.Option("--autofocus", help="Correct errors along the aperture, where that does good.")
    ] = False,
    autofocus_method: Annotated[
        str, typer.Option(help="auto, phase-gradient, minimum-entropy or track (a trolley's place); with --autofocus.")
    ] = "auto",
    explain: Annotated[bool, typer.Option("--explain", help="Tell why this method, and what else there was.")] = False,
    memory: Annotated[
        str | None, typer.Option(help="Limit of memory, such as 500MB: the image is formed in tiles that fit.")
    ] = None,
    tile: Annotated[int | None, typer.Option(min=16, help="Rows and columns of a tile, instead of what fits.")] = None,
    dask: Annotated[
        str | None,
        typer.Option(help="Address of a Dask scheduler, or 'local': tiles (or whole sessions) on its workers."),
    ] = None,
    figure: Annotated[Path | None, typer.Option(help="Picture to draw; others are drawn beside it.")] = None,
    json_: Json = False,
    debug: Debug = False,
) -> None:
    """Focus a session: range profiles, then a complex image of every channel on the ground.

    Method, interpolator and oversampling are the cheapest whose expected error stays within the tolerance.

    Example: polfuse focus run.h5 -o products.h5 --tolerance-db -60 --autofocus --explain
    """
    _one_of(method, METHODS, "--method")
    _one_of(autofocus_method, AUTOFOCUS_METHODS, "--autofocus-method")
    if autofocus_method != "auto" and not autofocus:
        raise typer.BadParameter("takes effect with --autofocus only", param_hint="--autofocus-method")
    for value, option in ((window, "--window"), (aperture, "--aperture")):
        if value is not None:
            _one_of(value, WINDOWS, option)
    if tolerance is not None:
        from polfuse_lab.tolerances import as_db

        tolerance_db = as_db(tolerance, "focus")
    if not tolerance_db < 0:
        raise typer.BadParameter("an error below the image is a negative number of dB", param_hint="--tolerance-db")
    extents = None if x is None else _pair(x, "--x"), None if y is None else _pair(y, "--y")
    step = None if pixel is None else _pair(pixel, "--pixel")
    _one_of(grid_kind, ("plane", "polar"), "--grid")
    if heights is not None and (grid_kind == "polar" or extents != (None, None) or step is not None):
        raise typer.BadParameter("tells the places of all pixels itself", param_hint="--heights")

    if len(sessions) > 1:
        if figure is not None or target is not None:
            raise typer.BadParameter("takes one session", param_hint="--figure" if figure is not None else "--target")
        if heights is not None or grid_kind != "plane":
            raise typer.BadParameter("takes one session", param_hint="--grid" if heights is None else "--heights")
        from polfuse_lab.cli.focus_many import focus_many

        options = {
            "method": method, "tolerance_db": tolerance_db, "window": window, "aperture": aperture,
            "oversampling": oversampling, "compensate_pattern": pattern, "sky": sky and sky.resolve(),
            "x_m": extents[0], "y_m": extents[1], "step_m": step, "autofocus": autofocus_method if autofocus else None,
        }  # fmt: skip
        focus_many(sessions, output, options, memory=memory, tile=tile, dask=dask, as_json=json_)
        return
    (session,) = sessions

    from polfuse_lab.products import focus as stage
    from polfuse_lab.products import focus_grids as grids
    from polfuse_lab.scale.spread import spread
    from polfuse_lab.session import open_session

    with (
        open_session(session) as opened,
        spread(memory=memory, tile=tile, dask=dask, listener=counted) as spreading,
    ):
        grid: Any
        if heights is not None:
            grid = grids.read_heights(heights)
        elif grid_kind == "polar":
            grid = grids.polar_grid(opened, x_m=extents[0], y_m=extents[1], step=step)
        else:
            grid = stage.default_grid(opened, x_m=extents[0], y_m=extents[1], step_m=step)
        progress(f"focusing {session}: {grid.shape[1]} x {grid.shape[0]} pixels")
        made = stage.focus(
            opened,
            output,
            method=method,
            tolerance_db=tolerance_db,
            grid=grid,
            window=window,
            aperture=aperture,
            oversampling=oversampling,
            compensate_pattern=pattern,
            sky=sky,
            target=target,
            autofocus=autofocus_method if autofocus else None,
            scale=spreading.scale,
        )
    for warning in made.warnings:
        progress(f"note: {warning}")
    drawn: list[Path] = []
    if figure is not None and grid_kind == "polar":
        progress("note: figures show images in x and y; of a polar image none is drawn")
    elif figure is not None:
        from polfuse_lab.products.figures_sar import draw_all
        from polfuse_lab.products.store import Products

        drawn = draw_all(Products(output), figure)
    peaks = [{"x_m": peak.x_m, "y_m": peak.y_m, "dB": peak.level_db} for peak in made.peaks]
    values = {
        "products": made.products,
        "method": made.choice.method,
        "settings": made.settings,
        "predicted_error_db": made.choice.predicted_error_db,
        "pixels": made.pixels,
        "pulses": made.pulses,
        "seconds": made.seconds,
        "peaks": peaks,
        "figures": drawn,
        "explanation": list(made.explanation),
        "autofocus": made.settings.get("autofocus"),
    }
    lines = [
        f"{made.choice.method} ({made.choice.interpolator}), {made.choice.reason}; "
        f"expected error {made.choice.predicted_error_db:.0f} dB",
        *(made.explanation if explain else ()),
        *_autofocused(made.settings.get("autofocus")),
        f"{len(made.channels)} channels, {made.pulses} positions, {made.pixels} pixels in {made.seconds:.1f} s",
        *(f"peak at x = {p['x_m']:+.2f} m, y = {p['y_m']:.2f} m: {p['dB']:.1f} dB" for p in peaks),
        f"products: {made.products}",
        *(f"figure:   {path}" for path in drawn),
    ]
    result(values, as_json=json_, text="\n".join(lines))


def _autofocused(told: dict[str, Any] | None) -> list[str]:
    """What autofocus did, in words; nothing where it was not asked for or refused (a note tells that)."""
    if told is None or not told["applied"]:
        return []
    return [f"autofocus ({told['method']}): corrected {told['error_rad']:.2f} rad rms, {told['reason']}"]


def _one_of(value: str, allowed: tuple[str, ...], option: str) -> None:
    if value not in allowed:
        raise typer.BadParameter(f"{value!r} is not one of {', '.join(allowed)}", param_hint=option)


def _pair(text: str, option: str) -> tuple[float, float]:
    try:
        first, second = (float(part) for part in text.split(","))
    except ValueError:
        raise typer.BadParameter(f"{text!r} is not two numbers with a comma", param_hint=option) from None
    return first, second

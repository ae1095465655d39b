"""``polfuse motion``: moving targets in a radar's picture, and their traces in a polarizer series."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from polfuse_lab.cli.output import Debug, Json, guarded, result

if TYPE_CHECKING:
    from polfuse_lab.products.motion import MotionResult


@guarded
def motion(
    source: Annotated[
        Path,
        typer.Argument(
            help="Phase history (.npz) of a platform that passes, simulated scene, or session with a polarizer series."
        ),
    ],
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="Products file to write to; of a session SOURCE-products.h5 by default."),
    ] = None,
    figure: Annotated[Path | None, typer.Option(help="Picture to draw; beside the source by default.")] = None,
    velocity: Annotated[
        tuple[float, float] | None,
        typer.Option(help="Session: the object's velocity over the ground, vx vy in m/s; else the pictures tell."),
    ] = None,
    height_m: Annotated[float, typer.Option(help="Session: height of the object's surface above ground, m.")] = 0.0,
    x: Annotated[tuple[float, float] | None, typer.Option(help="History: first and last x of the picture, m.")] = None,
    y: Annotated[tuple[float, float] | None, typer.Option(help="History: first and last y of the picture, m.")] = None,
    false_alarm: Annotated[
        float, typer.Option(min=1e-6, max=0.4, help="History: chance that a tile of speckle shows a streak.")
    ] = 1e-3,
    example: Annotated[bool, typer.Option("--example", help="Simulate a phase history into SOURCE first.")] = False,
    json_: Json = False,
    debug: Debug = False,
) -> None:
    """Find moving targets and their velocities, or take their traces out of a polarizer series.

    A phase history holds echoes, first_hz, step_hz, antenna_m, reference_m, time_s, beamwidth_rad and z_m. Of a
    simulated scene in which something moves, the products file holds it.

    Example: polfuse motion flight.npz --example
    """
    from polfuse_lab.products.store import is_products

    if is_products(source):
        values, lines = _simulated(source, figure, velocity, height_m, x, y, false_alarm)
    elif source.suffix == ".npz":
        values, lines = _history(source, output, figure, x, y, false_alarm, example=example)
    else:
        values, lines = _session(source, output, figure, velocity, height_m)
    result(values, as_json=json_, text="\n".join(lines))


def _history(
    source: Path,
    output: Path | None,
    figure: Path | None,
    x: tuple[float, float] | None,
    y: tuple[float, float] | None,
    false_alarm: float,
    *,
    example: bool,
) -> tuple[dict[str, Any], list[str]]:
    from dataclasses import asdict

    from polfuse_lab.products import style
    from polfuse_lab.products.figures_motion import targets_figure
    from polfuse_lab.products.motion_history import moving_targets, write_example, write_targets

    if example:
        write_example(source)
    made = moving_targets(source, x_m=x, y_m=y, false_alarm=false_alarm)
    drawn = style.save(targets_figure(made, source.stem), figure or source.with_name(f"{source.stem}_motion.png"))
    if output is not None:
        write_targets(made, output, source)
    targets = made.targets()
    limits = asdict(made.ambiguities)
    values = {
        "targets": targets,
        "rejected": [item.reason for item in made.found.rejected],
        "tiles": made.found.tiles,
        "false_alarms_expected": made.found.tiles * false_alarm,
        "ambiguities": limits,
        "figure": drawn,
    }
    lines = [
        f"{len(targets)} moving, {len(made.found.rejected)} streaks rejected, {made.found.tiles} tiles "
        f"({made.found.tiles * false_alarm:.2f} false alarms expected of speckle)"
    ]
    lines += [
        f"target {number}: x {t['x_m']:.0f} m, y {t['y_m']:.0f} m, along {t['azimuth_m_s']:+.2f} +- "
        f"{t['azimuth_sd_m_s']:.2g} m/s, across {t['ground_m_s']:+.2f} +- {t['ground_sd_m_s']:.2g} m/s"
        for number, t in enumerate(targets, start=1)
    ]
    lines.append(
        f"range rates are unambiguous to {limits['unambiguous_m_s']:.1f} m/s, among the ground's echoes below "
        f"{limits['clutter_m_s']:.1f} m/s; 1 m/s^2 in range looks like "
        f"{limits['azimuth_per_acceleration_s']:.0f} m/s along the track"
    )
    return values, [*lines, f"figure: {drawn}"]


def _simulated(
    source: Path,
    figure: Path | None,
    velocity: tuple[float, float] | None,
    height_m: float,
    x: tuple[float, float] | None,
    y: tuple[float, float] | None,
    false_alarm: float,
) -> tuple[dict[str, Any], list[str]]:
    """What moves in the radar's echoes; and by its velocity, exposures that the camera took in turn, corrected."""
    from polfuse_lab.products.motion import correct_simulated
    from polfuse_lab.products.store import Products

    values, lines = _history(source, source, figure, x, y, false_alarm, example=False)
    if "exposures" not in Products(source).stages():
        return values, lines
    targets = values["targets"]
    told = velocity
    if told is None and targets:
        told = targets[0]["azimuth_m_s"], targets[0]["ground_m_s"]
    made = correct_simulated(source, velocity_m_s=told, height_m=height_m)
    drawn = figure or source.with_name(f"{source.stem}_motion.png")
    corrected, more = _told(made, drawn.with_name(f"{drawn.stem}_exposures{drawn.suffix}"))
    if velocity is None and targets:
        corrected["velocity_from"] = "radar"
        more[0] = more[0].replace("(given)", "(the radar's velocity)")
    return {**corrected, **values, "figures": [values["figure"], corrected["figure"]]}, [*lines, *more]


def _session(
    source: Path, output: Path | None, figure: Path | None, velocity: tuple[float, float] | None, height_m: float
) -> tuple[dict[str, Any], list[str]]:
    from polfuse_lab.products.motion import correct_exposures

    products = output or source.with_name(f"{source.stem}-products.h5")
    made = correct_exposures(source, products, velocity_m_s=velocity, height_m=height_m)
    return _told(made, figure or source.with_name(f"{source.stem}_motion.png"))


def _told(made: MotionResult, figure: Path) -> tuple[dict[str, Any], list[str]]:
    """What became of the exposures, with their figure drawn."""
    from polfuse_lab.products import style
    from polfuse_lab.products.figures_motion import exposures_figure

    drawn = style.save(exposures_figure(made), figure)
    values = {
        "velocity_from": made.velocity_from,
        "displacement_px": made.displacement_px.tolist(),
        "time_s": made.time_s.tolist(),
        "object_pixels": int(made.object_mask.sum()),
        "undefined_pixels": made.undefined,
        "error_down_db": made.error_down_db,
        "dolp_median": made.after.dolp_median,
        "figure": drawn,
        "products": made.products,
    }
    down, right = made.displacement_px[-1]
    lines = [
        f"an object of {values['object_pixels']} pixels moved by {right:+.1f} px to the right and {down:+.1f} px down "
        f"in {made.time_s[-1]:.2f} s ({made.velocity_from})",
        f"error image {made.error_down_db:.1f} dB down; {made.undefined} pixels undefined (hidden too often)",
        f"figure:   {drawn}",
        f"products: {made.products}",
    ]
    return values, lines

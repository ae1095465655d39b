"""What the calibrate command is given as text: places, targets and regions; and how a judged target is told."""

from __future__ import annotations

from math import radians
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from polfuse_lab.products.calibrate import Region, TargetSpec
    from polfuse_lab.products.calibration_targets import TargetView

KINDS = ("trihedral", "trihedral_triangular", "plate", "sphere", "dihedral", "dihedral_45")
"""Targets that may be stated in one word; a dihedral's fold stands upright, or at 45 degrees."""


def numbers(text: str, option: str, form: str) -> tuple[float, ...]:
    """Numbers separated by commas, as many as ``form`` names.

    Raises:
        typer.BadParameter: too few, too many, or no numbers.
    """
    try:
        found = tuple(float(part) for part in text.split(","))
    except ValueError:
        found = ()
    if len(found) != len(form.split(",")):
        raise typer.BadParameter(f"{text!r} is not {form}, {len(form.split(','))} numbers in metres", param_hint=option)
    return found


def place(text: str, option: str) -> tuple[float, float]:
    """X,Y in metres. Raises :class:`typer.BadParameter`."""
    x, y = numbers(text, option, "X,Y")
    return x, y


def region(text: str, method: str) -> Region:
    """X0,X1,Y0,Y1 in metres. Raises :class:`typer.BadParameter`."""
    from polfuse_lab.products.calibrate import Region

    x0, x1, y0, y1 = numbers(text, "--clutter", "X0,X1,Y0,Y1")
    if not (x0 < x1 and y0 < y1):
        raise typer.BadParameter(f"{text!r} is empty: X0 is below X1 and Y0 below Y1", param_hint="--clutter")
    return Region((x0, x1), (y0, y1), "ainsworth" if method == "ainsworth" else "quegan")


def spec(
    kind: str,
    at: tuple[float, float],
    edge_m: float,
    *,
    azimuth_deg: float | None = None,
    elevation_deg: float | None = None,
    fold_deg: float | None = None,
    height_m: float = 0.0,
    angle_sd_deg: float = 0.0,
    position_sd_m: float = 0.0,
    edge_sd_m: float = 0.0,
    name: str = "",
) -> TargetSpec:
    """A stated target; angles left out are those of its axis. Raises :class:`DataError` for impossible numbers."""
    from polfuse_lab.products.calibrate import TargetSpec
    from processing.calibration.rcs import TRIHEDRAL_AXIS_ELEVATION_RAD

    corner = kind.startswith("trihedral")
    folds = {"dihedral_45": 45.0, "dihedral": 90.0}
    axis = TRIHEDRAL_AXIS_ELEVATION_RAD if corner else 0.0
    return TargetSpec(
        kind="dihedral" if kind in folds else kind,
        x_m=at[0],
        y_m=at[1],
        edge_m=edge_m,
        azimuth_rad=radians(45.0 if corner else 0.0) if azimuth_deg is None else radians(azimuth_deg),
        elevation_rad=axis if elevation_deg is None else radians(elevation_deg),
        fold_rad=radians(folds.get(kind, 0.0) if fold_deg is None else fold_deg),
        height_m=height_m,
        angle_sd_rad=radians(angle_sd_deg),
        position_sd_m=position_sd_m,
        edge_sd_m=edge_sd_m,
        name=name,
    )


def further(text: str, edge_m: float, height_m: float, angle_sd_deg: float) -> TargetSpec:
    """A further target in the image, ``KIND@X,Y[@EDGE[@HEIGHT]]``. Raises :class:`typer.BadParameter`."""
    kind, _, rest = text.partition("@")
    where, _, rest = rest.partition("@")
    edge, _, height = rest.partition("@")
    if kind not in KINDS:
        raise typer.BadParameter(f"{kind!r} is none of {', '.join(KINDS)}", param_hint="--also")
    try:
        size = float(edge) if edge else edge_m
    except ValueError:
        raise typer.BadParameter(f"the edge {edge!r} is not a number in metres", param_hint="--also") from None
    try:
        high = float(height) if height else height_m
    except ValueError:
        raise typer.BadParameter(f"the height {height!r} is not a number in metres", param_hint="--also") from None
    return spec(kind, place(where, "--also"), size, height_m=high, angle_sd_deg=angle_sd_deg, name=kind)


def told(view: TargetView) -> str:
    """One line on a target that was looked at."""
    name = view.spec.label
    if not view.verdict.ok:
        return f"{name}: REFUSED: {view.verdict.reason}; {view.verdict.advice}"
    repeats = f", mean of {view.repeats} (+- {view.amplitude_sd_db:.2f} dB)" if view.repeats > 1 else ""
    return f"{name}: found at ({view.x_m:.2f}, {view.y_m:.2f}) m, {view.snr_db:.1f} dB above the background{repeats}"

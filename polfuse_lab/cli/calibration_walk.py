"""Walking a user through the calibration targets of an image, one after the other."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from polfuse_lab.cli.calibration_options import place, spec, told
from polfuse_lab.cli.output import progress

if TYPE_CHECKING:
    from polfuse_lab.products.calibrate import TargetSpec

STEPS = (
    ("trihedral", "Step 1 of 3: a trihedral with square faces (or a plate). It gives the constant and VV over HH."),
    ("dihedral", "Step 2 of 3: a dihedral with its fold upright. With step 3 it gives the crosstalk."),
    ("dihedral_45", "Step 3 of 3: a dihedral with its fold at 45 degrees. It shows the cross-polarized channels."),
)


def walk(products: Path, *, radius_m: float, min_snr_db: float) -> list[TargetSpec]:
    """Ask for each target, look for it at once, and say why it is refused where it is.

    Args:
        products: products file with a focused image.
        radius_m: how far from its stated place a peak may be, m.
        min_snr_db: least peak over background, dB.

    Returns:
        Targets that were found good, the one for the constant first.

    Raises:
        PolfuseError: the file has no focused image.
        typer.Abort: the input ended.
    """
    from polfuse_lab.products.calibration_inputs import read_focused
    from polfuse_lab.products.calibration_targets import look_in_image
    from polfuse_lab.products.store import Products

    focused = read_focused(Products(products))
    found: list[TargetSpec] = []
    edge_m, sd_deg = 0.61, 2.0
    for kind, words in STEPS:
        progress(words)
        while True:
            if kind == "trihedral":
                kind = _ask("  kind (trihedral, plate)", kind, ("trihedral", "plate"))
            if kind != "trihedral" and found and _ask("  is it in the image? (yes, no)", "yes", ("yes", "no")) == "no":
                break
            at = _place()
            edge_m = _number("  edge of its faces, m", edge_m)
            height_m = _number("  height of its apex (middle of fold or face) above the ground, m", 0.0)
            angles = {}
            if found == []:
                axis = (45.0, 35.264) if kind == "trihedral" else (0.0, 0.0)
                angles["azimuth_deg"] = _number("  azimuth of the radar in its frame, degrees", axis[0])
                angles["elevation_deg"] = _number("  elevation likewise, degrees", axis[1])
            sd_deg = _number("  standard deviation of its angles, degrees", sd_deg)
            stated = spec(kind, at, edge_m, height_m=height_m, angle_sd_deg=sd_deg, name=kind, **angles)
            view = look_in_image(focused, stated, radius_m=radius_m, min_snr_db=min_snr_db)
            progress("  " + told(view))
            if view.verdict.ok:
                found.append(stated)
                break
            if _ask("  state it again? (yes, no)", "yes", ("yes", "no")) == "no":
                if not found:
                    raise typer.Exit(1)
                break
    return found


def _ask(question: str, default: str, allowed: tuple[str, ...]) -> str:
    while True:
        answer = str(typer.prompt(question, default=default, err=True)).strip().lower()
        if answer in allowed:
            return answer
        progress(f"  {answer!r} is none of {', '.join(allowed)}")


def _number(question: str, default: float) -> float:
    return float(typer.prompt(question, default=default, type=float, err=True))


def _place() -> tuple[float, float]:
    while True:
        try:
            return place(str(typer.prompt("  its place X,Y: x along the rail, ground range y, m", err=True)), "place")
        except typer.BadParameter as error:
            progress(f"  {error.message}")

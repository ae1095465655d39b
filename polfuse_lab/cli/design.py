"""``polfuse design``: the figures of a rig before it is built."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from polfuse_lab.cli.output import Debug, Json, guarded, result

if TYPE_CHECKING:
    from polfuse_lab.design import DesignValue


@guarded
def design(
    rig: Annotated[
        Path | None, typer.Argument(metavar="[RIG.toml]", help="Rig file; the thesis's rail rig, if left out.")
    ] = None,
    at: Annotated[float, typer.Option(help="Ground range at which figures are told, m.")] = 10.0,
    aperture: Annotated[float | None, typer.Option(help="Synthetic aperture, m; the whole rail, if left out.")] = None,
    step: Annotated[float, typer.Option(help="Distance between positions, m.")] = 0.0508,
    sweeps: Annotated[int, typer.Option(help="Up-ramps averaged at each position and channel.")] = 10,
    can: Annotated[
        float | None, typer.Option(help="Inner diameter of the cans, m; the middle of the usual rule, if left out.")
    ] = None,
    edge: Annotated[float, typer.Option(help="Edge of the calibration trihedral, m.")] = 1.2192,
    power: Annotated[float, typer.Option(help="Transmitted power, W.")] = 1.0,
    noise_figure: Annotated[float, typer.Option(help="Noise figure of the receiver, dB.")] = 10.0,
    json_: Json = False,
    debug: Debug = False,
) -> None:
    """Figures of a rig by formulas: can, beam, range, resolution, swath, noise, far field, grating lobes.

    Touches no device.

    Example: polfuse design rig.toml --can 0.085 --at 20
    """
    from polfuse_lab.design import DesignWishes
    from polfuse_lab.design import design as made
    from polfuse_lab.rig import load_rig
    from polfuse_lab.rig.examples import thesis_rig

    meant = thesis_rig() if rig is None else load_rig(rig)
    values = made(
        meant,
        DesignWishes(
            at_m=at,
            aperture_m=aperture,
            step_m=step,
            sweeps=sweeps,
            can_diameter_m=can,
            edge_m=edge,
            power_w=power,
            noise_figure_db=noise_figure,
        ),
    )
    result({"values": {name: vars(value) for name, value in values.items()}}, as_json=json_, text=_table(values))


def _table(values: dict[str, DesignValue]) -> str:
    lines = []
    for name, told in values.items():
        if told.value is None:
            shown = "-"
        elif isinstance(told.value, bool):
            shown = "yes" if told.value else "no"
        else:
            shown = f"{told.value:.4g}"
        lines.append(f"{name.replace('_', ' '):26} {shown:>9} {told.unit:11} {told.equation}")
        if told.note:
            lines.append(f"{'':26} note: {told.note}")
    return "\n".join(lines)

"""``polfuse trade``: speed against accuracy of every knob, measured on this machine."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from polfuse_lab.cli.output import Debug, Json, guarded, progress, result

if TYPE_CHECKING:
    from polfuse_lab.trade import Row


@guarded
def trade(
    task: Annotated[
        list[str] | None,
        typer.Option(
            help="Only this group of tasks (may be given again): focus, ranging, optics.demosaic, optics.debias, "
            "raytrace, speckle, decompose, storage."
        ),
    ] = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder for a plot of each task; 'trade', if left out.")
    ] = None,
    quick: Annotated[bool, typer.Option("--quick", help="Smaller work, fewer rounds: under a minute.")] = False,
    knobs: Annotated[
        bool, typer.Option("--knobs", help="Only list every knob and where its trade is measured.")
    ] = False,
    json_: Json = False,
    debug: Debug = False,
) -> None:
    """Speed against accuracy: what each setting costs and what error it leaves, and which one a tolerance asks for.

    Times are processor time of one core of this machine; errors are against exact sums or simulated truth.

    Example: polfuse trade --quick -o trade
    """
    from polfuse_lab.trade.knobs import KNOBS

    listed = [vars(knob) for knob in KNOBS]
    if knobs:
        text = "\n".join(f"{k.name:32} {k.where:30} {k.trades:32} {k.measured:24} {k.decided_by}" for k in KNOBS)
        result({"knobs": listed}, as_json=json_, text=text)
        return
    from polfuse_lab.trade.figures import draw_all
    from polfuse_lab.trade.rows import as_json
    from polfuse_lab.trade.run import trade as measure

    rows, kinds = measure(task or (), quick=quick, progress=progress)
    figures = draw_all(rows, kinds, output or Path("trade"))
    text = "\n".join([_table(rows), "", *(f"figure: {path}" for path in figures)])
    result({"rows": as_json(rows), "knobs": listed, "figures": figures}, as_json=json_, text=text)


def _table(rows: list[Row]) -> str:
    lines = []
    for task in dict.fromkeys(row.task for row in rows):
        lines += ["", task, f"  {'setting':26} {'seconds':>10} {'error dB':>9} {'expected':>9}"]
        for row in (row for row in rows if row.task == task):
            expected = "" if row.predicted_error_db is None else f"{row.predicted_error_db:.1f}"
            lines.append(
                f"{'*' if row.pareto else ' '} {row.setting:26} {row.seconds:10.3g} {row.error_db:9.1f} {expected:>9}"
                f"  {', '.join(row.chosen_for)}".rstrip()
            )
    lines += ["", "*: no other setting is both faster and better"]
    return "\n".join(lines[1:])

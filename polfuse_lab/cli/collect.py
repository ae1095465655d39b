"""``polfuse collect``: a headless collect."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from polfuse_lab.cli.output import Debug, Json, guarded, progress, result


@guarded
def collect(
    rig: Annotated[Path, typer.Argument(metavar="RIG.toml", help="Rig file.")],
    plan: Annotated[Path, typer.Argument(metavar="PLAN.toml", help="Plan file.")],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="SESSION.h5", help="Session file; must not exist.")],
    continues: Annotated[
        Path | None,
        typer.Option(
            "--continue",
            metavar="OLD.h5",
            help="Session of the same plan that did not come to its end: collect only what is missing in it."
            " 'polfuse join OLD.h5 SESSION.h5 -o WHOLE.h5' makes one session of both.",
        ),
    ] = None,
    json_: Json = False,
    debug: Debug = False,
) -> None:
    """Collect: carry out a plan on a rig and write a session. Ctrl-C stops it cleanly; what was recorded is kept.

    Hand-operated devices ask on the terminal: do what is asked, then press Enter.

    A collect that stopped (a full disk, a lost device, a crash) goes on with --continue, on another disk if need be.

    Example: polfuse collect rig.toml plan.toml -o session.h5
    """
    from polfuse_lab.cli.terminal import AskOnTerminal, StatusLine, interrupt_on_sigterm
    from polfuse_lab.engine import collect as run

    line = StatusLine()
    with interrupt_on_sigterm():
        outcome = run(rig, plan, output, continues=continues, on_status=line.show, on_prompt=AskOnTerminal(line).ask)
    line.end()
    for warning in outcome.warnings:
        progress(f"warning: {warning}")
    result(
        {
            "session": outcome.session,
            "positions": outcome.positions,
            "sweeps": outcome.sweeps,
            "frames": outcome.frames,
            "samples_lost": outcome.samples_lost,
            "frames_lost": outcome.frames_lost,
            "sync_rms_s": outcome.sync_rms_s,
            "state": outcome.state,
            "reason": outcome.reason,
            "seconds": outcome.seconds,
        },
        as_json=json_,
        text=f"{outcome.state}: {outcome.sweeps} audio records at {outcome.positions} positions and {outcome.frames}"
        f" frames in {outcome.seconds:.1f} s; {outcome.session or 'no session was begun'}",
    )
    if outcome.state != "finished":
        kept = f" (what was recorded is in {outcome.session})" if outcome.session else ""
        progress(f"error: {outcome.reason}{kept}")
        raise typer.Exit(1)

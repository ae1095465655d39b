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
    json_: Json = False,
    debug: Debug = False,
) -> None:
    """Collect: carry out a plan on a rig and write a session. Ctrl-C stops it cleanly; what was recorded is kept.

    Hand-operated devices ask on the terminal: do what is asked, then press Enter.

    Example: polfuse collect rig.toml plan.toml -o session.h5
    """
    from polfuse_lab.cli.terminal import AskOnTerminal, StatusLine, interrupt_on_sigterm
    from polfuse_lab.engine import collect as run

    line = StatusLine()
    with interrupt_on_sigterm():
        outcome = run(rig, plan, output, on_status=line.show, on_prompt=AskOnTerminal(line).ask)
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

"""``polfuse replay``: play a session through the scheduler into a copy."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from polfuse_lab.cli.output import Debug, Json, guarded, progress, result


@guarded
def replay(
    session: Annotated[Path, typer.Argument(metavar="SESSION.h5", help="Session of a collect.")],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="COPY.h5", help="The copy; must not exist.")],
    speed: Annotated[
        float | None,
        typer.Option(metavar="X", help="So many times as fast as recorded (1: real time) [as fast as possible]."),
    ] = None,
    json_: Json = False,
    debug: Debug = False,
) -> None:
    """Play a session through playback devices and the same scheduler, and compare the copy with it byte by byte.

    Exit status 1 when they differ. Pauses and other idle time of the recording are shortened to two seconds.

    Example: polfuse replay session.h5 -o copy.h5 --speed 20
    """
    from polfuse_lab.cli.terminal import StatusLine, interrupt_on_sigterm
    from polfuse_lab.replay import FASTEST
    from polfuse_lab.replay import replay as play

    if speed is not None and not speed > 0:
        raise typer.BadParameter("it is above 0", param_hint="--speed")
    line = StatusLine()
    with interrupt_on_sigterm():
        played = play(session, output, speed=FASTEST if speed is None else speed, on_status=line.show)
    line.end()
    differences = [str(difference) for difference in played.differences]
    verdict = "identical" if played.identical else f"{len(differences)} differences"
    result(
        {
            "identical": played.identical,
            "differences": differences,
            "seconds": played.seconds,
            "session": played.session,
            "state": played.state,
            "reason": played.reason,
        },
        as_json=json_,
        text=f"{played.session}: {verdict}, replayed in {played.seconds:.1f} s",
    )
    if not played.identical:
        for difference in differences:
            progress(f"different: {difference}")
        progress(f"error: {output}: the copy is not identical; the run {played.state}: {played.reason}")
        raise typer.Exit(1)

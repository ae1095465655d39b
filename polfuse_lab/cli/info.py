"""``polfuse info``: what is inside a session."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from polfuse_lab.cli.output import Debug, Json, guarded, result


@guarded
def info(
    session: Annotated[Path, typer.Argument(metavar="SESSION.h5", help="Session file, finished or .partial.")],
    json_: Json = False,
    debug: Debug = False,
) -> None:
    """What is inside a session, and whether it is whole.

    Example: polfuse info session.h5
    """
    from polfuse_lab.session.summary import info as summarise

    found = summarise(session)
    sync = found["sync_rms_s"]
    lines = [
        f"{session}: {found['schema']}, {found['source']}, {'whole' if found['complete'] else 'NOT whole'}",
        f"  ended as {found['state']}: {found['reason'] or '-'}",
        f"  {found['sweeps']} audio records at {found['positions']} positions in {', '.join(found['channels']) or '-'}",
        f"  {found['frames']} camera frames, {found['duration_s']:.1f} s",
        f"  lost: {found['samples_lost']} audio frames, {found['frames_lost']} camera frames",
        f"  clocks: {'no device clock' if sync is None else f'synchronised to {sync * 1e6:.1f} us rms'}",
    ]
    lines += [f"  problem: {problem}" for problem in found["problems"]]
    result(found, as_json=json_, text="\n".join(lines))

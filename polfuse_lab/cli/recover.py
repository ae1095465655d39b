"""``polfuse recover``: rescue a session left by a crash."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from polfuse_lab.cli.output import Debug, Json, guarded, result


@guarded
def recover(
    partial: Annotated[Path, typer.Argument(metavar="FILE.partial", help="File left by a crash; it is not changed.")],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="SESSION.h5", help="New session file.")],
    json_: Json = False,
    debug: Debug = False,
) -> None:
    """Rescue a file left by a crash: copy every whole record into a clean session.

    Example: polfuse recover session.h5.partial -o session.h5
    """
    from polfuse_lab.session import recover as rescue

    rescued = rescue(partial, output)
    result(
        {
            "recovered_records": rescued.recovered_records,
            "lost_records": rescued.lost_records,
            "session": rescued.session,
        },
        as_json=json_,
        text=f"{rescued.recovered_records} records rescued, {rescued.lost_records} lost: {rescued.session}",
    )

"""``polfuse join``: the parts of a continued collect as one session."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from polfuse_lab.cli.output import Debug, Json, guarded, result


@guarded
def join(
    parts: Annotated[
        list[Path], typer.Argument(metavar="PART.h5...", help="Parts in their order; they are not changed.")
    ],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="SESSION.h5", help="New session file.")],
    json_: Json = False,
    debug: Debug = False,
) -> None:
    """Join the parts of a collect that was continued ('polfuse collect --continue') into one session.

    Example: polfuse join day1.h5 day1-rest.h5 -o whole.h5
    """
    from polfuse_lab.session import join as join_parts

    joined = join_parts(parts, output)
    lost = f", {joined.lost_records} could not be read" if joined.lost_records else ""
    result(
        {
            "session": joined.session,
            "parts": parts,
            "records": joined.records,
            "lost_records": joined.lost_records,
            "state": joined.state,
        },
        as_json=json_,
        text=f"{joined.records} records of {len(parts)} parts{lost}; ended as {joined.state}: {joined.session}",
    )

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
    from polfuse_lab.session import info as summarise
    from polfuse_lab.session import open_session
    from polfuse_lab.session.contents import disk
    from polfuse_lab.session.description import describe

    found = summarise(session)
    with open_session(session) as opened:
        found["disk"] = disk(opened)
    result(found, as_json=json_, text=describe(str(session), found))

"""``polfuse init``: commented example files."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from polfuse_lab.cli.output import Debug, Json, guarded, result


@guarded
def init(
    directory: Annotated[Path, typer.Argument(metavar="DIR", help="Where to write them; made if it is not there.")],
    by_hand: Annotated[
        bool, typer.Option("--by-hand", help="A rig whose trolley and polarizer are moved by hand.")
    ] = False,
    force: Annotated[bool, typer.Option("--force", help="Overwrite files that are there already.")] = False,
    json_: Json = False,
    debug: Debug = False,
) -> None:
    """Write a commented example rig, its plans, and a plan of each other kind: the thesis's rail rig.

    Example: polfuse init my_rig
    """
    from polfuse_lab.rig.examples import write_examples

    written = write_examples(directory, by_hand=by_hand, force=force)
    lines = [f"{key:18} {path}" for key, path in written.items()]
    text = "\n".join([*lines, f"Next: set the ports in {written['rig']}, then 'polfuse doctor {written['rig']}'."])
    result(written, as_json=json_, text=text)

"""``polfuse gui``: the desktop program."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from polfuse_lab.cli.output import Debug, Json, guarded, result


@guarded
def gui(
    opened: Annotated[
        Path | None, typer.Argument(metavar="[RIG.toml|SESSION.h5]", help="A rig, session or products file.")
    ] = None,
    tour: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Walk every page with the simulated rig and save a PNG of each, then end."),
    ] = None,
    json_: Json = False,
    debug: Debug = False,
) -> None:
    """The desktop program: set-up, collect, live view, and everything after.

    Example: polfuse gui rig.toml
    """
    import os
    import sys

    from polfuse_lab.errors import PolfuseError

    no_display = sys.platform.startswith("linux") and not {"DISPLAY", "WAYLAND_DISPLAY"} & set(os.environ)
    if no_display:
        if tour is None and "QT_QPA_PLATFORM" not in os.environ:
            raise PolfuseError(
                "there is no display", where="gui", advice="log in at the computer's own screen, or use the commands"
            )
        os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
    if opened is not None and not opened.is_file():
        raise PolfuseError("there is no such file", where=str(opened), advice="check its name")
    try:
        import pyqtgraph  # noqa: F401
        import PySide6  # noqa: F401
    except ImportError as error:
        raise PolfuseError(
            f"the window's packages are missing ({error.name})",
            where="gui",
            advice="install them: pip install 'polfuse-lab[gui]'",
        ) from error
    if tour is not None:
        from gui.tour import tour as walk

        pages = walk(tour)
        result({"pages": pages}, as_json=json_, text="\n".join(page["file"] for page in pages))
        return
    from gui.app import run

    raise typer.Exit(run(opened))

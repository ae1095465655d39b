"""Several sessions in one call of ``polfuse focus``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from polfuse_lab.cli.output import counted, progress, result

if TYPE_CHECKING:
    from polfuse_lab.scale.batch import Focused


def focus_many(
    sessions: list[Path],
    folder: Path,
    options: Mapping[str, Any],
    *,
    memory: str | None,
    tile: int | None,
    dask: str | None,
    as_json: bool,
) -> None:
    """Focus sessions into a folder and tell what became of each; exit status 1 where one failed.

    Raises:
        PolfuseError: as :func:`polfuse_lab.scale.batch.focus_batch`.
    """
    from polfuse_lab.scale.batch import focus_batch
    from polfuse_lab.scale.spread import spread

    with spread(memory=memory, tile=tile, dask=dask) as spreading:
        made = focus_batch(
            sessions,
            folder,
            options=options,
            memory_bytes=spreading.memory_bytes,
            tile=tile,
            cluster=spreading.cluster,
            listener=counted,
            finished=_tell,
        )
    failed = sum(item.error is not None for item in made)
    lines = [
        f"{item.products}: {item.method}, {item.pixels} pixels in {item.seconds:.1f} s"
        for item in made
        if item.error is None
    ]
    result({"sessions": [asdict(item) for item in made], "failed": failed}, as_json=as_json, text="\n".join(lines))
    if failed:
        raise typer.Exit(1)


def _tell(item: Focused) -> None:
    if item.error is not None:
        progress(f"error: {item.error}")
    for warning in item.warnings:
        progress(f"note: {Path(item.session).name}: {warning}")

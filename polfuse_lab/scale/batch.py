"""Many sessions focused one after the other, or side by side on Dask; each becomes a products file of its own."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from polfuse_lab.errors import PolfuseError
from polfuse_lab.products.focus import default_grid, focus
from polfuse_lab.scale.cluster import Cluster
from polfuse_lab.scale.focus_tiles import Scale
from polfuse_lab.scale.progress import Counter, Listener
from polfuse_lab.session import open_session
from processing.errors import DataError

GRID_OPTIONS = ("x_m", "y_m", "step_m")
"""Options that describe the grid, see :func:`polfuse_lab.products.focus.default_grid`."""


@dataclass(frozen=True)
class Focused:
    """What became of one session of a batch."""

    session: str
    products: str
    error: str | None = None
    """Why there is no image, in a sentence; None where there is one."""
    method: str | None = None
    predicted_error_db: float | None = None
    pixels: int = 0
    pulses: int = 0
    seconds: float = 0.0
    peaks: list[dict[str, float]] = field(default_factory=list)
    """``x_m``, ``y_m``, ``dB`` of each."""
    warnings: list[str] = field(default_factory=list)


def products_of(sessions: Sequence[Path], folder: Path) -> list[Path]:
    """Products file of each session: ``<folder>/<name>-products.h5``.

    Raises:
        PolfuseError: two sessions of one name, or the folder is a file.
    """
    names = [f"{path.name.removesuffix('.h5')}-products.h5" for path in sessions]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise PolfuseError(
            f"two sessions would be written to {twice[0]}", where=str(folder), advice="focus them one by one"
        )
    if folder.exists() and not folder.is_dir():
        raise PolfuseError("is a file", where=str(folder), advice="give a folder for the products of several sessions")
    return [folder / name for name in names]


def focus_batch(
    sessions: Sequence[Path | str],
    folder: Path | str,
    *,
    options: Mapping[str, Any] | None = None,
    memory_bytes: int | None = None,
    tile: int | None = None,
    cluster: Cluster | None = None,
    listener: Listener | None = None,
    finished: Callable[[Focused], None] | None = None,
) -> list[Focused]:
    """Focus sessions with the same options; what fails for one does not stop the others.

    Args:
        sessions: session files. On a cluster, workers read and write the same paths.
        folder: of the products files, made if it is not there.
        options: of :func:`polfuse_lab.products.focus.focus`, and :data:`GRID_OPTIONS`.
        memory_bytes: limit of memory, for images in tiles; see :class:`polfuse_lab.scale.focus_tiles.Scale`.
        tile: rows and columns of tiles, likewise.
        cluster: where to work, whole sessions on each worker; in this process where left out.
        listener: who is told how far it is.
        finished: who is told of each session as it is done.

    Returns:
        What became of each, in their order.

    Raises:
        PolfuseError: sessions of the same name, an unusable folder, or the cluster is lost.
    """
    paths, folder = [Path(path).resolve() for path in sessions], Path(folder).resolve()
    outputs = products_of(paths, folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise PolfuseError(
            f"cannot be made ({error.strerror})", where=str(folder), advice="check the path and its permissions"
        ) from error
    work = [
        (str(path), str(output), dict(options or {}), memory_bytes, tile)
        for path, output in zip(paths, outputs, strict=True)
    ]
    counter = Counter("sessions", len(work), listener, every_s=0.0)
    results: dict[int, Focused] = {}
    done = cluster.each(focus_one, work) if cluster is not None else enumerate(focus_one(*item) for item in work)
    for index, values in done:
        results[index] = Focused(**values)
        counter.add()
        if finished is not None:
            finished(results[index])
    return [results[index] for index in range(len(work))]


def focus_one(
    session: str, products: str, options: Mapping[str, Any], memory_bytes: int | None, tile: int | None
) -> dict[str, Any]:
    """Focus one session of a batch; the fields of :class:`Focused` as plain values, an error among them."""
    chosen = {name: value for name, value in options.items() if name not in GRID_OPTIONS}
    where = {name: options[name] for name in GRID_OPTIONS if name in options}
    scale = None if memory_bytes is None and tile is None else Scale(memory_bytes=memory_bytes, tile=tile)
    try:
        with open_session(session) as opened:
            made = focus(opened, products, grid=default_grid(opened, **where), scale=scale, **chosen)
    except (PolfuseError, DataError) as error:
        return asdict(Focused(session, products, str(error)))
    return asdict(
        Focused(
            session,
            products,
            None,
            made.choice.method,
            made.choice.predicted_error_db,
            made.pixels,
            made.pulses,
            made.seconds,
            [{"x_m": peak.x_m, "y_m": peak.y_m, "dB": peak.level_db} for peak in made.peaks],
            made.warnings,
        )
    )

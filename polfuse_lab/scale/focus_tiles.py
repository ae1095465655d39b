"""Focusing in tiles: profiles and image grow in a file, and memory holds a block of one and a tile of the other.

The image has the bits of back-projection in one piece (:mod:`processing.sar.tiles` says what that takes), whatever the
tiles' size, the number of processes, and however often the run was interrupted.
"""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polfuse_lab.errors import PolfuseError
from polfuse_lab.products.focus_grids import told
from polfuse_lab.products.focus_parts import (
    Span,
    rail_order,
    step_m,
    strongest_peaks,
    warnings_of,
)
from polfuse_lab.products.focus_plan import task_of
from polfuse_lab.products.focus_result import FocusResult
from polfuse_lab.products.forming import own_positions, position_weights
from polfuse_lab.products.growing import Growing, GrowingStages, Index
from polfuse_lab.products.provenance import versions
from polfuse_lab.products.rail_options import RailOptions, focus_settings, rail_work, ranging_settings
from polfuse_lab.products.ranging import ProfileSource
from polfuse_lab.products.store import Products
from polfuse_lab.scale.plan import Cut, cut
from polfuse_lab.scale.progress import Counter, Listener
from polfuse_lab.scale.tile_job import Formed, TileJob, form_tile
from polfuse_lab.session import Session
from polfuse_lab.session.runs import gapless_runs
from processing.errors import DataError
from processing.radar.profiles import RangeProfiles
from processing.sar.aperture import alias_free_angle_rad
from processing.sar.grid import ImageGrid
from processing.sar.planner import choose
from processing.sar.planner_words import explain
from processing.sar.tiles import GridTile

Place = tuple[int, int, int, int]
"""First row, first column, rows and columns of a tile."""

Workers = Callable[[TileJob, list[Place]], Iterator[tuple[int, Formed]]]
"""Forms tiles somewhere, and gives each with its index as it comes."""


@dataclass(frozen=True)
class Scale:
    """How focusing is spread over time, memory and processes."""

    memory_bytes: int | None = None
    """Limit of this process' memory (each worker's, with several); half of what there is where left out."""
    tile: int | None = None
    """Rows and columns of a tile, instead of what memory allows."""
    workers: Workers | None = None
    """Where tiles are formed; in this process where left out."""
    worker_count: int = 1
    """How many tiles are formed at the same time there."""
    listener: Listener | None = None
    """Who is told how far it is."""


def focus_in_tiles(
    session: Session, products_path: Path | str, grid: ImageGrid, scale: Scale, options: RailOptions
) -> FocusResult:
    """Focus a session by back-projection, tile by tile; options as in :func:`polfuse_lab.products.focus.focus`.

    An interrupted run (Ctrl-C, a full disk, a kill) leaves ``NAME.tiles`` beside the products file; the same call goes
    on with it. The result's image is read from the products file where it is looked at.

    Raises:
        PolfuseError: another method than back-projection, a limit of memory that is too small, a session that cannot be
            focused, a full disk.
        DataError: wrong window or tolerance, tiles that are too small.
    """
    begun = time.perf_counter()
    if options.method not in ("auto", "bp"):
        raise PolfuseError(
            f"{options.method} works on the whole image at once and has no tiles",
            where="method",
            advice="focus in tiles with auto or bp (back-projection)",
        )
    work = rail_work(session, grid, replace(options, method="bp"))
    source = ProfileSource(session, **work.profiles, keep_samples=False)
    order = rail_order(source.antenna_m, session)
    pieces = cut(
        grid,
        len(source.channels),
        len(source.range_m),
        memory_bytes=scale.memory_bytes,
        tile=scale.tile,
        workers=scale.worker_count,
    )
    recipe = {
        "inputs": [_identity(path) for path in work.inputs],
        "versions": versions(),
        "ranging": work.ranging,
        "method": [options.tolerance_db, options.aperture, options.compensate_pattern, options.target],
        "grid": [_digest(grid.x_m), _digest(grid.y_m), grid.z_m],
        "cut": [pieces.positions, _place(pieces.tiles[0]), _place(pieces.tiles[-1]), len(pieces.tiles)],
    }
    products = Products(products_path)
    # What is no products file is refused before hours of work, not after.
    products.stages()
    with _growing(products.path, recipe, source, grid, pieces) as growing:
        outline = _range(growing, source, order, pieces, scale.listener)
        weights = position_weights(outline, options.aperture, passes=bool(gapless_runs(session)))
        task = task_of(outline, grid, work.oversampling, work.beamwidth_rad is not None)
        choice = choose(task, options.tolerance_db, "bp")
        _check_weights(outline, weights)
        alone = own_positions(outline)
        count = len(outline.channels)
        job = TileJob(
            profiles=growing.raw("ranging/profiles"),
            outline=outline,
            weights=weights,
            grid=grid,
            interpolator=choice.interpolator,
            beamwidth_rad=work.beamwidth_rad,
            depression_rad=work.depression_rad,
            alias_free_rad=alias_free_angle_rad(step_m(outline), outline.wavelength_m),
            groups=(tuple(range(count)),) if alone is None else tuple((c,) for c in range(count)),
        )
        _form(growing, job, pieces, scale)
        strongest = strongest_peaks(Span(_Stored(growing, "focus/image")), grid, outline, options.peaks)
        warnings = warnings_of(outline, grid, choice, options.tolerance_db)
        settings = focus_settings(work, outline, grid, choice, weights, warnings) | told(grid)
        ranging = ranging_settings(work, outline, session)
        image = growing.raw("focus/image")
        growing.become(products, {"ranging": ranging, "focus": settings}, work.inputs)
    return FocusResult(
        products=products.path,
        image=np.memmap(products.path, np.dtype(image.dtype), "r", image.offset, image.shape),
        grid=grid,
        channels=outline.channels,
        choice=choice,
        explanation=tuple(explain(task, choice, options.tolerance_db)),
        settings=settings,
        pulses=len(outline.antenna_m),
        seconds=time.perf_counter() - begun,
        peaks=strongest,
        warnings=warnings,
    )


def _check_weights(outline: RangeProfiles, weights: NDArray[np.float64]) -> None:
    present = ~np.isnan(outline.values[:, :, 0])
    for name, own in zip(outline.channels, present, strict=True):
        if not (own & (weights > 0)).any():
            raise DataError(f"channel {name} has no profile with any weight", "collect it again, or leave it out")


def _identity(path: Path) -> list[Any]:
    """What tells a file from another one without reading it."""
    try:
        known = path.stat()
    except OSError as error:
        raise PolfuseError(f"cannot be read ({error.strerror})", where=str(path), advice="check the path") from error
    return [str(path.resolve()), known.st_size, known.st_mtime_ns]


def _digest(values: NDArray[np.float64]) -> str:
    return hashlib.sha256(np.ascontiguousarray(values).data).hexdigest()


def _place(tile: GridTile) -> Place:
    return tile.first_row, tile.first_column, tile.row_count, tile.column_count


def _blocks(positions: int, pieces: Cut) -> list[slice]:
    return [slice(first, min(first + pieces.positions, positions)) for first in range(0, positions, pieces.positions)]


def _growing(path: Path, recipe: dict[str, Any], source: ProfileSource, grid: ImageGrid, pieces: Cut) -> GrowingStages:
    channels, positions, bins = len(source.channels), len(source.antenna_m), len(source.range_m)
    arrays = {
        "ranging/profiles": Growing((channels, positions, bins), np.complex64, "full scale * m^2"),
        "ranging/range_m": Growing((bins,), np.float64, "m"),
        "ranging/antenna_m": Growing((positions, 3), np.float64, "m"),
        "focus/image": Growing((channels, *grid.shape), np.complex64, "full scale * m^2"),
        "focus/flags": Growing(grid.shape, np.uint8, "bits"),
        "focus/x_m": Growing((grid.shape[1],), np.float64, "m"),
        "focus/y_m": Growing((grid.shape[0],), np.float64, "m"),
    }
    counts = {"axes": 1, "blocks": len(_blocks(positions, pieces)), "tiles": len(pieces.tiles)}
    return GrowingStages(path, recipe, arrays, counts)


def _range(
    growing: GrowingStages,
    source: ProfileSource,
    order: NDArray[np.intp],
    pieces: Cut,
    listener: Listener | None,
) -> RangeProfiles:
    """Write the profiles that are missing; returns what is known of them all, with one bin each (NaN: no profile)."""
    blocks = _blocks(len(order), pieces)
    everything = slice(None)
    where: list[dict[str, Index]] = [{"ranging/profiles": (everything, block, everything)} for block in blocks]
    if growing.resumed:
        growing.keep_sound("blocks", dict(enumerate(where)))
    done = growing.done("blocks")
    counter = Counter("blocks of profiles", len(blocks), listener, already=int(done.sum()))
    marks = np.empty((len(source.channels), len(order), 1), dtype=np.complex64)
    for number, block in enumerate(blocks):
        if done[number]:
            values = growing.get("ranging/profiles", where[number]["ranging/profiles"])
        else:
            values, _ = source.profiles([int(place) for place in order[block]])
            growing.put("blocks", number, {"ranging/profiles": (where[number]["ranging/profiles"], values)})
            counter.add()
        marks[:, block, 0] = np.where(np.isnan(values).all(axis=2), np.nan, 0)
    antenna = source.antenna_m[order]
    growing.put(
        "axes",
        0,
        {"ranging/range_m": ((everything,), source.range_m), "ranging/antenna_m": ((everything, everything), antenna)},
    )
    return source.described(marks, None).at_positions(order, marks)


def _form(growing: GrowingStages, job: TileJob, pieces: Cut, scale: Scale) -> None:
    where: list[dict[str, Index]] = [
        {"focus/image": (slice(None), tile.rows, tile.columns), "focus/flags": (tile.rows, tile.columns)}
        for tile in pieces.tiles
    ]
    if growing.resumed:
        growing.keep_sound("tiles", dict(enumerate(where)))
    done = growing.done("tiles")
    missing = [int(number) for number in np.flatnonzero(~done)]
    counter = Counter("tiles", len(where), scale.listener, already=len(where) - len(missing))
    everything = slice(None)
    growing.put("axes", 0, {"focus/x_m": ((everything,), job.grid.x_m), "focus/y_m": ((everything,), job.grid.y_m)})
    places = [_place(pieces.tiles[number]) for number in missing]
    formed = _here(job, places) if scale.workers is None else scale.workers(job, places)
    for index, (image, flags) in formed:
        number = missing[index]
        parts = where[number]
        growing.put(
            "tiles",
            number,
            {"focus/image": (parts["focus/image"], image), "focus/flags": (parts["focus/flags"], flags)},
        )
        del image, flags
        counter.add()


def _here(job: TileJob, places: Iterable[Place]) -> Iterator[tuple[int, Formed]]:
    for index, place in enumerate(places):
        yield index, form_tile(job, place)


class _Stored:
    """An array in the growing file, read where it is looked at."""

    def __init__(self, growing: GrowingStages, name: str) -> None:
        self._growing, self._name = growing, name
        self.shape = growing.raw(name).shape

    def __getitem__(self, where: Index) -> NDArray[Any]:
        return self._growing.get(self._name, where)

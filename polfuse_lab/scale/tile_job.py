"""What forms one tile of an image, in this process or in another: profiles from a file, a block of pulses at a time."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from polfuse_lab.errors import PolfuseError
from polfuse_lab.products.forming import motion_model
from polfuse_lab.products.growing import RawArray
from processing.radar.profiles import RangeProfiles
from processing.sar.backprojection import LiveImage, pulses_in_block
from processing.sar.footprint import ImageFlag, footprint_flags
from processing.sar.grid import ImageGrid
from processing.sar.tiles import GridTile

Formed = tuple[NDArray[np.complex64], NDArray[np.uint8]]
"""Image (channels, rows, columns) and flags (rows, columns) of a tile."""


@dataclass(frozen=True)
class TileJob:
    """A back-projection whose tiles can be formed anywhere that its file is seen."""

    profiles: RawArray
    """(channels, positions, bins) complex64."""
    outline: RangeProfiles
    """What is known of them; its ``values`` have one bin, NaN where a channel has no profile."""
    weights: NDArray[np.float64]
    """(positions,)."""
    grid: ImageGrid
    interpolator: str
    beamwidth_rad: float | None
    depression_rad: float
    alias_free_rad: float
    groups: tuple[tuple[int, ...], ...]
    """Channels that are formed together; each group from the positions that it has."""

    @property
    def present(self) -> NDArray[np.bool_]:
        """(channels, positions) which profiles there are."""
        present: NDArray[np.bool_] = ~np.isnan(self.outline.values[:, :, 0])
        return present

    def form(self, tile: GridTile) -> Formed:
        """One tile, with the bits that it has in the image in one piece.

        Raises:
            PolfuseError: the profiles cannot be read.
            DataError: as :class:`processing.sar.backprojection.LiveImage`.
        """
        image = np.empty((len(self.outline.channels), *tile.shape), dtype=np.complex64)
        for group in self.groups:
            image[list(group)] = self._form(tile, list(group))
        part = ImageGrid(self.grid.x_m[tile.columns], self.grid.y_m[tile.rows], self.grid.z_m)
        flags = footprint_flags(
            part,
            beamwidth_rad=self.beamwidth_rad,
            depression_rad=self.depression_rad,
            alias_free_rad=self.alias_free_rad,
            undefined=np.asarray(~np.isfinite(image).all(axis=0)),
        )
        image[:, (flags & ImageFlag.OUTSIDE_BEAM) != 0] = np.nan
        return image, flags

    def _form(self, tile: GridTile, group: list[int]) -> NDArray[np.complex64]:
        used = np.flatnonzero(self.present[group].any(axis=0) & (self.weights > 0))
        antenna = self.outline.antenna_m[used]
        seen = self.outline.at_positions(used)
        some = replace(
            seen,
            values=seen.values[group],
            noise=None,
            channels=tuple(self.outline.channels[c] for c in group),
            pairs=None if self.outline.pairs is None else tuple(self.outline.pairs[c] for c in group),
        )
        live = LiveImage(
            tile,
            interpolator=self.interpolator,
            beamwidth_rad=self.beamwidth_rad,
            depression_rad=self.depression_rad,
            track_m=antenna,
        )
        step = pulses_in_block(some, self.interpolator)
        motion = motion_model(self.outline)
        for first in range(0, len(used), step):
            block = used[first : first + step]
            values = np.stack([self._read(channel, block) for channel in group])
            here = some.at_positions(np.arange(first, first + len(block)), values)
            live.add(here, weights=self.weights[block], motion=motion)
        return live.finish()

    def _read(self, channel: int, positions: NDArray[np.intp]) -> NDArray[np.complex64]:
        first = int(positions[0])
        try:
            rows = self.profiles.rows(channel, slice(first, int(positions[-1]) + 1))
        except (OSError, EOFError) as error:
            raise PolfuseError(
                f"the range profiles cannot be read here ({error})",
                where=self.profiles.path,
                advice="write products to a folder that every worker sees under the same name",
            ) from error
        return np.ascontiguousarray(rows if len(rows) == len(positions) else rows[positions - first])


def form_tile(job: TileJob, place: tuple[int, int, int, int]) -> Formed:
    """Form the tile that begins at a row and column and has so many rows and columns; see :meth:`TileJob.form`."""
    return job.form(GridTile(job.grid, *place))

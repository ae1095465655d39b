"""From the options of a command to how its work is spread over memory and processes."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass

from polfuse_lab.scale.cluster import Cluster, connect
from polfuse_lab.scale.focus_tiles import Place, Scale
from polfuse_lab.scale.memory import parse_size
from polfuse_lab.scale.progress import Listener
from polfuse_lab.scale.tile_job import Formed, TileJob, form_tile


@dataclass(frozen=True)
class Spread:
    """How work is spread."""

    memory_bytes: int | None
    tile: int | None
    cluster: Cluster | None
    listener: Listener | None

    @property
    def scale(self) -> Scale | None:
        """For one session; None where nothing was asked for: tiles are used then where memory is short."""
        if self.memory_bytes is None and self.tile is None and self.cluster is None:
            return None
        if self.cluster is None:
            return Scale(self.memory_bytes, self.tile, listener=self.listener)
        return on_cluster(self.cluster, self.memory_bytes, self.tile, self.listener)


def on_cluster(
    cluster: Cluster, memory_bytes: int | None = None, tile: int | None = None, listener: Listener | None = None
) -> Scale:
    """Tiles on the workers of a cluster, which see the products' folder under the same path; else as :class:`Scale`."""

    def workers(job: TileJob, places: list[Place]) -> Iterator[tuple[int, Formed]]:
        return cluster.each(form_tile, [(job, place) for place in places])

    return Scale(memory_bytes, tile, workers, cluster.worker_count, listener)


@contextmanager
def spread(
    *,
    memory: str | None = None,
    tile: int | None = None,
    dask: str | None = None,
    listener: Listener | None = None,
) -> Iterator[Spread]:
    """How work is spread, for as long as the cluster is needed.

    Args:
        memory: limit of memory as people write it, such as ``2GB``.
        tile: rows and columns of a tile.
        dask: address of a Dask scheduler, or ``local``.
        listener: who is told how far it is.

    Raises:
        PolfuseError: no such size, or the cluster cannot be reached.
    """
    limit = None if memory is None else parse_size(memory)
    with nullcontext(None) if dask is None else connect(dask) as cluster:
        yield Spread(limit, tile, cluster, listener)

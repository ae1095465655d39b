"""One focusing run in a process of its own, so that its memory can be told from that of others: prints JSON."""

from __future__ import annotations

import argparse
import json
import resource
import time
from pathlib import Path


def main() -> None:
    """Focus a session in one piece or in tiles; tells seconds, resident memory before, and at its peak."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("session", type=Path)
    parser.add_argument("products", type=Path)
    parser.add_argument("--pixels", type=int, required=True, help="rows and columns of the image")
    parser.add_argument("--memory", type=int, help="limit of memory, bytes")
    parser.add_argument("--tiles", action="store_true", help="tiles, whatever the memory")
    parser.add_argument("--workers", type=int, help="processes of a local Dask cluster")
    given = parser.parse_args()

    import numpy as np

    from polfuse_lab.products.focus import focus
    from polfuse_lab.scale.focus_tiles import Scale
    from polfuse_lab.scale.memory import resident_bytes
    from processing.sar.grid import ImageGrid

    def image(count: int) -> ImageGrid:
        return ImageGrid(np.linspace(-4, 4, count), np.linspace(5, 17, count), -1.0)

    # Code is loaded and compiled before memory and time count.
    focus(given.session, given.products.with_suffix(".warm.h5"), grid=image(40), method="bp")
    before = resident_bytes()

    def run(scale: Scale | None) -> None:
        begun = time.perf_counter()
        made = focus(given.session, given.products, grid=image(given.pixels), method="bp", scale=scale)
        told = {
            "seconds": time.perf_counter() - begun,
            "before": before,
            "peak": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024,
            "positions": made.pulses,
            "channels": len(made.channels),
        }
        print(json.dumps(told))

    if given.workers:
        from polfuse_lab.scale.cluster import connect
        from polfuse_lab.scale.spread import on_cluster

        with connect("local", workers=given.workers) as cluster:
            run(on_cluster(cluster))
    else:
        run(Scale(given.memory) if given.tiles or given.memory else None)


if __name__ == "__main__":
    main()

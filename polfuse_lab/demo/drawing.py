"""Draw the report's pictures in a process of its own, while the demo goes on."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from concurrent.futures import Future, ProcessPoolExecutor
from multiprocessing import connection
from pathlib import Path
from types import TracebackType

from polfuse_lab.products.store import Products
from polfuse_lab.report.pictures import Picture, pictured_stages, stage_pictures


class Drawing:
    """Draws stages of a products file as soon as they are there; use it with ``with``."""

    def __init__(self, products: Path) -> None:
        self._products = products
        self._pool = ProcessPoolExecutor(
            1, mp_context=multiprocessing.get_context("spawn"), initializer=_end_with_parent
        )
        self._drawn: dict[str, Future[list[Picture]]] = {}
        # Loads what drawing needs, while the rig is still at work.
        self._ready = self._pool.submit(_prepare)

    def __enter__(self) -> Drawing:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._pool.shutdown(wait=True, cancel_futures=True)

    def draw(self, *stages: str) -> None:
        """Begin to draw stages that are finished."""
        for stage in stages:
            self._drawn[stage] = self._pool.submit(_draw, self._products, stage)

    def pictures(self) -> list[Picture]:
        """All pictures in the order of the page, once they are drawn. Raises what drawing raised."""
        order = [stage for stage in pictured_stages() if stage in self._drawn]
        return [picture for stage in order for picture in self._drawn[stage].result()]


def _end_with_parent() -> None:
    """Ctrl-C reaches all processes of a terminal and is the parent's to answer; nothing outlives a killed parent."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_wait_for, args=(parent.sentinel,), name="parent watch", daemon=True).start()


def _wait_for(sentinel: int) -> None:
    connection.wait([sentinel])
    os._exit(1)


def _prepare() -> None:
    from polfuse_lab.products import figures_calibration, figures_fusion, figures_optics, figures_sar, style

    # The first text drawn makes matplotlib look for its fonts.
    modules = (figures_calibration, figures_fusion, figures_optics, figures_sar)
    figure = style.new_figure(1.0, 1.0, title=str(len(modules)))
    figure.canvas.draw()


def _draw(products: Path, stage: str) -> list[Picture]:
    return stage_pictures(Products(products), stage)

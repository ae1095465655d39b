"""A plot for each task: error over time, the front that nothing beats, and what each tolerance asks for."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from matplotlib.figure import Figure

from polfuse_lab.products.style import CLASS_COLOURS, new_figure
from polfuse_lab.tolerances import TOLERANCES_DB
from polfuse_lab.trade.rows import EXACT_DB, Row

LOWEST_DB = -170.0
"""Errors below are drawn there: nothing is told apart further down."""


def draw(rows: Sequence[Row], kind: str | None, title: str) -> Figure:
    """One task."""
    figure = new_figure(7.0, 4.6, title=title)
    axes = figure.add_subplot()
    shown = {id(row): max(row.error_db, LOWEST_DB) for row in rows}
    front = sorted((row for row in rows if row.pareto), key=lambda row: row.seconds)
    axes.plot([row.seconds for row in front], [shown[id(row)] for row in front], color=CLASS_COLOURS[0], lw=1, zorder=1)
    # Labels stand to the right of a point and to the left of the next one on the front, where they meet least.
    left = {id(row) for row in front[1::2]} if len(front) > 1 else set()
    for row in rows:
        colour = CLASS_COLOURS[0] if row.pareto else "0.6"
        axes.plot(row.seconds, shown[id(row)], "o", ms=5, color=colour)
        if row.predicted_error_db is not None:
            axes.plot(row.seconds, max(row.predicted_error_db, LOWEST_DB), "_", ms=9, color=CLASS_COLOURS[5])
        if row.pareto or len(rows) < 10:
            words = row.setting + (f" ({', '.join(row.chosen_for)})" if row.chosen_for else "")
            at, align = ((-5, -9), "right") if id(row) in left else ((5, 4), "left")
            place = (row.seconds, shown[id(row)])
            axes.annotate(words, place, xytext=at, textcoords="offset points", fontsize=7, ha=align)
    if kind is not None:
        low, high = axes.get_ylim()
        for name, limit in TOLERANCES_DB[kind].items():
            if low < limit < high:
                axes.axhline(limit, color="0.8", lw=0.8, zorder=0)
                axes.text(
                    1.0,
                    limit,
                    name,
                    transform=axes.get_yaxis_transform(),
                    fontsize=7,
                    color="0.4",
                    va="bottom",
                    ha="right",
                )
    axes.set_xscale("log")
    axes.margins(x=0.36, y=0.08)
    axes.set_xlabel("processor time of one run [s]")
    axes.set_ylabel("size over the raw size [dB]" if kind is None else "error [dB]")
    axes.grid(alpha=0.25)
    if any(row.predicted_error_db is not None for row in rows):
        axes.plot([], [], "_", color=CLASS_COLOURS[5], ms=9, label="expected by the planner")
        axes.legend(fontsize=7, loc="lower left")
    if any(row.error_db <= EXACT_DB for row in rows):
        axes.text(0.01, 0.02, "at the bottom: no error at all", transform=axes.transAxes, fontsize=7, color="0.4")
    return figure


def draw_all(rows: Sequence[Row], kinds: dict[str, str | None], folder: Path | str) -> list[Path]:
    """A PNG for each task, named after it."""
    os.makedirs(folder, exist_ok=True)
    made = []
    for task in dict.fromkeys(row.task for row in rows):
        figure = draw([row for row in rows if row.task == task], kinds[task], task)
        path = Path(folder) / f"{task}.png"
        figure.savefig(path, metadata={"Software": None})
        made.append(path)
    return made

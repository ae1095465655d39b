"""Checks: a number against what it should be. They are kept in the products file, so that every report shows them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from polfuse_lab.products.store import Products

STAGE = "checks"


@dataclass(frozen=True)
class Check:
    """One comparison: passed when ``value`` is within ``tolerance`` of ``expected`` (or beyond it, see ``sense``)."""

    name: str
    """Short identifier such as ``dihedral_rcs``."""
    value: float
    expected: float
    tolerance: float
    unit: str = ""
    meaning: str = ""
    """One sentence for the report: what is compared, and where the expected value comes from."""
    sense: str = "within"
    """``"within"``: |value - expected| <= tolerance; ``"at_least"``: value >= expected - tolerance."""

    @property
    def ok(self) -> bool:
        """Whether it holds; never for an undefined value."""
        if not (math.isfinite(self.value) and math.isfinite(self.expected) and math.isfinite(self.tolerance)):
            return False
        if self.sense == "at_least":
            return self.value >= self.expected - self.tolerance
        return abs(self.value - self.expected) <= self.tolerance

    def fields(self) -> dict[str, Any]:
        """``value``, ``expected``, ``tolerance``, ``ok``, ``unit``, ``meaning``."""
        return {
            "value": self.value,
            "expected": self.expected,
            "tolerance": self.tolerance,
            "ok": self.ok,
            "unit": self.unit,
            "meaning": self.meaning,
        }


def write_checks(products: Path | str, checks: Iterable[Check], *, inputs: Iterable[Path | str] = ()) -> None:
    """Keep checks in the products file as stage ``"checks"``. Raises as :meth:`Products.write`."""
    items = list(checks)
    Products(products).write(
        STAGE,
        {
            "value": np.array([item.value for item in items]),
            "expected": np.array([item.expected for item in items]),
            "tolerance": np.array([item.tolerance for item in items]),
            "ok": np.array([item.ok for item in items], dtype=bool),
        },
        settings={
            "names": [item.name for item in items],
            "units": [item.unit for item in items],
            "meanings": [item.meaning for item in items],
            "senses": [item.sense for item in items],
        },
        inputs=[*inputs, products],
        units={},
    )


def read_checks(products: Path | str) -> list[Check]:
    """Checks kept in a products file; none where nobody has made any."""
    store = Products(products)
    if STAGE not in store.stages():
        return []
    arrays, settings = store.read(STAGE), store.settings(STAGE)
    columns = (settings["names"], arrays["value"], arrays["expected"], arrays["tolerance"])
    texts = (settings["units"], settings["meanings"], settings["senses"])
    return [
        Check(str(name), float(value), float(expected), float(tolerance), unit, meaning, sense)
        for name, value, expected, tolerance, unit, meaning, sense in zip(*columns, *texts, strict=True)
    ]


def as_json(checks: Iterable[Check]) -> Mapping[str, dict[str, Any]]:
    """Checks by name, as the command line prints them."""
    return {check.name: check.fields() for check in checks}

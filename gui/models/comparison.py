"""What stands in a file that is compared with another: its pictures, and what they were made with."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from polfuse_lab.products.pictures import picture_names
from polfuse_lab.products.store import Products, is_products
from polfuse_lab.session import info


@dataclass(frozen=True)
class Side:
    """One of the two files."""

    path: Path
    products: Path | None
    """Where its pictures are: itself, or the products beside a session."""
    pictures: tuple[tuple[str, str], ...]
    """Name and title of each."""
    facts: dict[str, str]


def side_of(path: Path) -> Side:
    """Look into a session or a products file.

    Raises:
        PolfuseError: it is neither.
    """
    facts: dict[str, str] = {}
    products: Path | None = path if is_products(path) else None
    if products is None:
        told = info(path)
        facts |= {f"session: {key}": text for key, value in told.items() if (text := _text(value))}
        beside = path.with_name(f"{path.stem}-products.h5")
        products = beside if beside.is_file() and is_products(beside) else None
    if products is None:
        return Side(path, None, (), facts)
    opened = Products(products)
    for stage in opened.stages():
        facts |= {f"{stage}: {key}": text for key, value in opened.settings(stage).items() if (text := _text(value))}
    return Side(path, products, tuple(picture_names(opened)), facts)


def differences(left: Side, right: Side) -> list[tuple[str, str, str]]:
    """Facts that are not the same: what, left, right."""
    keys = [*left.facts, *(key for key in right.facts if key not in left.facts)]
    pairs = ((key, left.facts.get(key, "–"), right.facts.get(key, "–")) for key in keys)
    return [(key, one, other) for key, one, other in pairs if one != other]


def _text(value: Any) -> str:
    """Short facts only: numbers, words, and short lists of them."""
    if isinstance(value, bool | int | str) or value is None:
        text = str(value)
    elif isinstance(value, float):
        text = f"{value:.6g}"
    elif isinstance(value, list | tuple) and all(isinstance(part, int | float | str) for part in value):
        text = ", ".join(f"{part:.6g}" if isinstance(part, float) else str(part) for part in value)
    else:
        return ""
    return text if len(text) <= 60 else ""

"""Build the page from a products file."""

from __future__ import annotations

import json
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

from jinja2 import Environment, StrictUndefined
from markupsafe import Markup

from polfuse_lab.errors import PolfuseError
from polfuse_lab.products.checks import read_checks
from polfuse_lab.products.store import Products
from polfuse_lab.report.calibration import calibration_tables
from polfuse_lab.report.numbers import stage_numbers
from polfuse_lab.report.pictures import Picture, stage_pictures
from polfuse_lab.report.text import Number, check_texts, size_text, value_text


def report(
    products_path: Path | str,
    out: Path | str,
    *,
    title: str = "",
    pictures: Sequence[Picture] | None = None,
    numbers: Sequence[Number] | None = None,
) -> Path:
    """Write one self-contained HTML page about a products file.

    Args:
        products_path: the products file; whatever stages it has are shown.
        out: the page, made anew.
        title: heading; default: from the rig's and the plan's names, or the file's.
        pictures: figures to show; default: drawn from the stages present.
        numbers: table of numbers; default: from the stages present.

    Returns:
        ``out``.

    Raises:
        PolfuseError: no products file, an empty one, or the page cannot be written.
    """
    products, out = Products(products_path), Path(out)
    if not products.stages():
        raise PolfuseError(
            "there is nothing to report", where=str(products.path), advice="make products with 'polfuse focus' first"
        )
    checks = read_checks(products.path)
    page = _template().render(
        title=title or _title(products),
        lead=_lead(products),
        css=_part("page.css"),
        script=_part("page.js"),
        numbers=stage_numbers(products) if numbers is None else numbers,
        tables=calibration_tables(products),
        checks=checks,
        all_ok=all(check.ok for check in checks),
        failed=sum(not check.ok for check in checks),
        pictures=stage_pictures(products) if pictures is None else pictures,
        stages=[_stage(products, name) for name in products.stages()],
        products_name=products.path.name,
        value_text=value_text,
        check_texts=check_texts,
    )
    try:
        out.write_text(page, encoding="utf-8")
    except OSError as error:
        raise PolfuseError(
            f"the report cannot be written ({error.strerror})", where=str(out), advice="check the folder"
        ) from error
    return out


def _title(products: Products) -> str:
    stages = set(products.stages())
    kind = "Radar and light" if {"focus", "optics"} <= stages else "Radar" if "focus" in stages else "Light"
    return f"{kind}: {products.path.stem}"


def _lead(products: Products) -> str:
    stages = products.stages()
    newest = max(products.provenance(name)["time_utc"] for name in stages)
    return f"{products.path.name}, stages {', '.join(stages)}; last changed {newest.replace('T', ' ')}."


def _part(name: str) -> Markup:
    return Markup(files(__package__).joinpath(name).read_text(encoding="utf-8"))


def _template() -> Any:
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    return environment.from_string(files(__package__).joinpath("page.html").read_text(encoding="utf-8"))


def _stage(products: Products, name: str) -> dict[str, Any]:
    origin = products.provenance(name)
    arrays = products.read(name)
    shapes = ", ".join(f"{key} {'×'.join(map(str, value.shape)) or 'scalar'}" for key, value in arrays.items())
    return {
        "name": name,
        "time_utc": origin["time_utc"],
        "inputs": [
            {"name": Path(item["path"]).name, "size": size_text(item["bytes"]), "sha256": item["sha256"]}
            for item in origin["inputs"]
        ],
        "from_stages": sorted(origin["stages"].items()),
        "sha256": origin["sha256"],
        "arrays": shapes,
        "host": f"{origin['host']} ({origin['system']})",
        "versions": ", ".join(f"{key} {value}" for key, value in origin["versions"].items()),
        "settings": [(key, _setting(value)) for key, value in origin["settings"].items()],
    }


def _setting(value: Any) -> str:
    text = value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)
    return text if len(text) <= 2_000 else f"{text[:2_000]} …"

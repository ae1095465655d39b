"""Where an image lies: the rig file that tells it, and maps that hold it."""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from polfuse_lab.errors import PolfuseError
from polfuse_lab.exports.layers import Layer
from polfuse_lab.exports.wgs84 import Placement, sagitta_m
from polfuse_lab.products.store import Products
from polfuse_lab.rig import Rig, load_rig

EXTRA = "polfuse-lab[exports]"
"""What has to be installed for formats that need other packages."""


@dataclass(frozen=True)
class MapGrid:
    """An affine map of a layer's pixels, written from the furthest row on, in a projection of the earth."""

    epsg: int
    transform: tuple[float, float, float, float, float, float]
    """a, b, c, d, e, f: easting = a column + b row + c, northing = d column + e row + f, from the corner of the first
    pixel (as GDAL has it)."""
    error_m: float
    """Largest distance between the map and the exact projection of pixels, m."""


def needed(package: str, for_what: str) -> Any:
    """A package that only some exports need. Raises PolfuseError where it is not installed."""
    try:
        return importlib.import_module(package)
    except ImportError as error:
        raise PolfuseError(
            f"needs the package {package.split('.')[0]}, which is not installed",
            where=for_what,
            advice=f"install it with: pip install '{EXTRA}'",
        ) from error


def rig_of(products: Products, rig: Path | str | None) -> Rig | None:
    """The rig file given, or that of the session that the image was focused from; None where neither is there.

    Raises:
        PolfuseError: the given file cannot be read.
    """
    if rig is not None:
        return load_rig(rig)
    session = session_of(products)
    if session is None:
        return None
    from polfuse_lab.session import open_session

    with open_session(session) as opened:
        return opened.rig


def session_of(products: Products) -> Path | None:
    """The session that the image was focused from, if it is still where it was."""
    if "focus" not in products.stages():
        return None
    for item in products.provenance("focus")["inputs"][:1]:
        if (path := Path(item["path"])).exists():
            return path
    return None


def placement_of(products: Products, rig: Path | str | None, *, for_what: str) -> Placement:
    """Where the rig stands on the earth.

    Raises:
        PolfuseError: nothing tells it.
    """
    found = rig_of(products, rig)
    if found is None or found.site is None:
        where = str(rig) if rig is not None else str(products.path)
        what = "its rig file has no [site]" if found is not None else "the session with its rig file is not there"
        raise PolfuseError(
            f"{for_what} needs the place on the earth, and {what}",
            where=where,
            advice="add [site] with latitude_deg, longitude_deg, height_m and heading_deg to the rig file and give it "
            "with --rig",
        )
    return Placement(found.site)


def map_grid(layer: Layer, placement: Placement) -> MapGrid:
    """The layer's pixels in UTM (polar stereographic beyond 84 degrees), as the affine map nearest to the exact one.

    Raises:
        PolfuseError: pyproj is not installed, or the layer has no place on the ground.
    """
    pyproj = needed("pyproj", "export")
    layer.on_the_ground()
    site = placement.site
    epsg = _epsg(site.latitude_deg, site.longitude_deg)
    to_map = pyproj.Transformer.from_crs("EPSG:4979", f"EPSG:{epsg}", always_xy=True)
    rows, columns = layer.shape
    # Corners, edges' middles and the centre of the image, in pixels from the corner of the first written one.
    column, row = (part.ravel() for part in np.meshgrid(np.linspace(0, columns, 5), np.linspace(0, rows, 5)))
    step_x, step_y = layer.step_m
    x = layer.x_m[0] + (column - 0.5) * step_x
    y = layer.y_m[-1] - (row - 0.5) * step_y
    lat, lon, _ = placement.geodetic(np.stack([x, y, np.full_like(x, layer.z_m)], axis=-1)).T
    easting, northing = to_map.transform(lon, lat)
    # Around the middle, for the last digits of coordinates of millions of metres.
    known = np.stack([column - columns / 2, row - rows / 2, np.ones_like(row)], axis=-1)
    east, north = (np.linalg.lstsq(known, values, rcond=None)[0] for values in (easting, northing))
    error = np.hypot(known @ east - easting, known @ north - northing).max()
    corner = [float(c[2] - c[0] * columns / 2 - c[1] * rows / 2) for c in (east, north)]
    transform = (float(east[0]), float(east[1]), corner[0], float(north[0]), float(north[1]), corner[1])
    return MapGrid(epsg, transform, float(error))


def flat_error_m(layer: Layer) -> float:
    """Height by which the image's flat ground departs from the ellipsoid at its furthest pixel, m."""
    furthest = np.hypot(np.abs(layer.x_m).max(), np.abs(layer.y_m).max())
    return sagitta_m(float(furthest))


def _epsg(latitude_deg: float, longitude_deg: float) -> int:
    if latitude_deg > 84:
        return 32661
    if latitude_deg < -80:
        return 32761
    zone = int((longitude_deg + 180) // 6) % 60 + 1
    return (32600 if latitude_deg >= 0 else 32700) + zone

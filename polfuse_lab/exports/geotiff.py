"""A layer as a GeoTIFF, placed by the rig's position and heading."""

from __future__ import annotations

import json
import warnings

import numpy as np

from polfuse_lab.errors import PolfuseError
from polfuse_lab.exports.formats import Exported, Request, unwritable
from polfuse_lab.exports.layers import layer_of
from polfuse_lab.exports.placing import flat_error_m, map_grid, needed, placement_of
from polfuse_lab.products.provenance import versions


def run(request: Request) -> Exported:
    """Write ``OUTPUT``; the default layer is "db" (levels of the channels).

    Bands are float32 or complex64 exactly as in the products file (NaN where undefined), or colours with opacity, the
    furthest row first. The transform turns the image to its heading; nothing is resampled. Its error against the
    exact projection of each pixel is told.

    Raises:
        PolfuseError: no such layer, no place on the earth, rasterio or pyproj not installed, or no room.
    """
    placement = placement_of(request.products, request.rig, for_what="a GeoTIFF")
    layer = layer_of(request.products, request.layer or "db")
    rasterio = needed("rasterio", "export --to geotiff")
    grid = map_grid(layer, placement)
    values = layer.top_down
    told = {
        "layer": layer.name,
        "unit": layer.unit,
        "source": request.products.path.name,
        "provenance": json.dumps(
            {"sha256": request.products.provenance(layer.stage)["sha256"], "versions": versions()}
        ),
        "map_error_m": f"{grid.error_m:.3g}",
        "flat_ground_error_m": f"{flat_error_m(layer):.3g}",
        "heading_deg": f"{placement.site.heading_deg!r}",
    }
    fresh = request.output.with_name(f"{request.output.name}.new")
    try:
        request.output.parent.mkdir(parents=True, exist_ok=True)
        with warnings.catch_warnings(), rasterio.open(
            fresh, "w", driver="GTiff", height=layer.shape[0], width=layer.shape[1], count=len(values),
            dtype=values.dtype.name, crs=f"EPSG:{grid.epsg}", transform=rasterio.Affine(*grid.transform),
            compress="deflate", nodata=None if values.dtype == np.uint8 else float("nan"),
            **({"photometric": "RGB"} if values.dtype == np.uint8 else {}),
        ) as file:  # fmt: skip
            file.write(values)
            file.update_tags(**told)
            for number, name in enumerate(layer.bands, 1):
                file.set_band_description(number, name)
        fresh.replace(request.output)
    except OSError as error:
        raise unwritable(request.output, error) from error
    except rasterio.errors.RasterioError as error:
        raise PolfuseError(
            f"cannot be written ({error})", where=str(request.output), advice="check the folder and the disk's space"
        ) from error
    finally:
        fresh.unlink(missing_ok=True)
    values_told = {"epsg": grid.epsg, "map_error_m": grid.error_m, "flat_ground_error_m": flat_error_m(layer)}
    return Exported((request.output,), layer.name, values_told)

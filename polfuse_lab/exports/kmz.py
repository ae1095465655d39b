"""A layer as an overlay for Google Earth and other viewers of KML, with the fan masked (thesis Fig. 5.10)."""

from __future__ import annotations

import io
import zipfile
from xml.sax.saxutils import escape

import numpy as np
from numpy.typing import NDArray

from polfuse_lab.exports.formats import Exported, Request, written
from polfuse_lab.exports.layers import Layer
from polfuse_lab.exports.pictures import picture_of, png_bytes, provenance_words
from polfuse_lab.exports.placing import placement_of
from polfuse_lab.exports.wgs84 import Placement, ecef_of_geodetic

MOST_PIXELS = 4096
"""Width and height of the overlay's picture, at most: what viewers take as one texture."""


def run(request: Request) -> Exported:
    """Write ``OUTPUT``: an overlay to the north, transparent outside the fan, and a mark and a line at the rig.

    Viewers take overlays along meridians and parallels only, so the picture is turned to north: each of its pixels has
    the colour of the image's nearest one. Needs no other package.

    Raises:
        PolfuseError: no such layer, no place on the earth, or no room.
    """
    placement = placement_of(request.products, request.rig, for_what="a KMZ overlay")
    layer = picture_of(request.products, request.layer)
    layer.on_the_ground()
    colours, (south, north, west, east) = turned_to_north(layer, placement)
    told = provenance_words(request.products, layer)
    document = _kml(layer, placement, (south, north, west, east), str(told["Software"]))
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in (("doc.kml", document.encode()), ("overlay.png", png_bytes(colours, told))):
            # A date of its own would make every file another one.
            archive.writestr(zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0)), content, zipfile.ZIP_DEFLATED)
    values = {"south": south, "north": north, "west": west, "east": east}
    return Exported((written(request.output, stream.getvalue()),), layer.name, values)


def turned_to_north(layer: Layer, placement: Placement) -> tuple[NDArray[np.uint8], tuple[float, float, float, float]]:
    """Colours (4, rows, columns) with north up, and south, north, west and east of its outer edges, degrees."""
    (dx, dy), z = layer.step_m, layer.z_m
    corners = [
        (x, y, z)
        for x in (layer.x_m[0] - dx / 2, layer.x_m[-1] + dx / 2)
        for y in (layer.y_m[0] - dy / 2, layer.y_m[-1] + dy / 2)
    ]
    found = placement.geodetic(np.array(corners))
    south, west = found[:, :2].min(axis=0)
    north, east = found[:, :2].max(axis=0)
    height = float(found[:, 2].mean())
    # Metres of the box, and pixels not larger than the image's.
    middle = (south + north) / 2, (west + east) / 2
    wide = float(np.linalg.norm(np.diff(ecef_of_geodetic([middle[0]] * 2, [west, east], height), axis=0)))
    tall = float(np.linalg.norm(np.diff(ecef_of_geodetic([south, north], [middle[1]] * 2, height), axis=0)))
    step = max(min(dx, dy) / 2, max(wide, tall) / MOST_PIXELS)
    columns, rows = max(int(np.ceil(wide / step)), 1), max(int(np.ceil(tall / step)), 1)
    lon = west + (np.arange(columns) + 0.5) / columns * (east - west)
    lat = north - (np.arange(rows) + 0.5) / rows * (north - south)
    grid = np.stack(np.broadcast_arrays(lat[:, None], lon[None, :], np.float64(height)), axis=-1)
    local = placement.local(grid)
    column = np.rint((local[..., 0] - layer.x_m[0]) / dx).astype(np.int64)
    row = np.rint((local[..., 1] - layer.y_m[0]) / dy).astype(np.int64)
    inside = (column >= 0) & (column < layer.shape[1]) & (row >= 0) & (row < layer.shape[0])
    colours = layer.values[:, np.where(inside, row, 0), np.where(inside, column, 0)]
    colours[3] = np.where(inside, colours[3], 0)
    return colours, (float(south), float(north), float(west), float(east))


def _kml(layer: Layer, placement: Placement, box: tuple[float, float, float, float], software: str) -> str:
    site = placement.site
    south, north, west, east = box
    ahead = placement.geodetic([0.0, float(layer.y_m[-1]), 0.0])
    name = escape(f"{layer.name} of {layer.where.rsplit('/', 1)[-1]}")
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<kml xmlns="http://www.opengis.net/kml/2.2">
<Document>
<name>{name}</name>
<description>{escape(software)}</description>
<GroundOverlay>
<name>{name}</name>
<Icon><href>overlay.png</href></Icon>
<LatLonBox><north>{north:.10f}</north><south>{south:.10f}</south><east>{east:.10f}</east><west>{west:.10f}</west>\
</LatLonBox>
</GroundOverlay>
<Placemark>
<name>rig</name>
<description>heading {site.heading_deg:g} degrees from true north</description>
<Point><coordinates>{site.longitude_deg:.10f},{site.latitude_deg:.10f},0</coordinates></Point>
</Placemark>
<Placemark>
<name>line of sight</name>
<LineString><tessellate>1</tessellate><coordinates>{site.longitude_deg:.10f},{site.latitude_deg:.10f},0 \
{ahead[1]:.10f},{ahead[0]:.10f},0</coordinates></LineString>
</Placemark>
</Document>
</kml>
"""

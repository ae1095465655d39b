"""A picture of a layer with a world file, and its provenance inside."""

from __future__ import annotations

from polfuse_lab.errors import PolfuseError
from polfuse_lab.exports.formats import Exported, Request, written
from polfuse_lab.exports.pictures import picture_of, png_bytes, provenance_words
from polfuse_lab.exports.placing import map_grid, needed, rig_of
from polfuse_lab.exports.wgs84 import Placement


def run(request: Request) -> Exported:
    """Write ``OUTPUT`` and its world file ``.pgw``: one colour for each pixel, the furthest row first.

    The world file holds UTM, with ``.prj`` beside it, where the rig file tells the place on the earth; else metres in
    the rig's coordinates. An imported image without a place on the ground gets none.

    Raises:
        PolfuseError: no such layer, pyproj not installed where it is needed, or no room.
    """
    if request.output.suffix.lower() != ".png":
        raise PolfuseError("a PNG is written", where=str(request.output), advice="give a name that ends in .png")
    layer = picture_of(request.products, request.layer)
    files = [written(request.output, png_bytes(layer.top_down, provenance_words(request.products, layer)))]
    if not layer.ground:
        return Exported(
            tuple(files), layer.name, note="the image has no place on the ground, so there is no world file"
        )
    rig = rig_of(request.products, request.rig)
    if rig is None or rig.site is None:
        (dx, dy), left, top = layer.step_m, layer.x_m[0], layer.y_m[-1]
        lines = (dx, 0.0, 0.0, -dy, left, top)
        note = "the world file is in metres of the rig's coordinates: no [site] tells the place on the earth"
        values: dict[str, object] = {"epsg": None}
    else:
        grid = map_grid(layer, Placement(rig.site))
        a, b, c, d, e, f = grid.transform
        # A world file tells the middle of the first pixel.
        lines, note = (a, d, b, e, c + (a + b) / 2, f + (d + e) / 2), ""
        values = {"epsg": grid.epsg, "map_error_m": grid.error_m}
        words = needed("pyproj", "export --to png").CRS.from_epsg(grid.epsg).to_wkt("WKT1_ESRI")
        files.append(written(request.output.with_suffix(".prj"), words.encode()))
    world = "".join(f"{float(value)!r}\n" for value in lines)
    files.append(written(request.output.with_suffix(".pgw"), world.encode("ascii")))
    return Exported(tuple(files), layer.name, values, note)

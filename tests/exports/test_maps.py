"""Exports to GIS: places on the earth against PROJ, values read back by rasterio, masks, world files, refusals."""

from __future__ import annotations

import io
import json
import xml.etree.ElementTree as ElementTree
import zipfile
from pathlib import Path

import numpy as np
import pytest
from export_stand import CHANNELS, products_file, rig_file
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image
from typer.testing import CliRunner

from polfuse_lab.cli import build
from polfuse_lab.errors import PolfuseError
from polfuse_lab.exports.formats import FORMATS, Request, export
from polfuse_lab.exports.layers import layer_of
from polfuse_lab.exports.wgs84 import Placement, ecef_of_geodetic, geodetic_of_ecef, sagitta_m
from polfuse_lab.products.decompose import decompose
from polfuse_lab.products.store import Products
from polfuse_lab.rig import Site, load_rig


def placement(heading: float = 30.0, latitude: float = 39.78) -> Placement:
    return Placement(Site(latitude_deg=latitude, longitude_deg=-84.08, height_m=240.0, heading_deg=heading))


def made(tmp_path: Path, to: str, output: str, layer: str | None = None, heading: float = 30.0) -> tuple[Path, ...]:
    path = products_file(tmp_path / "p.h5")
    rig = rig_file(tmp_path / "rig.toml", heading) if "rig" in FORMATS[to].options else None
    return export(Request(Products(path), tmp_path / output, layer, rig), to).files


@given(st.floats(-90, 90), st.floats(-180, 180), st.floats(-1000, 100_000))
@settings(deadline=None)
def test_geodetic_and_back(latitude: float, longitude: float, height: float) -> None:
    found = geodetic_of_ecef(ecef_of_geodetic(latitude, longitude, height))
    # A nanometre is 1e-14 degrees of latitude; doubles of 6e6 m hold 1e-9 m: 2e-14 degrees, eight of them.
    np.testing.assert_allclose(found[0], latitude, atol=2e-13)
    np.testing.assert_allclose(found[2], height, atol=5e-9)
    turn = (found[1] - longitude + 180) % 360 - 180
    assert abs(turn) * np.cos(np.radians(latitude)) < 2e-13


def test_earth_centred_coordinates_are_proj_s() -> None:
    pyproj = pytest.importorskip("pyproj")
    to_ecef = pyproj.Transformer.from_crs("EPSG:4979", "EPSG:4978", always_xy=True)
    rng = np.random.default_rng(1)
    lat, lon, h = rng.uniform(-90, 90, 200), rng.uniform(-180, 180, 200), rng.uniform(-500, 9000, 200)
    expected = np.stack(to_ecef.transform(lon, lat, h), axis=-1)
    np.testing.assert_allclose(ecef_of_geodetic(lat, lon, h), expected, atol=1e-8)


def test_the_rig_s_axes_point_where_its_heading_says() -> None:
    # Looking east, x (right of the line of sight) points south; 111.32 km are a degree of longitude at the equator.
    here = Placement(Site(latitude_deg=0.0, longitude_deg=10.0, height_m=0.0, heading_deg=90.0))
    east = here.geodetic([0.0, 100.0, 0.0])
    np.testing.assert_allclose(east[:2], [0.0, 10 + np.degrees(100 / 6378137)], atol=1e-9)
    south = here.geodetic([100.0, 0.0, 0.0])
    assert south[0] < 0
    np.testing.assert_allclose(south[1], 10, atol=1e-12)
    np.testing.assert_allclose(here.geodetic([0.0, 0.0, 7.0]), [0, 10, 7], atol=1e-9)
    # Right-handed unit vectors, there and back.
    np.testing.assert_allclose(here.axes @ here.axes.T, np.eye(3), atol=1e-15)
    np.testing.assert_allclose(np.linalg.det(placement().axes), 1, atol=1e-15)
    points = np.random.default_rng(2).normal(size=(20, 3)) * 50
    np.testing.assert_allclose(placement().local(placement().geodetic(points)), points, atol=2e-8)
    # Flat ground rises above the ellipsoid by d^2 / 2R, along meridians and parallels to a part in 150.
    np.testing.assert_allclose(placement().geodetic([0.0, 1000.0, 0.0])[2] - 240, sagitta_m(1000.0), rtol=0.01)


@pytest.mark.parametrize(("layer", "count"), [("scattering", 4), ("db", 4), ("pauli", 4), ("freeman", 3)])
@pytest.mark.parametrize("heading", [0.0, 30.0, 200.0])
def test_rasterio_reads_back_what_was_written(tmp_path: Path, layer: str, count: int, heading: float) -> None:
    rasterio, pyproj = pytest.importorskip("rasterio"), pytest.importorskip("pyproj")
    path = products_file(tmp_path / "p.h5")
    if layer == "freeman":
        decompose(path, "freeman", window=3)
    rig = rig_file(tmp_path / "rig.toml", heading)
    done = export(Request(Products(path), tmp_path / "out.tif", layer, rig), "geotiff")
    known = layer_of(Products(path), layer)
    with rasterio.open(done.files[0]) as file:
        np.testing.assert_array_equal(file.read(), known.values[:, ::-1])
        assert file.count == count
        assert file.descriptions == known.bands
        assert file.crs.to_epsg() == 32616  # UTM zone 16 north: 90 to 84 degrees west
        to_map = pyproj.Transformer.from_crs("EPSG:4979", file.crs, always_xy=True)
        for row, column in ((0, 0), (7, 20), (29, 23)):
            lat, lon, _ = placement(heading).geodetic([known.x_m[column], known.y_m[row], known.z_m])
            # Pixel (row, column) of the products file is row 29 - row of the map.
            np.testing.assert_allclose(file.xy(29 - row, column), to_map.transform(lon, lat), atol=1e-5)
    # Over 17 m the projection bends by less than 10 micrometres; the ground departs by 22.
    assert done.values["map_error_m"] < 1e-5
    np.testing.assert_allclose(done.values["flat_ground_error_m"], (16.7**2 + 1.2**2) / 2 / 6378137, rtol=1e-3)


@pytest.mark.parametrize(("latitude", "epsg"), [(-33.0, 32716), (85.0, 32661), (-89.0, 32761)])
def test_maps_everywhere(tmp_path: Path, latitude: float, epsg: int) -> None:
    rasterio = pytest.importorskip("rasterio")
    rig = rig_file(tmp_path / "rig.toml")
    rig.write_text(rig.read_text(encoding="utf-8").replace("latitude_deg = 39.78\nl", f"latitude_deg = {latitude}\nl"))
    path = products_file(tmp_path / "p.h5")
    done = export(Request(Products(path), tmp_path / "out.tif", None, rig), "geotiff")
    with rasterio.open(done.files[0]) as file:
        assert file.crs.to_epsg() == epsg
    assert done.values["map_error_m"] < 1e-4


@pytest.mark.parametrize("layer", ["scattering", "db"])
def test_envi_round_trip(tmp_path: Path, layer: str) -> None:
    rasterio = pytest.importorskip("rasterio")
    path, header = made(tmp_path, "envi", "out.dat", layer)
    known = layer_of(Products(tmp_path / "p.h5"), layer)
    kind = "<c8" if layer == "scattering" else "<f4"
    np.testing.assert_array_equal(np.fromfile(path, kind).reshape(4, 30, 24), known.values[:, ::-1])
    assert f"data type = {6 if layer == 'scattering' else 4}" in header.read_text()
    with rasterio.open(path) as file:
        np.testing.assert_array_equal(file.read(), known.values[:, ::-1])
        np.testing.assert_allclose(file.xy(29, 0), [known.x_m[0], known.y_m[0]], atol=1e-12)
        np.testing.assert_allclose(file.xy(0, 23), [known.x_m[-1], known.y_m[-1]], atol=1e-12)


def test_png_with_world_file_and_provenance(tmp_path: Path) -> None:
    path = products_file(tmp_path / "p.h5")
    # Without a place on the earth: metres of the rig's coordinates.
    done = export(Request(Products(path), tmp_path / "a.png", None, rig_file(tmp_path / "r.toml", None)), "png")
    known = layer_of(Products(path), "pauli")
    with Image.open(done.files[0]) as picture:
        shown = np.moveaxis(np.asarray(picture), -1, 0)
        assert json.loads(picture.text["Provenance"])["stage"] == "calibration"  # type: ignore[attr-defined]
    np.testing.assert_array_equal(shown, known.values[:, ::-1])
    # The undefined corner, the nearest rows at the left, is transparent, and nothing else is.
    assert (shown[3, -4:, :3] == 0).all()
    assert (shown[3] == 0).sum() == 12
    numbers = [float(line) for line in (tmp_path / "a.pgw").read_text().split()]
    np.testing.assert_allclose(numbers, [0.1, 0, 0, -0.3, -1.2, 16.7], atol=1e-12)
    assert "no [site]" in done.note
    # With one: the same map as the GeoTIFF's, by the middle of the first pixel.
    rasterio = pytest.importorskip("rasterio")
    rig = rig_file(tmp_path / "rig.toml")
    done = export(Request(Products(path), tmp_path / "b.png", None, rig), "png")
    assert {file.suffix for file in done.files} == {".png", ".pgw", ".prj"}
    export(Request(Products(path), tmp_path / "b.tif", "pauli", rig), "geotiff")
    a, d, b, e, c, f = (float(line) for line in (tmp_path / "b.pgw").read_text().split())
    with rasterio.open(tmp_path / "b.tif") as file:
        np.testing.assert_allclose(file.xy(5, 9), [a * 9 + b * 5 + c, d * 9 + e * 5 + f], atol=1e-8)
    with rasterio.open(tmp_path / "b.png") as file:
        assert file.crs is None or file.crs.to_epsg() in (32616, None)
        np.testing.assert_allclose(file.xy(5, 9), [a * 9 + b * 5 + c, d * 9 + e * 5 + f], atol=1e-8)


@pytest.mark.parametrize("heading", [0.0, 75.0])
def test_kmz_shows_each_pixel_where_it_is_and_masks_the_rest(tmp_path: Path, heading: float) -> None:
    (path,) = made(tmp_path, "kmz", "out.kmz", heading=heading)
    with zipfile.ZipFile(path) as archive:
        assert archive.namelist() == ["doc.kml", "overlay.png"]
        root = ElementTree.fromstring(archive.read("doc.kml"))
        colours = np.asarray(Image.open(io.BytesIO(archive.read("overlay.png"))))
    names = {"k": "http://www.opengis.net/kml/2.2"}
    box = {
        side: float(root.findtext(f".//k:LatLonBox/k:{side}", "", names)) for side in ("north", "south", "east", "west")
    }
    known = layer_of(Products(tmp_path / "p.h5"), "pauli")
    rows, columns = colours.shape[:2]
    for row, column in np.ndindex(known.shape):
        lat, lon, _ = placement(heading).geodetic([known.x_m[column], known.y_m[row], known.z_m])
        r = (box["north"] - lat) / (box["north"] - box["south"]) * rows
        c = (lon - box["west"]) / (box["east"] - box["west"]) * columns
        np.testing.assert_array_equal(colours[int(r), int(c)], known.values[:, row, column])
    # The fan's share of the overlay: its own area over the box's, less the undefined pixels.
    tall, wide = (
        (box["north"] - box["south"]) * 111_035,
        (box["east"] - box["west"]) * 111_320 * np.cos(np.radians(39.78)),
    )
    share = 0.1 * 0.3 * (30 * 24 - 12) / (tall * wide)
    np.testing.assert_allclose((colours[..., 3] > 0).mean(), share, rtol=0.02)
    point = root.findtext(".//k:Point/k:coordinates", "", names).split(",")
    np.testing.assert_allclose([float(p) for p in point[:2]], [-84.08, 39.78], atol=1e-9)


def test_the_same_products_give_the_same_bytes(tmp_path: Path) -> None:
    path, rig = products_file(tmp_path / "p.h5"), rig_file(tmp_path / "rig.toml")
    for to, name in (("kmz", "kmz"), ("png", "png"), ("envi", "dat")):
        contents = []
        for turn in "ab":
            request = Request(Products(path), tmp_path / turn / f"o.{name}", None, None if to == "envi" else rig)
            contents.append([file.read_bytes() for file in export(request, to).files])
        assert contents[0] == contents[1]


def test_what_cannot_be_exported_is_said(tmp_path: Path) -> None:
    path, nowhere = products_file(tmp_path / "p.h5", calibrated=False), rig_file(tmp_path / "r.toml", None)
    products = Products(path)
    for to in ("kmz", "geotiff"):
        with pytest.raises(PolfuseError, match=r"needs the place on the earth, and its rig file has no \[site\]"):
            export(Request(products, tmp_path / "o.x", "db", nowhere), to)
        with pytest.raises(PolfuseError, match="the session with its rig file is not there"):
            export(Request(products, tmp_path / "o.x", "db"), to)
    with pytest.raises(PolfuseError, match="no calibrated polarimetric image"):
        export(Request(products, tmp_path / "o.png", "pauli"), "png")
    with pytest.raises(PolfuseError, match="has no layer 'magic'"):
        export(Request(products, tmp_path / "o.dat", "magic"), "envi")
    with pytest.raises(PolfuseError, match="no format 'word'"):
        export(Request(products, tmp_path / "o"), "word")
    with pytest.raises(PolfuseError, match="envi takes no --rig"):
        export(Request(products, tmp_path / "o", None, nowhere), "envi")
    with pytest.raises(PolfuseError, match=r"ends in \.png"):
        export(Request(products, tmp_path / "o.jpg"), "png")
    with pytest.raises(PolfuseError, match="no such products file"):
        export(Request(Products(tmp_path / "none.h5"), tmp_path / "o"), "envi")
    (tmp_path / "file").write_text("x")
    with pytest.raises(PolfuseError, match="cannot be written"):
        export(Request(products, tmp_path / "file" / "o.dat"), "envi")
    with pytest.raises(PolfuseError, match="no matrix 'X9'"):
        export(Request(products, tmp_path / "o", None, None, "X9"), "polsarpro")


def test_a_missing_package_is_named_with_the_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import sys

    monkeypatch.setitem(sys.modules, "rasterio", None)
    path, rig = products_file(tmp_path / "p.h5"), rig_file(tmp_path / "rig.toml")
    with pytest.raises(PolfuseError, match=r"needs the package rasterio.*polfuse-lab\[exports\]"):
        export(Request(Products(path), tmp_path / "o.tif", None, rig), "geotiff")


def test_imported_matrices_have_pictures_but_no_maps(tmp_path: Path) -> None:
    planes = np.abs(np.random.default_rng(3).normal(size=(9, 8, 10))).astype(np.float32)
    path = tmp_path / "p.h5"
    Products(path).write("matrices", {"planes": planes}, settings={"matrix": "T3"}, inputs=[], units={})
    done = export(Request(Products(path), tmp_path / "o.png"), "png")
    assert [file.suffix for file in done.files] == [".png"]
    assert np.asarray(Image.open(done.files[0])).shape == (8, 10, 4)
    with pytest.raises(PolfuseError, match="imported without a place on the ground"):
        export(Request(Products(path), tmp_path / "o.kmz", None, rig_file(tmp_path / "r.toml")), "kmz")


def test_the_site_is_read_and_checked(tmp_path: Path) -> None:
    rig = load_rig(rig_file(tmp_path / "rig.toml", 45.0))
    assert rig.site == Site(latitude_deg=39.78, longitude_deg=-84.08, height_m=240.0, heading_deg=45.0)
    with pytest.raises(PolfuseError, match="heading_deg: found 400"):
        load_rig(rig_file(tmp_path / "bad.toml", 400.0))


def test_the_command_answers_as_agreed(tmp_path: Path) -> None:
    path, rig = products_file(tmp_path / "p.h5"), rig_file(tmp_path / "rig.toml")
    words = ["export", str(path), "--to", "kmz", "-o", str(tmp_path / "o.kmz"), "--rig", str(rig), "--json"]
    answer = CliRunner().invoke(build(), words)
    assert answer.exit_code == 0, answer.output
    found = json.loads(answer.stdout)
    assert found["files"] == [str(tmp_path / "o.kmz")]
    answer = CliRunner().invoke(
        build(), ["export", str(path), "--to", "polsarpro", "-o", str(tmp_path / "S2"), "--json"]
    )
    assert answer.exit_code == 0, answer.output
    assert len(json.loads(answer.stdout)["files"]) >= 2 * len(CHANNELS)
    answer = CliRunner().invoke(build(), ["export", str(path), "--to", "kmz", "-o", str(tmp_path / "o.kmz")])
    assert answer.exit_code == 1
    assert "[site]" in answer.stderr

"""From a session with a place on the earth over focusing to every format, without telling the rig file again."""

from __future__ import annotations

import importlib
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from export_stand import SITE

from polfuse_lab.exports.collect_time import collect_of
from polfuse_lab.exports.formats import FORMATS, Request, export
from polfuse_lab.products.focus import default_grid, focus
from polfuse_lab.products.store import Products
from polfuse_lab.session import open_session

SUFFIXES = {"geotiff": "tif", "sicd": "nitf", "polsarpro": "", "envi": "dat"}


@pytest.mark.filterwarnings(r"ignore:(read|open)_text is deprecated:DeprecationWarning")
def test_from_the_session_to_every_format(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for package in ("sarkit", "rasterio", "pyproj"):
        pytest.importorskip(package)
    monkeypatch.syspath_prepend(str(Path(__file__).parents[1] / "sar"))
    rail = importlib.import_module("rail_session")
    target = ((0.4, 8.0, -1.069), np.array([[3.0, 1.0], [1.0, 2.0]]))
    path = rail.write_session(
        tmp_path / "s.h5", [target], np.linspace(-0.6, 0.6, 25), rig=rail.RIG + SITE.format(heading=75.0)
    )
    products = Products(tmp_path / "p.h5")
    with open_session(path) as session:
        grid = default_grid(session, x_m=(-1.5, 1.5), y_m=(5.0, 11.0))
        focus(session, products.path, grid=grid)
        # The first record's stamp is 0 on the host's clock, which had its own time when the session began.
        begun = float(session.config["start_unix_s"]) - int(session.config["start_host_ns"]) * 1e-9
    for to in FORMATS:
        if to in ("polsarpro", "png", "kmz"):
            continue  # calibrated images only, or pictures of them
        made = export(Request(products, tmp_path / to / f"o.{SUFFIXES.get(to, to)}"), to)
        assert all(file.stat().st_size for file in made.files)
        if to in ("sicd", "cphd"):
            assert "of the session" in made.note
            from sarkit import verification

            kind = verification.SicdConsistency if to == "sicd" else verification.CphdConsistency
            with made.files[0].open("rb") as stream:
                check = kind.from_file(stream)
            check.check()
            assert check.failures() == {}
    for to, layer in (("png", None), ("kmz", "db")):
        assert export(Request(products, tmp_path / f"o.{to}", layer), to).layer == "db"
    collect = collect_of(products)
    # 25 positions a millisecond apart: the time of a position each.
    np.testing.assert_allclose(collect.duration_s, 0.025, rtol=1e-6)
    assert abs((collect.start - datetime.fromtimestamp(begun, UTC)).total_seconds()) < 1e-3
    np.testing.assert_allclose(collect.places_m(collect.times_s), collect.antenna_m, atol=1e-4)
    # Without the session there is no place on the earth, and times are made.
    path.unlink()
    assert "is not there" in collect_of(products).told

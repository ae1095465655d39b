"""SICD and CPHD: sarkit's own checks, values read back, and the physics of what is written against closed forms."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from export_stand import BANDWIDTH_HZ, CENTRE_HZ, point_profiles, products_file, rig_file

from polfuse_lab.errors import PolfuseError
from polfuse_lab.exports.collect_time import collect_of
from polfuse_lab.exports.cphd import history_of
from polfuse_lab.exports.formats import Request, export
from polfuse_lab.exports.placing import placement_of
from polfuse_lab.exports.sicd import scene_of
from polfuse_lab.exports.wgs84 import Placement
from polfuse_lab.products.store import Products
from processing.radar.profiles import SPEED_OF_LIGHT_M_S, RangeProfiles
from processing.sar.backprojection import backproject
from processing.sar.grid import ImageGrid

pytest.importorskip("sarkit")
# sarkit reads its schemas by functions that Python 3.11 calls deprecated.
pytestmark = pytest.mark.filterwarnings(r"ignore:(read|open)_text is deprecated:DeprecationWarning")

POINT = (0.5, 9.2, -1.07)


def placed(tmp_path: Path) -> tuple[Products, Path, Placement]:
    products, rig = Products(products_file(tmp_path / "p.h5")), rig_file(tmp_path / "rig.toml")
    return products, rig, placement_of(products, rig, for_what="a test")


def failures(kind: str, path: Path) -> dict[str, Any]:
    from sarkit import verification

    with path.open("rb") as stream:
        check = getattr(verification, f"{kind}Consistency").from_file(stream)
    check.check()
    assert check.passes()
    found: dict[str, Any] = check.failures()
    return found


def read_sicd(path: Path) -> tuple[Any, np.ndarray]:
    from sarkit import sicd

    with path.open("rb") as stream, sicd.NitfReader(stream) as reader:
        return sicd.ElementWrapper(reader.metadata.xmltree.getroot()), reader.read_image()


def read_cphd(path: Path, channel: str) -> tuple[Any, np.ndarray, np.ndarray]:
    from sarkit import cphd

    with path.open("rb") as stream, cphd.Reader(stream) as reader:
        signal, vectors = reader.read_channel(channel)
        return cphd.ElementWrapper(reader.metadata.xmltree.getroot()), signal, vectors


def test_sarkit_finds_nothing_wrong(tmp_path: Path) -> None:
    products, rig, _ = placed(tmp_path)
    made = export(Request(products, tmp_path / "o.nitf", None, rig), "sicd")
    assert [path.name for path in made.files] == [f"o_{name}.nitf" for name in ("HH", "HV", "VH", "VV")]
    for path in made.files:
        assert failures("Sicd", path) == {}
    made = export(Request(products, tmp_path / "o.cphd", None, rig), "cphd")
    assert failures("Cphd", made.files[0]) == {}


def test_sicd_holds_the_pixels_where_they_are(tmp_path: Path) -> None:
    products, rig, placement = placed(tmp_path)
    made = export(Request(products, tmp_path / "one.nitf", None, rig, None, ("HV",)), "sicd")
    assert [path.name for path in made.files] == ["one.nitf"]
    told, image = read_sicd(made.files[0])
    scene = scene_of(products, placement)
    np.testing.assert_array_equal(image, scene.pixels(1))
    known = products.read("calibration")
    row_step, column_step = made.values["stride"]
    kept = known["scattering"][1][::row_step, ::-1][:, ::column_step]
    # Base-banding turns phases only; undefined pixels are zero.
    np.testing.assert_allclose(np.abs(image), np.nan_to_num(np.abs(kept)), rtol=1e-6)
    assert (image[np.isnan(kept)] == 0).all()
    scp = tuple(told["ImageData"]["SCPPixel"])
    np.testing.assert_allclose(image[scp], kept[scp], rtol=1e-6)
    # SICD's own geometry leads from the scene's centre to each pixel's place.
    row, col = told["Grid"]["Row"], told["Grid"]["Col"]
    for at in ((0, 0), (5, 3), (14, 11)):
        place = (
            np.asarray(told["GeoData"]["SCP"]["ECF"])
            + np.asarray(row["UVectECF"]) * (at[0] - scp[0]) * row["SS"]
            + np.asarray(col["UVectECF"]) * (at[1] - scp[1]) * col["SS"]
        )
        x, y = known["x_m"][::-1][::column_step][at[1]], known["y_m"][::row_step][at[0]]
        np.testing.assert_allclose(placement.local_of_ecef(place), [x, y, -1.07], atol=1e-6)
    # H sent, V received; the antennas walk along x at the height of the origin.
    assert told["ImageFormation"]["TxRcvPolarizationProc"] == "H:V"
    polynomial = np.asarray(told["Position"]["ARPPoly"])
    start = placement.local_of_ecef(np.array([np.polynomial.polynomial.polyval(0.5, axis) for axis in polynomial.T]))
    np.testing.assert_allclose(start, [-1, 0, 0], atol=1e-6)


def test_sicd_is_at_base_band(tmp_path: Path) -> None:
    # A point that was focused has its spectrum inside the bandwidth that the file tells, whichever of its pixels are
    # written; as it was focused it has not: the carrier turns by 1.5 cycles from row to row.
    products, _, placement = placed(tmp_path)
    ranging, focused = products.read("ranging"), products.read("focus")
    channels = ("HH", "HV", "VH", "VV")
    profiles = RangeProfiles(
        ranging["profiles"], ranging["range_m"], ranging["antenna_m"], channels, CENTRE_HZ, BANDWIDTH_HZ,
        range_compensated=True,
    )  # fmt: skip
    image = backproject(profiles, ImageGrid(focused["x_m"], focused["y_m"], -1.07), interpolator="sinc16")
    units = {"scattering": "sqrt(m^2)"}
    arrays = {"scattering": image.astype(np.complex64), "x_m": focused["x_m"], "y_m": focused["y_m"]}
    products.write(
        "calibration", arrays, settings={"channels": ["HH", "HV", "VH", "VV"]}, inputs=[products.path], units=units
    )
    scene = scene_of(products, placement)
    whole = np.nan_to_num(scene.layer.values[0] * scene.band_phase())[:, ::-1]
    shares = []
    for values in (whole, np.nan_to_num(scene.layer.values[0])[:, ::-1]):
        power = np.abs(np.fft.fft2(values)) ** 2
        k = np.meshgrid(*(np.fft.fftfreq(n, d) for n, d in zip(values.shape, (0.3, 0.1), strict=True)), indexing="ij")
        inside = (np.abs(k[0]) < scene.bandwidth[0] / 2) & (np.abs(k[1]) < scene.bandwidth[1] / 2)
        shares.append(power[inside].sum() / power.sum())
    assert shares[0] > 0.97  # the image's edge cuts side lobes
    assert shares[1] < 0.8
    # The same phase is taken off all channels.
    ratio = scene.pixels(3) / scene.pixels(0)
    strong = np.abs(scene.pixels(0)) > 0.1
    np.testing.assert_allclose(ratio[strong], -0.8, atol=1e-4)


def test_cphd_holds_echoes_over_frequency(tmp_path: Path) -> None:
    products, rig, placement = placed(tmp_path)
    _without_compensation(products)
    made = export(Request(products, tmp_path / "o.cphd", None, rig), "cphd")
    told, signal, vectors = read_cphd(made.files[0], "HV")
    history = history_of(products, collect_of(products))
    np.testing.assert_array_equal(signal, history.signal[1])
    sent = placement.local_of_ecef(vectors["TxPos"])
    np.testing.assert_allclose(sent, products.read("ranging")["antenna_m"], atol=1e-6)
    srp = placement.local_of_ecef(vectors["SRPPos"][0])
    np.testing.assert_allclose(srp, history.srp_m, atol=1e-6)
    # CPHD: exp(SGN j 2 pi f dt), dt the delay against the reference point; times the Hann window of mean 1, 0.3j.
    f = vectors["SC0"][:, None] + vectors["SCSS"][:, None] * np.arange(signal.shape[1])
    further = np.linalg.norm(sent - POINT, axis=1) - np.linalg.norm(sent - srp, axis=1)
    window = 2 * np.cos(np.pi * (f - CENTRE_HZ) / BANDWIDTH_HZ) ** 2
    expected = 0.3j * window * np.exp(-4j * np.pi * f * further[:, None] / SPEED_OF_LIGHT_M_S)
    # Side lobes of the envelope beyond the 32 m of profiles: (R / cell)^-3 of the peak, below 1e-3.
    np.testing.assert_allclose(signal, expected, atol=2e-3)
    assert told["Global"]["SGN"] == -1
    assert (vectors["SIGNAL"] == 1).all()
    # Out of the file alone, the echo adds up where the point stands: SRP-relative matched filter over places.
    x = np.linspace(-1.5, 2.5, 41)
    level = []
    for place in x:
        away = np.linalg.norm(sent - [place, POINT[1], POINT[2]], axis=1) - np.linalg.norm(sent - srp, axis=1)
        level.append(abs(np.sum(signal * np.exp(4j * np.pi * f * away[:, None] / SPEED_OF_LIGHT_M_S))))
    np.testing.assert_allclose(x[int(np.argmax(level))], POINT[0], atol=1e-9)


def test_cphd_takes_range_compensation_back(tmp_path: Path) -> None:
    products, _, _ = placed(tmp_path)
    _without_compensation(products)
    arrays, settings = products.read("ranging"), products.settings("ranging")
    arrays["profiles"][..., 0] = 0  # at range 0 compensation leaves nothing
    products.write("ranging", arrays, settings=settings, inputs=[], units={})
    expected = history_of(products, collect_of(products)).signal
    arrays["profiles"] = (arrays["profiles"] * arrays["range_m"] ** 2).astype(np.complex64)
    products.write("ranging", arrays, settings={**settings, "range_compensated": True}, inputs=[], units={})
    # Two roundings of complex64.
    np.testing.assert_allclose(history_of(products, collect_of(products)).signal, expected, atol=1e-6)


def test_positions_that_were_not_recorded(tmp_path: Path) -> None:
    products, rig, _ = placed(tmp_path)
    arrays = products.read("ranging")
    arrays["profiles"][1, 7:9] = np.nan
    products.write("ranging", arrays, settings=products.settings("ranging"), inputs=[], units={})
    made = export(Request(products, tmp_path / "o.cphd", None, rig), "cphd")
    _, signal, vectors = read_cphd(made.files[0], "HV")
    assert np.flatnonzero(vectors["SIGNAL"] == 0).tolist() == [7, 8]
    assert (signal[7:9] == 0).all()
    assert failures("Cphd", made.files[0]) == {}


def test_antennas_apart(tmp_path: Path) -> None:
    products, rig, placement = placed(tmp_path)
    settings = products.settings("focus")
    pair = {"transmit": [-0.2, 0.0, 0.1], "receive": [0.2, 0.0, -0.1]}
    products.write(
        "focus", products.read("focus"), settings={**settings, "antennas_m": [pair] * 4}, inputs=[], units={}
    )
    made = export(Request(products, tmp_path / "o.cphd", None, rig), "cphd")
    _, _, vectors = read_cphd(made.files[0], "VV")
    between = placement.local_of_ecef(vectors["RcvPos"]) - placement.local_of_ecef(vectors["TxPos"])
    np.testing.assert_allclose(between, np.broadcast_to([0.4, 0, -0.2], between.shape), atol=1e-6)
    assert failures("Cphd", made.files[0]) == {}


def test_what_cannot_be_written_is_said(tmp_path: Path) -> None:
    products, rig, _ = placed(tmp_path)
    nowhere = rig_file(tmp_path / "n.toml", None)
    for to in ("sicd", "cphd"):
        with pytest.raises(PolfuseError, match="has no channel XX"):
            export(Request(products, tmp_path / "o", None, rig, None, ("XX",)), to)
        with pytest.raises(PolfuseError, match="needs the place on the earth"):
            export(Request(products, tmp_path / "o", None, nowhere), to)
    focused = products.read("focus")
    focused["x_m"] = focused["x_m"] * 4
    products.write("focus", focused, settings=products.settings("focus"), inputs=[], units={})
    products.write(
        "calibration", {**products.read("calibration"), "x_m": focused["x_m"]},
        settings=products.settings("calibration"), inputs=[], units={},
    )  # fmt: skip
    with pytest.raises(PolfuseError, match=r"has pixels of 0.4 m in x where its bandwidth needs 0\.\d+ m"):
        export(Request(products, tmp_path / "o", None, rig), "sicd")
    arrays = products.read("ranging")
    arrays["antenna_m"][:] = 0
    products.write("ranging", arrays, settings=products.settings("ranging"), inputs=[], units={})
    with pytest.raises(PolfuseError, match="positions at one place"):
        export(Request(products, tmp_path / "o", None, rig), "cphd")


def _without_compensation(products: Products) -> None:
    arrays, settings = products.read("ranging"), products.settings("ranging")
    arrays["profiles"] = point_profiles(arrays["antenna_m"], arrays["range_m"], POINT)
    products.write("ranging", arrays, settings={**settings, "range_compensated": False}, inputs=[], units={})

"""Gotcha files, as AFRL delivers them and as nobody should: import, and focusing of what was imported."""

import contextlib
import json

import numpy as np
import pytest
import scipy.io
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from rail_data import C
from real_data import real_data
from typer.testing import CliRunner

from polfuse_lab.cli import build
from polfuse_lab.errors import PolfuseError
from polfuse_lab.imports.gotcha import import_gotcha
from polfuse_lab.products.focus import default_grid, focus
from polfuse_lab.products.focus_history import read_history
from polfuse_lab.session import open_session
from processing.errors import DataError
from processing.radar.phase_history import PhaseHistory, history_profiles
from processing.sar.grid import ImageGrid
from processing.sar.quality import carrier_of, point_response
from processing.sar.resolution import point_resolution

TARGETS = [(3.0, -2.0, 0.0, 1.0), (-4.0, 5.0, 0.0, 0.5j)]


def collect(azimuth_deg, pulses=60, count=64, scale=1.0, **changed):
    """Fields of one file: a circle of 7 km radius at 7 km height, echoes of the targets by their closed form."""
    azimuth = np.radians(azimuth_deg + np.linspace(0, 1, pulses, endpoint=False))
    places = np.stack([7000 * np.cos(azimuth), 7000 * np.sin(azimuth), np.full(pulses, 7000.0)])
    frequency = 9.3e9 + 6e6 * np.arange(count)
    reference = np.linalg.norm(places, axis=0)
    echo = np.zeros((count, pulses), dtype=complex)
    for x, y, z, a in TARGETS:
        away = np.linalg.norm(places.T - (x, y, z), axis=1) - reference
        echo += scale * a * np.exp(-4j * np.pi / C * frequency[:, None] * away)
    fields = {"fp": echo.astype(np.complex64), "freq": frequency, "r0": reference}
    fields |= dict(zip("xyz", places, strict=True))
    return {"data": fields | changed}


@pytest.fixture
def files(tmp_path):
    made = []
    for channel, scale in (("HH", 1.0), ("VV", 0.5)):
        for degree in (2, 1):
            path = tmp_path / f"data_3dsar_pass1_az{degree:03d}_{channel}.mat"
            scipy.io.savemat(path, collect(degree, scale=scale))
            made.append(path)
    return made


def test_what_was_recorded_comes_back_bit_for_bit(files, tmp_path):
    session, history = import_gotcha(files, tmp_path / "s.h5")
    with open_session(session) as opened:
        assert opened.complete
        again = read_history(opened)
    np.testing.assert_array_equal(again.echoes, history.echoes)
    np.testing.assert_array_equal(again.antenna_m, history.antenna_m)
    assert again.channels == ("HH", "VV")
    assert (again.first_hz, again.step_hz) == pytest.approx((9.3e9, 6e6))
    # In the order of azimuth, whatever the order of the files.
    assert (np.diff(np.arctan2(again.antenna_m[:, 1], again.antenna_m[:, 0])) > 0).all()


@pytest.mark.parametrize("method", ["bp", "ffbp", "auto"])
def test_targets_stand_at_their_places_with_amplitude_and_phase(files, tmp_path, method):
    session, _ = import_gotcha(files, tmp_path / "s.h5")
    places = np.array([[x, y] for x, y, _, _ in TARGETS])
    grid = ImageGrid(np.unique(places[:, 0]), np.unique(places[:, 1]), 0.0)
    made = focus(session, tmp_path / "p.h5", method=method, grid=grid, window="rectangular", aperture="rectangular")
    for channel, scale in ((0, 1.0), (1, 0.5)):
        for x, y, _, a in TARGETS:
            value = made.image[channel, np.searchsorted(grid.y_m, y), np.searchsorted(grid.x_m, x)]
            # The centre frequency's phase of a point is its own; the other target's side lobes are below -30 dB here.
            assert value == pytest.approx(scale * a, abs=0.05)


def test_default_image_is_what_is_free_of_ambiguities(files, tmp_path):
    session, history = import_gotcha(files, tmp_path / "s.h5")
    with open_session(session) as opened:
        grid = default_grid(opened)
    # c / 2 step over the cosine of 45 degrees; wavelength / (2 angle): 55 m across, which is the smaller.
    wavelength = C / (9.3e9 + 32 * 6e6)
    across = wavelength / (2 * np.radians(1 / 60) * np.sqrt(0.5))
    along = history.unambiguous_m / np.sqrt(0.5)
    assert grid.x_m[-1] - grid.x_m[0] == pytest.approx(0.95 / np.sqrt(2) * min(across, along), rel=0.02)
    assert np.mean(grid.x_m) == pytest.approx(0.0, abs=0.2)


def test_command_line(files, tmp_path):
    runner = CliRunner()
    session, products = tmp_path / "s.h5", tmp_path / "p.h5"
    done = runner.invoke(build(), ["import", str(tmp_path), "-o", str(session), "--as", "gotcha", "--json"])
    assert done.exit_code == 0, done.output
    values = json.loads(done.stdout)
    assert (values["sweeps"], values["pulses"], values["channels"]) == (240, 120, ["HH", "VV"])
    figure = tmp_path / "f.png"
    arguments = ["focus", str(session), "-o", str(products), "--method", "ffbp", "--x", "-8,8", "--y", "-8,8", "--json"]
    done = runner.invoke(build(), [*arguments, "--figure", str(figure)])
    assert done.exit_code == 0, done.output
    values = json.loads(done.stdout)
    assert values["method"] == "ffbp"
    assert figure.stat().st_size > 10_000
    first = values["peaks"][0]
    assert (first["x_m"], first["y_m"]) == pytest.approx((3.0, -2.0), abs=0.1)
    done = runner.invoke(build(), ["focus", str(session), "-o", str(products), "--method", "rma"])
    assert done.exit_code == 1
    assert "back-projection" in done.stderr


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"fp": np.zeros((3, 4), np.complex64)}, "echoes of shape"),
        ({"x": np.full(60, np.nan)}, "not finite"),
        ({"freq": 9e9 + 1e6 * np.arange(64) ** 2}, "equidistant"),
        ({"freq": np.array([9e9])}, "echoes of shape"),
    ],
)
def test_files_that_do_not_hold_together_are_refused(tmp_path, changed, words):
    path = tmp_path / "a_HH.mat"
    scipy.io.savemat(path, collect(1, **changed))
    with pytest.raises(PolfuseError, match=words):
        import_gotcha([path], tmp_path / "s.h5")
    assert not (tmp_path / "s.h5").exists()


def test_wrong_sets_of_files_are_refused(files, tmp_path):
    for given_files, words in (
        ([], "no file"),
        ([files[0], files[0]], "twice"),
        (files[:3], "other pulses"),
        ([tmp_path / "missing_HH.mat"], "cannot be read"),
    ):
        with pytest.raises(PolfuseError, match=words):
            import_gotcha(given_files, tmp_path / "s.h5")
    nameless = tmp_path / "collect.mat"
    scipy.io.savemat(nameless, collect(1))
    with pytest.raises(PolfuseError, match="polarisation"):
        import_gotcha([nameless], tmp_path / "s.h5")
    empty = tmp_path / "empty"
    empty.mkdir()
    with pytest.raises(PolfuseError, match="holds no"):
        import_gotcha([empty], tmp_path / "s.h5")
    foreign = tmp_path / "foreign_HH.mat"
    scipy.io.savemat(foreign, {"other": 1})
    with pytest.raises(PolfuseError, match="no MATLAB file"):
        import_gotcha([foreign], tmp_path / "s.h5")


@settings(max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(at=st.integers(0, 40_000), byte=st.integers(0, 255), keep=st.floats(0, 1))
def test_damaged_files_are_errors_or_read(tmp_path_factory, at, byte, keep):
    folder = tmp_path_factory.mktemp("damaged")
    path = folder / "a_HH.mat"
    scipy.io.savemat(path, collect(1, pulses=8, count=8))
    raw = bytearray(path.read_bytes())
    raw[at % len(raw)] = byte
    path.write_bytes(raw[: max(1, int(len(raw) * keep))])
    # Whatever the bytes say: an import, or the one kind of error that is told in a sentence.
    with contextlib.suppress(PolfuseError):
        import_gotcha([path], folder / "s.h5")


def test_histories_that_do_not_hold_together_are_refused():
    echoes, antenna = np.ones((1, 4, 16), np.complex64), np.ones((4, 3)) * 1e3
    good = PhaseHistory(echoes, 9e9, 1e6, antenna, np.full(4, 1e3), ("HH",))
    assert history_profiles(good).values.shape == (1, 4, 128)
    for changed, words in (
        ({"echoes": echoes[0]}, "shape"),
        ({"channels": ()}, "names"),
        ({"antenna_m": antenna[:2]}, "do not fit"),
        ({"step_hz": 0.0}, "frequencies"),
    ):
        with pytest.raises(DataError, match=words):
            history_profiles(PhaseHistory(**{**good.__dict__, **changed}))
    with pytest.raises(DataError, match="window"):
        history_profiles(good, window="flat")
    with pytest.raises(DataError, match="oversampling"):
        history_profiles(good, oversampling=0)


@pytest.mark.parametrize("method", ["bp", "ffbp"])
def test_the_car_park_of_the_real_collect(tmp_path, method):
    folder = real_data("gotcha")
    session, history = import_gotcha([folder], tmp_path / "s.h5")
    assert history.echoes.shape == (1, 234, 424)
    # The brightest reflector (a trihedral at the park's edge) on a fine grid.
    grid = ImageGrid(np.arange(-22, -9, 0.08), np.arange(15, 28, 0.12), 0.0)
    made = focus(session, tmp_path / "p.h5", method=method, grid=grid)
    peak = made.peaks[0]
    assert (peak.x_m, peak.y_m) == pytest.approx((-15.6, 21.6), abs=0.3)
    response = point_response(
        made.image[0], grid, peak.x_m, peak.y_m, reach_m=(2.0, 3.0), carrier=carrier_of(history.antenna_m, 9.6e9)
    )
    theory = point_resolution(
        history.antenna_m,
        (peak.x_m, peak.y_m, 0.0),
        centre_hz=history.first_hz + 212 * history.step_hz,
        bandwidth_hz=history.bandwidth_hz,
        window="taylor",
        aperture_weights=np.asarray(made.settings["aperture_weights"]),
    )
    assert response.x.width_m == pytest.approx(theory.x_m, rel=0.15)
    assert response.y.width_m == pytest.approx(theory.y_m, rel=0.15)


def test_corrections_of_the_real_collect_are_in_its_echoes(tmp_path):
    # Applying them once more, or taking them off, spreads the image: its entropy grows by more than half a nat.
    folder = real_data("gotcha")
    session, history = import_gotcha([folder], tmp_path / "s.h5")
    with open_session(session) as opened:
        correction = np.asarray(opened.config["extra"]["corrections_applied"]["range_m"])
    grid = ImageGrid(np.arange(-40, 40, 0.5), np.arange(-40, 40, 0.5), 0.0)
    from processing.sar.factorized import factorized

    def entropy(reference_m):
        moved = PhaseHistory(**{**history.__dict__, "reference_m": reference_m})
        power = np.abs(factorized(history_profiles(moved), grid)[0].astype(complex)) ** 2
        share = power / power.sum()
        return -np.sum(share * np.log(share + 1e-30))

    sharp = entropy(history.reference_m)
    for sign in (1, -1):
        assert entropy(history.reference_m + sign * correction) > sharp + 0.5

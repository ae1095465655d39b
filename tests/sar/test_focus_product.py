import json
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from rail_data import CELL_M, CENTRE_HZ, HEIGHT_M, ground
from rail_session import AMPLITUDE, BEAMWIDTH, write_session
from typer.testing import CliRunner

from drivers.records import Channel
from polfuse_lab.cli import build
from polfuse_lab.errors import PolfuseError
from polfuse_lab.products.figures_sar import draw_all, magnitude_figure, pauli_figure, rail_figure
from polfuse_lab.products.focus import default_grid, focus
from polfuse_lab.products.store import Products
from polfuse_lab.session import open_session
from processing.sar.quality import complex_correlation
from processing.sar.resolution import point_resolution

TRIHEDRAL = ((1.2, 8.0, -HEIGHT_M), np.array([[1, 0], [0, 0.8j]]) * 3)
DIPLANE = ((-2.0, 13.0, -HEIGHT_M), np.array([[1, 0.5], [0.25, -1]]) * 4)
TARGETS = [TRIHEDRAL, DIPLANE]
POSITIONS = (np.arange(31) - 15) * 0.0508
EXTENT = {"x_m": (-4.0, 4.0), "y_m": (5.0, 17.0)}


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    return write_session(tmp_path_factory.mktemp("rail") / "rail.h5", TARGETS, POSITIONS)


@pytest.fixture(scope="module")
def grid(session):
    with open_session(session) as opened:
        return default_grid(opened, **EXTENT)


@pytest.fixture(scope="module")
def focused(session, grid, tmp_path_factory):
    return focus(session, tmp_path_factory.mktemp("products") / "products.h5", grid=grid)


def test_every_channel_of_every_target_has_its_amplitude_and_phase(session, tmp_path):
    # |image| = amplitude at 1 m times |S| at the target's place, range and pattern compensated, with the phase of S.
    # Two ramps of 960 samples in float32, a 1.9 m cell and another target 5 m away set 2 % of the stronger one.
    for place, s in TARGETS:
        here = ground([place[0]], [place[1]])
        made = focus(session, tmp_path / "p.h5", grid=here, tolerance_db=-80)
        assert made.channels == ("HH", "HV", "VH", "VV")
        # HV transmits H and receives V: S_vh, row V, column H.
        expected = AMPLITUDE * np.array([s[0, 0], s[1, 0], s[0, 1], s[1, 1]])
        np.testing.assert_allclose(made.image[:, 0, 0], expected, atol=0.02 * AMPLITUDE * 4)


def test_peaks_stand_at_the_targets(focused):
    strongest = sorted(focused.peaks[:2], key=lambda peak: peak.y_m)
    antenna = np.column_stack([POSITIONS, np.zeros((31, 2))])
    for peak, (place, s) in zip(strongest, TARGETS, strict=True):
        cell = point_resolution(antenna, place, centre_hz=CENTRE_HZ, bandwidth_hz=80e6, window="hann")
        assert abs(peak.x_m - place[0]) < 0.1 * cell.x_m
        assert abs(peak.y_m - place[1]) < 0.1 * cell.y_m
        span = AMPLITUDE * np.linalg.norm(s)
        assert peak.level_db == pytest.approx(20 * np.log10(span), abs=0.4)


def test_default_grid_samples_the_narrowest_cell_four_times(session, grid):
    antenna = np.column_stack([POSITIONS, np.zeros((31, 2))])
    cell = point_resolution(antenna, (0.0, 5.0, -HEIGHT_M), centre_hz=CENTRE_HZ, bandwidth_hz=80e6)
    dx, dy = grid.x_m[1] - grid.x_m[0], grid.y_m[1] - grid.y_m[0]
    assert 0.4 * cell.x_m / 4 <= dx <= cell.x_m / 4
    assert 0.4 * min(cell.y_m, CELL_M) / 4 <= dy <= cell.y_m / 4
    assert (grid.x_m[0], grid.x_m[-1]) == (-4.0, pytest.approx(4.0, abs=dx))
    assert grid.z_m == -HEIGHT_M


def test_products_hold_profiles_image_and_how_they_were_made(focused, session):
    products = Products(focused.products)
    assert products.stages() == ["ranging", "focus"]
    image, ranging = products.read("focus"), products.read("ranging")
    np.testing.assert_array_equal(image["image"], focused.image)
    assert image["image"].dtype == ranging["profiles"].dtype == np.complex64
    assert image["image"].shape == (4, len(image["y_m"]), len(image["x_m"]))
    np.testing.assert_allclose(ranging["antenna_m"][:, 0], POSITIONS, atol=1e-12)
    settings = products.settings("focus")
    assert settings["channels"] == ["HH", "HV", "VH", "VV"]
    assert settings["method"] == focused.choice.method
    assert settings["predicted_error_db"] <= -50
    assert settings["beamwidth_rad"] == pytest.approx(BEAMWIDTH)
    assert settings["z_m"] == -HEIGHT_M
    assert products.provenance("focus")["inputs"][0]["path"].endswith(session.name)


def test_the_same_session_gives_the_same_bytes(focused, session, grid, tmp_path):
    again = focus(session, tmp_path / "again.h5", grid=grid)
    for stage in ("ranging", "focus"):
        first, second = Products(focused.products).read(stage), Products(again.products).read(stage)
        assert {name: a.tobytes() for name, a in first.items()} == {name: a.tobytes() for name, a in second.items()}


def test_methods_agree_within_their_predicted_errors(session, tmp_path):
    with open_session(session) as opened:
        small = default_grid(opened, x_m=(-3.0, 2.5), y_m=(7.0, 14.5), step_m=(0.1, 0.4))
    made = {
        method: focus(session, tmp_path / f"{method}.h5", method=method, grid=small, tolerance_db=-60)
        for method in ("bp", "rma", "reference")
    }
    assert {method: result.choice.method for method, result in made.items()} == {m: m for m in made}
    exact = made["reference"].image
    for method in ("bp", "rma"):
        error = 20 * np.log10(np.linalg.norm(made[method].image - exact) / np.linalg.norm(exact))
        assert error < made[method].choice.predicted_error_db + 3
        assert abs(complex_correlation(made[method].image, exact)) > 0.99


def test_missing_positions_are_told_and_left_out(tmp_path):
    path = write_session(
        tmp_path / "gap.h5", [TRIHEDRAL], POSITIONS[::2], (Channel.HH, Channel.VV), skip={(Channel.VV, 7)}
    )
    place = TRIHEDRAL[0]
    made = focus(path, tmp_path / "gap_products.h5", grid=ground([place[0]], [place[1]]))
    assert "channel VV misses 1 of 16 positions" in made.warnings
    expected = AMPLITUDE * np.array([3, 2.4j])
    np.testing.assert_allclose(made.image[:, 0, 0], expected, atol=0.02)


def test_grating_lobes_and_loose_errors_are_told(session, tmp_path):
    wide = ground(np.arange(-8.0, 8.0, 1.0), np.arange(3.0, 9.0, 1.0))
    made = focus(session, tmp_path / "wide.h5", grid=wide, method="rma", tolerance_db=-60)
    assert any("38 degrees" in warning for warning in made.warnings)
    assert any("is above -60 dB" in warning for warning in made.warnings)


def test_a_sky_look_takes_the_antennas_coupling_off(tmp_path):
    # A strong path at 0.5 m leaks over its side lobes; the sky holds nothing but it.
    coupling = ((0.0, 0.5, 0.0), np.eye(2) * 0.3)
    weak = ((0.0, 9.0, -HEIGHT_M), np.eye(2))
    moving = lambda x: [((x, 0.5, 0.0), coupling[1])]  # noqa: E731  (it rides with the trolley)
    field = tmp_path / "field.h5"
    positions = POSITIONS[10:21]
    paths = {}
    for name, targets in (("field", [weak]), ("sky", [])):
        paths[name] = tmp_path / f"{name}.h5"
        _write_with_coupling(paths[name], targets, moving, positions)
    here = ground([0.0], [9.0])
    with_it = focus(field, tmp_path / "a.h5", grid=here).image[0, 0, 0]
    without = focus(field, tmp_path / "b.h5", grid=here, sky=paths["sky"]).image[0, 0, 0]
    assert abs(without - AMPLITUDE) < 0.01 * AMPLITUDE
    assert abs(with_it - AMPLITUDE) > 5 * abs(without - AMPLITUDE)


def _write_with_coupling(path, targets, moving, positions):
    from rail_data import BANDWIDTH_HZ
    from rail_session import RATE_HZ, RIG, samples

    from drivers.records import AudioBlock
    from polfuse_lab.records import Sweeps
    from polfuse_lab.rig import Waveform
    from polfuse_lab.session import SessionConfig, SessionWriter

    waveform = Waveform(centre_hz=CENTRE_HZ, bandwidth_hz=BANDWIDTH_HZ, ramp_up_s=0.02, sweep_period_s=0.04)
    config = SessionConfig("collect", waveform, RATE_HZ, sample_dtype="float32", rig_toml=RIG)
    with SessionWriter.create(path, config, ballast_bytes=0) as writer:
        for position, x in enumerate(positions):
            block = AudioBlock(samples(x, [*targets, *moving(x)], Channel.HH), RATE_HZ, 0, 0.0, position)
            writer.write(Sweeps(block, Channel.HH, position, x_m=float(x), sweeps_requested=2))


def test_sessions_that_are_no_rail_are_refused(tmp_path):
    here = ground([0.0], [8.0])
    one = write_session(tmp_path / "one.h5", [TRIHEDRAL], [0.0], (Channel.HH,))
    with pytest.raises(PolfuseError, match="no aperture"):
        focus(one, tmp_path / "p.h5", grid=here)
    foreign = write_session(tmp_path / "foreign.h5", [TRIHEDRAL], POSITIONS[:3], (Channel.HH,), rig=None)
    with pytest.raises(PolfuseError, match="no rig"):
        focus(foreign, tmp_path / "p.h5", grid=here)
    with pytest.raises(PolfuseError, match="no rig"):
        focus(foreign, tmp_path / "p.h5")
    empty = write_session(tmp_path / "empty.h5", [], [], ())
    with pytest.raises(PolfuseError, match="no sweeps"):
        focus(empty, tmp_path / "p.h5", grid=here)
    uneven = write_session(tmp_path / "uneven.h5", [TRIHEDRAL], [0.0, 0.1, 0.25, 0.3], (Channel.HH,))
    # Unequal steps are a rail all the same: range migration sums positions where they stand.
    by_sum, by_migration = (
        focus(uneven, tmp_path / "p.h5", grid=here, method=method).image for method in ("bp", "rma")
    )
    np.testing.assert_allclose(by_migration, by_sum, rtol=5e-3)
    assert focus(uneven, tmp_path / "p.h5", grid=here).choice.method == "bp"


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"x_m": (2.0, -2.0)}, "no image"),
        ({"y_m": (-3.0, 5.0)}, "no image"),
        ({"step_m": (0.0, 0.1)}, "positive"),
        ({"step_m": (1e-6, 1e-6)}, "larger pixels"),
    ],
)
def test_grids_that_make_no_image_are_refused(session, wrong, words):
    with open_session(session) as opened, pytest.raises(PolfuseError, match=words):
        default_grid(opened, **wrong)


def run(*arguments):
    return CliRunner().invoke(build(), ["focus", *map(str, arguments)])


def test_command_prints_one_json_object(session, tmp_path):
    out, picture = tmp_path / "products.h5", tmp_path / "pictures" / "focus.png"
    done = run(
        session, "-o", out, "--x", "-4,4", "--y", "5,17", "--pixel", "0.1,0.4", "--tolerance-db", -60,
        "--figure", picture, "--json",
    )  # fmt: skip
    assert done.exit_code == 0, done.stderr
    values = json.loads(done.stdout)
    assert {"method", "settings", "predicted_error_db", "pixels", "pulses", "seconds", "peaks"} <= set(values)
    assert values["pulses"] == 31
    assert values["pixels"] == 81 * 31
    assert values["predicted_error_db"] <= -60
    assert set(values["peaks"][0]) == {"x_m", "y_m", "dB"}
    assert (values["peaks"][0]["x_m"], values["peaks"][0]["y_m"]) == pytest.approx((-2.0, 13.0), abs=0.15)
    assert len(values["figures"]) == 3
    assert all(Path(name).read_bytes().startswith(b"\x89PNG") for name in values["figures"])


def test_command_tells_people_what_it_did(session, tmp_path):
    done = run(session, "-o", tmp_path / "p.h5", "--x", "-1,2", "--y", "7,9", "--method", "bp")
    assert done.exit_code == 0
    assert "expected error" in done.stdout
    assert "peak at x = +1.2" in done.stdout


@pytest.mark.parametrize(
    "arguments",
    [
        ["--method", "pga"],
        ["--autofocus", "--autofocus-method", "pga"],
        ["--autofocus-method", "track"],
        ["--tolerance-db", "3"],
        ["--window", "square"],
        ["--x", "1;2"],
        ["--pixel", "a,b"],
        ["--oversampling", "1"],
    ],
)
def test_wrong_usage_ends_with_status_two(session, tmp_path, arguments):
    done = run(session, "-o", tmp_path / "p.h5", *arguments)
    assert done.exit_code == 2
    assert not (tmp_path / "p.h5").exists()


def test_the_choice_is_explained_and_autofocus_leaves_focused_data_alone(session, tmp_path):
    plain, after = tmp_path / "plain.h5", tmp_path / "after.h5"
    common = ("--x", "-4,4", "--y", "5,17", "--pixel", "0.1,0.4")
    assert run(session, "-o", plain, *common).exit_code == 0
    done = run(session, "-o", after, *common, "--autofocus", "--explain", "--json")
    assert done.exit_code == 0, done.stderr
    values = json.loads(done.stdout)
    told = values["autofocus"]
    assert told == Products(after).settings("focus")["autofocus"]
    assert told["applied"] is False
    assert "autofocus" in done.stderr
    images = [Products(path).read("focus")["image"] for path in (plain, after)]
    np.testing.assert_array_equal(*images)
    assert any("not range migration" in line for line in values["explanation"])
    settings = Products(after).settings("focus")
    assert settings["precision"]
    assert {"method", "interpolator", "oversampling", "predicted_error_db", "core_seconds"} <= set(
        settings["considered"][0]
    )


def test_a_trolley_that_was_elsewhere_is_found_by_autofocus(tmp_path):
    # Pushed by hand: 3 cm rms from where it was thought to be, slowly varying. Samples are of where it was.
    n = np.arange(41)
    thought = (n - 20) * 0.0508
    was = thought + 0.045 * np.sin(2 * np.pi * n / 40 * 1.2)
    targets = [
        ((x, y, -HEIGHT_M), np.array([[1, 0], [0, 1]]) * (y / 8) ** 2)
        for x, y in [(-2.5, 6.0), (2.8, 6.5), (0.3, 9.0), (-4.0, 11.0), (4.2, 12.0), (0.8, 15.0)]
    ]
    path = write_session(tmp_path / "pushed.h5", targets, was, (Channel.HH,), told=thought)
    here = ground(np.arange(-6, 6.01, 0.08), np.arange(4, 18, 0.3))
    blurred = focus(path, tmp_path / "blurred.h5", grid=here)
    sharp = focus(path, tmp_path / "sharp.h5", grid=here, autofocus="track")
    told = sharp.settings["autofocus"]
    assert told["applied"], told["reason"]
    assert told["entropy_after"] < told["entropy_before"] - 0.05
    span = [np.nanmax(np.abs(made.image)) for made in (blurred, sharp)]
    assert span[1] > span[0]


def test_failures_end_with_status_one_and_one_line(tmp_path):
    done = run(tmp_path / "absent.h5", "-o", tmp_path / "p.h5")
    assert done.exit_code == 1
    assert done.stderr.startswith("error: ")
    assert len(done.stderr.strip().splitlines()) == 1


def test_pictures_of_one_channel_and_of_undefined_images(focused, tmp_path):
    arrays = Products(focused.products).read("focus")
    alone = {**arrays, "image": arrays["image"][:1]}
    assert len(magnitude_figure(alone, ("HH",), peaks=focused.peaks).axes) >= 1
    blank = {**arrays, "image": np.full_like(arrays["image"], np.nan)}
    for figure in (magnitude_figure(blank, focused.channels), pauli_figure(blank, focused.channels)):
        assert isinstance(figure, Figure)
        figure.savefig(tmp_path / "blank.png")
    ranging = Products(focused.products).read("ranging")
    ranging["profiles"][1] = np.nan
    rail_figure(ranging, focused.channels).savefig(tmp_path / "rail.png")
    # The picture's mesh holds every position and bin of a channel.
    mesh = rail_figure(ranging, focused.channels).axes[0].collections[0]
    assert mesh.get_array().size == ranging["profiles"][0].size
    assert len(draw_all(Products(focused.products), tmp_path / "all.png")) == 3

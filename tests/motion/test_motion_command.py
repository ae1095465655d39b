"""``polfuse motion``: vehicles in a phase history, and a session whose exposures a lorry passed."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from benchmarks.motion_scene import ANGLES_RAD, RoadScene
from drivers.records import Frame
from polfuse_lab.cli import build
from polfuse_lab.products.pictures import load_picture
from polfuse_lab.products.store import Products
from polfuse_lab.records import Exposure
from polfuse_lab.rig import Waveform
from polfuse_lab.session import SessionConfig, SessionWriter

VELOCITY = (8.0, 9.0, 0.0)
RIG = """
name = "from far above"
[waveform]
centre_hz = 2.4e9
bandwidth_hz = 80e6
ramp_up_s = 0.02
sweep_period_s = 0.04
[geometry]
antenna_height_m = 15000.0
[radar]
driver = "sounddevice"
[switches]
driver = "dowkey_ms"
[trolley]
driver = "by_hand"
length_m = 3.2
[camera]
driver = "scene"
width_px = 160
height_px = 128
exposure_s = 0.001
focal_length_m = 1.110
pixel_pitch_m = 30e-6
depression_deg = 45.0
read_noise_counts = 5.0
[polarizer]
driver = "by_hand"
extinction_ratio = 1e9
"""


def run(*arguments: str) -> tuple[int, str, str]:
    done = CliRunner().invoke(build(), ["motion", *arguments])
    return done.exit_code, done.stdout, done.stderr


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    scene = RoadScene(VELOCITY, np.arange(4) * 0.3)
    light = scene.exposures(np.random.default_rng(1))
    path = tmp_path_factory.mktemp("motion") / "road.h5"
    waveform = Waveform(centre_hz=2.4e9, bandwidth_hz=80e6, ramp_up_s=0.02, sweep_period_s=0.04)
    config = SessionConfig("collect", waveform, 48_000.0, frame_shape=(128, 160), rig_toml=RIG, audio_block_frames=1024)
    with SessionWriter.create(path, config, ballast_bytes=0) as writer:
        for k, image in enumerate(light):
            counts = np.clip(np.rint(image), 0, 65_534).astype(np.uint16)
            frame = Frame(counts, k, 0.001, 0.0, 0.3 * k, 10**9 + int(0.3e9 * k))
            writer.write(Exposure(frame, float(ANGLES_RAD[k])))
    return path


@pytest.mark.parametrize("given", [True, False])
def test_a_sessions_exposures_are_corrected(session: Path, tmp_path: Path, given: bool) -> None:
    velocity = ["--velocity", "8.0", "9.0"] if given else []
    output, figure = tmp_path / "p.h5", tmp_path / "f.png"
    code, told, _ = run(str(session), "-o", str(output), "--figure", str(figure), *velocity, "--json")
    assert code == 0
    values = json.loads(told)
    assert values["velocity_from"] == ("given" if given else "pictures")
    assert values["error_down_db"] > 10
    # 8 m/s for 0.9 s at 0.573 m a pixel (Table 7.1), 9 m/s seen under 45 degrees.
    assert values["displacement_px"][-1] == pytest.approx([-10.0, 12.56], abs=0.3)
    assert values["time_s"] == pytest.approx([0.0, 0.3, 0.6, 0.9])
    assert figure.stat().st_size > 10_000
    stored = Products(output).read("motion")
    # The cab's DOLP is 0.45, the load's 0.25; before, some of them were more than twice that.
    assert np.nanpercentile(stored["dolp"][stored["object"] > 0], 99.5) < 0.5
    assert np.nanpercentile(stored["dolp_before"], 99.9) > 0.55
    assert int((stored["hidden"] >= 2).sum()) == values["undefined_pixels"]


def test_vehicles_of_the_example_are_found(tmp_path: Path) -> None:
    path, products = tmp_path / "flight.npz", Products(tmp_path / "p.h5")
    where = ("-o", str(products.path), "--x", "-600", "500", "--y", "14700", "15180")
    code, told, _ = run(str(path), "--example", "--json", *where)
    assert code == 0
    values = json.loads(told)
    found = sorted((t["azimuth_m_s"], t["ground_m_s"], t["ground_sd_m_s"]) for t in values["targets"])
    assert len(found) == 3
    # As the example says where it is made.
    for (along, across, sd), truth in zip(found, [(-10.0, 6.0), (-6.0, -4.0), (8.0, 3.0)], strict=True):
        assert along == pytest.approx(truth[0], abs=0.1)
        assert across == pytest.approx(truth[1], abs=4 * sd)
    assert values["ambiguities"]["unambiguous_m_s"] == pytest.approx(21.6, abs=0.1)
    assert Path(values["figure"]).stat().st_size > 10_000
    # As the window shows them: an arrow from each streak to its target, whose velocity shifts it along the track.
    shown = load_picture(products, "moving.power")
    for track, target in zip(shown.tracks, values["targets"], strict=True):
        assert (track.x[-1], track.y[-1]) == (target["x_m"], target["y_m"])
        # The streak's middle is that of the time in which it is seen, in which the target goes on along the track.
        on = abs(target["azimuth_m_s"]) * np.ptp(np.load(path)["time_s"]) / 2
        assert track.x[0] - track.x[-1] == pytest.approx(target["shift_m"], abs=on)
        assert f"along {target['azimuth_m_s']:+.2f}" in track.words


def test_files_that_cannot_be_used_are_refused_in_one_line(tmp_path: Path) -> None:
    empty = tmp_path / "a.npz"
    np.savez(empty, echoes=np.zeros(3))
    for path, words in (
        (empty, "lacks first_hz"),
        (tmp_path / "no.npz", "no NumPy file"),
        (tmp_path / "no.h5", "no.h5"),
    ):
        code, out, err = run(str(path))
        assert code == 1
        assert out == ""
        assert words in err
        assert len(err.strip().splitlines()) == 1
    odd = tmp_path / "b.npz"
    names = ("first_hz", "step_hz", "reference_m", "beamwidth_rad", "z_m")
    np.savez(
        odd, echoes=np.zeros((4, 4)), antenna_m=np.zeros((3, 3)), time_s=np.arange(4.0), **dict.fromkeys(names, 1.0)
    )
    code, _, err = run(str(odd))
    assert code == 1
    assert "do not fit" in err

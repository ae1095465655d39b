"""A collect whose camera is on the network: GigE Vision over loopback, the open GenTL producer, harvesters."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from drivers.camera.producers import aravis_producer
from hw_mocks.rig import Camera, SimulatedRig
from hw_mocks.scene_file import load_scene_file
from polfuse_lab.cli.sim import sim
from polfuse_lab.engine import collect
from polfuse_lab.errors import PolfuseError
from polfuse_lab.rig import driver_options, load_rig
from polfuse_lab.session import open_session

SCENE = Path(__file__).resolve().parents[2] / "examples" / "scenes" / "field.toml"
PLAN = """\
aperture_m = 0.0508
step_m = 0.0508
sweeps_per_channel = 1
move_settle_s = 0.0
[optics]
frames_per_angle = 2
settle_s = 0.05
"""

pytest.importorskip("harvesters", reason="install with: pip install 'polfuse-lab[camera]'")
needs_producer = pytest.mark.skipif(
    not sys.platform.startswith("linux") or aravis_producer() is None,
    reason="the open GenTL producer is not built (make gentl, on Linux)",
)


def collected(folder: Path, camera: Camera) -> tuple[np.ndarray, np.ndarray, int]:
    """Images and angles of a session with that camera, and the frames lost."""
    folder.mkdir()
    plan = folder / "plan.toml"
    plan.write_text(PLAN)
    with SimulatedRig(SCENE, folder / "rig", seed=7, audio="tcp", camera=camera) as rig:
        outcome = collect(rig.write_rig(), plan, folder / "s.h5")
        rig.check()
    assert outcome.state == "finished", outcome.reason
    with open_session(folder / "s.h5") as session:
        images = np.stack([session.frame(index) for index in range(len(session.frames))])
        return images, np.asarray(session.frames["angle_rad"]), outcome.frames_lost


@needs_producer
def test_frames_over_the_wire_are_the_scene_cameras(tmp_path: Path) -> None:
    direct, angles, _ = collected(tmp_path / "scene", "scene")
    images, wire_angles, lost = collected(tmp_path / "gige", "gige")
    assert lost == 0
    assert images.shape == (8, 582, 782)
    np.testing.assert_array_equal(wire_angles, angles)
    # One seed and one noise rule: the frames of the camera that needs no wire are the truth, count for count.
    np.testing.assert_array_equal(images, direct)
    # A picture, with noise that differs between the two frames of one angle.
    assert all(image.std() > 10 for image in images)
    assert (images[0] != images[1]).mean() > 0.5


def test_only_the_cameras_address_is_asked(tmp_path: Path) -> None:
    with SimulatedRig(SCENE, tmp_path, audio="tcp", camera="gige") as rig:
        path = rig.write_rig()
        options = driver_options(load_rig(path), "camera", path)
        assert rig.endpoints["camera"] == f"gige://{options.addresses[0]}:3956"
    assert options.cti == "aravis"
    assert [address.startswith("127.") for address in options.addresses] == [True]
    # What the scene file says reaches the driver.
    camera = load_scene_file(SCENE).camera
    assert camera is not None
    assert (options.width_px, options.height_px, options.exposure_s) == (782, 582, camera.exposure_s)


def test_a_scene_without_a_camera_has_none_on_the_wire(tmp_path: Path) -> None:
    scene = tmp_path / "scene.toml"
    scene.write_text('name = "radar only"\n')
    with pytest.raises(PolfuseError, match="no camera"):
        SimulatedRig(scene, tmp_path / "rig", audio="tcp", camera="gige")


@needs_producer
def test_sim_offers_the_camera_on_the_wire(tmp_path: Path) -> None:
    command = [sys.executable, "-c", "from polfuse_lab.cli import main; main()", "sim", str(SCENE), "--camera", "gige"]
    process = subprocess.Popen(
        [*command, "--rig-out", str(tmp_path / "rig.toml"), "--audio", "tcp", "--json"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    try:
        endpoints = json.loads(process.stdout.readline())["endpoints"]
        assert endpoints["camera"].startswith("gige://127.")
    finally:
        process.send_signal(signal.SIGTERM)
        _, err = process.communicate(timeout=10)
    assert process.returncode == 0, err


def test_sim_says_how_to_build_what_is_missing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    import typer

    monkeypatch.setattr("drivers.camera.producers.aravis_producer", lambda: None)
    with pytest.raises(typer.Exit) as ended:
        sim(SCENE, tmp_path / "rig.toml", camera="gige", debug=False)
    assert ended.value.exit_code == 1
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "make gentl" in said
    assert not os.path.exists(tmp_path / "rig.toml")

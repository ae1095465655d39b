"""Independent GigE Vision clients agree with the simulated camera: Aravis' tools and telegenicam.

Clients search by broadcast, so camera and client live in a network namespace with nothing but a loopback interface.
"""

import json
import re
import sys

import pytest

from benchmarks.gige_peers import NAME, PeerMissing, aravis, aravis_counters, camera_beside, namespace
from hw_mocks.gige_camera.features import make_features
from hw_mocks.gige_camera.pixel_packing import PixelFormat


@pytest.fixture(autouse=True)
def shut_off() -> None:
    """Skip, with the reason, where namespaces cannot be had."""
    try:
        with namespace():
            pass
    except PeerMissing as missing:
        pytest.skip(str(missing))


@pytest.fixture
def tool() -> str:
    """Aravis' tool; skips where it is not installed."""
    try:
        aravis("camera-test")
        return aravis("tool")
    except PeerMissing as missing:
        pytest.skip(str(missing))


def test_aravis_reads_every_feature(tool: str) -> None:
    with camera_beside() as beside:
        assert f"{NAME} (127.0.0.1)" in beside.run(tool)
        text = beside.run(tool, "-n", NAME, "values")
    formats = (PixelFormat.Mono16,)
    features = make_features(width=782, height=582, exposure_us=2000.0, frame_rate_hz=50.0, formats=formats)
    # Chunks are read from frames, not from the camera.
    expected = {feature.name for feature in features if not feature.chunk}
    assert expected <= set(re.findall(r"'(\w+)'", text))
    readable = {feature.name for feature in features if feature.kind != "command" and not feature.chunk}
    assert readable <= set(re.findall(r"'(\w+)' = ", text))
    assert "'ExposureTime' = 2000 us" in text
    assert "'PixelFormat' = 'Mono16'" in text
    assert "'PayloadSize' = 910248" in text


def test_aravis_sets_features(tool: str) -> None:
    with camera_beside() as beside:
        words = ("Width=128", "OffsetX=16", "PixelFormat=Mono12p", "ExposureTime=750", "Gain=3.5", "DeviceUserID=left")
        beside.run(tool, "-n", NAME, "control", *words)
        text = beside.run(tool, "-n", NAME, "values")
        refused = beside.run(tool, "-n", NAME, "control", "Width=2000")
    for name, value in (
        ("Width", "128"),
        ("OffsetX", "16"),
        ("PixelFormat", "'Mono12p'"),
        ("ExposureTime", "750 us"),
        ("Gain", "3.5 dB"),
        ("DeviceUserID", "'left'"),
        # 128 x 582 x 1.5.
        ("PayloadSize", "111744"),
    ):
        assert f"'{name}' = {value}" in text, name
    # 2000 columns are more than the sensor has: INVALID_PARAMETER.
    assert "Width write error" in refused
    assert "invalid-parameter" in refused


def test_aravis_takes_a_hundred_frames_and_misses_none(tool: str) -> None:
    with camera_beside() as beside:
        # A machine under load may keep Aravis from its socket: it may ask for all that it missed.
        counters = aravis_counters(beside, 3, "-q", "1")
        told = beside.finish()
    # 50 frames per second for some 3 s; the first second also opens the camera.
    assert counters["n_completed_buffers"] >= 100
    for name in ("n_failures", "n_underruns", "n_timeouts", "n_missing_frames", "n_missing_packets", "n_error_packets"):
        assert counters[name] == 0, name
    assert counters["n_size_mismatch_errors"] == 0
    # The last frame may be on its way when the client stops.
    assert 0 <= told["frames sent"] - counters["n_completed_buffers"] <= 3


def test_aravis_asks_again_for_what_was_dropped(tool: str) -> None:
    with camera_beside(drop=0.02) as beside:
        # By default Aravis asks for a tenth of a frame's packets at most.
        counters = aravis_counters(beside, 3, "-q", "1")
        told = beside.finish()
    assert counters["n_completed_buffers"] >= 100
    assert counters["n_missing_packets"] == 0
    assert counters["n_missing_frames"] == 0
    assert counters["n_failures"] == 0
    # 624 packets a frame, one in fifty lost.
    lost = told["packets dropped"]
    assert lost == pytest.approx(0.02 * 624 * told["frames sent"], rel=0.15)
    assert counters["n_resent_packets"] == pytest.approx(told["packets sent again"], abs=60)


def test_aravis_triggers_by_software_and_reads_chunks(tool: str) -> None:
    with camera_beside() as beside:
        counters = aravis_counters(beside, 3, "-o", "20", "-u", "Timestamp,FrameID")
        told = beside.finish()
    assert counters["n_completed_buffers"] >= 30
    assert counters["n_failures"] == 0
    assert told["frames taken"] == pytest.approx(counters["n_completed_buffers"], abs=3)


TELEGENIC = """
import json, struct, telegenic
camera = telegenic.Camera("127.0.0.1")
camera.connect()
names = [n for n in camera.feature_names() if not n.endswith("Reg")]
camera.set_float("ExposureTime", 500.0)
camera.set_enum("PixelFormat", "Mono16")
camera.set_integer("Width", 64)
camera.set_integer("Height", 32)
frames = []
with camera.start_acquisition() as acquisition:
    for _ in range(10):
        frame = acquisition.wait_for(timeout=2.0)
        frames.append((str(frame.status), frame.width, frame.height, str(frame.pixel_format), frame.data().hex()))
print(json.dumps({"names": names, "frames": frames, "exposure": camera.get_float("ExposureTime"),
                  "model": camera.get_string("DeviceModelName"), "payload": camera.get_integer("PayloadSize")}))
camera.disconnect()
"""


def test_telegenicam_takes_frames_pixel_by_pixel() -> None:
    pytest.importorskip("telegenic", reason="needs telegenicam from PyPI")
    import numpy as np

    with camera_beside() as beside:
        text = beside.run(sys.executable, "-c", TELEGENIC)
    found = json.loads(text.strip().splitlines()[-1])
    assert found["model"] == "SimCam"
    assert found["exposure"] == 500.0
    assert found["payload"] == 64 * 32 * 2
    y, x = np.mgrid[:32, :64]
    first = (7 * x + 13 * y).astype(np.uint16)
    for status, width, height, _, data in found["frames"]:
        assert "Complete" in status
        assert (width, height) == (64, 32)
        image = np.frombuffer(bytes.fromhex(data), "<u2").reshape(32, 64)
        # The pattern grows by 16 with each frame.
        step = image[0, 0]
        assert step % 16 == 0
        np.testing.assert_array_equal(image, first + step)

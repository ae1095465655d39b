"""What becomes of a GenICam camera's options: each set under the camera's own name, read back, told or refused."""

import math

import pytest
from camera_node_map import READ_ONLY, Node, NodeMap

from drivers.camera.features import Features
from drivers.camera.genicam_setup import GenicamOptions, Setup, set_up


def nodes(**more: Node) -> dict[str, Node]:
    """A GigE Vision 2 camera with everything."""
    made = {
        "PixelFormat": Node("Mono8", symbolics=("Mono8", "Mono12p", "Mono16")),
        "OffsetX": Node(4, 0, 1000, inc=2),
        "OffsetY": Node(0, 0, 1000, inc=2),
        "Width": Node(640, 16, 1280, inc=4),
        "Height": Node(480, 16, 1024, inc=2),
        "ExposureAuto": Node("Continuous", symbolics=("Off", "Continuous")),
        "ExposureTime": Node(100.0, 10.0, 1e6),
        "GainAuto": Node("Continuous", symbolics=("Off", "Continuous")),
        "Gain": Node(3.0, 0.0, 24.0),
        "GammaEnable": Node(True),
        "AcquisitionMode": Node("SingleFrame", symbolics=("SingleFrame", "Continuous")),
        "AcquisitionFrameRateEnable": Node(False),
        "AcquisitionFrameRate": Node(10.0, 1.0, 200.0),
        "TriggerSelector": Node("AcquisitionStart", symbolics=("AcquisitionStart", "ExposureStart")),
        "TriggerMode": Node("Off", symbolics=("Off", "On")),
        "TriggerSource": Node("Software", symbolics=("Software", "Line1", "Line2")),
        "TriggerActivation": Node("RisingEdge", symbolics=("RisingEdge", "FallingEdge")),
        "TriggerSoftware": Node(None),
        "GevSCPSPacketSize": Node(1500, 576, 9000, inc=4),
        "GevSCPD": Node(0, 0, 100_000),
        "GevTimestampTickFrequency": Node(125_000_000, mode=READ_ONLY),
        "GevIEEE1588": Node(False),
        "GevIEEE1588Status": Node("Slave", mode=READ_ONLY),
        "ChunkModeActive": Node(False),
        "ChunkSelector": Node("Timestamp", symbolics=("Image", "Timestamp", "FrameID", "ExposureTime")),
        "ChunkEnable": Node(False),
    }
    return {**made, **more}


def run(camera: dict[str, Node], **options: object) -> tuple[Setup, Features]:
    features = Features(NodeMap(camera))
    return set_up(features, GenicamOptions(**options)), features  # type: ignore[arg-type]


def test_what_is_asked_for_is_set_and_told() -> None:
    camera = nodes()
    setup, features = run(
        camera,
        pixel_format="Mono12p",
        width_px=800,
        height_px=600,
        offset_x_px=100,
        offset_y_px=50,
        exposure_s=0.003,
        gain_db=6.0,
        packet_size_bytes=9000,
        packet_delay_s=8e-6,
        ptp=True,
        chunks=True,
    )
    values = {name: node.value for name, node in camera.items()}
    # 8 us of a clock of 125 MHz are 1000 ticks.
    expected = {
        "PixelFormat": "Mono12p",
        "Width": 800,
        "Height": 600,
        "OffsetX": 100,
        "OffsetY": 50,
        "ExposureTime": 3000.0,
        "Gain": 6.0,
        "GevSCPSPacketSize": 9000,
        "GevSCPD": 1000,
        "GevIEEE1588": True,
        "ChunkModeActive": True,
        "ChunkEnable": True,
        "TriggerMode": "On",
        "TriggerSelector": "ExposureStart",
        "AcquisitionMode": "Continuous",
    }
    assert {name: values[name] for name in expected} == expected
    # What would change by itself, or bend the counts, is off.
    assert (values["ExposureAuto"], values["GainAuto"], values["GammaEnable"]) == ("Off", "Off", False)
    assert features.missing == []
    assert setup.notes == (
        "800x600 Mono12p",
        "software trigger",
        "exposure 3 ms",
        "gain 6 dB",
        "packets of 9000 bytes",
        "packet delay 8 us",
        "PTP Slave",
        "chunks Timestamp, FrameID, ExposureTime",
    )
    assert (setup.shape, setup.format_code, setup.free, setup.chunks) == ((600, 800), 0x010C0047, False, True)


def test_line_trigger_and_free_running() -> None:
    camera = nodes()
    setup, _ = run(camera, trigger="line", trigger_line="Line2", trigger_edge="FallingEdge")
    assert "trigger on Line2" in setup.notes
    assert not setup.free
    assert camera["TriggerSource"].value == "Line2"
    assert camera["TriggerActivation"].value == "FallingEdge"
    setup, _ = run(camera, trigger="free", frame_rate_hz=50.0)
    assert setup.free
    assert camera["TriggerMode"].value == "Off"
    assert (camera["AcquisitionFrameRateEnable"].value, camera["AcquisitionFrameRate"].value) == (True, 50.0)


def test_older_names_do_as_well() -> None:
    camera = nodes(
        ExposureTimeAbs=Node(100.0, 10.0, 1e6),
        GainRaw=Node(0, 0, 300),
        AcquisitionFrameRateAbs=Node(10.0, 1.0, 200.0),
        PtpEnable=Node(False),
    )
    for newer in ("ExposureTime", "Gain", "AcquisitionFrameRate", "GevIEEE1588", "GevIEEE1588Status"):
        del camera[newer]
    setup, features = run(camera, gain_raw=120, trigger="free", frame_rate_hz=20.0, ptp=True)
    assert camera["ExposureTimeAbs"].value == 2000.0
    assert camera["GainRaw"].value == 120
    assert camera["AcquisitionFrameRateAbs"].value == 20.0
    assert camera["PtpEnable"].value is True
    # A raw gain has no unit: nobody may take it for 0 dB.
    assert math.isnan(setup.gain_db)
    assert features.missing == []


@pytest.mark.parametrize(
    ("lacking", "options", "words"),
    [
        ("GevSCPSPacketSize", {"packet_size_bytes": 1500}, "has no GevSCPSPacketSize that can be set to 1500"),
        ("GevSCPD", {"packet_delay_s": 1e-6}, "has no GevSCPD"),
        ("GevIEEE1588", {"ptp": True}, "has no PtpEnable or GevIEEE1588 that can be set to True"),
        ("ChunkModeActive", {"chunks": True}, "has no ChunkModeActive"),
        ("TriggerSource", {"trigger": "line"}, "has no TriggerSource that can be set to Line1"),
        ("AcquisitionFrameRate", {"trigger": "free", "frame_rate_hz": 9.0}, "has no AcquisitionFrameRate or"),
        ("OffsetX", {"offset_x_px": 2}, "has no OffsetX"),
        ("ExposureTime", {"strict": True}, "lacks ExposureTime"),
        ("TriggerSoftware", {"strict": True}, "lacks TriggerSoftware"),
    ],
)
def test_what_is_asked_for_and_lacking_is_refused(lacking: str, options: dict[str, object], words: str) -> None:
    camera = nodes()
    del camera[lacking]
    with pytest.raises(ValueError, match=words):
        run(camera, **options)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"trigger": "line", "trigger_line": "Line9"}, "TriggerSource: found 'Line9', allowed: Software, Line1, Line2"),
        ({"packet_size_bytes": 100}, "GevSCPSPacketSize: found 100, allowed: 576 to 9000"),
        ({"width_px": 642}, "Width: found 642, nearest allowed"),
        ({"gain_db": 1.0, "gain_raw": 1}, "gain_db and gain_raw are both given"),
        ({"mosaic": "90-45-135-0", "offset_x_px": 3}, "OffsetX: found 3, allowed: even"),
        ({"mosaic": "90-45-135-0", "height_px": 33}, "Height: found 33, allowed: even"),
        ({"pixel_format": "RGB8"}, "pixel_format: found 'RGB8'"),
    ],
)
def test_what_cannot_be_is_refused(options: dict[str, object], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        run(nodes(), **options)


def test_a_camera_that_keeps_another_value_is_found_out() -> None:
    class Stubborn(Node):
        def __setattr__(self, name: str, value: object) -> None:
            if name != "value" or "value" not in self.__dict__:
                super().__setattr__(name, value)

    with pytest.raises(ValueError, match="GevSCPSPacketSize: 9000 was set, the camera kept 1500"):
        run(nodes(GevSCPSPacketSize=Stubborn(1500, 576, 9000)), packet_size_bytes=9000)


def test_a_mosaic_that_stands_at_an_odd_place_is_refused() -> None:
    with pytest.raises(ValueError, match="OffsetX stands at 5: a mosaic of polarizers needs it even"):
        run(nodes(OffsetX=Node(5, 0, 1000)), mosaic="90-45-135-0")


def test_missing_chunks_and_triggers_are_told() -> None:
    camera = nodes(ChunkSelector=Node("Image", symbolics=("Image", "Timestamp")))
    del camera["TriggerMode"]
    setup, features = run(camera, chunks=True)
    assert features.missing == ["TriggerMode", "chunk FrameID", "chunk ExposureTime"]
    assert setup.free
    assert "chunks Timestamp" in setup.notes

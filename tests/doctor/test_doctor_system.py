"""What the doctor says of a computer, from facts made up here; and that looking at a real one never hangs or fails."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from polfuse_lab.doctor import Facts, Finding, gather, judge
from polfuse_lab.doctor.facts import Interface, Listing, SerialPort, _probe, _within
from polfuse_lab.doctor.system import rig_ports, rig_producer
from polfuse_lab.rig import Rig

NOW = 1_800_000_000.0  # 2027
HEALTHY = Facts(
    platform="linux",
    user="ada",
    groups=frozenset({"ada", "dialout", "audio"}),
    listed_groups=frozenset({"dialout", "audio"}),
    serial_ports=(SerialPort("/dev/ttyUSB0", "FT232R", True, "dialout"),),
    sound_inputs=Listing(("Line In, ALSA, 48000 Hz",)),
    cameras={"/opt/vendor.cti": Listing(("Vendor Cam 1",))},
    packages={"libportaudio2": True, "libaravis-0.8-0": True},
    interfaces=(Interface("lo", 65536, True, True), Interface("eth0", 9000)),
    receive_buffer_bytes=33_554_432,
    free_bytes=10**11,
    clock_synchronised=True,
    now_s=NOW,
)


def rig(*, camera: dict[str, Any] | None = None, port: str = "/dev/ttyUSB0", radar: str = "sounddevice") -> Rig:
    sections: dict[str, Any] = {
        "waveform": {"centre_hz": 2.4e9, "bandwidth_hz": 80e6, "ramp_up_s": 0.02, "sweep_period_s": 0.04},
        "geometry": {"antenna_height_m": 1.069},
        "radar": {"driver": radar},
        "switches": {"driver": "dowkey_ms", "options": {"port": port}},
        "trolley": {"driver": "by_hand", "length_m": 1.0},
    }
    if camera is not None:
        size = {"width_px": 782, "height_px": 582, "exposure_s": 0.01, "focal_length_m": 0.008, "pixel_pitch_m": 8.3e-6}
        sections["camera"] = {"driver": "harvesters", **size, "options": camera}
        sections["polarizer"] = {"driver": "by_hand"}
    return Rig.model_validate(sections)


CAMERA = rig(camera={"cti": "/opt/vendor.cti"})


def bad(found: list[Finding]) -> dict[str, Finding]:
    return {finding.name: finding for finding in found if not finding.ok}


def test_a_healthy_computer_has_nothing_to_mend() -> None:
    for one in (rig(), CAMERA):
        found = judge(one, HEALTHY)
        assert bad(found) == {}
        assert all(not finding.advice for finding in found)


def test_a_forbidden_port_names_the_group_and_the_command() -> None:
    port = SerialPort("/dev/ttyUSB0", "FT232R", False, "dialout")
    stranger = replace(HEALTHY, serial_ports=(port,), groups=frozenset({"ada"}), listed_groups=frozenset())
    finding = bad(judge(rig(), stranger))["serial port of the switches"]
    assert "/dev/ttyUSB0 may not be used by ada: it belongs to the group dialout" in finding.detail
    assert finding.advice == "sudo usermod -aG dialout ada, then log in again"
    # The group has been given, but this session began before.
    fresh = replace(stranger, listed_groups=frozenset({"dialout"}))
    assert "log out and in again" in bad(judge(rig(), fresh))["serial port of the switches"].advice


def test_ports_of_other_programs_and_addresses_do_not_matter() -> None:
    other = SerialPort("/dev/ttyS0", "", False, "root")
    assert bad(judge(rig(), replace(HEALTHY, serial_ports=(*HEALTHY.serial_ports, other)))) == {}
    assert rig_ports(rig(port="socket://127.0.0.1:4000")) == {}
    assert rig_ports(rig()) == {"switches": "/dev/ttyUSB0"}


def test_modem_manager_is_only_advice_and_only_with_serial_ports() -> None:
    busy = replace(HEALTHY, programs=frozenset({"ModemManager"}))
    (finding,) = [f for f in judge(rig(), busy) if f.name == "ModemManager"]
    assert finding.ok
    assert "systemctl disable" in finding.advice
    assert not [f for f in judge(rig(port="socket://h:1"), busy) if f.name == "ModemManager"]


def test_a_missing_package_is_named_where_the_rig_needs_it() -> None:
    without = replace(HEALTHY, packages={"libportaudio2": False}, sound_inputs=Listing(trouble="no library"))
    assert bad(judge(rig(), without))["PortAudio"].advice == "sudo apt install libportaudio2"
    assert bad(judge(rig(radar="scene"), without)) == {}
    aravis = rig(camera={"cti": "/opt/polfuse-aravis.cti"})
    missing = replace(HEALTHY, packages={"libaravis-0.8-0": False})
    assert bad(judge(aravis, missing))["Aravis"].advice == "sudo apt install libaravis-0.8-0"
    assert "Aravis" not in bad(judge(CAMERA, missing))


def test_a_hanging_sound_server_is_said() -> None:
    hung = replace(HEALTHY, sound_inputs=Listing(trouble="did not answer within 12 s"))
    assert bad(judge(rig(), hung))["sound inputs"].detail == "did not answer within 12 s"


@pytest.mark.parametrize(
    ("listing", "name", "says"),
    [
        (Listing(trouble="vendor.cti: wrong architecture"), "GenTL producer", "wrong architecture"),
        (Listing(), "cameras", "vendor.cti sees no camera"),
    ],
)
def test_producers_and_cameras(listing: Listing, name: str, says: str) -> None:
    found = bad(judge(CAMERA, replace(HEALTHY, cameras={"/opt/vendor.cti": listing})))
    assert says in found[name].detail


def test_packets_must_fit_the_interface() -> None:
    narrow = replace(HEALTHY, interfaces=(Interface("lo", 65536, True, True), Interface("eth0", 1500)))
    jumbo = rig(camera={"cti": "/opt/vendor.cti", "packet_size": 8228})
    finding = bad(judge(jumbo, narrow))["network packets"]
    assert "packets of 8228 bytes do not fit into eth0, whose MTU is 1500" in finding.detail
    assert "sudo ip link set eth0 mtu 9000" in finding.advice
    # Without such packets it is only slower.
    (finding,) = [f for f in judge(CAMERA, narrow) if f.name == "network packets"]
    assert finding.ok
    assert bad(judge(rig(), narrow)) == {}


def test_a_receive_buffer_must_hold_a_frame() -> None:
    # 782 x 582 x 2 bytes = 910,248.
    for size, ok in ((212_992, False), (910_248, True), (4_000_000, True)):
        (finding,) = [
            f for f in judge(CAMERA, replace(HEALTHY, receive_buffer_bytes=size)) if f.name == "receive buffer"
        ]
        assert finding.ok == ok
        assert "910248" in finding.detail
        assert "net.core.rmem_max" in finding.advice
    assert not [f for f in judge(CAMERA, HEALTHY) if f.name == "receive buffer"]


def test_disk_and_clock() -> None:
    full = judge(rig(), replace(HEALTHY, free_bytes=10**8))
    assert "only 0.1 GB free" in bad(full)["disk"].detail
    little = [f for f in judge(rig(), replace(HEALTHY, free_bytes=10**9)) if f.name == "disk"]
    assert [(f.ok, bool(f.advice)) for f in little] == [(True, True)]
    assert "1970-01-01" in bad(judge(rig(), replace(HEALTHY, now_s=100.0)))["clock"].detail
    drifting = [f for f in judge(rig(), replace(HEALTHY, clock_synchronised=False)) if f.name == "clock"]
    assert [f.ok for f in drifting] == [True]


def test_what_is_unknown_is_no_complaint() -> None:
    unknown = Facts(now_s=NOW)
    assert bad(judge(rig(port="socket://h:1"), unknown)) == {}
    assert bad(judge(CAMERA, replace(unknown, groups=frozenset({"dialout"})))) == {}


def test_missing_producer_folders_are_advice() -> None:
    found = judge(rig(), replace(HEALTHY, producer_folders_missing=("/nowhere",)))
    (finding,) = [f for f in found if f.name == "GENICAM_GENTL64_PATH"]
    assert finding.ok
    assert "/nowhere" in finding.detail


def test_the_producer_is_the_rigs_own() -> None:
    assert rig_producer(CAMERA) == "/opt/vendor.cti"
    assert rig_producer(rig(camera={})) == ""
    assert rig_producer(rig()) == ""


def test_looking_at_this_computer_is_bounded_and_complete(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "one.cti").write_bytes(b"no library")
    monkeypatch.setenv("GENICAM_GENTL64_PATH", f"{tmp_path}:{tmp_path / 'nowhere'}")
    began = time.monotonic()
    facts = gather(tmp_path)
    assert time.monotonic() - began < 40
    assert facts.free_bytes is not None
    assert facts.user
    assert facts.producers == (str(tmp_path / "one.cti"),)
    assert facts.producer_folders_missing == (str(tmp_path / "nowhere"),)
    # Whatever this is, it is no producer: said, not raised.
    assert facts.cameras[str(tmp_path / "one.cti")].trouble
    if sys.platform == "linux":
        assert any(interface.loopback for interface in facts.interfaces)
        assert facts.receive_buffer_bytes is not None
        assert facts.receive_buffer_bytes > 0


def test_whoever_hangs_or_fails_stays_unknown() -> None:
    began = time.monotonic()
    assert _within(lambda: time.sleep(5) or 1, 0, 0.2) == 0
    assert _within(lambda: 1 // 0, 7) == 7
    assert _within(lambda: 3, 0) == 3
    # A process that needs longer than it is given.
    assert _probe("sound", seconds=0.001).trouble == "did not answer within 0.001 s"
    assert time.monotonic() - began < 3


def test_a_probe_answers_in_one_line_of_json(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "polfuse_lab.doctor.probe", "cameras", str(tmp_path / "none.cti")]
    said = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True).stdout
    answer = json.loads(said.strip().splitlines()[-1])
    assert answer["found"] == []
    assert answer["trouble"]

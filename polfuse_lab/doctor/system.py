"""What the computer lacks for a rig: permissions, packages, network, space, time. Judges :class:`Facts` alone."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

from polfuse_lab.doctor.facts import Facts, Interface, SerialPort, serial_port
from polfuse_lab.doctor.findings import Finding
from polfuse_lab.rig import Rig

FREE_LEAST = 200_000_000
"""Less space than this is not enough for any collect."""
FREE_WISHED = 5_000_000_000
RECEIVE_WISHED = 8_000_000
"""Receive buffer that survives pauses of a busy computer."""
JUMBO_MTU = 8000
ETHERNET_MTU = 1500
EARLIEST_S = 1_735_689_600.0
"""2025-01-01: a clock that is before it was never set."""
AUDIO_PACKAGE = "libportaudio2"


def judge(rig: Rig, facts: Facts) -> list[Finding]:
    """Everything about the computer that matters to this rig, good or bad."""
    return [*_serial(rig, facts), *_sound(rig, facts), *_camera(rig, facts), *_disk(facts), *_clock(facts)]


def _found(name: str, ok: bool, detail: str, advice: str = "") -> Finding:
    return Finding(name, "system", ok, detail, advice)


def rig_ports(rig: Rig) -> dict[str, str]:
    """Serial ports that a rig names (not addresses such as ``socket://``), by the kind of device on each."""
    sections = {kind: rig.section(kind) for kind in ("switches", "trolley", "polarizer", "source_polarizer")}
    named = {kind: section.options.get("port") for kind, section in sections.items() if section is not None}
    return {kind: port for kind, port in named.items() if isinstance(port, str) and "://" not in port}


def rig_producer(rig: Rig) -> str:
    """GenTL producer that a rig names; empty for none, or for the one that comes with the camera's packages."""
    if rig.camera is None or rig.camera.driver != "harvesters":
        return ""
    return str(rig.camera.options.get("cti") or "")


def _serial(rig: Rig, facts: Facts) -> Iterator[Finding]:
    ports = {port.device: port for port in facts.serial_ports}
    wanted = rig_ports(rig)
    for kind, device in wanted.items():
        port = ports.get(device) or serial_port(device)
        if not port.accessible:
            yield _found(f"serial port of the {kind}", False, *_forbidden(port, facts))
    if wanted and "ModemManager" in facts.programs:
        yield _found(
            "ModemManager",
            True,
            "runs, and sends modem commands to new serial ports",
            "sudo systemctl disable --now ModemManager",
        )


def _forbidden(port: SerialPort, facts: Facts) -> tuple[str, str]:
    group = port.group or "dialout"
    what = f"{port.device} may not be used by {facts.user or 'this user'}"
    if group in facts.listed_groups and group not in facts.groups:
        return f"{what} in this session", f"log out and in again: the group {group} is new to you"
    return (
        f"{what}: it belongs to the group {group}",
        f"sudo usermod -aG {group} {facts.user or '$USER'}, then log in again",
    )


def _sound(rig: Rig, facts: Facts) -> Iterator[Finding]:
    if rig.radar.driver != "sounddevice":
        return
    inputs = facts.sound_inputs
    if facts.packages.get(AUDIO_PACKAGE) is False and not inputs.found:
        yield _found("PortAudio", False, f"the package {AUDIO_PACKAGE} is missing", f"sudo apt install {AUDIO_PACKAGE}")
    elif inputs.trouble:
        yield _found(
            "sound inputs", False, inputs.trouble, "restart the sound server, or unplug the sound card and plug it in"
        )
    if (
        facts.platform == "linux"
        and "audio" not in facts.groups
        and not inputs.found
        and "audio" in facts.listed_groups
    ):
        yield _found("audio group", False, "the group audio is new to you", "log out and in again")


def _camera(rig: Rig, facts: Facts) -> Iterator[Finding]:
    producer = rig_producer(rig)
    if facts.producer_folders_missing:
        folders = ", ".join(facts.producer_folders_missing)
        yield _found(
            "GENICAM_GENTL64_PATH", True, f"names what is no folder: {folders}", "correct the variable in your profile"
        )
    if not producer:
        return
    listing = facts.cameras.get(producer)
    if listing is not None and listing.trouble:
        advice = "check that it is a 64 bit producer and that what it needs is installed"
        yield _found("GenTL producer", False, listing.trouble, advice)
    elif listing is not None and not listing.found:
        advice = "check its power and cable, and that its address is in the network of this computer's interface"
        yield _found("cameras", False, f"{Path(producer).name} sees no camera", advice)
    if "aravis" in producer.lower() and facts.packages.get("libaravis-0.8-0") is False:
        yield _found("Aravis", False, "the package libaravis-0.8-0 is missing", "sudo apt install libaravis-0.8-0")
    yield from _network(rig, facts)


def _network(rig: Rig, facts: Facts) -> Iterator[Finding]:
    """A GigE Vision camera: packets that fit, and a buffer that holds them."""
    assert rig.camera is not None
    wired = [i for i in facts.interfaces if i.up and not i.loopback]
    widest = max(wired, key=lambda i: i.mtu, default=Interface("none", ETHERNET_MTU))
    packet = rig.camera.options.get("packet_size")
    if isinstance(packet, int) and wired and packet > widest.mtu:
        yield _found(
            "network packets",
            False,
            f"packets of {packet} bytes do not fit into {widest.name}, whose MTU is {widest.mtu}",
            f"sudo ip link set {widest.name} mtu 9000 (and in the switch between), or a smaller packet_size",
        )
    elif wired and widest.mtu < JUMBO_MTU:
        yield _found(
            "network packets",
            True,
            f"no interface takes jumbo frames ({widest.name}: MTU {widest.mtu}), which cost the computer more",
            f"sudo ip link set {widest.name} mtu 9000, where camera and switch can do it",
        )
    buffer = facts.receive_buffer_bytes
    frame = rig.camera.width_px * rig.camera.height_px * (1 if rig.camera.pixel_format == "Mono8" else 2)
    if buffer is not None and buffer < RECEIVE_WISHED:
        what = f"net.core.rmem_max is {buffer} bytes, a frame has {frame}"
        advice = "sudo sysctl -w net.core.rmem_max=33554432 (and the same in /etc/sysctl.d/ to keep it)"
        yield _found("receive buffer", buffer >= frame, what, advice)


def _disk(facts: Facts) -> Iterator[Finding]:
    if facts.free_bytes is None:
        return
    free = f"{facts.free_bytes / 1e9:.1f} GB free"
    if facts.free_bytes < FREE_WISHED:
        advice = "free some space, or record to another disk ('polfuse plan' tells what a collect needs)"
        yield _found("disk", facts.free_bytes >= FREE_LEAST, f"only {free} where the rig file is", advice)
    else:
        yield _found("disk", True, free)


def _clock(facts: Facts) -> Iterator[Finding]:
    day = time.strftime("%Y-%m-%d", time.gmtime(facts.now_s))
    if facts.now_s < EARLIEST_S:
        yield _found("clock", False, f"the computer says that it is {day}", "set its clock: sessions carry the date")
    elif facts.clock_synchronised is False:
        advice = "connect it to a time server if dates matter (intervals do not depend on it)"
        yield _found("clock", True, f"{day}, not synchronised", advice)

"""The whole simulated rig: its services, its rig file, and 'polfuse sim'."""

from __future__ import annotations

import json
import os
import signal
import socket
import stat
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
from audio_rig import need, position_in_cycle, take

from drivers import registry
from drivers.errors import DeviceBadAnswer, DeviceLost, DeviceRefused, DeviceTimeout
from drivers.records import Channel
from hw_mocks.loopback import Address, listen
from hw_mocks.rig import SimulatedRig
from hw_mocks.sound_card import Synthesizer
from hw_mocks.world import World
from hw_mocks.world_link import WorldClient, WorldServer
from polfuse_lab.errors import PolfuseError
from polfuse_lab.rig import driver_options, load_rig

FIELD = Path(__file__).resolve().parents[2] / "examples" / "scenes" / "field.toml"


def hung_up(connection: socket.socket) -> bool:
    """Whether the peer closes the connection without an answer (a time-out raises)."""
    try:
        return connection.recv(100) == b""
    except ConnectionError:
        return True


def test_the_world_is_seen_from_outside() -> None:
    world = World()
    with WorldServer(world) as server:
        client = WorldClient(server.url)
        world.trolley_x_m.hold(0.25)
        world.receive.set("V")
        time.sleep(0.001)
        state = client.state()
        assert (state["trolley_x_m"], state["transmit"], state["receive"], state["polarizer_rad"]) == (
            0.25,
            "H",
            "V",
            0,
        )
        assert abs(state["t_ns"] - time.monotonic_ns()) < 10**9
        client.close()
        client.close()
        assert client.state()["receive"] == "V", "a closed client connects again"
        with pytest.raises(DeviceLost, match="hung up"):
            WorldClient(Address(Address.parse(server.url).port, "f" * 32).url).state()
        with socket.create_connection(("127.0.0.1", Address.parse(server.url).port), timeout=5) as stranger:
            stranger.sendall(b"x" * 5000)
            assert hung_up(stranger)
        assert client.state()["receive"] == "V", "strangers do not disturb"
    with pytest.raises(DeviceLost):
        client.state()
    client.close()
    server.close()


def test_wrong_servers_are_refused() -> None:
    server, address = listen()

    def answer(reply: bytes) -> None:
        connection, _ = server.accept()
        with connection:
            connection.recv(200)
            connection.sendall(reply)
            connection.recv(200)

    with server:
        for reply, error in ((b"hello\n", DeviceBadAnswer), (b"[1]\n", DeviceBadAnswer), (b"{", DeviceTimeout)):
            thread = threading.Thread(target=answer, args=(reply,))
            thread.start()
            client = WorldClient(address.url, timeout_s=0.2)
            with pytest.raises(error):
                client.state()
            client.close()
            thread.join()
    with pytest.raises(DeviceRefused, match="no address"):
        WorldClient("tcp://198.51.100.7:80?token=a")


@pytest.mark.parametrize("audio", ["tcp", "pulse"])
def test_the_rig_file_reaches_every_device(tmp_path: Path, audio: str) -> None:
    if audio == "pulse":
        need("pulse")
    before = set(threading.enumerate())
    with SimulatedRig(FIELD, tmp_path / "sim", seed=5, audio=audio) as simulated:  # type: ignore[arg-type]
        path = simulated.write_rig()
        assert stat.S_IMODE(path.stat().st_mode) == 0o600
        rig = load_rig(path)
        assert rig.waveform == simulated.file.waveform
        devices = {}
        for kind in ("switches", "radar", "trolley", "camera", "polarizer"):
            section = rig.section(kind)
            assert section is not None
            devices[kind] = registry.driver_class(kind, section.driver)(driver_options(rig, kind, path))
        for device in devices.values():
            device.open()
        state = devices["switches"].select(Channel.HV)
        assert (state.transmit, state.receive, state.verified) == ("H", "V", True)
        assert simulated.world.receive.at() == "V"
        devices["trolley"].start_move(0.0508)
        while devices["trolley"].poll().moving:
            time.sleep(0.01)
        assert simulated.world.trolley_x_m.at() == pytest.approx(0.0508, abs=1e-5)
        # The record is the standing rig's cycle for this place, channel and seed, bit for bit.
        block = take(devices["radar"], 4000)
        file = simulated.file
        twin = Synthesizer(file.scene(), file.waveform, file.geometry, file.audio, simulated.world, 5)
        assert position_in_cycle(block.samples, twin.block(0, 3841, time.monotonic_ns())) >= 0
        devices["camera"].trigger()
        deadline = time.monotonic() + 5
        while (frame := devices["camera"].poll()) is None:
            assert time.monotonic() < deadline
            time.sleep(0.01)
        assert frame.image.shape == (582, 782)
        for device in devices.values():
            device.make_safe()
            device.close()
        simulated.check()
    assert set(threading.enumerate()) <= before


def test_what_cannot_be_started_is_said(tmp_path: Path) -> None:
    with pytest.raises(PolfuseError, match="seed"):
        SimulatedRig(FIELD, tmp_path, seed=-1)
    with SimulatedRig(FIELD, tmp_path, audio="tcp") as rig, pytest.raises(PolfuseError, match="cannot be written"):
        rig.write_rig(tmp_path / "no" / "such" / "rig.toml")


@pytest.mark.parametrize("end", [signal.SIGINT, signal.SIGTERM])
def test_sim_prints_endpoints_runs_and_ends_cleanly(tmp_path: Path, end: signal.Signals) -> None:
    rig_path = tmp_path / "rig.toml"
    command = [sys.executable, "-c", "from polfuse_lab.cli import main; main()", "sim", str(FIELD)]
    process = subprocess.Popen(
        [*command, "--rig-out", str(rig_path), "--audio", "tcp", "--json"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONUNBUFFERED": ""},
    )
    assert process.stdout is not None
    endpoints = json.loads(process.stdout.readline())["endpoints"]
    assert set(endpoints) == {"switches", "trolley", "polarizer", "radar", "audio_stream", "world"}
    client = WorldClient(endpoints["world"])
    assert client.state()["transmit"] == "H"
    client.close()
    load_rig(rig_path)
    process.send_signal(end)
    out, err = process.communicate(timeout=10)
    assert process.returncode == 0, err
    assert out == ""
    assert "Traceback" not in err


def test_sim_answers_a_wrong_scene_in_one_line(tmp_path: Path) -> None:
    scene = tmp_path / "wrong.toml"
    scene.write_text("[audio]\nnoise_cycle = 0\n")
    command = [sys.executable, "-c", "from polfuse_lab.cli import main; main()", "sim", str(scene)]
    run = subprocess.run(
        [*command, "--rig-out", str(tmp_path / "rig.toml")], capture_output=True, text=True, timeout=30, check=False
    )
    assert run.returncode == 1
    assert run.stderr.count("\n") == 1
    assert "line 2, audio.noise_cycle: found 0" in run.stderr

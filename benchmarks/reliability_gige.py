"""The simulated GigE Vision camera against Aravis' client, and its control protocol under random datagrams."""

from __future__ import annotations

import random
import time
import tracemalloc

from benchmarks.gige_peers import PeerMissing, aravis_counters, camera_beside
from benchmarks.rows import Row
from hw_mocks.gige_camera import GigeCamera, Pattern
from hw_mocks.gige_camera.gvcp import GvcpServer
from hw_mocks.world import World

_PEER = "Aravis 0.8"
_SEEDS = (
    "42110002 00000001",
    "42010080 00080002 00000000 00000a00",
    "42010082 00100003 00000a00 00000002 00000938 000003e8",
    "42010084 00080004 00000200 00000200",
    "42010086 00100005 000000e8 7261696c 00000000 00000000",
    "42000040 000c0006 00000007 00000003 00000005",
    "42100040 00140007 00000000 00000003 00000005 00000000 00000002",
    "42010082 00080008 00010000 00000040",
)
_GROWTH_BYTES = 200_000


def run(quick: bool) -> list[Row]:
    """Frames without loss, frames with loss and resends, processor time at 60 frames per second, fuzz."""
    seconds = 3 if quick else 12
    rows = [
        _frames("gige.aravis_frames", seconds, 0.9 if quick else 1.0),
        _frames("gige.aravis_resends", seconds, 0.9 if quick else 1.0, drop=0.02),
        _throughput("gige.throughput_1500", seconds, 1500),
        _throughput("gige.throughput_9000", seconds, 9000),
        _fuzz(20_000 if quick else 1_000_000),
    ]
    return rows


def _frames(name: str, seconds: int, share: float, *, drop: float = 0.0) -> Row:
    wanted = (100 if seconds < 10 else 500) * share
    target = f"at least {wanted:g} frames at 50 per second, none missing, with {drop:.0%} of packets dropped"
    try:
        with camera_beside(drop=drop) as beside:
            # By default Aravis asks for a tenth of a frame's packets at most.
            found = aravis_counters(beside, seconds, "-q", "1")
            told = beside.finish()
    except PeerMissing as missing:
        return Row(name, _PEER, None, True, f"not compared: {missing}")
    names = ("n_failures", "n_underruns", "n_timeouts", "n_missing_frames", "n_missing_packets", "n_error_packets")
    bad = {counter: found[counter] for counter in names if found[counter]}
    if drop and not found["n_resent_packets"]:
        bad["n_resent_packets"] = 0
    good = not bad and found["n_completed_buffers"] >= wanted
    text = f"{found['n_completed_buffers']} frames, {found['n_resent_packets']} packets resent"
    if bad:
        text += f", {bad}"
    return Row(name, _PEER, found["n_completed_buffers"] / told["frames sent"], good, target, error=text)


def _throughput(name: str, seconds: int, packet_size: int) -> Row:
    target = "60 frames per second of 782 x 582 Mono16 with less than 60 % of one core"
    try:
        with camera_beside(frame_rate_hz=60.0, packet_size=packet_size) as beside:
            # Aravis would choose the largest packets that the link carries.
            found = aravis_counters(beside, seconds, "-f", "60", "-i", str(packet_size), "-j", "never", "-q", "1")
            told = beside.finish()
    except PeerMissing as missing:
        return Row(name, _PEER, None, True, f"not compared: {missing}")
    frames = found["n_completed_buffers"]
    # One second is allowed for opening the camera.
    good = frames >= 60 * (seconds - 1) and not found["n_missing_packets"] and not found["n_failures"]
    core = told["cpu seconds"] / (told["frames sent"] / 60)
    text = f"{frames} frames in {seconds} s, {found['n_resent_packets']} packets resent, "
    text += f"{found['n_missing_packets']} missing, {core:.0%} of a core"
    return Row(name, "one core", core, good and core < 0.6, target, error=text)


def _fuzz(inputs: int) -> Row:
    """Mutated and random datagrams into the control server, without sockets."""
    chance = random.Random(1)
    seeds = [bytes.fromhex(text) for text in _SEEDS]
    peers = [("127.0.0.1", 40000), ("127.0.0.1", 40001)]
    with GigeCamera(Pattern(64, 96), World(), port=0) as camera:
        server = GvcpServer(camera.registers, lambda request: None, lambda: None)
        slowest_s, growth, start_bytes = 0.0, 0, 0
        tracemalloc.start()
        try:
            for k in range(inputs):
                if k == inputs // 10:
                    start_bytes = tracemalloc.get_traced_memory()[0]
                datagram = bytearray(chance.choice(seeds) if chance.random() < 0.9 else chance.randbytes(40))
                for _ in range(chance.randrange(4)):
                    datagram[chance.randrange(len(datagram))] = chance.randrange(256)
                begin = time.perf_counter()
                server.answer(bytes(datagram[: chance.randrange(len(datagram) + 1)]), peers[k % 7 == 0], k)
                slowest_s = max(slowest_s, time.perf_counter() - begin)
            growth = tracemalloc.get_traced_memory()[0] - start_bytes
        finally:
            tracemalloc.stop()
        camera.check()
    target = f"{inputs} datagrams, none raises, the slowest below 1 s, memory grows by less than {_GROWTH_BYTES} bytes"
    text = f"slowest {slowest_s * 1e3:.1f} ms, growth {growth} bytes"
    return Row("gige.fuzz", "", growth / _GROWTH_BYTES, growth < _GROWTH_BYTES and slowest_s < 1.0, target, error=text)

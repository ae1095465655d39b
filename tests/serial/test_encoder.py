"""Encoder trolley: lines, counters that wrap, clocks that drift, and the driver against the simulated controller."""

from __future__ import annotations

import math
import random
import time
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from serial_helpers import PatientOperator, Talker, both_kinds, wait_for

from drivers.contracts import Trolley
from drivers.errors import DeviceBadAnswer, DeviceError, DeviceLost, DeviceRefused, DeviceTimeout
from drivers.trolley.encoder import EncoderTrolley
from drivers.trolley.encoder_protocol import EncoderLine, checksum, format_line, parse_line, unwrap
from drivers.trolley.encoder_track import EncoderTrack, Jump, Scale
from hw_mocks.encoder import Encoder, start_encoder
from hw_mocks.faults import FaultKind
from hw_mocks.wire import Kind, serve
from hw_mocks.world import World

PER_M = 10_000.0


def driver(url: str, operator: PatientOperator | None = None, **options: Any) -> EncoderTrolley:
    given = {"length_m": 4.0, "counts_per_m": PER_M, "rest_s": 0.1, "start_x_m": 0.0} | options
    return EncoderTrolley(EncoderTrolley.Options(port=url, **given), operator or PatientOperator())


# Lines


def test_exact_bytes_of_a_line() -> None:
    # The checksum as NMEA 0183 defines it, character by character.
    body = "ENC,7,1234567,4294967295,"
    parity = 0
    for character in body:
        parity ^= ord(character)
    assert parse_line(f"${body}*{parity:02X}") == EncoderLine(7, 1_234_567, 4_294_967_295, None)
    assert format_line(EncoderLine(0, 0, 0, 65_535)) == "$ENC,0,0,0,65535*" + f"{checksum('ENC,0,0,0,65535'):02X}"
    # NMEA 0183's own example of its checksum.
    assert checksum("GPGLL,5300.97914,N,00259.98174,E,125926,A") == 0x28


def test_the_simulated_controller_says_exactly_that() -> None:
    world = World()
    encoder = Encoder(world, first_count=5, first_micros=10)
    said = encoder.handle(b"").decode()
    first = said.splitlines()[0]
    assert said.endswith("\r\n")
    assert parse_line(first) == EncoderLine(1, 10, 5, None)
    assert format_line(EncoderLine(1, 10, 5, None)) == first


@given(st.integers(0, 255), st.integers(0, 2**32 - 1), st.integers(0, 2**32 - 1), st.none() | st.integers(0, 2**32 - 1))
def test_lines_there_and_back(sequence: int, micros: int, count: int, index: int | None) -> None:
    line = EncoderLine(sequence, micros, count, index)
    text = format_line(line)
    assert parse_line(text) == line
    # Any one character changed is noticed: an exclusive or sees every change of a single one.
    place = random.Random(micros).randrange(1, len(text) - 3)
    assert parse_line(text[:place] + chr(ord(text[place]) ^ 1) + text[place + 1 :]) is None


@pytest.mark.parametrize("text", ["", "$ENC", "$ENC,1,2,3,*00", "$ENC,256,1,1,*00", "ok", "$ENC,-1,2,3,4*11"])
def test_other_lines(text: str) -> None:
    assert parse_line(text) is None


@given(st.text(max_size=60))
@settings(deadline=None)
def test_fuzz_lines(text: str) -> None:
    assert parse_line(text) is None or text.startswith("$ENC,")


@given(st.integers(-(2**40), 2**40), st.integers(-(2**15), 2**15 - 1))
def test_unwrapped_counters_follow(last: int, step: int) -> None:
    assert unwrap(last, (last + step) % 2**16, 16) == last + step


# Track


def track(**changes: Any) -> EncoderTrack:
    given: dict[str, Any] = {
        "counts_per_m": PER_M, "scale_sd": 0.0, "reference_sd_m": 1e-3, "index_x_m": None, "counter_bits": 32,
        "max_speed_m_s": 5.0,
    }  # fmt: skip
    return EncoderTrack(Scale(**(given | changes)), 0.0)


@pytest.mark.parametrize("drift", [0.0, 5e-3, -5e-3])
def test_drifting_clock_and_late_lines_are_laid_on_the_host_s_clock(drift: float) -> None:
    """A trolley at 0.5 m/s, lines 1 to 4 ms late, now and then 0.3 s: positions at host times are met."""
    found = track()
    dice = random.Random(1)
    start_ns = 5_000_000_000_000
    for number in range(500):
        host_s = number * 0.01
        late_s = 0.3 if 100 < number < 110 else dice.uniform(1e-3, 4e-3)
        micros = round(host_s * (1 + drift) * 1e6) % 2**32
        line = EncoderLine(number % 256, micros, round(0.5 * host_s * PER_M), None)
        found.add(line, start_ns + round((host_s + late_s) * 1e9))
    for host_s in (0.5, 1.234, 3.0, 4.985):
        x_m, sd_m = found.position(start_ns + round(host_s * 1e9))
        # The shortest delay (1 ms) is taken for the clocks' offset: 0.5 mm; half a count; the rate's error 1 ms in 3 s.
        assert x_m == pytest.approx(0.5 * host_s, abs=0.5 * 2.5e-3 + 1e-4)
        assert abs(x_m - 0.5 * host_s) < 3 * sd_m
    assert abs(found.last_t_ns - start_ns - 4.99e9) < 3e6


def test_wrapping_counter_and_clock() -> None:
    found = track(counter_bits=16)
    for number in range(300):
        micros = (2**32 - 1_000_000 + number * 10_000) % 2**32
        found.add(EncoderLine(number % 256, micros, (65_000 + 20 * number) % 65_536, None), number * 10_000_000)
    # 20 counts a line: 299 * 20 / 10000 m.
    assert found.last_x_m == pytest.approx(0.598, abs=1e-12)
    assert found.lost_lines == 0


def test_lost_lines_are_counted_and_lose_no_count() -> None:
    found = track()
    for number in (0, 1, 2, 5, 6, 300):
        found.add(EncoderLine(number % 256, number * 10_000, number * 10, None), number * 10_000_000)
    # 3 and 4, and of 7 to 299 all but a whole turn of the sequence (256): 293 - 256.
    assert found.lost_lines == 2 + 37
    assert found.last_x_m == pytest.approx(0.3)


def test_the_index_mark_sets_the_position() -> None:
    found = track(index_x_m=1.0, counts_per_m=-PER_M)
    found.add(EncoderLine(0, 0, 0, None), 0)
    found.add(EncoderLine(1, 10_000, 2**32 - 100, None), 10_000_000)
    assert (found.last_x_m, found.indexed) == (pytest.approx(0.01), False)
    found.add(EncoderLine(2, 20_000, 2**32 - 200, 2**32 - 150), 20_000_000)
    assert (found.last_x_m, found.indexed) == (pytest.approx(1.005), True)
    # A controller that went on while nobody listened has passed the mark already.
    later = track(index_x_m=1.0)
    later.add(EncoderLine(9, 9, 700, 500), 0)
    assert later.last_x_m == pytest.approx(1.02)


def test_a_clock_that_jumps_ahead_is_noticed_and_positions_stay() -> None:
    found = track()
    for number in range(100):
        jump = 2_000_000 if number >= 50 else 0
        found.add(EncoderLine(number, number * 10_000 + jump, number * 10, None), number * 10_000_000)
    assert found.clock_jumps == 1
    assert found.last_x_m == pytest.approx(0.099)
    assert found.last_t_ns == pytest.approx(0.99e9, abs=1e4)
    with pytest.raises(ValueError, match="earlier than what is kept"):
        found.position(100_000_000)


@pytest.mark.parametrize(
    ("line", "says"),
    [
        (EncoderLine(2, 5_000, 20, None), "restarted"),
        (EncoderLine(2, 20_000, 5_000, None), r"jumped by \+0.499 m in 10 ms"),
    ],
)
def test_jumps(line: EncoderLine, says: str) -> None:
    found = track()
    found.add(EncoderLine(0, 0, 0, None), 0)
    found.add(EncoderLine(1, 10_000, 10, None), 10_000_000)
    with pytest.raises(Jump, match=says):
        found.add(line, 20_000_000)


def test_uncertainty_grows_with_the_way() -> None:
    found = track(scale_sd=0.01)
    for number in range(101):
        found.add(EncoderLine(number, number * 10_000, number * 100, None), number * 10_000_000)
    for number in range(101, 201):  # then it stands
        found.add(EncoderLine(number, number * 10_000, 10_000, None), number * 10_000_000)
    x_m, sd_m = found.position()
    # 1 mm of reference, 1 % of 1 m, a uniform count of 0.1 mm.
    assert x_m == pytest.approx(1.0)
    assert sd_m == pytest.approx(math.sqrt(1e-6 + 1e-4 + 1e-8 / 12), rel=1e-9)
    assert found.spread_m(0.9) == 0.0
    assert found.spread_m(1.5) > 0.4
    assert found.spread_m(60) == math.inf


# Driver


@both_kinds
def test_a_person_pushes_to_a_mark(kind: Kind) -> None:
    world, operator = World(), PatientOperator()
    with start_encoder(world, kind=kind) as wire:
        trolley = driver(wire.url, operator)
        assert isinstance(trolley, Trolley)
        identity = trolley.open()
        assert (identity.kind, identity.driver) == ("trolley", "encoder")
        assert trolley.limits_m == (-2.0, 2.0)
        wait_for(lambda: not trolley.poll().moving, "rest")
        trolley.start_move(0.2)
        assert "Push the trolley to x = +0.2000 m (2.2000 m from the rail's left end)" in operator.prompts[1]
        fix = trolley.poll()
        assert (fix.moving, fix.state) == (True, "asked")
        assert isinstance(wire.handler, Encoder)
        wire.handler.push(0.203, 1.0)
        wait_for(lambda: not trolley.poll().moving, "arrival")
        fix = trolley.poll()
        # A count is 0.1 mm; where it really stands is what is told.
        assert fix.x_m == pytest.approx(0.203, abs=1e-4)
        assert fix.state == "standing"
        assert operator.withdrawn == {1}
        assert abs(time.monotonic_ns() - fix.t_host_ns) < 0.2e9
        trolley.close()
        trolley.close()


def test_off_the_mark_it_waits_until_the_operator_confirms() -> None:
    world, operator = World(), PatientOperator()
    with start_encoder(world) as wire:
        trolley = driver(wire.url, operator)
        trolley.open()
        trolley.start_move(0.1)
        assert isinstance(wire.handler, Encoder)
        wire.handler.push(0.15, 2.0)
        time.sleep(0.35)
        assert trolley.poll().moving
        operator.confirmed.add(1)
        wait_for(lambda: not trolley.poll().moving, "the confirmation")
        assert trolley.poll().x_m == pytest.approx(0.15, abs=1e-4)
        trolley.start_move(0.2)
        trolley.start_move(0.3)
        trolley.make_safe()
        assert operator.withdrawn == {1, 2, 3}
        trolley.close()


def test_positions_under_way_are_those_of_their_instants() -> None:
    world = World()
    with start_encoder(world) as wire:
        trolley = driver(wire.url)
        trolley.open()
        time.sleep(0.1)
        assert isinstance(wire.handler, Encoder)
        wire.handler.push(1.0, 1.0)
        time.sleep(0.5)
        t_ns = time.monotonic_ns()
        time.sleep(0.03)
        fix = trolley.position_at(t_ns)
        # 1 m/s, and lines that come some milliseconds late on a busy machine.
        assert fix.x_m == pytest.approx(world.trolley_x_m.at(t_ns), abs=0.02)
        assert fix.t_host_ns == t_ns
        assert trolley.poll().state == "pushed"
        with pytest.raises(ValueError, match="earlier"):
            trolley.position_at(t_ns - 60_000_000_000)
        trolley.close()


@pytest.mark.parametrize("direction", [1, -1])
def test_start_direction_and_index(direction: int) -> None:
    world = World()
    encoder = Encoder(world, counts_per_m=direction * PER_M, index_x_m=0.5)
    with serve(encoder) as wire:
        # It stands at 0, but is believed to stand at 0.1 until the mark at 0.5 is passed.
        trolley = driver(wire.url, direction=direction, start_x_m=0.1, index_x_m=0.5)
        trolley.open()
        assert trolley.poll().x_m == pytest.approx(0.1, abs=1e-4)
        encoder.push(0.6, 3.0)
        wait_for(lambda: not trolley.poll().moving, "rest")
        assert trolley.poll().x_m == pytest.approx(0.6, abs=2e-4)
        trolley.close()


def test_lost_and_damaged_lines_lose_no_position() -> None:
    world = World()
    with start_encoder(world) as wire:
        trolley = driver(wire.url)
        trolley.open()
        wire.faults.start(FaultKind.DROP_PACKETS, amount=0.5)
        assert isinstance(wire.handler, Encoder)
        wire.handler.push(0.5, 2.0)
        time.sleep(0.3)
        wire.faults.stop(FaultKind.DROP_PACKETS)
        wire.faults.start(FaultKind.PARTIAL_LINE, for_s=0.05)
        wait_for(lambda: not trolley.poll().moving, "rest")
        assert trolley.poll().x_m == pytest.approx(0.5, abs=1e-4)
        assert trolley.lost_lines > 5
        trolley.close()


def test_a_controller_that_restarts_is_lost() -> None:
    world = World()
    with start_encoder(world) as wire:
        trolley = driver(wire.url)
        trolley.open()
        time.sleep(0.05)
        assert isinstance(wire.handler, Encoder)
        wire.handler.power_cycle()
        with pytest.raises(DeviceLost, match=r"restarted.*push the trolley back to its start"):
            wait_for(lambda: trolley.poll() is None, "the restart")
        trolley.open()
        assert trolley.poll().x_m == pytest.approx(0.0, abs=1e-4)
        trolley.close()


def test_silence_is_a_timeout() -> None:
    with start_encoder(World()) as wire:
        trolley = driver(wire.url, silence_s=0.3)
        trolley.open()
        wire.faults.start(FaultKind.SILENCE)
        started = time.monotonic()
        with pytest.raises(DeviceTimeout, match=r"no line of the encoder for 0\.3 s"):
            wait_for(lambda: trolley.poll() is None, "the silence")
        assert time.monotonic() - started < 1
        trolley.close()


def test_somebody_else_on_the_port() -> None:
    with serve(Talker(b"ok\r\n")) as wire:
        trolley = driver(wire.url)
        with pytest.raises(DeviceBadAnswer, match="none of an encoder"):
            trolley.open()
        with pytest.raises(DeviceLost, match="not open"):
            trolley.poll()


@both_kinds
def test_unplugged(kind: Kind) -> None:
    world = World()
    with start_encoder(world, kind=kind) as wire:
        trolley = driver(wire.url)
        trolley.open()
        wire.unplug()
        with pytest.raises((DeviceLost, DeviceTimeout)):
            wait_for(lambda: trolley.poll() is None, "the loss")
        trolley.make_safe()
        trolley.close()
        wire.plug()
        trolley.open()
        assert trolley.poll().state != "asked"
        trolley.close()


@pytest.mark.parametrize("x_m", [2.1, -2.1, math.nan])
def test_beyond_the_rail(x_m: float) -> None:
    operator = PatientOperator()
    with pytest.raises(DeviceRefused, match="outside the rail"):
        driver("unused", operator).start_move(x_m)
    assert operator.prompts == {}


def test_fuzz_answers() -> None:
    with start_encoder(World()) as wire:
        trolley = driver(wire.url)
        trolley.open()

        @given(
            garbage=st.one_of(
                st.binary(max_size=60),
                st.builds(
                    lambda *numbers: (format_line(EncoderLine(*numbers)) + "\r\n").encode(),
                    st.integers(0, 255), st.integers(0, 2**32 - 1), st.integers(0, 2**32 - 1), st.none(),
                ),
            )
        )  # fmt: skip
        @settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck))
        def anything(garbage: bytes) -> None:
            wire.filter = lambda _: garbage
            time.sleep(0.012)
            try:
                fix = trolley.poll()
            except DeviceError:
                return
            assert math.isfinite(fix.x_m)
            assert math.isfinite(fix.sd_m)

        anything()
        trolley.close()

"""ELL14: messages, exact bytes, driver against the simulated mount. Protocol: Thorlabs' Elliptec messages."""

from __future__ import annotations

import math
import time
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from serial_helpers import Script, both_kinds, keep_trying, until_still, wait_for

from drivers.contracts import Polarizer
from drivers.errors import DeviceBadAnswer, DeviceError, DeviceLost, DeviceRefused, DeviceTimeout
from drivers.polarizer import elliptec
from drivers.polarizer.ell14 import Ell14
from hw_mocks.rotator import Rotator, start_rotator
from hw_mocks.wire import Kind, serve
from hw_mocks.world import World

INFORMATION = b"0IN0E1140060920231701016800023000\r\n"  # ELL14, 360 degrees, 0x23000 = 143360 pulses
OPENING = [(b"0in", INFORMATION), (b"0ho0", b"0PO00000000\r\n")]
PULSE_RAD = 2 * math.pi / 143_360


def driver(url: str, **options: Any) -> Ell14:
    return Ell14(Ell14.Options(port=url, **({"timeout_s": 0.5, "turn_timeout_s": 2.0} | options)))


def fast(world: World, **options: Any) -> Rotator:
    return Rotator(world, **({"speed_rad_s": 40.0} | options))


# Messages


def test_information() -> None:
    info = elliptec.information(INFORMATION.decode().strip())
    assert info == elliptec.Information(14, "11400609", "2023", "17", 360, 143_360)


@given(st.integers(-(2**31), 2**31 - 1))
def test_pulses_there_and_back(pulses: int) -> None:
    assert elliptec.position("0PO" + elliptec.pulses_hex(pulses)) == pulses


def test_pulses_of_the_maker_s_example() -> None:
    # 45 degrees of 143360 pulses per turn are 17920 = 0x4600.
    assert elliptec.pulses_hex(143_360 // 8) == "00004600"
    assert elliptec.position("0POFFFFFFFE") == -2
    with pytest.raises(ValueError, match="do not fit"):
        elliptec.pulses_hex(2**31)


@given(st.text(max_size=40))
@settings(deadline=None)
def test_fuzz_messages(message: str) -> None:
    assert elliptec.position(message) is None or message[1:3] == "PO"
    assert elliptec.status(message) is None or message[1:3] == "GS"
    assert elliptec.information(message) is None or message[1:3] == "IN"


# Exact bytes


@both_kinds
def test_exact_bytes(kind: Kind) -> None:
    script = Script(
        *OPENING,
        (b"0ma00004600", b"0GS09\r\n0PO00004601\r\n"),
        (b"0gp", b"0PO00004601\r\n"),
        (b"0ma0001A400", b"0PO0001A400\r\n"),  # -90 degrees = 270 degrees = 107520 pulses
    )
    with serve(script, kind=kind) as wire:
        polarizer = driver(wire.url)
        assert isinstance(polarizer, Polarizer)
        identity = polarizer.open()
        assert (identity.kind, identity.driver, identity.name) == ("polarizer", "ell14", "ELL14 11400609")
        assert "143360 pulses per turn" in identity.detail
        polarizer.start_turn(math.pi / 4)
        fix = until_still(polarizer.poll)
        assert fix.angle_rad == pytest.approx(math.pi / 4 + PULSE_RAD, abs=1e-12)
        assert fix.sd_rad == pytest.approx(math.radians(0.25))
        assert polarizer.poll().angle_rad == fix.angle_rad
        polarizer.start_turn(-math.pi / 2)
        assert until_still(polarizer.poll).angle_rad == pytest.approx(-math.pi / 2, abs=1e-12)
        polarizer.close()
    script.check()


def test_address_offset_and_pulses_per_turn_are_used() -> None:
    script = Script(
        (b"Ain", b"0GS03\r\nAIN0E1140060920231701016800010000\r\n"),  # 65536 pulses; another mount talks in between
        (b"Agp", b"APO00000000\r\n"),
        (b"Ama00004000", b"APO00004000\r\n"),  # (100 - 10) degrees of 65536 pulses
    )
    with serve(script) as wire:
        polarizer = driver(wire.url, address="A", offset_deg=10.0, home_at_open=False)
        polarizer.open()
        polarizer.start_turn(math.radians(100))
        assert until_still(polarizer.poll).angle_rad == pytest.approx(math.radians(100), abs=1e-12)
        polarizer.close()
    script.check()


# Driver against simulation


@both_kinds
def test_turns(kind: Kind) -> None:
    world = World()
    with start_rotator(world, kind=kind) as wire:
        polarizer = driver(wire.url)
        polarizer.open()
        for degrees in (0.0, 45.0, 90.0, 135.0, 22.5):
            polarizer.start_turn(math.radians(degrees))
            fix = until_still(polarizer.poll)
            assert fix.angle_rad == pytest.approx(math.radians(degrees), abs=0.5001 * PULSE_RAD)
            assert world.polarizer_rad.at() == pytest.approx(fix.angle_rad, abs=1e-9)
        polarizer.close()


@given(st.floats(-20, 20))
@settings(max_examples=25, deadline=None)
def test_any_angle_is_met_modulo_a_turn(angle_rad: float) -> None:
    world = World()
    with serve(fast(world, speed_rad_s=1e4)) as wire:
        polarizer = driver(wire.url, offset_deg=33.0)
        polarizer.open()
        polarizer.start_turn(angle_rad)
        assert until_still(polarizer.poll).angle_rad == pytest.approx(angle_rad, abs=0.5001 * PULSE_RAD + 1e-9)
        turned = world.polarizer_rad.at() + math.radians(33.0) - angle_rad
        assert math.remainder(turned, 2 * math.pi) == pytest.approx(0.0, abs=0.5001 * PULSE_RAD + 1e-9)
        polarizer.close()


def test_polling_does_not_wait_and_a_turn_takes_its_time() -> None:
    world = World()
    with serve(fast(world, speed_rad_s=math.pi / 2, says_busy=True)) as wire:
        polarizer = driver(wire.url)
        polarizer.open()
        started = time.monotonic()
        polarizer.start_turn(math.pi / 4)
        assert polarizer.poll().moving
        assert time.monotonic() - started < 0.2
        with pytest.raises(DeviceRefused, match="still turning"):
            polarizer.start_turn(0.0)
        until_still(polarizer.poll)
        # A quarter of pi at half pi per second takes 0.5 s.
        assert time.monotonic() - started == pytest.approx(0.5, abs=0.2)
        polarizer.close()


def test_stop_is_prompt_and_the_mount_finishes_its_turn() -> None:
    world = World()
    with serve(fast(world, speed_rad_s=math.pi / 2)) as wire:
        polarizer = driver(wire.url)
        polarizer.open()
        polarizer.start_turn(math.pi / 4)
        started = time.monotonic()
        polarizer.stop()
        assert time.monotonic() - started < 0.3
        assert until_still(polarizer.poll).angle_rad == pytest.approx(math.pi / 4, abs=PULSE_RAD)
        polarizer.start_turn(0.0)
        assert until_still(polarizer.poll).angle_rad == pytest.approx(0.0, abs=PULSE_RAD)
        polarizer.close()


def test_opened_while_it_turns() -> None:
    world = World()
    mount = fast(world, speed_rad_s=math.pi)
    with serve(mount) as wire:
        first = driver(wire.url)
        first.open()
        first.start_turn(math.pi / 2)
        wait_for(lambda: world.polarizer_rad.at() > 0.01, "the turn")
        first.close()
        second = driver(wire.url, timeout_s=2.0)
        second.open()  # the mount is busy, then homes
        assert world.polarizer_rad.at() == pytest.approx(0.0, abs=1e-9)
        second.close()


def test_busy_with_an_earlier_turn_asks_again() -> None:
    """The mount drops a request while busy: GS09, then the position of the earlier turn."""
    script = Script(
        *OPENING,
        (b"0ma00004600", b"0GS09\r\n0PO00008C00\r\n"),
        (b"0ma00004600", b"0PO00004600\r\n"),
    )
    with serve(script) as wire:
        polarizer = driver(wire.url)
        polarizer.open()
        polarizer.start_turn(math.pi / 4)
        assert until_still(polarizer.poll).angle_rad == pytest.approx(math.pi / 4, abs=1e-12)
        polarizer.close()
    script.check()


def test_never_at_its_target_is_refused() -> None:
    script = Script(*OPENING, *[(b"0ma00004600", b"0PO00008C00\r\n")] * 3)
    with serve(script) as wire:
        polarizer = driver(wire.url)
        polarizer.open()
        polarizer.start_turn(math.pi / 4)
        with pytest.raises(DeviceRefused, match=r"stands at 90.00 degrees instead of 45.00"):
            until_still(polarizer.poll)
        polarizer.close()
    script.check()


@pytest.mark.parametrize(
    ("code", "words"),
    [(0x01, "communication time-out"), (0x02, "mechanical time-out"), (0x03, "command error"),
     (0x04, "value out of range"), (0x07, "initialisation error"), (0x08, "thermal error"), (0x0A, "sensor error"),
     (0x0B, "motor error"), (0x0D, "overcurrent"), (0x77, "reserves")],
)  # fmt: skip
def test_status_in_words(code: int, words: str) -> None:
    mount = fast(World())
    with serve(mount) as wire:
        polarizer = driver(wire.url)
        polarizer.open()
        mount.fail_next(code)
        polarizer.start_turn(1.0)
        with pytest.raises(DeviceRefused, match=rf"{words}.*\(GS{code:02X}\)"):
            until_still(polarizer.poll)
        assert polarizer.poll().moving is False
        polarizer.close()


def test_a_turn_without_end_times_out() -> None:
    with serve(Script(*OPENING, (b"0ma00004600", b""))) as wire:
        polarizer = driver(wire.url, turn_timeout_s=0.2)
        polarizer.open()
        polarizer.start_turn(math.pi / 4)
        with pytest.raises(DeviceTimeout, match=r"no end of the turn within 0.2 s"):
            until_still(polarizer.poll)
        polarizer.close()


@pytest.mark.parametrize(
    ("opening", "error", "says"),
    [
        ([(b"0in", b"0IN071140060920231701001C00000800\r\n")], DeviceRefused, "no rotation mount"),
        ([(b"0in", b"0IN0E1140060920231701016800000000\r\n")], DeviceRefused, "no rotation mount"),
        ([(b"0in", b"0GS0A\r\n")], DeviceRefused, "sensor error"),
        ([(b"0in", b"0INxyz\r\n")], DeviceBadAnswer, "neither a position nor a status"),
        ([(b"0in", b"1GS00\r\n" * 300)], DeviceBadAnswer, "talk without end"),
        ([(b"0in", b"")], DeviceTimeout, "no answer"),
        ([(b"0in", INFORMATION), (b"0ho0", b"0GS02\r\n")], DeviceRefused, "mechanical time-out"),
    ],
)
def test_openings_that_fail(opening: list[tuple[bytes, bytes]], error: type[DeviceError], says: str) -> None:
    with serve(Script(*opening)) as wire:
        polarizer = driver(wire.url)
        with pytest.raises(error, match=says):
            polarizer.open()
        with pytest.raises(DeviceError):
            polarizer.start_turn(0.0)


@pytest.mark.parametrize("angle_rad", [math.nan, math.inf])
def test_no_angle(angle_rad: float) -> None:
    with pytest.raises(DeviceRefused, match="is no angle"):
        driver("unused").start_turn(angle_rad)


@both_kinds
def test_unplugged(kind: Kind) -> None:
    with serve(fast(World()), kind=kind) as wire:
        polarizer = driver(wire.url)
        polarizer.open()
        wire.unplug()
        with pytest.raises(DeviceLost):
            keep_trying(polarizer.poll)
        polarizer.make_safe()
        polarizer.close()
        wire.plug()
        polarizer.open()
        assert not polarizer.poll().moving
        polarizer.close()


def test_fuzz_answers() -> None:
    with serve(fast(World())) as wire:
        polarizer = driver(wire.url, timeout_s=0.02, turn_timeout_s=0.02)
        polarizer.open()

        @given(
            garbage=st.one_of(
                st.binary(max_size=30),
                st.from_regex(rb"[01](GS[0-9A-F]{1,3}|PO[0-9A-F]{7,8}|IN[0-9A-F]{30})\r\n", fullmatch=True),
            )
        )
        @settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck))
        def anything(garbage: bytes) -> None:
            wire.filter = lambda _: garbage
            for act in (polarizer.poll, lambda: polarizer.start_turn(1.0), polarizer.poll, polarizer.stop):
                try:
                    fix = act()
                except DeviceError:
                    continue
                assert fix is None or math.isfinite(fix.angle_rad)

        anything()
        polarizer.close()


def test_the_simulated_mount_follows_the_protocol() -> None:
    world = World()
    mount = Rotator(world, speed_rad_s=math.pi)
    assert mount.handle(b"0in") == b"0IN0E1140SIM120230101016800023000\r\n"
    assert mount.handle(b"0gp\r0gs\r\n") == b"0PO00000000\r\n0GS00\r\n"
    assert mount.handle(b"1gp") == b""  # another mount's
    assert mount.handle(b"0ma0FFFFFFF") == b"0GS04\r\n"
    assert mount.handle(b"0xyz12345678") == b"0GS03\r\n"
    assert mount.handle(b"0mr0000") == b""
    assert mount.handle(b"1000") == b""  # the rest of 0x1000 pulses: 0.18 rad at pi rad/s
    assert mount.handle(b"0gp") == b"0GS09\r\n"
    assert mount.handle(b"0st") == b"0GS09\r\n"
    time.sleep(0.07)
    assert mount.handle(b"") == b"0PO00001000\r\n"
    assert world.polarizer_rad.at() == pytest.approx(0x1000 * PULSE_RAD, abs=1e-12)
    assert mount.handle(b"0mrFFFFF000") == b""
    time.sleep(0.07)
    assert mount.handle(b"0gp") == b"0PO00000000\r\n0PO00000000\r\n"

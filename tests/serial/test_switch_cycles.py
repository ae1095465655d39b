"""The cycle counter: kept across sessions, whole after a kill at any moment, never in the way of a measurement."""

from __future__ import annotations

import json
import logging
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
from serial_helpers import both_kinds

from drivers.records import Channel
from drivers.switches.cycles import CycleCounter
from drivers.switches.dowkey_ms import DowKeyMs
from drivers.switches.sequence import RfPath, Sequence, SequenceOptions
from drivers.user_data import user_data_folder
from hw_mocks.switch_box import start_switch_box
from hw_mocks.wire import Kind
from hw_mocks.world import World


def test_counts_are_kept_across_sessions_and_units_are_apart(tmp_path: Path) -> None:
    first = CycleCounter("unit 1", tmp_path)
    assert first.cycles() == {}
    for switch in "1", "2", "1":
        first.count(switch)
    first.close()
    assert CycleCounter("unit 1", tmp_path).cycles() == {"1": 2, "2": 1}
    assert CycleCounter("unit-1", tmp_path).cycles() == {}  # another name with the same letters in it
    assert json.loads(first.path.read_text()) == {"unit": "unit 1", "cycles": {"1": 2, "2": 1}}


def test_two_programs_count_the_same_unit(tmp_path: Path) -> None:
    counters = [CycleCounter("unit", tmp_path) for _ in range(4)]

    def work(counter: CycleCounter) -> None:
        for _ in range(50):
            counter.count("1")

    threads = [threading.Thread(target=work, args=(counter,)) for counter in counters]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(30)
    # Those that found the file busy for too long still hold their counts; closing writes them.
    for counter in counters:
        counter.close()
    assert CycleCounter("unit", tmp_path).cycles() == {"1": 200}


def test_a_program_killed_at_any_moment_loses_at_most_the_actuation_under_way(tmp_path: Path) -> None:
    program = (
        "import sys; from pathlib import Path; from drivers.switches.cycles import CycleCounter\n"
        "counter = CycleCounter('unit', Path(sys.argv[1]))\n"
        "while True: counter.count('1'); sys.stdout.write('x'); sys.stdout.flush()\n"
    )
    counted = 0
    for delay_s in (0.01, 0.03, 0.05):
        process = subprocess.Popen([sys.executable, "-c", program, str(tmp_path)], stdout=subprocess.PIPE)
        assert process.stdout is not None
        told = len(process.stdout.read(1))
        time.sleep(delay_s)
        process.send_signal(signal.SIGKILL)
        told += len(process.stdout.read())
        process.stdout.close()
        process.wait(5)
        counter = CycleCounter("unit", tmp_path)
        found = counter.cycles()["1"]
        assert counter.trouble is None
        assert counted + told <= found <= counted + told + 1
        counted = found


def test_a_damaged_file_falls_back_to_the_last_closed_session(tmp_path: Path) -> None:
    counter = CycleCounter("unit", tmp_path)
    counter.count("1")
    counter.close()
    counter.path.write_text("")  # as a loss of power can leave it
    counter = CycleCounter("unit", tmp_path)
    counter.count("1")
    assert counter.cycles() == {"1": 2}
    assert counter.trouble is not None
    assert "is damaged; mend or remove it" in counter.trouble


@pytest.mark.parametrize("content", ['{"cycles": {"1": -4}}', '{"cycles": [1]}', "[]", "{", '{"cycles": {"1": 1.5}}'])
def test_nonsense_in_the_file_is_said(tmp_path: Path, content: str) -> None:
    counter = CycleCounter("unit", tmp_path)
    counter.count("1")
    counter.path.write_text(content)
    assert counter.cycles() == {}
    assert counter.trouble is not None


def test_a_disk_that_cannot_be_written_does_not_stop_the_count(tmp_path: Path) -> None:
    (tmp_path / "switch-cycles").write_text("a file where the folder should be")
    counter = CycleCounter("unit", tmp_path)
    counter.count("1")
    counter.count("1")
    counter.close()
    assert counter.trouble is not None
    assert "cannot be written" in counter.trouble
    assert counter.cycles() == {"1": 2}
    (tmp_path / "switch-cycles").unlink()
    counter.count("1")
    assert CycleCounter("unit", tmp_path).cycles() == {"1": 3}


def test_the_folder_is_the_users_unless_told(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("POLFUSE_USER_DATA", str(tmp_path))
    assert user_data_folder() == tmp_path
    monkeypatch.delenv("POLFUSE_USER_DATA")
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "xdg"))
    if sys.platform.startswith("linux"):
        assert user_data_folder() == tmp_path / "xdg" / "polfuse-lab"


@both_kinds
def test_the_driver_counts_what_it_moves_and_warns_of_wear(
    kind: Kind, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    for session in (1, 2):
        with start_switch_box(World(), kind=kind) as wire:
            options = DowKeyMs.Options(port=wire.url, settle_s=0.02, cycles_folder=str(tmp_path), wear_limit_cycles=2)
            switches = DowKeyMs(options)
            with caplog.at_level(logging.WARNING):
                identity = switches.open()
            if session == 1:
                assert identity.detail == "switch 1 at 1, switch 2 at 1, 0 cycles of switch 1, 0 cycles of switch 2"
            else:
                assert "switch 2 is beyond its 2 cycles: replace it soon" in identity.detail
                assert "switch 1 is beyond" not in identity.detail
                assert "switch 2 is beyond its 2 cycles" in caplog.text
            # HH to HV to HH moves the receive switch twice; the second HH nothing.
            for channel in (Channel.HV, Channel.HH, Channel.HH):
                switches.select(channel)
            assert switches.cycles == {"2": 2 * session}
            switches.close()


def test_the_option_unit_names_the_counter(tmp_path: Path) -> None:
    sequence = Sequence(SequenceOptions(unit="box 7", cycles_folder=str(tmp_path)), {"transmit": "1", "receive": "2"})
    assert sequence.cycles == {}
    sequence.begin("what it says of itself")
    sequence.move(["receive"], lambda path: None)
    assert CycleCounter("box 7", tmp_path).cycles() == {"2": 1}


@pytest.mark.parametrize("first", ["transmit", "receive"])
def test_one_after_the_other(first: RfPath, tmp_path: Path) -> None:
    other: RfPath = "receive" if first == "transmit" else "transmit"
    options = SequenceOptions(first=first, stagger_s=0.05, settle_s=0.1, cycles_folder=str(tmp_path))
    sequence = Sequence(options, {"transmit": "1", "receive": "2"})
    told: list[tuple[RfPath, float]] = []
    began = time.monotonic()
    sequence.move(["receive", "transmit"], lambda path: told.append((path, time.monotonic() - began)))
    assert [path for path, _ in told] == [first, other]
    assert told[1][1] - told[0][1] >= 0.05
    assert time.monotonic() - began >= told[1][1] + 0.1
    began = time.monotonic()
    sequence.move([], lambda path: told.append((path, 0.0)))
    assert time.monotonic() - began < 0.05
    assert len(told) == 2


def test_a_command_that_fails_ends_the_sequence(tmp_path: Path) -> None:
    sequence = Sequence(SequenceOptions(cycles_folder=str(tmp_path)), {"transmit": "1", "receive": "2"})
    sequence.begin("unit")
    told: list[str] = []

    def tell(path: RfPath) -> None:
        told.append(path)
        raise OSError("gone")

    with pytest.raises(OSError, match="gone"):
        sequence.move(["transmit", "receive"], tell)
    assert told == ["transmit"]
    assert sequence.cycles == {}


def test_order_and_settling_fit_into_half_a_second() -> None:
    with pytest.raises(ValueError, match=r"stagger_s plus settle_s: found 0\.6, allowed: at most 0\.5"):
        SequenceOptions(settle_s=0.4, stagger_s=0.2)

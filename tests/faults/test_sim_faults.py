"""Faults of the whole simulated rig, as 'polfuse sim --fault' scripts them for field training."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from fault_bench import SCENE, FaultBench

from drivers.errors import DeviceError, DeviceTimeout
from drivers.records import Channel
from hw_mocks.faults import Fault, FaultKind, parse_fault
from hw_mocks.rig import DEVICE_FAULTS
from polfuse_lab.errors import PolfuseError


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[FaultBench]:
    with FaultBench(tmp_path) as made:
        yield made


def test_a_scripted_fault_comes_and_goes(bench: FaultBench) -> None:
    driver = bench.driver("switches", timeout_s=0.2)
    driver.open()
    try:
        bench.simulated.arm([parse_fault("switches:silence:after=0.3s:for=0.8s")])
        armed = time.monotonic()
        assert driver.select(Channel.VV).verified
        time.sleep(max(armed + 0.4 - time.monotonic(), 0))
        with pytest.raises(DeviceTimeout, match="no answer within"):
            driver.select(Channel.HH)
        time.sleep(max(armed + 1.2 - time.monotonic(), 0))
        assert driver.select(Channel.HH).verified
    finally:
        driver.close()


def test_every_device_and_kind_that_is_offered_can_be_armed(bench: FaultBench) -> None:
    here = bench.simulated.faults
    bench.simulated.arm((name, Fault(kind, after_s=1e6)) for name in here for kind in DEVICE_FAULTS[name])
    assert set(here) == {"switches", "trolley", "polarizer", "radar"}
    assert set(DEVICE_FAULTS) == {*here, "camera"}


def test_a_fault_of_the_radar_reaches_its_samples(bench: FaultBench) -> None:
    driver = bench.driver("radar")
    driver.open()
    try:
        bench.simulated.arm([("radar", Fault(FaultKind.SILENCE, amount=2))])
        time.sleep(0.1)
        driver.begin(4800)
        end = time.monotonic() + 5
        while (block := driver.poll()) is None:
            assert time.monotonic() < end
            time.sleep(0.01)
        assert not block.samples.any()
    finally:
        driver.close()


@pytest.mark.parametrize(
    ("device", "kind", "says"),
    [
        ("switches", FaultKind.LOST_STEPS, "cannot have the fault 'lost_steps'; choose one of: silence, garbage"),
        ("camera", FaultKind.DROP_FRAMES, "has no faults while it is simulated in process; put it on the wire"),
        ("toaster", FaultKind.SILENCE, "is no device with faults; choose one of: switches, trolley"),
    ],
)
def test_impossible_faults_are_refused_before_anything_is_armed(
    bench: FaultBench, device: str, kind: FaultKind, says: str
) -> None:
    good = ("switches", Fault(FaultKind.DISCONNECT))
    with pytest.raises(PolfuseError, match=says):
        bench.simulated.arm([good, (device, Fault(kind))])
    assert bench.simulated.faults["switches"].active(FaultKind.DISCONNECT) is None


def polfuse_sim(folder: Path, *faults: str) -> list[str]:
    scene = folder / "scene.toml"
    scene.write_text(SCENE)
    command = [sys.executable, "-c", "from polfuse_lab.cli import main; main()", "sim", str(scene)]
    return [*command, "--rig-out", str(folder / "rig.toml"), "--audio", "tcp", "--json", *faults]


def test_the_command_arms_what_it_is_told(tmp_path: Path) -> None:
    from drivers.switches.dowkey_ms import DowKeyMs

    command = polfuse_sim(tmp_path, "--fault", "switches:garbage", "--fault", "trolley:stall:after=1s")
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            url = json.loads(process.stdout.readline())["endpoints"]["switches"]
            options = DowKeyMs.Options(port=url, timeout_s=0.3, cycles_folder=str(tmp_path))
            with pytest.raises(DeviceError):
                DowKeyMs(options).open()
        finally:
            process.send_signal(signal.SIGINT)
            _, said = process.communicate(timeout=20)
    assert process.returncode == 0
    assert "Traceback" not in said


@pytest.mark.parametrize(("fault", "status"), [("trolley:melt", 2), ("trolley:heat_alarm", 1)])
def test_the_command_refuses_wrong_faults(tmp_path: Path, fault: str, status: int) -> None:
    done = subprocess.run(
        polfuse_sim(tmp_path, "--fault", fault), capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == status
    assert "Traceback" not in done.stderr
    assert "silence" in done.stderr


def test_a_count_beyond_every_float_is_a_bad_number() -> None:
    # Found by fuzzing: 10^400 is an int that no float holds.
    with pytest.raises(ValueError, match="allowed: a number"):
        parse_fault(f"trolley:silence:after={10**400}")

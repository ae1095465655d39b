"""The GenTL producer over Aravis: its C interface, Aravis' fake camera, lost packets, a camera that returns."""

import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

HERE = Path(__file__).resolve().parent
SOURCES = HERE.parents[1] / "drivers" / "camera" / "gentl"
Run = Callable[..., subprocess.CompletedProcess[str]]


@pytest.fixture(scope="module")
def walk(producer: Path) -> Path:
    """A client in C that expects of every function what the GenTL standard says."""
    out = producer.with_name("walk")
    command = ["cc", "-std=gnu11", "-Wall", "-Wextra", "-Werror", "-g", f"-I{SOURCES}", str(HERE / "walk.c")]
    made = subprocess.run(
        [*command, "-o", str(out), "-ldl", "-lpthread"], capture_output=True, text=True, timeout=60, check=False
    )
    assert made.returncode == 0, made.stderr
    return out


def beside_a_camera(fake_camera: str, *command: str) -> list[str]:
    """A command that runs while the fake camera does, and ends it."""
    script = 'camera=$1; shift; "$camera" -i 127.0.0.1 >/dev/null 2>&1 & sleep 1; "$@"; code=$?; kill $!; exit $code'
    return ["sh", "-c", script, "sh", fake_camera, *command]


def test_the_c_interface_keeps_to_the_standard(walk: Path, producer: Path, alone: Run, fake_camera: str) -> None:
    done = alone(*beside_a_camera(fake_camera, str(walk), str(producer)))
    assert done.returncode == 0, done.stdout + done.stderr


def test_no_memory_is_lost_or_misused(walk: Path, producer: Path, alone: Run, fake_camera: str) -> None:
    valgrind = shutil.which("valgrind")
    if valgrind is None:
        pytest.skip("valgrind is not installed")
    # Nothing that no pointer leads to any more, no read of what was never written, no access to what was freed.
    options = ["-q", "--leak-check=full", "--errors-for-leak-kinds=definite", "--error-exitcode=98"]
    done = alone(*beside_a_camera(fake_camera, valgrind, *options, str(walk), str(producer)))
    assert done.returncode == 0, (done.stdout + done.stderr)[-4000:]


@pytest.fixture(scope="module")
def told(program: Callable[..., dict], producer: Path, fake_camera: str) -> dict:
    return program("fake_camera_program.py", str(producer), fake_camera)


@pytest.mark.parametrize(("name", "kind"), [("Mono8", "uint8"), ("Mono16", "uint16")])
def test_frames_of_aravis_camera_are_exact(told: dict, name: str, kind: str) -> None:
    found = told[name]
    assert found["types"] == [kind]
    assert found["exact"] == [True] * 4
    # One software trigger, one frame.
    assert [number - found["numbers"][0] for number in found["numbers"]] == [0, 1, 2, 3]
    assert found["stamps_s"] == sorted(set(found["stamps_s"]))
    assert "software trigger" in found["detail"]
    assert found["exposure_s"] == pytest.approx(0.01)


def test_a_killed_camera_is_lost_released_and_found_again(told: dict) -> None:
    assert told["lost"].startswith("DeviceLost: camera: ")
    # Aravis asks five times, half a second each; then everything fails at once, closing too (7.5 s and more otherwise).
    assert told["lost_after_s"] < 4.5
    assert told["closed_after_s"] < 1.0
    assert "no such camera (found: none)" in told["absent"]
    assert told["after_return"] is True


def test_lost_packets_are_asked_for_again_and_incomplete_frames_told(
    program: Callable[..., dict], producer: Path
) -> None:
    found = program("lossy_program.py", str(producer))
    # Of the packets 2 % were dropped; what was delivered as complete is so, in every pixel.
    assert found["dropped"] > 0
    assert found["resent"] > 0
    assert found["exact"] == [True] * len(found["exact"])
    assert found["numbers"] == sorted(set(found["numbers"]))
    assert found["incomplete"] >= 3
    # GenTL's PAYLOAD_TYPE_CHUNK_DATA; 240 x 320 pixels of 2 bytes, and more behind them.
    assert found["has_chunks"] is True
    assert found["payload_type"] == 4
    assert found["filled"] > 240 * 320 * 2
    assert found["chunk_image"] is True


@pytest.mark.parametrize("wrong", ["camera.local", "10.0.0", "127.0.0.1,x"])
def test_an_address_that_is_none_is_refused_in_words(producer: Path, alone: Run, wrong: str) -> None:
    pytest.importorskip("genicam")
    script = (
        "from genicam.gentl import GenTLProducer, GenericException\n"
        "import sys\n"
        "producer = GenTLProducer.create_producer()\n"
        "producer.open(sys.argv[1])\n"
        "system = producer.create_system()\n"
        "system.open()\n"
        "try:\n"
        "    system.update_interface_info_list(100)\n"
        "except GenericException as error:\n"
        "    print(error)\n"
    )
    done = alone(sys.executable, "-c", script, str(producer), POLFUSE_GENTL_CAMERAS=wrong)
    assert f"POLFUSE_GENTL_CAMERAS: found '{wrong.split(',')[-1]}', expected IPv4 addresses" in done.stdout


def test_the_driver_names_how_to_build_it(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    from drivers.camera import producers
    from drivers.errors import DeviceError

    # A folder that the standard's variable names comes first.
    (tmp_path / "polfuse-aravis.cti").touch()
    monkeypatch.setenv("GENICAM_GENTL64_PATH", f"/nowhere:{tmp_path}")
    assert producers.find_producer("aravis", "camera") == tmp_path / "polfuse-aravis.cti"
    monkeypatch.setattr(producers, "aravis_producer", lambda: None)
    with pytest.raises(DeviceError, match="make gentl"):
        producers.find_producer("aravis", "camera")

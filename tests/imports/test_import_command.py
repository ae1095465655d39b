import json

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner
from walked_rail import walk, write

from drivers.records import Channel
from polfuse_lab.cli import build
from polfuse_lab.errors import PolfuseError
from polfuse_lab.imports.formats import FORMATS, run_import
from polfuse_lab.imports.options import channel_list, number_list, wishes_of
from polfuse_lab.session import info


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("foreign")
    samples = walk(8, sweeps=2.7)
    for name in ("hh", "hv", "vh", "vv"):
        write(folder / f"{name}.wav", samples)
    for angle in (0, 45, 90, 135):
        # Malus's law for light of S0 = 4000, DOLP 0.5 at 0 degrees, behind a perfect polarizer.
        value = round(2000 * (1 + 0.5 * np.cos(np.radians(2 * angle))))
        Image.fromarray(np.full((8, 10), value, np.uint16)).save(folder / f"pol_{angle:03d}.tif")
    Image.fromarray(np.zeros((8, 10), np.uint16)).save(folder / "dark.tif")
    return folder


def polfuse(*words):
    return CliRunner().invoke(build(), [str(word) for word in words])


def test_four_channels_and_frames_become_one_session(files, tmp_path):
    out = tmp_path / "s.h5"
    wavs = [files / f"{name}.wav" for name in ("hh", "hv", "vh", "vv")]
    run = polfuse(
        "import", *wavs, "-o", out, "--as", "sar-wav", "--channels", "HH,HV,VH,VV", "--up-ramp", "high",
        "--frames", files / "pol_*.tif", "--dark", files / "dark.tif", "--bits", "12", "--json",
    )  # fmt: skip
    assert run.exit_code == 0, run.stderr
    values = json.loads(run.stdout)
    # What other tools rely on, and what there is to know besides.
    assert values["session"] == str(out)
    assert values["sync_channel"] == 1
    assert values["sync_inverted"] is False
    assert values["sweep_period_s"] == pytest.approx(1920.5 / 48_000, abs=1e-7)
    assert values["sweeps"] >= 4 * 8
    assert (values["positions"], values["frames"], values["step_m"]) == (8, 5, 0.0508)
    inside = info(out)
    assert (inside["channels"], inside["positions"], inside["frames"]) == (["HH", "HV", "VH", "VV"], 8, 5)
    assert inside["complete"]
    made = polfuse("optics", out, "-o", tmp_path / "p.h5", "--json")
    assert made.exit_code == 0, made.stderr
    # The rig made for the import has the example's extinction ratio of 800: 0.5 (1 + 2 / 800) to first order.
    assert json.loads(made.stdout)["dolp_median"] == pytest.approx(0.5 * (1 + 2 / 800), abs=3e-4)


def test_people_read_what_was_found(files, tmp_path):
    run = polfuse("import", files / "vv.wav", "-o", tmp_path / "s.h5", "--as", "sar-wav", "--channel", "VV")
    assert run.exit_code == 0, run.stderr
    assert "8 positions 0.0508 m apart in VV" in run.stdout
    assert "assumption" in run.stdout
    run = polfuse("import", files, "-o", tmp_path / "f.h5", "--as", "frames", "--json", "--angle-pattern", "*_{angle}")
    assert run.exit_code == 1  # the dark frame has no angle, and is not told to be one
    assert "dark.tif" in run.stderr
    assert run.stdout == ""
    run = polfuse("import", files / "pol_*.tif", "-o", tmp_path / "f.h5", "--as", "frames", "--angles", "0,45,90,135")
    assert run.exit_code == 0, run.stderr
    assert "4 frames at 0, 45, 90, 135 degrees" in run.stdout


@pytest.mark.parametrize(
    ("words", "status", "says"),
    [
        (["vv.wav", "--as", "wav", "--step-m", "1"], 2, "--step-m"),
        (["vv.wav", "--as", "frames", "--channel", "HH"], 2, "--channel"),
        (["vv.wav", "--as", "mp3"], 2, "mp3"),
        (["vv.wav", "--as", "sar-wav"], 1, "channel of the recording is not told"),
        (["vv.wav", "hh.wav", "--as", "sar-wav"], 1, "--channels HH,HV,VH,VV"),
        (["vv.wav", "--as", "sar-wav", "--channels", "XX"], 1, "there is no channel 'XX'"),
        (["vv.wav", "--as", "sar-wav", "--channel", "VV", "--channels", "VV"], 1, "give one of them"),
        (["vv.wav", "--as", "sar-wav", "--channel", "VV", "--dark", "dark.tif"], 1, "no frames"),
        (["vv.wav", "--as", "sar-wav", "--channel", "VV", "--drop", "x"], 1, "names no burst"),
        (["vv.wav", "--as", "sar-wav", "--channel", "VV", "--positions", "9"], 1, "9 are expected"),
        (["vv.wav", "--as", "wav"], 1, "sar-wav"),  # a rail recording is recognised as one
        (["dark.tif", "--as", "sar-wav", "--channel", "VV"], 1, "not a WAV"),
        (["pol_000.tif", "--as", "frames", "--angles", "a,b"], 1, "not a list of numbers"),
    ],
)
def test_wrong_words_are_answered(files, tmp_path, words, status, says, monkeypatch):
    monkeypatch.chdir(files)
    run = polfuse("import", *words, "-o", tmp_path / "s.h5")
    assert run.exit_code == status
    assert says in run.stderr
    assert "Traceback" not in run.stderr
    assert not list(tmp_path.iterdir())


def test_the_table_of_formats_refuses_what_a_format_does_not_take(tmp_path):
    with pytest.raises(PolfuseError, match="no format 'mp3'"):
        run_import("mp3", [], tmp_path / "a", {})
    with pytest.raises(PolfuseError, match="--step-m means nothing to the format wav"):
        run_import("wav", [], tmp_path / "a", {"step_m": 1.0})


def test_every_format_takes_the_options_that_it_claims():
    import importlib
    import inspect

    for item in FORMATS.values():
        taken = inspect.signature(importlib.import_module(item.module).run).parameters
        if not any(parameter.kind is parameter.VAR_KEYWORD for parameter in taken.values()):
            assert item.options == set(list(taken)[2:])


def test_bursts_are_named_by_channel():
    both = (Channel.HH, Channel.HV)
    wishes = wishes_of(both, 61, ["HV:3,hh:4"], ["HV:7"])
    assert (wishes[Channel.HV].drop, wishes[Channel.HV].repeats) == ({3}, {7})
    assert (wishes[Channel.HH].drop, wishes[Channel.HH].positions) == ({4}, 61)
    assert wishes_of([Channel.VV], None, ["3"], [])[Channel.VV].drop == {3}
    with pytest.raises(PolfuseError, match="burst 3 of which file"):
        wishes_of(both, None, ["3"], [])
    with pytest.raises(PolfuseError, match="no file is of channel VV"):
        wishes_of(both, None, ["VV:3"], [])
    assert channel_list("hh, vv") == (Channel.HH, Channel.VV)
    assert number_list("0,22.5", "--angles") == (0.0, 22.5)

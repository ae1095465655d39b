"""Example rigs and plans: they load, and they are the thesis's."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from polfuse_lab.errors import PolfuseError
from polfuse_lab.plans import load_plan
from polfuse_lab.rig import driver_options, load_rig
from polfuse_lab.rig.examples import MOTORIZED, write_examples


@pytest.mark.parametrize("by_hand", [False, True])
def test_the_files_load(tmp_path: Path, by_hand: bool) -> None:
    written = write_examples(tmp_path / "new" / "rig", by_hand=by_hand)
    rig = load_rig(written["rig"])
    assert (rig.trolley.driver == "by_hand") is by_hand
    assert load_plan(written["sky"]).kind == "sky"
    plan = load_plan(written["plan"])
    # Thesis 5.5: 10 ft in steps of 2 in; table 6.2: the camera; c / 2B of 80 MHz.
    assert len(plan.positions_m) == 61
    assert plan.positions_m[-1] - plan.positions_m[0] == pytest.approx(10 * 0.3048, abs=1e-12)
    assert max(plan.positions_m) <= rig.trolley.length_m / 2
    assert rig.waveform.range_resolution_m == pytest.approx(1.8737, abs=1e-4)
    assert rig.camera is not None
    assert (rig.camera.width_px, rig.camera.height_px) == (782, 582)


@pytest.mark.parametrize(
    "name", ["rig.toml", "rig_by_hand.toml", *(name for name in MOTORIZED.values() if "rig" not in name)]
)
def test_every_field_is_explained_in_the_file(name: str) -> None:
    import polfuse_lab.rig.examples as examples

    for line in (Path(examples.__file__).parent / name).read_text(encoding="utf-8").splitlines():
        if re.match(r"\w+ = ", line) and not line.startswith(("name", "steps_json")):
            assert re.search(r"\S\s+# \S", line), f"{name}: no comment in {line!r}"


def test_every_field_of_the_model_is_shown() -> None:
    import polfuse_lab.rig.examples as examples
    from polfuse_lab.plans import RailSarPlan
    from polfuse_lab.rig import Rig

    folder = Path(examples.__file__).parent
    text = (folder / "rig.toml").read_text(encoding="utf-8")
    # The antennas' places and the second polarizer are shown, but few have them.
    antennas = re.search(r"(?ms)^# \[geometry.phase_centres\]$.*?^$", text)
    assert antennas
    text = text.replace(antennas[0], re.sub(r"(?m)^# (?=\[|\w+ *=)", "", antennas[0]))
    before, shown, after = text.partition("# [source_polarizer]")
    rig = tomllib.loads(before + re.sub(r"(?m)^# (?=\[|\w+ *=)", "", shown + after))
    for section, field in Rig.model_fields.items():
        inner = getattr(field.annotation, "model_fields", {})
        assert set(inner) <= set(rig[section]) if inner else section in rig
    plan = tomllib.loads((folder / "plan.toml").read_text(encoding="utf-8"))
    assert set(plan) == set(RailSarPlan.model_fields)


def test_nothing_is_overwritten_unless_told(tmp_path: Path) -> None:
    written = write_examples(tmp_path)
    written["plan"].write_text("mine", encoding="utf-8")
    written["rig"].unlink()
    with pytest.raises(PolfuseError, match=r"holds plan\.toml, sky\.toml and \d more already.*--force"):
        write_examples(tmp_path)
    assert written["plan"].read_text(encoding="utf-8") == "mine"
    assert not written["rig"].exists()
    write_examples(tmp_path, force=True)
    assert load_plan(written["plan"]).kind == "rail_sar"


def test_a_directory_that_cannot_be_made(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(PolfuseError, match="cannot be written"):
        write_examples(tmp_path / "file" / "rig")


def test_the_command(tmp_path: Path) -> None:
    run = [sys.executable, "-c", "from polfuse_lab.cli import main; main()", "init", str(tmp_path / "r"), "--json"]
    first = subprocess.run(run, capture_output=True, text=True, timeout=60)
    assert first.returncode == 0, first.stderr
    assert Path(json.loads(first.stdout)["rig"]).is_file()
    second = subprocess.run(run, capture_output=True, text=True, timeout=60)
    assert (second.returncode, second.stdout) == (1, "")
    assert second.stderr.count("\n") == 1
    assert "already" in second.stderr


def test_a_section_and_its_driver_agree(tmp_path: Path) -> None:
    path = write_examples(tmp_path)["rig"]
    rig = load_rig(path)
    camera = driver_options(rig, "camera", path)
    # Written once, in [camera] and [trolley]: the driver is handed what the section says.
    assert (camera.exposure_s, camera.width_px, camera.pixel_format) == (0.002, 782, "Mono16")
    assert driver_options(rig, "trolley", path).length_m == rig.trolley.length_m
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace('cti = ""', 'cti = ""\nexposure_s = 0.5'), encoding="utf-8")
    with pytest.raises(PolfuseError, match=r"line \d+, camera\.options\.exposure_s: found 0\.5, allowed: 0\.002 as"):
        load_rig(path)

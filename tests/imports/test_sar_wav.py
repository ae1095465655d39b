import contextlib

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from scipy.io import wavfile
from walked_rail import HEIGHT_M, STEP_M, TARGETS, Gap, scene, walk, write

from drivers.records import Channel
from polfuse_lab.errors import PolfuseError
from polfuse_lab.imports import import_sar_wav
from polfuse_lab.imports.positions import Wishes
from polfuse_lab.products.focus import default_grid, focus
from polfuse_lab.products.ranging import range_profiles
from polfuse_lab.rig.examples import write_examples
from polfuse_lab.session import open_session
from polfuse_lab.session.summary import problems

VV = [Channel.VV]
NEAR = {"near": TARGETS["near"]}
TOLD = {"bandwidth_hz": 80e6, "centre_hz": 2.4e9, "antenna_height_m": HEIGHT_M}


def imported(tmp_path, samples, **options):
    wav = write(tmp_path / "vv.wav", samples)
    return import_sar_wav([wav], tmp_path / "s.h5", **({"channels": VV} | TOLD | options))


def focused(session, folder):
    with open_session(session) as opened:
        grid = default_grid(opened, x_m=(-2.5, 2.5), y_m=(4.0, 16.0))
    return focus(session, folder / "p.h5", grid=grid)


@pytest.mark.parametrize(
    "kind",
    [{}, {"inverted": True, "sync_channel": 0}, {"silence": Gap(hum=0.3, clicks=8)}],
    ids=["plain", "inverted", "hum"],
)
def test_targets_are_focused_where_the_simulator_put_them(tmp_path, kind):
    done = imported(tmp_path, walk(61, sweeps=2.7, **kind))
    assert done.positions == 61
    assert done.sync_channel == kind.get("sync_channel", 1)
    assert done.sync_inverted is kind.get("inverted", False)
    assert done.polarity_from == "focus"
    assert done.sweep_period_s == pytest.approx(1920.5 / 48_000, abs=1e-7)
    assert done.ramp_up_s == pytest.approx(960.25 / 48_000, abs=1e-7)
    assert done.notes == ()
    found = focused(done.session, tmp_path)
    assert found.pulses == 61
    # Cells are 1.87 m (c/2B) by lambda R / 2L = 0.12 and 0.29 m. Noise and the other target's side lobes (Hann: below
    # -60 dB six cells away) leave a hundredth of a cell; a twentieth is allowed.
    for name, rcs in (("far", 36.0), ("near", 9.0)):  # |S_vv|^2 of the scene
        place = TARGETS[name]
        cell_x = 0.125 * np.hypot(place[1], place[2]) / (2 * 60 * STEP_M)
        peak = min(found.peaks, key=lambda one: np.hypot(one.x_m - place[0], one.y_m - place[1]))
        assert peak.x_m == pytest.approx(place[0], abs=cell_x / 20)
        assert peak.y_m == pytest.approx(place[1], abs=1.87 / 20)
        assert peak.level_db == pytest.approx(10 * np.log10(rcs), abs=0.1)


def test_records_hold_the_samples_as_they_were_and_say_where_they_stood(tmp_path):
    done = imported(tmp_path, walk(11), step_m=-0.1)
    samples = wavfile.read(tmp_path / "vv.wav")[1]
    with open_session(done.session) as session:
        assert session.complete
        assert problems(session) == []
        assert session.sweeps["position"].tolist() == list(range(11))
        # Centred, pushed towards -x.
        assert session.sweeps["x_m"] == pytest.approx(0.5 - 0.1 * np.arange(11))
        assert (session.sweeps["x_sd_m"] > 0).all()
        for index, row in enumerate(session.sweeps):
            first = int(row["device_frame"])
            assert np.array_equal(session.audio(index), samples[first : first + int(row["samples"])])
            assert row["t_device_s"] == pytest.approx(first / 48_000)
        assert np.all(np.diff(session.sweeps["t_host_ns"]) > 0)
        assert session.config["source"] == "import:sar-wav"
        assert session.config["extra"]["files"][0]["channel"] == "VV"
        assert session.rig.geometry.antenna_height_m == HEIGHT_M
        assert str(tmp_path) not in str(session.config)


def test_four_files_give_the_scattering_matrix(tmp_path):
    order = [Channel.HH, Channel.HV, Channel.VH, Channel.VV]
    files = [
        write(
            tmp_path / f"{channel.name}.wav", walk(31, channel=channel.name, sweeps=2.7, seed=index, the_scene=scene())
        )
        for index, channel in enumerate(order)
    ]
    done = import_sar_wav(files, tmp_path / "s.h5", channels=order, **TOLD)
    assert (done.positions, done.channels) == (31, ("HH", "HV", "VH", "VV"))
    found = focused(done.session, tmp_path)
    iy = int(np.argmin(abs(found.grid.y_m - TARGETS["far"][1])))
    ix = int(np.argmin(abs(found.grid.x_m - TARGETS["far"][0])))
    value = dict(zip(found.channels, found.image[:, iy, ix], strict=True))
    # S of the far point: HH 6, VV -6, HV = VH 2. The near one's side lobes and the noise stay below 2 % of HH.
    assert value["VV"] / value["HH"] == pytest.approx(-1, abs=0.02)
    assert value["HV"] / value["HH"] == pytest.approx(1 / 3, abs=0.02)
    assert value["VH"] / value["HH"] == pytest.approx(1 / 3, abs=0.02)


def test_a_channel_with_another_number_of_positions_is_named(tmp_path):
    hh, vv = write(tmp_path / "hh.wav", walk(9, channel="HH")), write(tmp_path / "vv.wav", walk(8))
    vh = write(tmp_path / "vh.wav", walk(9, channel="VH"))
    with pytest.raises(PolfuseError, match=r"vv.wav: holds 8 positions \(8 bursts of .* s\), hh.wav holds 9"):
        import_sar_wav([hh, vv, vh], tmp_path / "s.h5", channels=[Channel.HH, Channel.VV, Channel.VH])
    wishes = {Channel.HH: Wishes(drop=frozenset({9}))}
    done = import_sar_wav([hh, vv], tmp_path / "s.h5", channels=[Channel.HH, Channel.VV], wishes=wishes)
    assert done.positions == 8


def test_a_position_recorded_twice_is_reported_and_taken_as_told(tmp_path):
    samples = walk(31, stops=[*range(11), 10, *range(11, 31)], sweeps=3.7)
    with pytest.raises(PolfuseError, match=r"burst 12 .* looks like burst 11"):
        imported(tmp_path, samples)
    assert not list(tmp_path.glob("s.h5*"))
    done = imported(tmp_path, samples, wishes={Channel.VV: Wishes(positions=31)})
    assert done.positions == 31
    with open_session(done.session) as session:
        assert session.sweeps["position"].tolist() == [*range(11), 10, *range(11, 31)]
        assert session.sweeps["attempt"].sum() == 1
        assert session.sweeps["x_m"][10] == session.sweeps["x_m"][11]
    assert range_profiles(done.session).values.shape[1] == 31


def test_no_doubled_position_is_made_up_abreast_of_a_target(tmp_path):
    # 32 positions about a target at x = 0: the two in the middle see it from the same distance.
    done = imported(tmp_path, walk(32, the_scene=scene({"near": (0.0, 8.0, -HEIGHT_M)}), sweeps=3.7))
    assert done.positions == 32


def test_a_false_start_is_reported_and_a_fragment_at_an_end_left_out(tmp_path):
    lengths = [1.8] + [5.6] * 10
    with pytest.raises(PolfuseError, match=r"burst 4 .* s long, others"):
        imported(tmp_path, walk(11, lengths=[5.6] * 3 + [1.8] + [5.6] * 7))
    done = imported(tmp_path, walk(11, lengths=lengths))
    assert done.positions == 10
    assert any("burst 1" in note and "left out" in note for note in done.notes)


def test_a_cart_that_moved_while_the_radar_was_on_is_reported(tmp_path):
    # Burst 6 holds two places without a silence between them: 5.6 sweeps at each.
    one = walk(12, sweeps=5.6, silence=Gap(0.3))
    still = walk(12, lengths=[5.6] * 5 + [14.6] + [5.6] * 6)
    middle = walk(12, stops=[5], sweeps=5.6, silence=Gap(0.0)), walk(12, stops=[6], sweeps=5.6, silence=Gap(0.0))
    first, last = walk(12, stops=range(5), sweeps=5.6), walk(12, stops=range(7, 12), sweeps=5.6)
    assert imported(tmp_path, one).positions == 12
    (tmp_path / "s.h5").unlink()
    assert imported(tmp_path, still).positions == 12
    (tmp_path / "s.h5").unlink()
    with pytest.raises(PolfuseError, match=r"burst 6 .* as if the cart had moved"):
        imported(tmp_path, np.concatenate([first, *middle, last]))


def test_noise_does_not_tell_the_polarity(tmp_path):
    # A target so far away that its echo drowns: at 59 m 9 m^2 stand at 0.1 % of full scale, noise at 5 %.
    samples = walk(24, sweeps=2.7, the_scene=scene({"near": (0.0, 59.0, -HEIGHT_M)}, noise=0.05), inverted=True)
    done = imported(tmp_path, samples)
    assert (done.positions, done.polarity_from) == (24, "convention")


def test_few_positions_do_not_tell_the_polarity_and_it_is_said(tmp_path):
    done = imported(tmp_path, walk(5, inverted=True))
    assert (done.sync_inverted, done.polarity_from) == (False, "convention")
    assert any("high is taken for up" in note for note in done.notes)
    (tmp_path / "s.h5").unlink()
    done = imported(tmp_path, walk(5, inverted=True), polarity="low")
    assert (done.sync_inverted, done.polarity_from) == (True, "given")
    (tmp_path / "s.h5").unlink()
    # Unequal levels tell by themselves.
    done = imported(tmp_path, walk(5, inverted=True, ramp_share=0.7))
    assert (done.sync_inverted, done.polarity_from) == (True, "duration")
    assert done.ramp_up_s == pytest.approx(0.7 * 1920.5 / 48_000, abs=1e-6)


def test_a_rig_file_tells_the_radar(tmp_path):
    rig = write_examples(tmp_path / "rig", by_hand=True)["rig"]
    wav = write(tmp_path / "vv.wav", walk(5))
    done = import_sar_wav([wav], tmp_path / "s.h5", channels=VV, rig=rig)
    assert not any("assumption" in note for note in done.notes)
    with open_session(done.session) as session:
        assert session.rig_toml == rig.read_text()
        assert session.waveform.sweep_period_s == pytest.approx(1920.5 / 48_000, abs=1e-7)
    with pytest.raises(PolfuseError, match="bandwidth"):
        import_sar_wav([wav], tmp_path / "t.h5", channels=VV, rig=rig, bandwidth_hz=100e6)
    rig.write_text(rig.read_text().replace("ramp_up_s = 0.020", "ramp_up_s = 0.012"))
    with pytest.raises(PolfuseError, match=r"ramp_up_s is 0.012 s, the recording's is 0.0200"):
        import_sar_wav([wav], tmp_path / "t.h5", channels=VV, rig=rig)
    assert not list(tmp_path.glob("t.h5*"))


def test_what_was_not_told_is_noted(tmp_path):
    done = import_sar_wav([write(tmp_path / "vv.wav", walk(5))], tmp_path / "s.h5", channels=VV)
    assert sum("assumption" in note for note in done.notes) == 3


def test_refusals_name_the_file_and_leave_none(tmp_path):
    samples = walk(3)
    good = write(tmp_path / "good.wav", samples)
    write(tmp_path / "mono.wav", samples[:, 0])
    write(tmp_path / "same.wav", samples[:, [0, 0]])
    write(tmp_path / "no_sync.wav", np.stack([samples[:, 0], samples[::-1, 0]], axis=1))
    write(tmp_path / "one.wav", walk(3, stops=[1], silence=Gap(0.0)))
    write(tmp_path / "fast.wav", samples, rate=44_100)
    (tmp_path / "cut.wav").write_bytes(good.read_bytes()[:5000])
    for name, words in (
        ("mono.wav", "1 channel"),
        ("same.wav", "identical"),
        ("no_sync.wav", "no sync"),
        ("one.wav", "no silence that would part positions"),
        ("cut.wav", "cut short"),
        ("missing.wav", "cannot be read"),
    ):
        with pytest.raises(PolfuseError, match=words) as caught:
            import_sar_wav([tmp_path / name], tmp_path / "out.h5", channels=VV)
        assert name in str(caught.value)
    two = [Channel.VV, Channel.HH]
    with pytest.raises(PolfuseError, match=r"fast.wav: has another sample rate"):
        import_sar_wav([good, tmp_path / "fast.wav"], tmp_path / "out.h5", channels=two)
    for files, options, words in (
        ([good], {"channels": two}, r"2 channel\(s\) are given for 1"),
        ([good, good], {"channels": VV * 2}, "given twice"),
        ([], {"channels": []}, "no file"),
        ([good], {"channels": VV, "step_m": 0.0}, "no aperture"),
        ([good], {"channels": VV, "step_m": float("nan")}, "no aperture"),
        ([good], {"channels": VV, "bandwidth_hz": -1.0}, r"bandwidth_hz = -1.0 is impossible"),
        ([good], {"channels": VV, "bandwidth_hz": 9e9}, "below twice"),
        ([good], {"channels": VV, "antenna_height_m": 0.0}, "antenna_height_m = 0.0 is impossible"),
        ([good], {"channels": VV, "wishes": {Channel.VV: Wishes(positions=9)}}, "9 are expected"),
    ):
        with pytest.raises(PolfuseError, match=words):
            import_sar_wav(files, tmp_path / "out.h5", **options)
    assert not list(tmp_path.glob("out.h5*"))


@pytest.fixture(scope="module")
def short_walk():
    return walk(3, sweeps=3.2, silence=Gap(0.25), the_scene=scene(NEAR))


@given(data=st.data())
@settings(  # without shrinking, which would repeat whole imports for minutes
    max_examples=15,
    deadline=None,
    phases=[Phase.generate],
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
def test_damaged_recordings_are_imported_or_refused_in_words(tmp_path, short_walk, data):
    samples = short_walk.copy()
    for _ in range(data.draw(st.integers(1, 4))):
        start = data.draw(st.integers(0, len(samples) - 1))
        stop = min(start + data.draw(st.integers(1, 20_000)), len(samples))
        kind = data.draw(st.sampled_from(["zero", "full", "swap", "turn", "cut"]))
        if kind == "cut":
            samples = np.delete(samples, slice(start, stop), axis=0) if stop - start < len(samples) - 10 else samples
            continue
        part = samples[start:stop]
        replaced = {"zero": part * 0, "full": part * 0 + 32_767, "swap": part[:, ::-1], "turn": -1 - part}
        samples[start:stop] = replaced[kind]
    wav = write(tmp_path / "damaged.wav", samples)
    out = tmp_path / "damaged.h5"
    out.unlink(missing_ok=True)
    with contextlib.suppress(PolfuseError):  # and nothing else
        done = import_sar_wav([wav], out, channels=VV)
        assert done.positions >= 2
    assert not list(tmp_path.glob("*.partial"))

import contextlib
import struct

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from PIL import Image

from polfuse_lab.errors import PolfuseError
from polfuse_lab.imports import import_frames
from polfuse_lab.imports.frames import FrameOptions, angle_of_name, find_frames
from polfuse_lab.imports.images import inspect_image, read_images
from polfuse_lab.products.optics import optics
from polfuse_lab.rig.examples import write_examples
from polfuse_lab.session import open_session

SHAPE = (24, 32)
DARK = 200


def malus(angle_deg, *, s0=8000.0, dolp=0.4, aop_deg=30.0, extinction=800.0):
    """Counts behind a polarizer of that extinction ratio, from Malus's law with a leak of 1/extinction."""
    wave = np.cos(2 * np.radians(angle_deg - aop_deg))
    return 0.5 * s0 * ((1 + dolp * wave) + (1 - dolp * wave) / extinction)


def counts(value, dtype=np.uint16):
    return np.full(SHAPE, round(value), dtype)


def save(path, *images, **options):
    first, *others = [Image.fromarray(image) for image in images]
    first.save(path, save_all=bool(others), append_images=others, **options) if others else first.save(path, **options)
    return path


def tiff(path, values, bits, *, big_endian=False):
    """A TIFF with one strip, byte by byte from the TIFF 6.0 tables: no library at hand writes 12 bits."""
    order = ">" if big_endian else "<"
    rows, columns = values.shape
    if bits == 12:  # two pixels in three bytes, the first in the upper bits
        a, b = values.ravel()[0::2].astype(int), values.ravel()[1::2].astype(int)
        data = np.stack([a >> 4, (a & 15) << 4 | b >> 8, b & 255], axis=1).astype(np.uint8).tobytes()
    else:
        data = values.astype(f"{order}u{bits // 8}").tobytes()
    tags = [(256, columns), (257, rows), (258, bits), (259, 1), (262, 1), (273, 8), (277, 1), (278, rows)]
    tags.append((279, len(data)))
    body = struct.pack(f"{order}H", len(tags))
    for tag, value in tags:
        body += struct.pack(f"{order}HHII", tag, 4, 1, value)
    header = (b"MM" if big_endian else b"II") + struct.pack(f"{order}HI", 42, 8 + len(data))
    path.write_bytes(header + data + body + bytes(4))
    return path


@pytest.fixture
def series(tmp_path):
    folder = tmp_path / "series"
    folder.mkdir()
    for angle in (0, 45, 90, 135):
        save(folder / f"scene_{angle:03d}.tif", counts(DARK + malus(angle)))
    return folder


@pytest.mark.parametrize("kind", ["8 tif", "8 png", "16 tif", "16 png", "16 big", "12", "pages", "packed"])
def test_counts_are_those_that_were_written(tmp_path, kind):
    rng = np.random.default_rng(1)
    top = {"8": 256, "12": 4096}.get(kind.split()[0], 65_536)
    values = rng.integers(0, top, size=SHAPE).astype(np.uint8 if top == 256 else np.uint16)
    values[0, 0] = top - 1
    images = [values]
    if kind in ("12", "16 big"):
        path = tiff(tmp_path / "a.tif", values, int(kind.split()[0]), big_endian=kind == "16 big")
    elif kind == "pages":
        images = [values, values // 2]
        path = save(tmp_path / "a.tif", *images)
    elif kind == "packed":
        path = save(tmp_path / "a.tif", values, compression="tiff_lzw")
    else:
        path = save(tmp_path / f"a.{kind.split()[1]}", values)
    file = inspect_image(path)
    assert (file.pages, file.shape, file.dtype) == (len(images), SHAPE, values.dtype.name)
    assert (file.largest, file.lowest_bit) == (top - 1, 0)
    assert file.bits == {256: 8, 4096: 12}.get(top, 16)
    for read, written in zip(read_images(file), images, strict=True):
        assert read.dtype == values.dtype
        assert np.array_equal(read, written)


def test_grey_in_three_colours_is_grey(tmp_path):
    values = np.arange(24 * 32, dtype=np.uint8).reshape(SHAPE)
    file = inspect_image(save(tmp_path / "a.png", np.repeat(values[..., None], 3, axis=2)))
    assert np.array_equal(next(read_images(file)), values)


def test_optics_finds_the_light_that_was_put_in(tmp_path, series):
    dark = save(tmp_path / "dark.png", counts(DARK))
    done = import_frames([series], tmp_path / "s.h5", dark=[dark])
    assert (done.frames, done.dark_frames, done.angles_deg) == (5, 1, (0.0, 45.0, 90.0, 135.0))
    made = optics(done.session, tmp_path / "p.h5")
    # Rounding to whole counts moves S1 and S2 by at most 1 of 8000.
    assert made.image.s0 == pytest.approx(8000, abs=2)
    assert made.dolp_median == pytest.approx(0.4, abs=2e-4)
    assert np.degrees(made.image.aop) == pytest.approx(30.0, abs=0.03)
    with open_session(done.session) as session:
        assert session.complete
        assert session.select_frames(dark=True).rows["angle_rad"].tolist() == [0.0]
        assert [f.angle_deg for f in session.select_frames(dark=False)] == pytest.approx([0, 45, 90, 135])
        assert session.frames["angle_sd_rad"][1:] == pytest.approx(np.radians(1.0))
        assert np.array_equal(session.frame(2), counts(DARK + malus(45)))
        assert next(item["name"] for item in session.config["extra"]["frame_files"]) == "scene_000.tif"
        assert str(tmp_path) not in str(session.config)


def test_frames_by_pattern_with_told_angles_and_pages(tmp_path):
    for name, angle in (("a", 10), ("b", 70), ("c", 130)):
        save(tmp_path / f"{name}.tif", *[counts(malus(angle, s0=4000))] * 3)
    options = FrameOptions(angles_deg=(10.0, 70.0, 130.0), bits=12, exposure_s=0.01, angle_sd_deg=0.2)
    done = import_frames([tmp_path / "?.tif"], tmp_path / "s.h5", options=options)
    assert (done.frames, done.pixel_format) == (9, "Mono12")
    made = optics(done.session, tmp_path / "p.h5")
    assert made.dolp_median == pytest.approx(0.4, abs=5e-4)
    with open_session(done.session) as session:
        assert session.rig.camera.saturation_counts == 4095
        assert np.unique(session.frames["exposure_s"]).tolist() == [0.01]
        assert session.frames["angle_sd_rad"] == pytest.approx(np.radians(0.2))


def test_a_rig_file_tells_the_camera(tmp_path, series):
    rig = write_examples(tmp_path / "rig")["rig"]
    with pytest.raises(PolfuseError, match="782 x 582 pixels, the frames 32 x 24"):
        import_frames([series], tmp_path / "s.h5", rig=rig)
    text = rig.read_text().replace("width_px = 782", "width_px = 32").replace("height_px = 582", "height_px = 24")
    rig.write_text(text)
    done = import_frames([series], tmp_path / "s.h5", rig=rig)
    assert done.notes == () or "bits" in done.notes[0]
    rig.write_text(text.replace('"Mono16"', '"Mono8"').replace("= 65535", "= 255"))
    with pytest.raises(PolfuseError, match="delivers Mono8, the frames hold uint16"):
        import_frames([series], tmp_path / "t.h5", rig=rig)
    # A camera with a mosaic sees all angles at once: names need none.
    mosaic = text[: text.index("[polarizer]")].replace('mosaic = "none"', 'mosaic = "90-45-135-0"')
    rig.write_text(mosaic)
    save(tmp_path / "shot.tif", counts(500))
    assert import_frames([tmp_path / "shot.tif"], tmp_path / "m.h5", rig=rig).angles_deg == ()
    rig.write_text(text[: text.index("[camera]")])
    with pytest.raises(PolfuseError, match=r"has no \[camera\]"):
        import_frames([series], tmp_path / "t.h5", rig=rig)


def test_counts_moved_up_to_16_bits_saturate_where_they_do(tmp_path):
    for angle in (0, 60, 120):
        save(tmp_path / f"s_{angle:03d}.tif", counts(round(malus(angle, s0=4000)) << 4))
    done = import_frames([tmp_path / "s_*.tif"], tmp_path / "s.h5", options=FrameOptions(bits=12))
    with open_session(done.session) as session:
        assert session.rig.camera.saturation_counts == 4095 << 4
    assert any("upper bits" in note for note in done.notes)
    done = import_frames([tmp_path / "s_*.tif"], tmp_path / "t.h5")
    assert done.pixel_format == "Mono16"


def test_likely_bits_and_too_few_angles_are_noted(tmp_path):
    save(tmp_path / "a_000.tif", counts(3000))
    save(tmp_path / "a_180.tif", counts(3000))
    notes = import_frames([tmp_path / "a_*.tif"], tmp_path / "s.h5").notes
    assert any("--bits 12" in note for note in notes)
    assert any("1 polarizer angle" in note for note in notes)


@pytest.mark.parametrize(
    ("name", "angle"),
    [
        ("scene_045.tif", 45.0),
        ("pol_0.png", 0.0),
        ("a_22.5.tif", 22.5),
        ("run7_135deg_003.tif", 135.0),
        ("x_-45.tif", -45.0),
        ("day_090_raw.tiff", 90.0),
    ],
)
def test_angles_of_names(tmp_path, name, angle):
    assert angle_of_name(tmp_path / name) == angle


def test_names_that_do_not_tell_are_reported(tmp_path):
    with pytest.raises(PolfuseError, match=r"several numbers that may be the angle \(045, 003\)"):
        angle_of_name(tmp_path / "scene_045_003.tif")
    assert angle_of_name(tmp_path / "scene_045_003.tif", "*_{angle}_*") == 45.0
    for name in ("scene.tif", "scene45.tif", "scene_a45.tif"):
        with pytest.raises(PolfuseError, match="tells no polarizer angle"):
            angle_of_name(tmp_path / name)
    with pytest.raises(PolfuseError, match="does not follow"):
        angle_of_name(tmp_path / "scene_x.tif", "scene_{angle}")


def test_refusals_name_the_file_and_leave_none(tmp_path, series):
    frames = sorted(series.iterdir())
    (tmp_path / "text_000.tif").write_text("no image")
    (tmp_path / "empty_000.tif").write_bytes(b"")
    (tmp_path / "cut_000.tif").write_bytes(frames[0].read_bytes()[:700])
    (tmp_path / "void").mkdir()
    save(tmp_path / "small_000.tif", counts(1)[:10])
    save(tmp_path / "eight_000.tif", counts(1, np.uint8))
    save(tmp_path / "float_000.tif", counts(1).astype(np.float32))
    rng = np.random.default_rng(0)
    save(tmp_path / "colour_000.png", rng.integers(0, 255, (*SHAPE, 3)).astype(np.uint8))
    save(tmp_path / "lossy_000.tif", counts(7, np.uint8), compression="jpeg")
    Image.fromarray(counts(1, np.uint8)).save(tmp_path / "photo_000.jpg")
    Image.fromarray(counts(1, np.uint8)).convert("P").save(tmp_path / "palette_000.png")
    save(tmp_path / "pages_000.tif", counts(1), counts(1)[:9])
    for name, words in (
        ("text_000.tif", "not a readable"),
        ("empty_000.tif", "is empty"),
        ("cut_000.tif", "not a readable|cut short"),
        ("missing_000.tif", "cannot be read"),
        ("void", "no TIFF or PNG"),
        ("no_*.tif", "matches no file"),
        ("small_000.tif", "is 32 x 24 pixels of uint16, small_000.tif 32 x 10"),
        ("eight_000.tif", "uint8"),
        ("float_000.tif", "floating point"),
        ("colour_000.png", "colour picture"),
        ("lossy_000.tif", "with loss"),
        ("photo_000.jpg", "not a readable"),
        ("palette_000.png", "palette"),
        ("pages_000.tif", "page 2 has another size"),
    ):
        with pytest.raises(PolfuseError, match=words) as caught:
            import_frames([tmp_path / name, *frames], tmp_path / "out.h5")
        assert str(tmp_path) in str(caught.value)
    for options, words in (
        (FrameOptions(angles_deg=(0.0, 45.0)), "2 angles are given for 4 frames"),
        (FrameOptions(angles_deg=(0.0, 45.0, 90.0, float("nan"))), "no polarizer angle"),
        (FrameOptions(angles_deg=(0.0,), angle_pattern="{angle}"), "give one of them"),
        (FrameOptions(angle_pattern="scene"), "does not hold"),
        (FrameOptions(bits=8), "hold 16 bits, 8 are said"),
        (FrameOptions(bits=12), "more than 12 bits"),
        (FrameOptions(exposure_s=0.0), "exposure of 0"),
        (FrameOptions(angle_sd_deg=-1.0), "within -1"),
    ):
        with pytest.raises(PolfuseError, match=words):
            import_frames(frames, tmp_path / "out.h5", options=options)
    with pytest.raises(PolfuseError, match="as a frame and as a dark frame"):
        import_frames(frames, tmp_path / "out.h5", dark=[frames[0]])
    with pytest.raises(PolfuseError, match="no frame"):
        import_frames([], tmp_path / "out.h5")
    assert not list(tmp_path.glob("out.h5*"))


@pytest.mark.parametrize("kind", ["tif", "png", "lzw", "hand"])
def test_a_file_that_is_cut_short_never_gives_other_counts(tmp_path, kind):
    values = np.random.default_rng(2).integers(0, 4096, SHAPE).astype(np.uint16)
    path = tmp_path / ("a.png" if kind == "png" else "a.tif")
    if kind == "hand":
        tiff(path, values, 12)
    else:
        save(path, values, **({"compression": "tiff_lzw"} if kind == "lzw" else {}))
    content = path.read_bytes()
    refused = 0
    for length in range(0, len(content), 41):
        path.write_bytes(content[:length])
        try:
            file = inspect_image(path)
        except PolfuseError:
            refused += 1
            continue
        assert np.array_equal(next(read_images(file)), values)  # only what stands behind the counts was lost
    assert refused > 10


def test_a_file_that_changes_meanwhile_is_noticed(series):
    frames = find_frames([series], [], FrameOptions())
    save(frames.files[0].path, counts(1))
    with pytest.raises(PolfuseError, match="was changed"):
        list(read_images(frames.files[0]))


@given(data=st.data())
@settings(
    max_examples=150,
    deadline=None,
    phases=[Phase.generate],
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
def test_damaged_images_are_read_or_refused_in_words(tmp_path, data):
    kind = data.draw(st.sampled_from(["tif", "png", "lzw", "hand"]))
    path = tmp_path / f"damaged.{'png' if kind == 'png' else 'tif'}"
    values = np.arange(24 * 32, dtype=np.uint16).reshape(SHAPE)
    if kind == "hand":
        tiff(path, values, 12)
    else:
        save(path, values, **({"compression": "tiff_lzw"} if kind == "lzw" else {}))
    content = bytearray(path.read_bytes())
    for _ in range(data.draw(st.integers(0, 6))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    path.write_bytes(content[: data.draw(st.integers(0, len(content)))])
    with contextlib.suppress(PolfuseError):  # and nothing else
        file = inspect_image(path)
        assert all(image.shape == file.shape for image in read_images(file))

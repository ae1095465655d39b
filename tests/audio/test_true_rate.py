"""Whether the sound system resamples, read from what the kernel and sound servers say (transcripts shortened)."""

from __future__ import annotations

from pathlib import Path

from drivers.radar.true_rate import card_rate_hz, kernel_rates, server_rates

# pactl 16.1, --format=json list source-outputs / sources.
STREAMS = [
    {"index": 3, "source": 1, "resample_method": "speex-float-1", "properties": {"application.process.id": "812"}},
    {"index": 4, "source": 0, "resample_method": "", "properties": {"application.process.id": "77"}},
    {"index": 5, "source": 9, "properties": {"application.process.id": "812"}},
    {"index": 6, "source": 0},
]
SOURCES = [
    {"index": 0, "name": "hdmi.monitor", "sample_specification": "s16le 2ch 44100Hz"},
    {"index": 1, "name": "polfuse_radar", "sample_specification": "s24-32le 2ch 96000Hz"},
]


def test_a_sound_servers_source_is_found_by_the_process() -> None:
    assert server_rates(STREAMS, SOURCES, 812) == [96_000]
    assert server_rates(STREAMS, SOURCES, 77) == [44_100]
    assert server_rates(STREAMS, SOURCES, 1) == []
    assert server_rates([], [{"index": 0, "sample_specification": None}], 1) == []


def card(proc: Path, number: int, owner: str, rate: str) -> None:
    # As /proc/asound shows an open capture substream (Linux 6.1).
    folder = proc / "asound" / f"card{number}" / "pcm0c" / "sub0"
    folder.mkdir(parents=True)
    (folder / "status").write_text(f"state: RUNNING\nowner_pid   : {owner}\ntrigger_time: 12.5\n")
    (folder / "hw_params").write_text(
        f"access: MMAP_INTERLEAVED\nformat: S32_LE\nchannels: 2\nrate: {rate} ({rate}/1)\n"
    )


def test_an_open_sound_card_is_found_by_its_owner_thread(tmp_path: Path) -> None:
    card(tmp_path, 0, "500", "44100")
    card(tmp_path, 1, "4711", "48000")
    card(tmp_path, 2, "4712", "192000")
    (tmp_path / "asound" / "card3" / "pcm0c" / "sub0").mkdir(parents=True)
    (tmp_path / "asound" / "card3" / "pcm0c" / "sub0" / "status").write_text("closed\n")
    (tmp_path / "4700" / "task" / "4711").mkdir(parents=True)
    assert kernel_rates(tmp_path, 4700) == [48_000], "its thread 4711 opened card 1"
    assert kernel_rates(tmp_path, 500) == [44_100]
    assert kernel_rates(tmp_path, 9) == []


def test_nothing_is_known_without_a_trace(tmp_path: Path) -> None:
    assert card_rate_hz(tmp_path) is None

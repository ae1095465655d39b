"""What waits for a live process that is slow: the newest frames, and every record."""

from __future__ import annotations

import threading
import time
from pathlib import Path

import numpy as np

from drivers.records import Frame, TrolleyFix
from polfuse_lab.live import feed as feeding
from polfuse_lab.records import Exposure


def test_the_oldest_frames_make_room_and_records_are_kept(tmp_path: Path, monkeypatch) -> None:
    feed = feeding.LiveFeed("", "rig.toml", tmp_path)
    # A live process that takes nothing in: the feed's thread stands still.
    monkeypatch.setattr(feed, "_thread", threading.current_thread())
    image = np.zeros((4, 4), np.uint16)
    count = feeding.FRAMES_WAITING + 10
    for number in range(count):
        feed.offer(TrolleyFix(0.001 * number, 0.001, True, time.monotonic_ns()))
        feed.offer(Exposure(Frame(image, number, 0.01, 0.0, 0.0, 0), 0.0))
    waiting = list(feed._waiting)
    frames = [record.frame.frame_id for record in waiting if isinstance(record, Exposure)]
    assert frames == list(range(10, count))
    assert sum(isinstance(record, TrolleyFix) for record in waiting) == count
    assert feed.dropped == 10
    assert feed._bytes == sum(map(feeding._size, waiting))

"""Replay: a recorded session through playback devices and the same scheduler, at any speed, into an identical copy.

::

    result = replay("day1.h5", "copy.h5")               # as fast as possible
    assert result.identical, result.differences

    with Player("day1.h5", speed=4.0, viewer=live) as player:   # watched only: nothing is written
        player.run()                                    # elsewhere: player.clock.pause(), .speed = 1.0, player.abort()
"""

from polfuse_lab.replay.clock import FASTEST, ReplayClock
from polfuse_lab.replay.compare import Difference, compare_sessions
from polfuse_lab.replay.player import Player, ReplayResult, replay

__all__ = ["FASTEST", "Difference", "Player", "ReplayClock", "ReplayResult", "compare_sessions", "replay"]

"""The live view: what has just been recorded, ready to be shown, and what is wrong with it.

:class:`LivePipeline` judges records inside the engine (warnings, one range profile); the live process makes everything
else of them and puts it on the :class:`Board`, which any number of clients read with a :class:`LiveView`.
"""

from polfuse_lab.live.board import Board, LiveView
from polfuse_lab.live.pipeline import QUEUE, LivePipeline, Preview, signal_health, sync_problem
from polfuse_lab.live.ring import Shown

__all__ = ["QUEUE", "Board", "LivePipeline", "LiveView", "Preview", "Shown", "signal_health", "sync_problem"]

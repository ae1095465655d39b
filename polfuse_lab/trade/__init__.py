"""Speed against accuracy: what every knob of the program costs and what error it leaves, measured on this machine."""

from polfuse_lab.trade.rows import Row, pareto, settle
from polfuse_lab.trade.run import TASKS, Trade, trade

__all__ = ["TASKS", "Row", "Trade", "pareto", "settle", "trade"]

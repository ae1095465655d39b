"""Comparisons with peers and reliability campaigns: ``python -m benchmarks [NAME...] [--quick] [--json]``.

A benchmark is a module ``GROUP_WHAT.py`` with a function ``run(quick: bool) -> list[Row]``; its name is ``GROUP.WHAT``
(``reliability_fuzz.py`` is ``reliability.fuzz``).
"""

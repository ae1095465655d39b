"""``python -m polfuse_lab.cli`` is ``polfuse``."""

from polfuse_lab.cli import main

main()

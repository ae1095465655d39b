"""Parts of the pages. Each can be run alone with demo data: ``python -m gui.widgets.<name>``."""

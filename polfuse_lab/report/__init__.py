"""One self-contained page about a products file: pictures, numbers with their uncertainty, checks and provenance."""

from polfuse_lab.report.builder import report

__all__ = ["report"]

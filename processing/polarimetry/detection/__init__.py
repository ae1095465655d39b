"""Targets in clutter: matched filter and constant false-alarm rate."""

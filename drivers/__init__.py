"""Devices: one folder per kind, with its contract (a ``Protocol``) and its real drivers."""

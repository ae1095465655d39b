"""Polarizers in front of the camera. A driver here offers :class:`drivers.contracts.Polarizer`."""

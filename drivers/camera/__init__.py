"""Cameras: GenICam through harvesters, and any camera driver in a process of its own."""

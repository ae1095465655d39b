"""RF transfer switches. A driver here offers :class:`drivers.contracts.Switches`."""

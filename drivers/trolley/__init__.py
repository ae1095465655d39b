"""Trolleys on the rail. A driver here offers :class:`drivers.contracts.Trolley`."""

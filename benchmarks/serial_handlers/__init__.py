"""Ports for pyserial that exist in memory only (:data:`serial.protocol_handler_packages`)."""

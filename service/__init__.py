"""The lumpwatch daemon: sources, bus, pipeline, alarms, store and telemetry around `models`."""

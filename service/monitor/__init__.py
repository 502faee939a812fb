"""The monitor process: decides frames, announces alarms, answers operators, and watches over itself."""

from lumpwatch.service.monitor.monitor_process import run_monitor

__all__ = [
    "run_monitor",
]

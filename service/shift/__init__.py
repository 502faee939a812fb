"""What happened in a shift: which time it is, what the event logs hold of it, and its figures."""

from lumpwatch.service.shift.figures import FLOOD, TEN_MINUTES_S, Figures, in_ten_minutes, shift_figures
from lumpwatch.service.shift.record import RoiRecord, read_shift
from lumpwatch.service.shift.window import Window, report_window

__all__ = [
    "FLOOD",
    "TEN_MINUTES_S",
    "Figures",
    "RoiRecord",
    "Window",
    "in_ten_minutes",
    "read_shift",
    "report_window",
    "shift_figures",
]

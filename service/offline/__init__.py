"""Work on recordings and logs: replay, overlay, backtest, the page of a shift, and plots."""

from lumpwatch.service.offline.backtest.archive import Clip, archive, boxes_of, short_names
from lumpwatch.service.offline.backtest.curve import Point, Terms
from lumpwatch.service.offline.backtest.plots import draw_backtest
from lumpwatch.service.offline.backtest.record import (
    Recording,
    Setup,
    Watch,
    finished_recordings,
    record_video,
    tasks_of,
)
from lumpwatch.service.offline.backtest.report import as_record as backtest_record
from lumpwatch.service.offline.backtest.report import write_backtest
from lumpwatch.service.offline.backtest.run import Backtest, Result, run_backtest
from lumpwatch.service.offline.evidence_replay import load_camera, replay_evidence
from lumpwatch.service.offline.html import (
    html_figure,
    html_items,
    html_page,
    html_paragraph,
    html_photo,
    html_picture,
    html_section,
    html_table,
    html_text,
)
from lumpwatch.service.offline.overlay import OverlayVideo
from lumpwatch.service.offline.plots import ExistenceCurves, PlotError, draw_prior, new_figure
from lumpwatch.service.offline.replay import FrameListener, ReplayError, RoiSummary, Summary, run_replay
from lumpwatch.service.offline.shadow_replay import ReplayShadow
from lumpwatch.service.offline.shift_report import shift_page

__all__ = [
    "Backtest",
    "Clip",
    "ExistenceCurves",
    "FrameListener",
    "OverlayVideo",
    "PlotError",
    "Point",
    "Recording",
    "ReplayError",
    "ReplayShadow",
    "Result",
    "RoiSummary",
    "Setup",
    "Summary",
    "Terms",
    "Watch",
    "archive",
    "backtest_record",
    "boxes_of",
    "draw_backtest",
    "draw_prior",
    "finished_recordings",
    "html_figure",
    "html_items",
    "html_page",
    "html_paragraph",
    "html_photo",
    "html_picture",
    "html_section",
    "html_table",
    "html_text",
    "load_camera",
    "new_figure",
    "record_video",
    "replay_evidence",
    "run_backtest",
    "run_replay",
    "shift_page",
    "short_names",
    "tasks_of",
    "write_backtest",
]

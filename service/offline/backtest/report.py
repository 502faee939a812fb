"""The results of a backtest as files: backtest.json and lumps.csv. The same results give the same bytes."""

from __future__ import annotations

import csv
import io
import json
import math
from pathlib import Path
from typing import Any

from lumpwatch.service.errors import LumpwatchError
from lumpwatch.service.offline.backtest.curve import Point, VideoRecord, in_time, quiet_time, scores_at
from lumpwatch.service.offline.backtest.episodes import Score, alarm_at
from lumpwatch.service.offline.backtest.run import Backtest, Result
from lumpwatch.service.offline.backtest.truth import OVERLAP

Record = dict[str, Any]

LUMP_COLUMNS = (
    *("config", "clip", "lump", "first_frame", "lip_frame", "lip_s", "lip_from"),
    *("counted", "warned_s", "announced"),
)


def write_backtest(found: Backtest, out: Path) -> None:
    """Write both files into `out`, made when missing. Raises LumpwatchError."""
    content = as_record(found)
    lumps = [
        {"config": result["config"], **lump} for result in content["results"] for lump in result["lumps"]
    ]
    try:
        out.mkdir(parents=True, exist_ok=True)
        (out / "backtest.json").write_text(
            json.dumps(content, indent=2, allow_nan=False) + "\n", encoding="utf-8"
        )
        (out / "lumps.csv").write_text(_csv(lumps), encoding="utf-8", errors="backslashreplace")
    except OSError as error:
        raise LumpwatchError(f"{error.filename or out}: cannot be written ({error.strerror})") from error


def as_record(found: Backtest) -> Record:
    """Everything, as plain data for JSON."""
    return {
        "hours": _rounded(found.hours),
        "least_warning_s": found.terms.least_warning_s,
        "tolerance_s": found.terms.tolerance_s,
        "wanted_false_alarms_per_hour": found.terms.false_alarms_per_hour,
        "least_overlap": OVERLAP,
        "failures": list(found.failures),
        "results": [_result(result, found) for result in found.results],
    }


def _result(result: Result, found: Backtest) -> Record:
    roi, advice = result.setup.roi, result.recommendation
    chosen = alarm_at(roi.alarm, result.chosen.raise_above)
    scores = scores_at(result.judged, chosen, found.terms)
    both = list(zip(result.judged, scores, strict=True))
    clips = [_clip(video, score, found) for video, score in both]
    return {
        "config": result.setup.name,
        "camera": result.setup.camera.id,
        "roi": roi.id,
        "prior": result.setup.prior.version if result.setup.prior else 0,
        "prior_refused_on": result.refused,
        "configured": _point(result.configured),
        "recommended": _point(advice.point) if advice.point else None,
        "none_recommended": advice.reason,
        "false_alarms_per_hour_surely_below": _rounded(advice.below_per_hour),
        "quiet_hours_needed": _rounded(advice.needed_h),
        "most_announced": advice.most_announced,
        "curve": [_point(point) for point in result.points],
        "details_at": chosen.raise_above,
        "clips": sorted(clips, key=lambda clip: (-clip["missed"], -clip["false"], -clip["misplaced"])),
        "lumps": [lump for video, score in both for lump in _lumps(video, score, found)],
        "alarms": [alarm for video, score in both for alarm in _alarms(video, score)],
    }


def _point(point: Point) -> Record:
    return {
        "raise_above": point.raise_above,
        "clear_below": _rounded(point.clear_below),
        "lumps": point.lumps,
        "announced": point.announced,
        "detection_rate": _rounded(point.detection_rate),
        "detection_interval": [_rounded(end) for end in point.detection_interval],
        "warning_median_s": _rounded(point.warning_median_s),
        "warning_worst_tenth_s": _rounded(point.warning_worst_tenth_s),
        "true_alarms": point.true_alarms,
        "misplaced_alarms": point.misplaced_alarms,
        "false_alarms": point.false_alarms,
        "quiet_hours": _rounded(point.quiet_h),
        "false_alarms_per_hour": _rounded(point.false_per_hour),
        "false_alarms_interval": [_rounded(end) for end in point.false_interval],
        "standing_share": _rounded(point.standing_share),
    }


def _clip(video: VideoRecord, score: Score, found: Backtest) -> Record:
    counted = [warned for lump, warned in zip(video.truth.lumps, score.warned_s, strict=True) if lump.counted]
    return {
        "clip": video.clip,
        "hours": _rounded(float(video.recording.intervals.sum()) / 3600),
        "quiet_hours": _rounded(quiet_time(video, found.terms) / 3600),
        "lumps": len(counted),
        "missed": sum(not in_time(warned, found.terms) for warned in counted),
        "true": score.count("true"),
        "false": score.count("false"),
        "misplaced": score.count("misplaced"),
        "lumps_not_counted": len(video.truth.lumps) - len(counted),
        "tracks_outside": video.truth.outside,
        "frames_not_judged": video.recording.length - len(video.recording.frames),
        "prior": video.recording.prior,
    }


def _lumps(video: VideoRecord, score: Score, found: Backtest) -> list[Record]:
    return [
        {
            "clip": video.clip,
            "lump": lump.track,
            "first_frame": lump.first_frame,
            "lip_frame": lump.lip_frame,
            "lip_s": _rounded(lump.lip_s),
            "lip_from": lump.lip_from,
            "counted": lump.counted,
            "warned_s": _rounded(warned),
            "announced": in_time(warned, found.terms),
        }
        for lump, warned in zip(video.truth.lumps, score.warned_s, strict=True)
    ]


def _alarms(video: VideoRecord, score: Score) -> list[Record]:
    frames, times = video.recording.frames, video.recording.times
    return [
        {
            "clip": video.clip,
            "verdict": episode.verdict,
            "raised_frame": int(frames[episode.raised]),
            "raised_s": _rounded(float(times[episode.raised])),
            "cleared_s": _rounded(float(times[episode.cleared])) if episode.cleared < len(times) else None,
        }
        for episode in score.episodes
    ]


def _csv(rows: list[Record]) -> str:
    text = io.StringIO()
    writer = csv.DictWriter(text, LUMP_COLUMNS, lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def _rounded(value: float | None) -> float | None:
    """What JSON can hold: None for what is undefined or without bound."""
    return None if value is None or not math.isfinite(value) else round(value, 6)

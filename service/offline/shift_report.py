"""The report of a shift as one HTML page that needs nothing else."""

from __future__ import annotations

import base64
import html
from collections.abc import Mapping, Sequence
from datetime import datetime
from typing import Any
from zoneinfo import ZoneInfo

from lumpwatch.service.offline.html import html_page
from lumpwatch.service.offline.shift_plots import distributions, rates, timeline
from lumpwatch.service.shift import Figures, RoiRecord, Window


def shift_page(
    found: Figures,
    records: Sequence[RoiRecord],
    window: Window,
    zone: ZoneInfo,
    stills: Mapping[tuple[str, str, str], bytes],
) -> str:
    """The page; `stills` are JPEGs by camera, ROI and evidence id. Raises PlotError without matplotlib."""
    shift = found["shift"]
    span = f"{_local(shift['begin'], zone)} to {_local(shift['end'], zone)} ({zone.key})"
    title = f"{found['site']}: {window.name}"
    parts = [
        f"<p class='sub'>{_text(span)}, {_hours(shift['hours'])}; "
        f"made {_text(_local(found['generated'], zone))}</p>",
        _tiles(found),
        "<h2>What each region saw</h2>",
        _plot(timeline(records, window, zone), "timeline"),
        _rois(found["rois"]),
        "<h2>Sizes, warning and acknowledge times</h2>",
        _plot(distributions(found), "distributions"),
        "<h2>Alarm rate</h2>",
        f"<p>On average {found['rates']['ten_minutes_mean']:.2f} alarms in ten minutes, at most "
        f"{found['rates']['ten_minutes_peak']}: {_text(found['rates']['eemua_191'])} for one operator "
        "(EEMUA 191).</p>",
        _plot(rates(records, window, zone), "rates"),
        f"<h2>Alarms ({len(found['alarms'])})</h2>",
        _alarms(found["alarms"], zone, stills),
        "<p class='sub'>Availability is the share of the shift in which a region could see; time in which "
        "nobody watched counts as not seen. A lump that is announced again while it is there is one lump. "
        "Precision is true / (true + false) over the judged alarms, with "
        "the exact 95 % interval of Clopper and Pearson. Times to acknowledge include those after the shift."
        "</p>",
    ]
    return html_page(title, parts)


def _tiles(found: Figures) -> str:
    total, rois = found["total"], found["rois"]
    worst = min((roi["availability"] for roi in rois), default=None)
    blind = sum(sum(roi["blind_minutes"].values()) for roi in rois)
    unknown = sum(roi["unknown_minutes"] for roi in rois)
    low, high = total["precision_interval"]
    precision = "-" if total["precision"] is None else f"{100 * total['precision']:.0f} %"
    judged = total["verdicts"]["true"] + total["verdicts"]["false"]
    tiles = [
        (str(total["lumps"]), "lumps announced"),
        (_number(total["longest_mm"]["worst"], " mm"), f"largest{_over(total, 'longest_mm')}"),
        (
            _number(total["warning_s"]["median"], " s"),
            f"median warning before the lip{_over(total, 'warning_s')}",
        ),
        (
            _number(total["acknowledge_s"]["median"], " s"),
            f"median time to acknowledge{_over(total, 'acknowledge_s')}",
        ),
        (str(total["unacknowledged"]), "not acknowledged"),
        (precision, f"precision, {judged} judged ({100 * low:.0f} to {100 * high:.0f} %)"),
        (_percent(worst), "availability of the worst region"),
        (f"{blind:.1f} min", f"blind, and {unknown:.1f} min not watched, all regions"),
        (
            "-" if total["alarms_per_hour"] is None else f"{total['alarms_per_hour']:.2f}",
            f"announcements an hour watched ({total['announcements']} in {_hours(total['watched_hours'])})",
        ),
    ]
    cells = [
        f"<div class='tile'><b>{_text(value)}</b><span>{_text(name)}</span></div>" for value, name in tiles
    ]
    return f"<div class='tiles'>{''.join(cells)}</div>"


def _over(total: Figures, key: str) -> str:
    """Over how many lumps a figure goes, where that is not all of them."""
    known = total[key]["count"]
    return "" if known == total["lumps"] else f" (known of {known} of {total['lumps']})"


def _hours(hours: float) -> str:
    """As people say it: 45 min, 5 h 44 min."""
    minutes = round(60 * hours)
    return (
        f"{minutes} min" if minutes < 60 else f"{minutes // 60} h {minutes % 60} min".removesuffix(" 0 min")
    )


def _rois(rois: Sequence[Figures]) -> str:
    heads = ("region", "lumps", "while held", "precision", "available", "blind (min)", "not watched (min)")
    rows = []
    for roi in rois:
        low, high = roi["precision_interval"]
        precision = "not judged"
        if roi["precision"] is not None:
            precision = f"{100 * roi['precision']:.0f} % ({100 * low:.0f} to {100 * high:.0f})"
        blind = (
            ", ".join(f"{reason} {minutes:.1f}" for reason, minutes in roi["blind_minutes"].items()) or "0"
        )
        rows.append(
            (
                f"{roi['camera']}/{roi['roi']}",
                str(roi["lumps"]),
                str(roi["held"]),
                precision,
                _percent(roi["availability"]),
                blind,
                f"{roi['unknown_minutes']:.1f}",
            )
        )
    return _table(heads, [[_text(cell) for cell in row] for row in rows])


def _alarms(alarms: Sequence[Figures], zone: ZoneInfo, stills: Mapping[tuple[str, str, str], bytes]) -> str:
    heads = ("time", "region", "no.", "size", "warning", "acknowledged", "lasted", "verdict", "")
    rows = []
    for alarm in alarms:
        acknowledged = "<span class='bad'>no</span>"
        if alarm["acknowledged_s"] is not None:
            by = _text(alarm["acknowledged_by"] or "")
            acknowledged = f"{_text(_number(alarm['acknowledged_s'], ' s'))}<br>{by}"
        verdict = "not judged"
        if alarm["verdict"]:
            note = f": {_text(alarm['note'])}" if alarm["note"] else ""
            outcome = _text(alarm["verdict"])
            verdict = f"<span class='{outcome}'>{outcome}</span> ({_text(alarm['verdict_by'])}){note}"
        still = stills.get((alarm["camera"], alarm["roi"], alarm["id"]))
        picture = ""
        if still is not None:
            coded = base64.b64encode(still).decode()
            picture = f"<img class='still' alt='still' src='data:image/jpeg;base64,{coded}'>"
        rows.append(
            [
                _text(_local(alarm["time"], zone)),
                _text(f"{alarm['camera']}/{alarm['roi']}"),
                str(alarm["sequence"]),
                _text(_number(alarm["longest_mm"], " mm")),
                _text(_number(alarm["warning_s"], " s")),
                acknowledged,
                _text(_number(alarm["lasted_s"], " s")),
                verdict,
                picture,
            ]
        )
    return _table(heads, rows) if rows else "<p>None.</p>"


def _table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    head = "".join(f"<th>{_text(heading)}</th>" for heading in heads)
    body = "".join("<tr>" + "".join(f"<td>{cell}</td>" for cell in row) + "</tr>" for row in rows)
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def _plot(svg: str, name: str) -> str:
    coded = base64.b64encode(svg.encode()).decode()
    return f"<img class='plot' alt='{name}' src='data:image/svg+xml;base64,{coded}'>"


def _local(iso: str, zone: ZoneInfo) -> str:
    return f"{datetime.fromisoformat(iso).astimezone(zone):%Y-%m-%d %H:%M:%S}"


def _number(value: float | None, unit: str) -> str:
    return "-" if value is None else f"{value:.1f}".removesuffix(".0") + unit


def _percent(share: float | None) -> str:
    return "-" if share is None else f"{100 * share:.2f} %"


def _text(value: Any) -> str:
    return html.escape(str(value))

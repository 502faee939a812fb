"""The register map as text: a table for people, CSV and JSON for engineering tools."""

from __future__ import annotations

import csv
import io
import json

from lumpwatch.service.gateway.register_map import Point, RegisterMap

COLUMNS = ("name", "table", "address", "type", "unit", "scale", "about")


def as_json(register_map: RegisterMap) -> str:
    """A list of objects."""
    return json.dumps([point.plain() for point in register_map.points], indent=1, ensure_ascii=False)


def as_csv(register_map: RegisterMap) -> str:
    """One line a value, with a header."""
    out = io.StringIO()
    writer = csv.DictWriter(out, COLUMNS, lineterminator="\n")
    writer.writeheader()
    writer.writerows(point.plain() for point in register_map.points)
    return out.getvalue().rstrip("\n")


def as_table(register_map: RegisterMap) -> str:
    """Columns for people. Addresses are those on the wire, from 0."""
    width = max(len(point.name) for point in register_map.points)
    lines = [f"{'name':{width}}  {'table':7}  address  type    unit  scale  about"]
    lines += [_line(point, width) for point in register_map.points]
    return "\n".join(lines)


def _line(p: Point, width: int) -> str:
    return f"{p.name:{width}}  {p.table:7}  {p.address:7}  {p.type:6}  {p.unit:4}  {p.scale:5}  {p.about}"

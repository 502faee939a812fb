"""The metrics of `lumpwatch.models.evaluation` once more: plain loops over frames, every assignment tried.

For few boxes a frame and few tracks. Input: rows (frame, id, left, top, width, height).
"""

from __future__ import annotations

from itertools import permutations

Row = tuple[int, int, float, float, float, float]


def overlap(a: Row, b: Row) -> float:
    _, _, ax, ay, aw, ah = a
    _, _, bx, by, bw, bh = b
    across = max(0.0, min(ax + aw, bx + bw) - max(ax, bx))
    down = max(0.0, min(ay + ah, by + bh) - max(ay, by))
    return across * down / (aw * ah + bw * bh - across * down)


def best(score: list[list[float]]) -> float:
    """The largest sum of a one-to-one assignment; scores are not negative."""
    if not score or not score[0]:
        return 0.0
    if len(score) > len(score[0]):
        score = [list(column) for column in zip(*score, strict=True)]
    columns = permutations(range(len(score[0])), len(score))
    return max(sum(row[j] for row, j in zip(score, chosen, strict=True)) for chosen in columns)


def at(rows: list[Row], frame: int) -> list[Row]:
    return [row for row in rows if row[0] == frame]


def sfda(result: list[Row], truth: list[Row]) -> float:
    frames = sorted({row[0] for row in result + truth})
    total = 0.0
    for t in frames:
        g, d = at(truth, t), at(result, t)
        total += best([[overlap(a, b) for b in d] for a in g]) / ((len(g) + len(d)) / 2)
    return total / len(frames)


def track_table(
    result: list[Row], truth: list[Row], threshold: float | None
) -> list[list[tuple[float, int]]]:
    """For each pair of tracks: overlap summed over the common frames, and frames with either."""
    table = []
    for g in sorted({row[1] for row in truth}):
        true = {row[0]: row for row in truth if row[1] == g}
        line = []
        for d in sorted({row[1] for row in result}):
            found = {row[0]: row for row in result if row[1] == d}
            shared = [overlap(true[t], found[t]) for t in true.keys() & found.keys()]
            if threshold is not None:
                shared = [float(one >= threshold) for one in shared]
            line.append((sum(shared), len(true.keys() | found.keys())))
        table.append(line)
    return table


def ata(result: list[Row], truth: list[Row], threshold: float | None) -> float:
    table = track_table(result, truth, threshold)
    tracks = len({row[1] for row in truth}) + len({row[1] for row in result})
    return best([[shared / frames for shared, frames in line] for line in table]) / (tracks / 2)


def idf1(result: list[Row], truth: list[Row], threshold: float) -> float:
    table = track_table(result, truth, threshold)
    return 2 * best([[shared for shared, _ in line] for line in table]) / (len(truth) + len(result))

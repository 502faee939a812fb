"""The videos of an archive, each with its labels."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from lumpwatch.service.core import read_bounded
from lumpwatch.service.errors import ConfigError
from lumpwatch.service.storage import Box, LabelError, read_labels

_VIDEOS = frozenset({".avi", ".m4v", ".mkv", ".mov", ".mp4", ".mpg", ".ts", ".webm"})


@dataclass(frozen=True, slots=True)
class Clip:
    """One video of the archive."""

    name: str
    """For people: the file's name where it is the only one of that name."""
    video: Path
    labels: Path | None
    boxes: tuple[Box, ...]
    """Empty: no lump comes."""


def archive(
    videos: Sequence[Path], labels: Sequence[Path] | None = None, unlabelled_is_empty: bool = False
) -> tuple[Clip, ...]:
    """The videos with their labels, which are `labels` in the order of the videos or lie beside them.

    A folder in which videos lie stands for them. Beside `clip.mp4` labels are `clip.txt`, or `gt.txt`. Raises
    ConfigError for a video without labels (unless that means that it shows no lump) and for arguments that contradict
    each other, LabelError.
    """
    videos = all_videos(videos)
    names = short_names(videos, "--videos")
    if labels is None:
        paths = tuple(beside(video, unlabelled_is_empty) for video in videos)
        _no_sharing(videos, paths)
    elif len(labels) == len(videos):
        paths = tuple(labels)
    else:
        raise ConfigError(
            f"--labels: expected one file a video, found {len(labels)} for {len(videos)} videos"
        )
    return tuple(
        Clip(name, video, path, () if path is None else boxes_of(path))
        for name, video, path in zip(names, videos, paths, strict=True)
    )


def all_videos(paths: Sequence[Path]) -> list[Path]:
    """The same with the videos that lie in a folder, by name, in its place; one without any is left as it is."""
    found: list[Path] = []
    for path in paths:
        inside = (
            sorted(one for one in path.iterdir() if one.suffix.lower() in _VIDEOS) if path.is_dir() else []
        )
        found += inside or [path]
    return found


def short_names(paths: Sequence[Path], argument: str) -> tuple[str, ...]:
    """The names of files, with their folders where a name alone could mean two. Raises ConfigError."""
    if len(set(paths)) < len(paths):
        (twice, _), *_ = Counter(paths).most_common(1)
        raise ConfigError(f"{argument}: {twice} is given more than once")
    counts = Counter(path.name for path in paths)
    return tuple(path.name if counts[path.name] == 1 else str(path) for path in paths)


def beside(video: Path, may_be_missing: bool) -> Path | None:
    """The labels that lie beside a video; raises ConfigError where there are none and must be."""
    candidates = (video.with_suffix(".txt"), video.with_name("gt.txt"))
    for path in candidates:
        if path.is_file():
            return path
    if may_be_missing:
        return None
    first, second = (path.name for path in candidates)
    raise ConfigError(
        f"{video}: has no labels beside it (neither {first} nor {second}); "
        "give --labels, or --unlabelled-is-empty where it shows no lump"
    )


def boxes_of(path: Path) -> tuple[Box, ...]:
    """The boxes of a label file, none where it is empty. Raises LabelError."""
    try:
        lines = read_bounded(path).decode("utf-8-sig").splitlines()
    except OSError as error:
        raise LabelError(f"{path}: cannot be read ({error.strerror})") from error
    except UnicodeDecodeError as error:
        raise LabelError(f"{path}: is not text") from error
    if all(not line.strip() or line.lstrip().startswith("#") for line in lines):
        return ()
    return read_labels(path)


def _no_sharing(videos: Sequence[Path], paths: Sequence[Path | None]) -> None:
    owners: dict[Path, Path] = {}
    for video, path in zip(videos, paths, strict=True):
        if path is None:
            continue
        if path in owners:
            raise ConfigError(
                f"{path}: lies beside both {owners[path].name} and {video.name}; say with --labels whose it is"
            )
        owners[path] = video

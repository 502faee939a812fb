"""Compiles the kernels of the lump filter ahead: `python -m lumpwatch.service.cli.kernels`.

numba keeps what it has compiled beside the sources, or in `NUMBA_CACHE_DIR`, by source, version and processor; a change
of any of them compiles anew. What the kernels are called with decides what is compiled, so the filter itself is run.
"""

from __future__ import annotations

from importlib.resources import as_file, files
from pathlib import Path

from lumpwatch.service.cli.demo import CAMERA, FEED, ROI, SEED, demo_config
from lumpwatch.service.config import parse_config
from lumpwatch.service.core import Frame
from lumpwatch.service.detection import CameraPipeline
from lumpwatch.service.simulator import FeedSimulator, FeedSpec
from lumpwatch.service.storage import read_file

_SECONDS = 5.0
"""A lump has come by then: what follows it is compiled, too."""


def compile_kernels() -> bool:
    """Run the demo's filter, trained and untrained, over the first seconds of its feed; whether it found a lump."""
    camera = parse_config(demo_config(Path("var"), SEED)).camera(CAMERA)
    with as_file(files("lumpwatch.service.simulator") / "demo.prior") as path:
        prior = read_file(path)
    pipelines = [CameraPipeline(camera, {ROI: prior}), CameraPipeline(camera)]
    spec = FeedSpec.from_query(FEED, seed=SEED)
    feed, found = FeedSimulator(spec), False
    for k in range(round(_SECONDS * spec.fps)):
        picture, _ = feed.render()
        time_s = k / spec.fps
        frame = Frame(k, time_s, time_s, time_s, spec.width, spec.height, "gray8", picture)
        for pipeline in pipelines:
            for result in pipeline.process(frame, time_s):
                found |= result.detection is not None and bool(result.detection.objects)
    return found


if __name__ == "__main__":
    compile_kernels()

"""Compiles the filters' kernels ahead: `python -m lumpwatch.service.cli.kernels [--all]`.

numba keeps what it has compiled beside the sources, or in `NUMBA_CACHE_DIR`, by source, version and processor; a change
of any of them compiles anew. What the kernels are called with decides what is compiled, so the filters themselves are
run. Without `--all` only that of lumps, which nearly every site uses.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable
from importlib.resources import as_file, files
from pathlib import Path

from lumpwatch.service.cli.demo import CAMERA, FEED, ROI, SEED, demo_config
from lumpwatch.service.config import CameraConfig, parse_config
from lumpwatch.service.core import Frame
from lumpwatch.service.detection import CameraPipeline
from lumpwatch.service.simulator import FeedSimulator, FeedSpec
from lumpwatch.service.storage import read_file

_SECONDS = 5.0
"""A lump has come by then: what follows it is compiled, too."""
_OTHERS = (
    "detector: {kind: imm_pf}",
    "detector: {kind: jpda}",
    "detector: {likelihood: {kind: histogram}}",
    "detector: {models: [random_walk, constant_velocity, bounce], form: sampled, objects: 1}",
)
"""What `--all` adds to the region of lumps."""


def compile_kernels(*, every: bool = False) -> bool:
    """Run filters over the first seconds of the demo's feed; whether that of lumps found one."""
    with as_file(files("lumpwatch.service.simulator") / "demo.prior") as path:
        prior = read_file(path)
    pipelines = [CameraPipeline(_camera(), {ROI: prior}), CameraPipeline(_camera())]
    if every:
        pipelines += [CameraPipeline(_camera(detector)) for detector in _OTHERS]
    return _run(pipelines)


def _camera(detector: str = "") -> CameraConfig:
    text = demo_config(Path("var"), SEED)
    return parse_config(f"{text}        {detector}\n" if detector else text).camera(CAMERA)


def _run(pipelines: Iterable[CameraPipeline]) -> bool:
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
    compile_kernels(every="--all" in sys.argv[1:])

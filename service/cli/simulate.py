"""`lumpwatch simulate`: a simulated feed as video and labels."""

from __future__ import annotations

import argparse
import sys

from lumpwatch.service.cli.common import progress
from lumpwatch.service.cli.options import tell_json
from lumpwatch.service.errors import ConfigError, LumpwatchError
from lumpwatch.service.simulator import FeedSpec, write_video


def simulate(arguments: argparse.Namespace) -> int:
    """Run the command."""
    spec = FeedSpec.from_query(arguments.set)
    if arguments.seed is not None:
        if arguments.seed < 0:
            raise ConfigError(f"--seed {arguments.seed}: must not be negative")
        spec = spec.model_copy(update={"seed": arguments.seed})
    if not 0 < arguments.for_s < 1e6:
        raise ConfigError(f"--for {arguments.for_s:g}s: must be positive and at most a million seconds")
    frames = round(arguments.for_s * spec.fps)
    try:
        with progress("rendering", frames) as advance:
            written = write_video(spec, arguments.for_s, arguments.out, lambda done, _: advance(done))
    except ValueError as error:
        raise ConfigError(f"--for {arguments.for_s:g}s: {error}") from error
    except OSError as error:
        raise LumpwatchError(f"{arguments.out}: cannot be written ({error.strerror})") from error
    if written.site_kept:
        sys.stderr.write(
            f"lumpwatch: warning: {written.site} was there already and stays; it may not fit this feed\n"
        )
    if arguments.json:
        files = {name: str(getattr(written, name)) for name in ("video", "labels", "spec", "site")}
        tell_json({**files, "seconds": arguments.for_s, "seed": spec.seed})
        return 0
    print(f"{written.video}\n{written.labels}\n{written.spec}\n{written.site}")  # noqa: T201 - the command's output
    return 0

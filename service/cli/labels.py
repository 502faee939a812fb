"""`lumpwatch labels`: verdicts of operators as labels for training."""

from __future__ import annotations

import argparse
from dataclasses import asdict

from lumpwatch.service.cli.options import tell_json
from lumpwatch.service.config import load_config
from lumpwatch.service.errors import ConfigError
from lumpwatch.service.evidence import Evidence, EvidenceStore
from lumpwatch.service.storage import EventLogError, Verdict, event_file, latest_verdicts, reading
from lumpwatch.service.training import export


def labels(arguments: argparse.Namespace) -> int:
    """Run the command."""
    config = load_config(arguments.config, secrets=False)
    store = EvidenceStore(config.store.path)
    judged: dict[str, tuple[Evidence, Verdict]] = {}
    without = 0
    for camera in config.cameras:
        path = event_file(config.store.path, camera.id)
        if not path.is_file():
            continue
        with reading(path) as db:
            verdicts = latest_verdicts(db)
        kept = {(evidence.meta.roi, evidence.meta.id): evidence for evidence in store.listed(camera.id)}
        for key, verdict in verdicts.items():
            if key in kept:
                judged[kept[key].meta.name] = (kept[key], verdict)
            else:
                without += 1
    if not judged:
        raise EventLogError(
            f"{config.store.path}: no alarm has both a verdict and evidence ({without} have no evidence)"
        )
    if arguments.out.is_dir() and any(arguments.out.iterdir()):
        raise ConfigError(f"--out {arguments.out}: is not empty")
    done = export(judged, arguments.out)
    if arguments.json:
        tell_json({"folder": str(arguments.out), **asdict(done), "without_evidence": without})
        return 0
    print(  # noqa: T201
        f"{done.true} true and {done.false} false alarms in {arguments.out}; left out: {done.unsure} unsure, "
        f"{done.without_track} without a track, {without} without evidence"
    )
    return 0

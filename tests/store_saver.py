"""Stores a prior again and again: `python -m tests.store_saver ROOT FILE NAME COUNT`."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

from lumpwatch.service.storage.prior_store import PriorStore, read_file


def main(root: str, file: str, name: str, count: str) -> None:
    prior = read_file(Path(file))
    store = PriorStore(Path(root), keep=100)
    for k in range(int(count)):
        store.save(replace(prior, meta=prior.meta.model_copy(update={"source": f"{name}-{k}"})))


if __name__ == "__main__":
    main(*sys.argv[1:])

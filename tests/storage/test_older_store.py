"""A store that version 0.1 wrote: what this version makes of it.

`store_0_1.tar.gz` was written by the code of 0.1.0: two priors (`apron` by histogram, `lumps` by hand-made features), a
picture reference, an event log of three records and the result of a proof test.
"""

from __future__ import annotations

import tarfile
from contextlib import closing
from pathlib import Path

import pytest

from lumpwatch.service.protocol import Outcome, ProofResult
from lumpwatch.service.storage.event_log import EventLog, event_file
from lumpwatch.service.storage.event_log_reader import read_events
from lumpwatch.service.storage.prior_store import PriorStore
from lumpwatch.service.storage.reference_store import ReferenceStore
from tests.service_helpers import bright_fit, same
from tests.service_helpers import prior as new_prior
from tests.storage.test_event_log import entry


@pytest.fixture
def store(tmp_path: Path) -> Path:
    with tarfile.open(Path(__file__).with_name("store_0_1.tar.gz")) as archive:
        archive.extractall(tmp_path, filter="data")
    return tmp_path


def test_a_prior_goes_on_and_gets_a_successor(store: Path) -> None:
    priors = PriorStore(store, 10)
    found = priors.current("cam", "apron")
    assert found.prior is not None
    assert (found.prior.version, found.prior.meta.source, found.problems) == (1, "belt.mp4", ())
    assert same(found.prior.learned.likelihood, bright_fit())
    assert priors.save(new_prior()).version == 2


def test_a_prior_of_hand_made_features_is_refused_with_what_to_do(store: Path) -> None:
    """The one format of 0.1 that is not read any more; docs/compatibility.md says so."""
    found = PriorStore(store, 10).current("cam", "lumps")
    assert found.prior is None
    assert "was trained by a version with other measures of a box: train again" in found.problems[0]


def test_the_event_log_goes_on_where_it_was(store: Path) -> None:
    file = event_file(store, "cam")
    with closing(EventLog(file)) as log:
        log.append([entry(4)])
        assert [kept.record for kept in log.records()] == [f"record {k}".encode() for k in range(1, 5)]
    assert [event.sequence for event in read_events(file)] == [1, 2, 3, 4]


def test_reference_and_proof_test(store: Path) -> None:
    reference = ReferenceStore(store).current("cam").reference
    assert reference is not None
    assert reference.version == 1
    result = ProofResult.model_validate_json((store / "proof/cam/apron.json").read_bytes())
    assert (result.outcome, result.warning_s) == (Outcome.PASSED, 4.2)

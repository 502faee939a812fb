"""From labelled footage to a prior, judged and reported."""

from lumpwatch.service.training.acceptance import Acceptance, accept, objection_to
from lumpwatch.service.training.coverage import coverage_warnings, validation_warnings
from lumpwatch.service.training.cross_validation import Validation, cross_validate
from lumpwatch.service.training.dataset import Clip, Material, clips_of, confirmed_clips, gather
from lumpwatch.service.training.evidence_labels import export
from lumpwatch.service.training.evidence_rate import TRIALS
from lumpwatch.service.training.footage import TrainingError
from lumpwatch.service.training.histogram_rate import HISTOGRAM_TRIALS
from lumpwatch.service.training.label_proposals import accept_proposals, parse_ids, to_text
from lumpwatch.service.training.learner import Trained, learn, tempered, with_choices_of
from lumpwatch.service.training.lump_cuts import cut_lumps
from lumpwatch.service.training.picture_reference import Recording, learn_reference
from lumpwatch.service.training.proposal_sheet import contact_sheet
from lumpwatch.service.training.proposing import Surest, suggest
from lumpwatch.service.training.report import training_report
from lumpwatch.service.training.sources import missing_sources, sources_text
from lumpwatch.service.training.tracker_choice import CANDIDATES, Tried, choose
from lumpwatch.service.training.unboxed_lumps import Unboxed, unboxed

__all__ = [
    "CANDIDATES",
    "HISTOGRAM_TRIALS",
    "TRIALS",
    "Acceptance",
    "Clip",
    "Material",
    "Recording",
    "Surest",
    "Trained",
    "TrainingError",
    "Tried",
    "Unboxed",
    "Validation",
    "accept",
    "accept_proposals",
    "choose",
    "clips_of",
    "confirmed_clips",
    "contact_sheet",
    "coverage_warnings",
    "cross_validate",
    "cut_lumps",
    "export",
    "gather",
    "learn",
    "learn_reference",
    "missing_sources",
    "objection_to",
    "parse_ids",
    "sources_text",
    "suggest",
    "tempered",
    "to_text",
    "training_report",
    "unboxed",
    "validation_warnings",
    "with_choices_of",
]

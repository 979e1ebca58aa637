"""Mixtures of training members at unseen parameters, with constants chosen on validation images."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from catalogs.store.catalog import Member
from catalogs.vocabulary.parameters import ParameterSpace
from surrogate.evaluation.cases import VALIDATION, Case, sample_of
from surrogate.evaluation.metrics import TrueImage
from surrogate.evaluation.pictures import Images
from surrogate.evaluation.scoring import mean, score_cases
from surrogate.evaluation.trivial.interpolation import fixed_rules, tuned_rules
from surrogate.evaluation.trivial.mixtures import MemberPictures, Mixtures

TUNING_IMAGES = 60  # validation images for the choice of a rule's constants


def member_mixtures(
    images: Images, members: Sequence[Member], space: ParameterSpace, appearance: str, watched: Sequence[Case]
) -> tuple[MemberPictures, Mixtures]:
    """Images of training `members` and all rules on them, with the constants that suit `watched` validation images best."""
    sources = [m for m in members if m.split == "train" and appearance in m.appearances]
    pictures, rules = MemberPictures(space, appearance, sources), fixed_rules(len(space))
    tuning = sample_of([case for case in watched if case.member.split == VALIDATION], TUNING_IMAGES)
    families = tuned_rules() if tuning else []
    tried = Mixtures(images, pictures, {name: rule for family in families for name, rule in family.items()})
    scores = score_cases(tried, images, tuning, metrics=TrueImage.psnr_alone) if families else []
    psnr = {name: mean(result.values(), "psnr") for name, result in zip(tried.names, scores, strict=True)}
    for family in families:
        values = [psnr[name] for name in family]
        best = int(np.argmax([-math.inf if value is None else value for value in values]))
        rules |= [list(family.items())[best]]
    return pictures, Mixtures(images, pictures, rules)

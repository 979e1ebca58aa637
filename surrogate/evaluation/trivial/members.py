"""Mixtures of training members at unseen parameters, with constants chosen on validation images."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from catalogs.store.catalog import Catalog
from catalogs.vocabulary.parameters import ParameterSpace
from surrogate.evaluation.cases import VALIDATION, Case, drawn
from surrogate.evaluation.scoring import mean, score_cases
from surrogate.evaluation.trivial.interpolation import fixed_rules, tuned_rules
from surrogate.evaluation.trivial.mixtures import MemberPictures, Mixtures

TUNING_IMAGES = 60  # validation images for the choice of a rule's constants


def member_mixtures(
    catalog: Catalog, space: ParameterSpace, appearance: str, watched: Sequence[Case]
) -> tuple[MemberPictures, Mixtures]:
    """Images of training members and all rules on them, with the constants that suit `watched` validation images best."""
    members = [m for m in catalog.members if m.split == "train" and appearance in m.appearances]
    pictures, rules = MemberPictures(space, appearance, members), fixed_rules(len(space))
    tuning = drawn([case for case in watched if case.member.split == VALIDATION], TUNING_IMAGES)
    for family in tuned_rules() if tuning else ():
        scores = score_cases(Mixtures(catalog, pictures, family), catalog, tuning)
        psnr = [mean(by_case.values(), "psnr") for by_case in scores]
        best = int(np.argmax([-math.inf if value is None else value for value in psnr]))
        rules |= [list(family.items())[best]]
    return pictures, Mixtures(catalog, pictures, rules)

"""Agreement and truth of predictions of members that were not learnt from: what doubt is calibrated with.

The emulator is judged by its own members, each predicted by one that learnt without it, and the Gaussians by validation members.
Test members and test views are never looked at.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from catalogs.files.images import ImageError
from catalogs.store.catalog import Catalog
from catalogs.store.members import Member
from catalogs.vocabulary.appearance import TransferFunction, field_of
from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.variations import Variation
from surrogate.answers.calibration import Unseen
from surrogate.answers.committee import Committee, left_out
from surrogate.answers.embeddings import Embeddings, pair_at
from surrogate.answers.opinions import Opinions
from surrogate.evaluation.metrics import WHITE, composite, psnr
from surrogate.evaluation.scoring import Report, spread
from surrogate.model import Surrogate
from surrogate.model.emulated_member import EmulatedMember
from surrogate.model.field_model import FieldModel
from surrogate.model.representation import FIELD, VIEW

VIEWS = 4  # of a member


@dataclass(frozen=True)
class Shown:
    """A member in one appearance, which shows a kind of question, with the visualization parameters that ask for it."""

    member: Member
    kind: str
    appearance: str
    varied: Mapping[str, float | str]

    @property
    def parameters(self) -> dict[str, float | str]:
        """All that `Surrogate.at` takes for it."""
        return {**self.member.parameters, **self.varied}

    @property
    def views(self) -> list[int]:
        """Some of the member's that are not for testing."""
        numbers = untested_views(self.member)
        return [numbers[i] for i in spread(len(numbers), VIEWS)]


@dataclass(frozen=True)
class UnseenPicture:
    """Agreement of predictions of a member's picture with each other and with the truth, dB.

    Attributes
    ----------
    using : the representation whose picture is meant.
    point : (P,) normalized parameters.
    """

    member: str
    kind: str
    using: str
    agreement: float
    truth: float
    point: tuple[float, ...]


def untested_views(member: Member) -> list[int]:
    """The numbers of a member's views that are not for testing."""
    return [view for view, split in enumerate(member.view_splits) if split != "test"]


def cases_of(base: str, variations: Sequence[Variation], members: Sequence[Member]) -> Iterator[Shown]:
    """Each member in the `base` appearance, and in one that was trained of each kind of variation."""
    for member in members:
        if base in member.appearances:
            yield Shown(member, VIEW, base, {})
        for variation in variations:
            settings = [
                s
                for s in variation.settings
                if s.split != "test" and s.appearance in member.appearances and s.appearance != base
            ]
            if settings:
                setting = settings[zlib.crc32(member.name.encode()) % len(settings)]
                yield Shown(member, variation.kind, setting.appearance, variation.arguments(setting))


def of_emulator(model: FieldModel, catalog: Catalog, progress: Report) -> Iterator[UnseenPicture]:
    """Of pictures of the emulated field, by emulators that left their members out."""
    background = catalog.plan.background
    learnt = [member for member in catalog.members if member.split in model.splits]
    names = {field_of(appearance) for appearance in model.appearances}
    for name, emulator in model.emulators.items():
        if name not in names:
            continue
        coarse = [(member, own[name]) for member in learnt if name in (own := member.coarse_fields())]
        having = [member for member, _ in coarse]
        if len(having) != len(emulator.processes.points):
            raise ValueError(f"{catalog.path} has other members than the emulator of its run learnt from")
        points = model.space.normalize(np.array([[m.parameters[p] for p in model.space.names] for m in having]))
        fields = np.stack([one.values for _, one in coarse])
        done = 0
        for other, numbers in left_out(emulator, points, fields):
            committee = Committee.of(other)
            for case in cases_of(model.appearances[0].name, model.variations, [having[i] for i in numbers]):
                point = model.point(case.parameters, "allow")
                if field_of(point.appearance) != name:
                    continue
                prediction = EmulatedMember(
                    other, point.simulation, point.appearance, {}, model.normalization, point.sample_distance
                )
                opinions = committee.at(point)
                for truth, camera in _true_pictures(catalog, case):
                    picture = composite(prediction.render(camera), background or WHITE)
                    agreement, right = opinions.agreement(camera, background), psnr(truth, picture)
                    yield UnseenPicture(case.member.name, case.kind, FIELD, agreement, right, tuple(point.simulation))
            done += len(numbers)
            progress("how sure the emulator is", done, len(having))


def of_gaussians(surrogate: Surrogate, embeddings: Embeddings | None, catalog: Catalog) -> Iterator[UnseenPicture]:
    """Of pictures by Gaussians, alone and as the mean image, of validation members; `surrogate` has not learnt from these."""
    background, space = catalog.plan.background, surrogate.space
    unseen = [m for m in catalog.members if m.split == "validation"]
    for case in cases_of(surrogate.base_appearance, surrogate.variations, unseen):
        opinions = opinions_of_gaussians(surrogate, embeddings, case.parameters)
        if not opinions:
            return
        members = [surrogate.using(one).at(case.parameters, outside="allow") for one in surrogate.representations]
        point = tuple(space.normalize(space.values(case.member.parameters, outside="allow")))
        for truth, camera in _true_pictures(catalog, case):
            agreement = agreement_of(opinions, camera, background)
            for using, member in zip(surrogate.representations, members, strict=True):
                if using != FIELD:
                    own = psnr(truth, composite(member.render(camera), background or WHITE))
                    yield UnseenPicture(case.member.name, case.kind, using, agreement, own, point)


def opinions_of_gaussians(
    surrogate: Surrogate,
    embeddings: Embeddings | None,
    parameters: Mapping[str, Any],
    function: TransferFunction | None = None,
) -> list[Opinions]:
    """Of a picture that Gaussians draw: other embeddings, and the emulated field where there is one."""
    opinions = [] if embeddings is None else [embeddings.at(parameters, function)]
    return opinions if surrogate.field is None else [*opinions, pair_at(surrogate, parameters, function)]


def agreement_of(opinions: Sequence[Opinions], camera: Camera, background: Sequence[float] | None) -> float:
    """The agreement of several kinds of opinions, mean in dB."""
    return float(np.mean([one.agreement(camera, background) for one in opinions]))


def by_member(pictures: Sequence[UnseenPicture]) -> Unseen:
    """Those of the members that have as many pictures as most."""
    groups: dict[str, list[UnseenPicture]] = {}
    for picture in pictures:
        groups.setdefault(picture.member, []).append(picture)
    most = max(map(len, groups.values()))
    whole = [group for group in groups.values() if len(group) == most]
    rows = np.array([[(one.agreement, one.truth) for one in group] for group in whole])  # [M, V, 2]
    return Unseen(np.array([group[0].point for group in whole], dtype=np.float64), rows[..., 0], rows[..., 1])


def _true_pictures(catalog: Catalog, case: Shown) -> Iterator[tuple[NDArray[np.float32], Camera]]:
    """The stored pictures, as displayed, with their cameras; those that can't be read are left out."""
    for view in case.views:
        with suppress(ImageError):
            image = catalog.image(case.member, case.appearance, view)
            yield composite(image, catalog.plan.background or WHITE), case.member.cameras[view]

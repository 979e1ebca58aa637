import numpy as np
import pytest

from surrogate.data import foreground_color, load_examples, training_rows, validation_rows
from surrogate.gaussians import Normalization

MEMBERS = (("train", 0.0), ("validation", 0.3), ("test", 0.6), ("train", 1.0))
VIEWS = ("train", "test", "validation", "train")


def test_only_training_members_at_training_views_are_learnt(make_catalog) -> None:
    catalog = make_catalog(members=MEMBERS, view_splits=VIEWS)
    assert [(row.member.name, row.view) for row in training_rows(catalog, ["drawn"])] == [
        ("member-0", 0),
        ("member-0", 3),
        ("member-3", 0),
        ("member-3", 3),
    ]


def test_choices_look_at_validation_views_of_validation_members_and_never_at_test(make_catalog) -> None:
    catalog = make_catalog(members=MEMBERS, view_splits=VIEWS)
    assert [(row.member.name, row.view) for row in validation_rows(catalog, ["drawn"], 10)] == [("member-1", 2)]
    assert validation_rows(catalog, ["drawn"], 0) == []


def test_without_validation_views_choices_look_at_all_views_of_validation_members(make_catalog) -> None:
    catalog = make_catalog(members=MEMBERS, view_splits=("train", "test", "train", "train"))
    views = [(row.member.name, row.view) for row in validation_rows(catalog, ["drawn"], 10)]
    assert views == [("member-1", 0), ("member-1", 2), ("member-1", 3)]
    assert len(validation_rows(catalog, ["drawn"], 2)) == 2


def test_without_validation_members_choices_look_at_validation_views(make_catalog) -> None:
    catalog = make_catalog(members=(("train", 0.0), ("test", 0.5)), view_splits=VIEWS)
    assert [(row.member.name, row.view) for row in validation_rows(catalog, ["drawn"], 10)] == [("member-0", 2)]


def test_a_catalog_without_training_images_is_refused(make_catalog) -> None:
    catalog = make_catalog(members=(("test", 0.0),), view_splits=VIEWS)
    with pytest.raises(ValueError, match="holds no training images"):
        training_rows(catalog, ["drawn"])


@pytest.mark.parametrize("background", [None, (1.0, 1.0, 1.0)])
def test_examples_hold_the_catalogs_images_and_cameras(make_catalog, background) -> None:
    catalog = make_catalog(members=MEMBERS, view_splits=VIEWS, background=background)
    normalization = Normalization.of_box(catalog.plan.bounds)
    rows = training_rows(catalog, ["drawn"])
    for row, example in zip(rows, load_examples(catalog, rows, normalization), strict=True):
        stored = catalog.image(row.member, "drawn", row.view, dtype="uint8")
        np.testing.assert_array_equal(example.pixels, stored if background is None else stored[..., :3])
        shown, alpha = example.pixels[..., :3].astype(int), example.pixels[..., 3:].astype(int)
        over_white = shown if background else np.concatenate([shown + 255 - alpha, alpha], axis=2)
        np.testing.assert_array_equal(example.compared(), over_white)
        assert example.parameters.tolist() == pytest.approx([2.0 * row.member.parameters["p"] - 1.0])
        camera, world = row.member.cameras[row.view], np.array([[0.3, -0.2, 0.5]])
        pixels, _ = example.camera.project(normalization.points(world))
        np.testing.assert_allclose(pixels, camera.project(world)[0], atol=1e-9)


def test_the_foreground_has_the_volumes_colour(make_catalog) -> None:
    colors = []
    for background in (None, (1.0, 1.0, 1.0)):
        catalog = make_catalog(view_splits=VIEWS, background=background, name=f"{background}.cdb")
        examples = load_examples(catalog, training_rows(catalog, ["drawn"]), Normalization.of_box(catalog.plan.bounds))
        colors.append(foreground_color(examples, background))
    assert ((colors[0] > 0) & (colors[0] < 1)).all()
    assert (colors[1] >= colors[0] - 0.02).all()  # translucent edges show the white behind them


def test_the_foreground_of_empty_images_is_grey(make_catalog) -> None:
    catalog = make_catalog(view_splits=VIEWS, blank=True)
    examples = load_examples(catalog, training_rows(catalog, ["drawn"]), Normalization.of_box(catalog.plan.bounds))
    assert foreground_color(examples, None).tolist() == [0.5, 0.5, 0.5]

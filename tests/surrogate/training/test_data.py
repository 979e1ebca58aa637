from dataclasses import replace

import numpy as np
import pytest
import torch

from catalogs.files.images import ImageError
from catalogs.store.catalog import Catalog
from catalogs.vocabulary.variations import Variation
from surrogate.gaussians import Normalization
from surrogate.training.data import foreground_color, load_examples, rows, training_rows, validation_rows
from tests.support.field_blobs import FUNCTIONS, ISOVALUE, STEPS, field_catalog

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


def test_a_damaged_image_is_named_and_never_learnt_from(make_catalog) -> None:
    catalog = make_catalog(members=MEMBERS, view_splits=VIEWS)
    learnt, normalization = training_rows(catalog, ["drawn"]), Normalization.of_box(catalog.plan.bounds)
    before = [example.pixels for example in load_examples(catalog, learnt, normalization)]
    path = catalog.image_path(learnt[1].member, "drawn", learnt[1].view)
    whole, refused = path.read_bytes(), 0
    for place in range(0, len(whole), max(1, len(whole) // 60)):
        path.write_bytes(whole[:place] + bytes([whole[place] ^ 0x40]) + whole[place + 1 :])
        try:
            found = [example.pixels for example in load_examples(catalog, learnt, normalization)]
        except ImageError as error:
            refused += str(path) in str(error)
            continue
        for one, other in zip(before, found, strict=True):
            np.testing.assert_array_equal(one, other)
    assert refused > 20
    path.unlink()
    with pytest.raises(ImageError, match=rf"{path.name} is missing"):
        load_examples(catalog, learnt, normalization)


@pytest.mark.parametrize("background", [None, (1.0, 1.0, 1.0)])
def test_examples_hold_the_catalogs_images_and_cameras(make_catalog, background) -> None:
    catalog = make_catalog(members=MEMBERS, view_splits=VIEWS, background=background)
    normalization = Normalization.of_box(catalog.plan.bounds)
    learnt = training_rows(catalog, ["drawn"])
    for row, example in zip(learnt, load_examples(catalog, learnt, normalization), strict=True):
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


SPLITS_OF_MEMBERS = (("train", 0.0), ("validation", 0.25), ("test", 0.5))


@pytest.fixture(scope="module")
def varied(tmp_path_factory: pytest.TempPathFactory) -> Catalog:
    path = tmp_path_factory.mktemp("varied") / "field.cdb"
    return field_catalog(path, members=SPLITS_OF_MEMBERS, view_splits=("train", "validation", "test"))


def shown(variation: Variation) -> list[str]:
    return [setting.appearance for setting in variation.settings]


@pytest.mark.parametrize("variation", [ISOVALUE, FUNCTIONS], ids=["isovalue", "functions"])
def test_rows_of_several_appearances_are_all_of_them_once(varied: Catalog, variation: Variation) -> None:
    found = [(row.member.name, row.appearance, row.view) for row in rows(varied, shown(variation))]
    assert len(set(found)) == len(found) == 3 * len(variation.settings) * 3
    for row in rows(varied, shown(variation)):
        assert row.setting == variation.setting(row.appearance)
        order = ["train", "validation", "test"]
        parts = (row.member.split, row.member.view_splits[row.view], row.setting.split)
        assert row.split == order[max(map(order.index, parts))]
    assert all(row.setting is None for row in rows(varied, ["dvr"]))


@pytest.mark.parametrize("variation", [ISOVALUE, FUNCTIONS], ids=["isovalue", "functions"])
def test_settings_kept_for_choices_or_tests_are_never_learnt(varied: Catalog, variation: Variation) -> None:
    learnt = training_rows(varied, shown(variation))
    assert {row.appearance for row in learnt} == set(variation.named("train"))
    assert {(row.member.name, row.view) for row in learnt} == {("member-0", 0)}
    watched = validation_rows(varied, shown(variation), 10)
    assert [(row.member.name, row.view, row.appearance) for row in watched] == [
        ("member-1", 1, name) for name in variation.named("validation")
    ]


def test_without_validation_settings_choices_look_at_trained_ones_elsewhere(tmp_path) -> None:
    trained = replace(ISOVALUE, settings=tuple(s for s in ISOVALUE.settings if s.split != "validation"))
    catalog = field_catalog(
        tmp_path / "a.cdb", [trained], members=SPLITS_OF_MEMBERS, view_splits=("train", "validation")
    )
    watched = validation_rows(catalog, shown(trained), 20)
    assert {(row.member.name, row.view) for row in watched} == {("member-1", 1)}
    assert [row.appearance for row in watched] == list(trained.named("train"))


@pytest.mark.parametrize("variation", [ISOVALUE, FUNCTIONS], ids=["isovalue", "functions"])
def test_parameters_of_the_visualization_follow_those_of_the_simulation(varied: Catalog, variation: Variation) -> None:
    wanted, normalization = rows(varied, shown(variation)), Normalization.of_box(varied.plan.bounds)
    for row, example in zip(wanted, load_examples(varied, wanted, normalization, variation), strict=True):
        assert row.setting is not None
        if variation is ISOVALUE:  # four trained isovalues at equal distances
            expected = [np.interp(row.setting.values[0], [0.1, 0.3, 0.55, 0.8], [-1, -1 / 3, 1 / 3, 1])]
        else:
            expected = np.array(row.setting.values) / STEPS
        assert example.parameters.dtype == torch.float32
        np.testing.assert_allclose(
            example.parameters.numpy(), [2 * row.member.parameters["p"] - 1, *expected], atol=1e-6
        )


def test_the_base_is_nan_among_isovalues_and_zero_among_functions(varied: Catalog) -> None:
    wanted, normalization = training_rows(varied, ["dvr"]), Normalization.of_box(varied.plan.bounds)
    of_isovalue = load_examples(varied, wanted, normalization, ISOVALUE)[0].parameters
    of_functions = load_examples(varied, wanted, normalization, FUNCTIONS)[0].parameters
    assert of_isovalue[0] == -1.0
    assert torch.isnan(of_isovalue[1:]).all()
    assert of_functions.tolist() == [-1.0, 0.0, 0.0, 0.0, 0.0]


def test_members_that_do_not_show_an_appearance_have_no_rows_of_it(tmp_path) -> None:
    catalog = field_catalog(
        tmp_path / "a.cdb", [ISOVALUE], members=SPLITS_OF_MEMBERS, view_splits=("train",), shown_by=("train",)
    )
    assert {row.member.name for row in rows(catalog, shown(ISOVALUE))} == {"member-0"}
    assert {row.member.name for row in rows(catalog, ["dvr"])} == {"member-0", "member-1", "member-2"}

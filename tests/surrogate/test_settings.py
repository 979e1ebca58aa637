import pytest
from hypothesis import given
from hypothesis import strategies as st

from catalogs.vocabulary.appearance import Isosurface
from surrogate.settings import FORMER, TrainingSettings, values_of_words


def test_an_empty_table_means_the_defaults() -> None:
    assert TrainingSettings() == TrainingSettings()


def test_settings_survive_json() -> None:
    settings = TrainingSettings(gaussians=77, initialization="random", latent_rate=0.25, batch=2)
    assert TrainingSettings.from_table(settings.to_json()) == settings


def test_a_change_keeps_all_else() -> None:
    settings = TrainingSettings(gaussians=77, carried="colors").changed(seed=3)
    assert settings == TrainingSettings(gaussians=77, carried="colors", seed=3)
    with pytest.raises(ValueError, match=r"training\.seed must be at least 0, got -1"):
        settings.changed(seed=-1)


def test_the_repr_lists_values_that_are_not_the_default() -> None:
    assert repr(TrainingSettings()) == "TrainingSettings()"
    settings = TrainingSettings(gaussians=77)
    assert repr(settings) == "TrainingSettings(gaussians=77)"
    assert eval(repr(settings)) == settings


def test_records_of_former_versions_make_the_same_settings() -> None:
    """Runs are recognized by a fingerprint over the present and the former keys: 55 of them, but for those that came later."""
    values = TrainingSettings().to_json()
    assert not set(values) & set(FORMER)
    assert len(values) + len(FORMER) == 55
    assert TrainingSettings.from_record({**FORMER, **values, "gaussians": 77}) == TrainingSettings(gaussians=77)
    assert set(TrainingSettings(samples=2, carried="colors").to_json()) - set(values) == {"samples", "carried"}


@pytest.mark.parametrize("key", ["deformation", "mean_rate", "held_still"])
def test_a_former_key_in_a_table_is_named_and_in_a_record_left_out(key: str) -> None:
    with pytest.raises(ValueError, match=rf"leave out {key}, which this version does not have any more"):
        TrainingSettings.from_table({key: 3})
    assert TrainingSettings.from_record({**FORMER, key: 3, "seed": 5}) == TrainingSettings(seed=5)


def test_a_whole_number_will_do_for_a_float() -> None:
    assert TrainingSettings(need_tolerance=1).need_tolerance == 1.0


@pytest.mark.parametrize(
    ("table", "complaint"),
    [
        ({"gausians": 10}, r"unknown keys gausians \(did you mean gaussians\?\); known are"),
        ({"xyz": 10}, r"unknown keys xyz; known are"),
        ({"gaussians": 10.5}, "training.gaussians must be of type int, got 10.5"),
        ({"gaussians": "many"}, "training.gaussians must be of type int"),
        ({"gaussians": True}, "training.gaussians must be of type int, got True"),
        ({"gaussians": 0}, "training.gaussians must be at least 1, got 0"),
        ({"seed": -1}, "training.seed must be at least 0"),
        ({"parameter_frequencies": 9}, "training.parameter_frequencies must be from 0 to 8, got 9"),
        ({"samples": 0}, "training.samples must be from 1 to 4, got 0"),
        ({"surface_samples": 5}, "training.surface_samples must be from 1 to 4, got 5"),
        ({"latent_rate": float("nan")}, "training.latent_rate must be finite"),
        ({"latent_rate": 0.0}, "training.latent_rate must be positive"),
        ({"color_degree": 2}, r"training.color_degree must be one of auto, 0, 1, got 2"),
        (
            {"initialization": 3},
            r"training.initialization must be one of auto, in-situ, sfm, random, got 3",
        ),
        ({"canonical_steps": -1}, "training.canonical_steps must be at least 0"),
        ({"checkpoint_seconds": 0}, "training.checkpoint_seconds must be positive"),
    ],
)
def test_bad_tables_are_named(table: dict[str, object], complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        TrainingSettings.from_table(table)


def test_options_are_also_checked_without_a_table() -> None:
    with pytest.raises(ValueError, match=r"initialization must be one of .*, got 'hull'"):
        TrainingSettings(initialization="hull")  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "table", [{"relocation_interval": 0}, {"canonical_steps": 0}, {"visualization_steps": 0}, {"validation_images": 0}]
)
def test_zero_is_a_choice_where_it_turns_something_off(table: dict[str, object]) -> None:
    assert TrainingSettings.from_table(table).to_json().items() >= table.items()


def test_surfaces_have_as_many_gaussians_as_the_base_unless_they_have_their_own() -> None:
    assert TrainingSettings(gaussians=7).count_on_surfaces == 7
    assert TrainingSettings(gaussians=7, visualization_gaussians=9).count_on_surfaces == 9


def test_values_are_not_carried_to_isosurfaces() -> None:
    with pytest.raises(ValueError, match='carried = "values" needs an unshaded volume rendering, but iso is'):
        TrainingSettings(carried="values").carry_values(Isosurface("iso", 1.0, color=(1.0, 0.5, 0.2)))


@given(st.dictionaries(st.text(max_size=8), st.one_of(st.none(), st.lists(st.integers(), max_size=2)), min_size=1))
def test_nonsense_never_passes(table: dict[str, object]) -> None:
    with pytest.raises(ValueError, match="training"):
        TrainingSettings.from_table(table)


@pytest.mark.parametrize(
    ("words", "values"),
    [
        ((), {}),
        (("gaussians=20000", "latent_rate=1e-3"), {"gaussians": 20_000, "latent_rate": 1e-3}),
        (("initialization=random", "color_degree=1"), {"initialization": "random", "color_degree": 1}),
        (("color_degree=auto", "fit_to_need=false"), {"color_degree": "auto", "fit_to_need": False}),
        (("carried=colors", "appearance=7"), {"carried": "colors", "appearance": "7"}),
    ],
)
def test_words_say_values(words: tuple[str, ...], values: dict[str, object]) -> None:
    assert values_of_words(words) == values


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (("gaussians",), "settings are KEY=VALUE, such as gaussians=20000, got 'gaussians'"),
        (("=3",), "settings are KEY=VALUE"),
        (("gausians=3",), "did you mean gaussians"),
        (("gaussians=many",), "training.gaussians must be of type int, got 'many'"),
        (("gaussians=1.5",), "training.gaussians must be of type int, got 1.5"),
        (("gaussians=",), "training.gaussians must be of type int, got ''"),
        (("gaussians=-1",), "at least 1, got -1"),
        (("latent_rate=nan",), "training.latent_rate must be finite"),
        (("gaussians=1", "gaussians=2"), "training.gaussians is given twice"),
        (("carried=size",), "training.carried must be one of"),
    ],
)
def test_words_that_say_none_are_named(words: tuple[str, ...], complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        values_of_words(words)

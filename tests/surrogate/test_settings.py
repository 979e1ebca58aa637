import pytest
from hypothesis import given
from hypothesis import strategies as st

from surrogate.settings import DeformationSize, TrainingSettings, values_of_words


def test_an_empty_table_means_the_defaults() -> None:
    assert TrainingSettings() == TrainingSettings()


def test_settings_survive_json() -> None:
    settings = TrainingSettings(gaussians=77, initialization="random", mean_rate=0.25)
    assert TrainingSettings(**settings.to_json()) == settings


def test_keys_are_flat_and_read_in_records() -> None:
    settings = TrainingSettings(mean_rate=0.25, need_tolerance=0.5, latent_size=3, visualization_latent_size=4)
    assert (settings.rates.means, settings.need_tolerance) == (0.25, 0.5)
    assert (settings.latent_size, settings.visualization_size.latent) == (3, 4)
    assert TrainingSettings().rates.means != 0.25


def test_a_change_keeps_all_else() -> None:
    settings = TrainingSettings(gaussians=77, held_still=("means",)).changed(seed=3)
    assert settings == TrainingSettings(gaussians=77, held_still=("means",), seed=3)
    with pytest.raises(ValueError, match=r"training\.seed must be at least 0, got -1"):
        settings.changed(seed=-1)


@pytest.mark.parametrize(
    ("factor", "cooldown", "done", "expected"),
    [
        (0.2, 0.3, 0.0, 1.0),
        (0.2, 0.3, 0.5, 0.2**0.5),
        (0.2, 0.3, 0.7, 0.2**0.7),  # where the last 30 % begin
        (0.2, 0.3, 0.85, 0.5 * 0.2**0.85),
        (0.2, 0.3, 1.0, 0.0),
        (0.05, 0.0, 1.0, 0.05),
        (1.0, 0.0, 0.6, 1.0),
        (1.0, 1.0, 0.25, 0.75),
    ],
)
def test_rates_fall_exponentially_and_to_zero_at_the_end(
    factor: float, cooldown: float, done: float, expected: float
) -> None:
    rates = TrainingSettings(final_rate_factor=factor, cooldown=cooldown).rates
    assert rates.decay(done) == pytest.approx(expected, abs=1e-12)


def test_settings_are_told_on_one_line_by_what_is_not_the_default() -> None:
    assert repr(TrainingSettings()) == "TrainingSettings()"
    settings = TrainingSettings(gaussians=77, visualization_hidden_width=5)
    assert repr(settings) == "TrainingSettings(gaussians=77, visualization_hidden_width=5)"
    assert eval(repr(settings)) == settings


def test_the_json_has_every_key_but_those_that_came_later() -> None:
    """Runs of earlier versions are recognized by a fingerprint over it."""
    values = TrainingSettings().to_json()
    assert len(values) == 55
    assert not {"held_still", "field_precision"} & set(values)
    assert set(TrainingSettings(held_still=("means",), field_precision="bfloat16").to_json()) - set(values) == {
        "held_still",
        "field_precision",
    }


def test_a_whole_number_will_do_for_a_float() -> None:
    assert TrainingSettings(dilation=1).splatting.dilation == 1.0


@pytest.mark.parametrize(
    ("table", "complaint"),
    [
        ({"gausians": 10}, r"unknown keys \['gausians'\] \(did you mean gaussians\?\); known are"),
        ({"xyz": 10}, r"unknown keys \['xyz'\]; known are"),
        ({"gaussians": 10.5}, "training.gaussians must be of type int, got 10.5"),
        ({"gaussians": "many"}, "training.gaussians must be of type int"),
        ({"gaussians": True}, "training.gaussians must be of type int, got True"),
        ({"gaussians": 0}, "training.gaussians must be at least 1, got 0"),
        ({"seed": -1}, "training.seed must be at least 0"),
        ({"parameter_frequencies": 9}, "training.parameter_frequencies must be from 0 to 8, got 9"),
        ({"samples": 0}, "training.samples must be from 1 to 4, got 0"),
        ({"surface_samples": 5}, "training.surface_samples must be from 1 to 4, got 5"),
        ({"mean_rate": float("nan")}, "training.mean_rate must be finite"),
        ({"mean_rate": 0.0}, "training.mean_rate must be positive"),
        ({"ssim_weight": 1.5}, r"training.ssim_weight must be in \[0, 1\], got 1.5"),
        ({"dead_opacity": 1.0}, "training.dead_opacity must be between 0 and 1"),
        ({"color_degree": 2}, r"training.color_degree must be one of \['auto', 0, 1\], got 2"),
        (
            {"initialization": 3},
            r"training.initialization must be one of \['auto', 'in-situ', 'hull', 'sfm', 'random'\], got 3",
        ),
        (
            {"relocation_target": "gradent"},
            r"relocation_target must be one of \['opacity', 'gradient'\], got 'gradent'",
        ),
        ({"deformation": "values"}, r"training.deformation must be one of \['bilinear', 'paper'\], got 'values'"),
        ({"visualization_deformation": "warp"}, "training.visualization_deformation must be one of"),
        ({"hard_example_power": -0.5}, "training.hard_example_power must be at least 0, got -0.5"),
        ({"deformation_penalty": float("inf")}, "training.deformation_penalty must be finite"),
        ({"simulation_rate_factor": -0.1}, "training.simulation_rate_factor must be at least 0"),
        ({"gradient_threshold": -1}, "training.gradient_threshold must be at least 0"),
        ({"canonical_steps": -1}, "training.canonical_steps must be at least 0"),
        ({"value_bins": 1}, "training.value_bins must be at least 2, got 1"),
        ({"value_rate": 0.0}, "training.value_rate must be positive"),
        ({"visualization_latent_size": 0}, "training.visualization_latent_size must be at least 1"),
        ({"alpha_cap": 1.0}, "training.alpha_cap must be above alpha_floor and below 1, got 1.0"),
        ({"alpha_floor": 0.5, "alpha_cap": 0.4}, "training.alpha_cap must be above alpha_floor and below 1, got 0.4"),
        ({"held_still": ["means", "size"]}, "training.held_still must be some of"),
        ({"checkpoint_seconds": 0}, "training.checkpoint_seconds must be positive"),
    ],
)
def test_bad_tables_are_named(table: dict[str, object], complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        TrainingSettings(**table)


def test_options_are_also_checked_without_a_table() -> None:
    with pytest.raises(ValueError, match=r"relocation_target must be one of \['opacity', 'gradient'\], got 'gradent'"):
        TrainingSettings(relocation_target="gradent")  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "table", [{"simulation_rate_factor": 0.0}, {"canonical_steps": 0}, {"visualization_steps": 0}, {"value_bins": 2}]
)
def test_zero_is_a_choice_where_it_turns_something_off(table: dict[str, object]) -> None:
    assert TrainingSettings(**table).to_json().items() >= table.items()


def test_f_vis_has_sizes_of_its_own() -> None:
    settings = TrainingSettings(visualization_latent_size=3, visualization_hidden_width=5, seed=4)
    assert settings.visualization_size == DeformationSize(3, 5)
    assert settings.simulation_size == TrainingSettings().simulation_size


@given(st.dictionaries(st.text(max_size=8), st.one_of(st.none(), st.lists(st.integers(), max_size=2)), min_size=1))
def test_nonsense_never_passes(table: dict[str, object]) -> None:
    with pytest.raises(ValueError, match="training"):
        TrainingSettings(**table)


@pytest.mark.parametrize(
    ("words", "values"),
    [
        ((), {}),
        (("gaussians=20000", "mean_rate=1e-3"), {"gaussians": 20_000, "mean_rate": 1e-3}),
        (("initialization=random", "color_degree=1"), {"initialization": "random", "color_degree": 1}),
        (("color_degree=auto", "fit_to_need=false"), {"color_degree": "auto", "fit_to_need": False}),
        (("held_still=quats,colors", "appearance=7"), {"held_still": ("quats", "colors"), "appearance": "7"}),
        (("held_still=",), {"held_still": ()}),
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
        (("mean_rate=nan",), "training.mean_rate must be finite"),
        (("gaussians=1", "gaussians=2"), "training.gaussians is given twice"),
        (("held_still=size",), "training.held_still must be some of"),
    ],
)
def test_words_that_say_none_are_named(words: tuple[str, ...], complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        values_of_words(words)

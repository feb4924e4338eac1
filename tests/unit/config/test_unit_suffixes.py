import pytest

from motord.config.unit_suffixes import UNITS, split_unit, unit_of


@pytest.mark.parametrize(
    ("name", "base", "unit"),
    [
        ("turns", "turns", ""), ("move_s", "move", "s"), ("alpha_a", "alpha_a", ""),
        ("beta_a_A", "beta_a", "A"), ("bar_kg_m2", "bar", "kg m2"), ("levers_m", "levers", "m"),
        ("stiffness_N_per_m", "stiffness", "N/m"), ("temperature_C", "temperature", "degC"),
        ("speed_rad_s", "speed", "rad/s"), ("a_rad_s2", "a", "rad/s2"), ("rests", "rests", ""),
        ("k_V_s_per_rad", "k", "V s/rad"), ("b_Nm_s_per_rad", "b", "Nm s/rad"),
        ("resistance_per_K", "resistance", "1/K"), ("resistance_ohm", "resistance", "ohm"),
        ("rise_K_per_A2", "rise", "K/A2"), ("loss_W_per_K", "loss", "W/K"),
        ("back_emf_percent_per_K", "back_emf", "%/K"), ("adc_V_per_count", "adc", "V/count"),
        ("torque_rate_Nm_per_s", "torque_rate", "Nm/s"),
        ("ripple_percent", "ripple", "%"), ("Nm", "Nm", ""), ("stderr_Nm", "stderr", "Nm"),
    ],
)  # fmt: skip
def test_the_unit_is_the_end_of_the_name(name, base, unit):
    assert (split_unit(name)[0], unit_of(name)) == (base, unit)


@pytest.mark.parametrize("suffix", UNITS)
def test_every_suffix_is_found_whole(suffix):
    assert split_unit(f"x_{suffix}") == ("x", suffix)

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from surrogate.training.compression.search import least


@given(low=st.integers(-50, 50), size=st.integers(0, 200), place=st.integers(0, 200))
def test_the_least_that_will_do_is_found_in_few_questions(low: int, size: int, place: int) -> None:
    high, asked = low + size, []
    wanted = min(low + place, high)

    def will_do(value: int) -> bool:
        asked.append(value)
        return value >= wanted

    assert least(low, high, will_do) == wanted
    assert len(asked) <= size.bit_length()
    assert high not in asked

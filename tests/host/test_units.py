"""Lengths and units as a person writes them."""

from __future__ import annotations

import math

import pytest
from crease.base.errors import UnitError
from crease.base.units import METRES, format_length, format_place, parse_length, parse_unit
from hypothesis import given
from hypothesis import strategies as st


@pytest.mark.parametrize(
    ("text", "length_m"),
    [
        ("2mm", 2e-3),
        ("0.1 mm", 1e-4),
        ("1in", 0.0254),
        ("0.5", 0.5),
        (" 3 CM ", 0.03),
        ("1e-3m", 1e-3),
        (".5mm", 5e-4),
        ("10µm", 1e-5),
    ],
)
def test_length_with_unit_is_metres(text: str, length_m: float) -> None:
    assert parse_length(text) == pytest.approx(length_m)


@pytest.mark.parametrize(
    "text", ["", "mm", "2 parsec", "two mm", "-1mm", "0", "nan", "inf", "1e999", "1,5mm", "2mm2"]
)
def test_what_is_no_length_is_refused_with_its_text(text: str) -> None:
    with pytest.raises(UnitError) as caught:
        parse_length(text)
    assert "\n" not in str(caught.value)


@given(st.floats(1e-6, 1e3), st.sampled_from(sorted(METRES)))
def test_any_positive_number_with_any_unit_parses(number: float, unit: str) -> None:
    assert math.isclose(parse_length(f"{number!r}{unit}"), number * METRES[unit], rel_tol=1e-12)


@given(st.floats(1e-12, 50.0))
def test_formatted_length_reads_back_within_its_three_digits(length_m: float) -> None:
    assert parse_length(format_length(length_m)) == pytest.approx(length_m, rel=6e-3)


@pytest.mark.parametrize(
    ("length_m", "text"), [(1e-12, "0.001 nm"), (-2.5e-10, "-0.25 nm"), (1e-9, "0.001 um")]
)
def test_less_than_a_nanometre_is_told_without_a_power_of_ten(length_m: float, text: str) -> None:
    assert format_length(length_m) == text


def test_kilometres_are_told_in_full() -> None:
    assert format_length(2000.0) == "2000 m"
    assert parse_length(format_length(123456.0)) == 123456.0


def test_unknown_unit_names_the_known_ones() -> None:
    with pytest.raises(UnitError, match="mm, cm"):
        parse_unit("furlong")


@pytest.mark.parametrize(
    ("place", "size", "text"),
    [
        ((0.0, 1e-17, 20.0), 90.0, "(0, 0, 20)"),
        ((-1e-9, 0.0123456, 0.04), 0.05, "(0, 0.01235, 0.04)"),
        ((50012.3456, -30000.0, 1e4), 54.0, "(50012.35, -30000, 10000)"),
        ((1234.5678, 0.0, 0.0), 3000.0, "(1235, 0, 0)"),
    ],
)
def test_a_place_is_as_fine_as_what_it_lies_on(
    place: tuple[float, float, float], size: float, text: str
) -> None:
    assert format_place(place, size) == text

"""Tokens, codes and names of machines that join."""

from __future__ import annotations

from uuid import UUID, uuid4

import pytest
from hypothesis import given
from hypothesis import strategies as st

from labweb.domain.enrollment.host_join import (
    CODE_SIGNS,
    Token,
    code_of,
    find_known,
    is_code,
    is_secret,
    key_of_name,
    parse_token,
    render_token,
    renew_due_s,
    secret_hash,
)
from labweb.domain.errors import DefinitionError

TOKEN = Token("ab" * 32, UUID(int=7), "cd" * 16)


def test_a_token_is_read_as_it_was_written() -> None:
    assert parse_token(f"  {render_token(TOKEN)}\n") == TOKEN


@pytest.mark.parametrize("cut", [0, 1, 60, 134])
def test_a_part_of_a_token_is_refused_without_repeating_it(cut: int) -> None:
    text = render_token(TOKEN)[:cut]
    with pytest.raises(DefinitionError) as refusal:
        parse_token(text)
    assert refusal.value.code == "join.bad_token"
    assert TOKEN.secret not in refusal.value.message


def test_a_secret_is_known_by_its_hash_alone() -> None:
    assert is_secret(TOKEN.secret, secret_hash(TOKEN.secret))
    assert not is_secret("0" * 32, secret_hash(TOKEN.secret))


@given(st.binary(min_size=32, max_size=32), st.binary(min_size=32, max_size=32))
def test_a_code_follows_from_both_keys(one: bytes, other: bytes) -> None:
    code = code_of("a" * 64, one)
    assert set(code) <= set(CODE_SIGNS) | {"-"}
    assert is_code(f" {code.lower().replace('-', ' ')} ", code)
    assert code != code_of("b" * 64, one)
    assert is_code(code_of("a" * 64, other), code) == (one == other)


def test_what_people_misread_counts_as_read() -> None:
    assert is_code("oilq", "011Q")
    assert not is_code("oilq", "0111")
    assert is_code("o-i-l", "011")
    assert not is_code("", "011")


def test_a_name_becomes_a_key() -> None:
    assert key_of_name("Bench 2, Räum B") == "bench_2_raum_b"
    assert key_of_name("−−") == ""


def test_a_certificate_is_renewed_after_two_thirds_of_its_life() -> None:
    assert renew_due_s(0.0, 90.0) == 60.0


def test_a_machine_is_known_by_its_id_before_its_name() -> None:
    one, two = uuid4(), uuid4()
    hosts = [(one, "bench_1", "m1"), (two, "bench_2", "")]
    assert find_known(hosts, key="bench_2", machine_id="m1") == one
    assert find_known(hosts, key="bench_2", machine_id="m9") == two
    assert find_known(hosts, key="bench_3", machine_id="") is None

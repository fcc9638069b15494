"""What may be in a vessel while a plan is made, and what a draw takes of it."""

from __future__ import annotations

from fractions import Fraction

from labweb.domain.recipes.on_rig.matter import LotShare, RigMatter

ACID, OTHER, SALT = ("acid", False), ("other", False), ("salt", True)


def share(least: int, most: int) -> LotShare:
    return LotShare(Fraction(least), Fraction(most))


def test_of_what_is_hardly_mixed_a_draw_takes_what_the_rest_cannot_make_up() -> None:
    matter = RigMatter()
    matter.add("flask", {ACID: share(15_000, 15_000), OTHER: share(0, 200)})
    taken = matter.draw("flask", 5_000)
    assert taken == {ACID: share(4_800, 5_000), OTHER: share(0, 200)}
    assert matter.held("flask") == {ACID: share(10_000, 10_200), OTHER: share(0, 200)}


def test_a_draw_that_the_vessel_may_not_hold_takes_nothing_for_certain() -> None:
    matter = RigMatter()
    matter.add("flask", {ACID: share(1_000, 9_000), OTHER: share(0, 200)})
    assert matter.draw("flask", 5_000)[ACID] == share(0, 5_000)


def test_of_layers_a_draw_may_take_one_lot_alone() -> None:
    matter = RigMatter()
    matter.add("tube", {ACID: share(1_000, 1_000), OTHER: share(4_000, 4_000)})
    matter.spin("tube")
    assert matter.draw("tube", 2_000) == {ACID: share(0, 1_000), OTHER: share(1_000, 2_000)}


def test_of_a_solid_that_lies_in_an_uncertain_liquid_all_or_nothing_may_come_along() -> None:
    matter = RigMatter()
    matter.add("flask", {ACID: share(500, 900), SALT: share(40, 40)})
    taken = matter.draw("flask", 500)
    assert taken == {ACID: share(500, 500), SALT: share(0, 40)}
    assert matter.held("flask")[SALT] == share(0, 40)

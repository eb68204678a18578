"""Photographs matched to shots by the index, by the shot id, or by their order."""

from dataclasses import replace

from hypothesis import given
from hypothesis import strategies as st

from procam.estimate.structured_light.photo_match import NUMBER, PhotoObservation, match_photos
from procam.model.plan import Plan, Shot

PLAN = Plan(
    (
        Shot("dark", "", "", "dark", (0.1, 5.0)),
        *(Shot(f"s-{i}", "s", f"{i}.png", "code", (0.1,), detail={NUMBER: i}) for i in range(1, 7)),
    )
)
SLOTS = [(shot.id, e) for shot in PLAN.shots for e in shot.exposures_s]


def photo(name: str, number: int | None = None, **changed: object) -> PhotoObservation:
    return replace(PhotoObservation(name, number, None, None, 0.0, 1.0), **changed)  # type: ignore[arg-type]


def full() -> list[PhotoObservation]:
    return [photo("d0"), photo("d1"), *(photo(f"p{i}", i) for i in range(1, 7))]


def chosen(
    photos: list[PhotoObservation], stored: set[tuple[str, float]] | None = None
) -> dict[str, str]:
    match = match_photos(PLAN, photos, stored or set())
    return {f"{s}@{e:g}": photos[i].name for (s, e), i in match.chosen.items()}


EVERYTHING = {"dark@0.1": "d0", "dark@5": "d1", **{f"s-{i}@0.1": f"p{i}" for i in range(1, 7)}}


class TestMatch:
    def test_all_in_order(self) -> None:
        match = match_photos(PLAN, full(), set())
        assert chosen(full()) == EVERYTHING
        assert match.notes == ["d0, d1: no number is readable; taken as dark by the order"]
        assert match.missing == []

    @given(st.permutations(range(2, 8)))
    def test_numbers_go_before_order(self, order: list[int]) -> None:
        photos = full()
        # the first numbered one must follow the dark ones for their place to be clear
        shuffled = photos[:2] + [photos[i] for i in order]
        found = chosen(shuffled)
        assert {k: v for k, v in found.items() if v in ("p1", "p6")} == {
            "s-1@0.1": "p1",
            "s-6@0.1": "p6",
        }
        if order[0] == 2:
            assert found == EVERYTHING
        else:
            assert "dark@0.1" not in found or found["dark@0.1"] == "d0"

    @given(st.sets(st.integers(0, 7)))
    def test_missing_ones_are_listed_and_nothing_is_invented(self, gone: set[int]) -> None:
        photos = [entry for i, entry in enumerate(full()) if i not in gone]
        match = match_photos(PLAN, photos, set())
        for key, name in chosen(photos).items():
            assert EVERYTHING[key] == name
        assert {s for s, e in match.missing} | {s for s, e in match.chosen} == {
            s.id for s in PLAN.shots
        }

    def test_one_unreadable_number_is_assigned_by_its_place_if_asked(self) -> None:
        photos = full()
        photos[4] = photo("p3")
        match = match_photos(PLAN, photos, set())
        assert match.missing == [("s-3", 0.1)] and "s-3" not in {s for s, _ in match.chosen}
        note = "p3: no number is readable; left out. By their order they show s-3: if you are sure"
        assert any(n.startswith(note) for n in match.notes)
        match = match_photos(PLAN, photos, set(), by_order=True)
        assert {f"{s}@{e:g}": photos[i].name for (s, e), i in match.chosen.items()} == EVERYTHING
        assert "p3: no number is readable; taken as s-3 by the order" in match.notes

    def test_an_ambiguous_place_is_left_out(self) -> None:
        photos = full()
        del photos[4]  # p3 is missing
        photos[4] = photo("p4")  # and p4 unreadable
        match = match_photos(PLAN, photos, set())
        assert ("s-3", 0.1) in match.missing and ("s-4", 0.1) in match.missing
        assert any("p4: no number is readable, and 2 shots fit" in note for note in match.notes)

    def test_a_photograph_too_many_is_left_out(self) -> None:
        photos = full()
        photos.insert(5, photo("cat"))
        match = match_photos(PLAN, photos, set())
        assert chosen(photos) == EVERYTHING
        assert any(note.startswith("cat: no number") and "0 shots" in note for note in match.notes)
        photos[5] = photo("cat", fits=False)
        notes = match_photos(PLAN, photos, set()).notes
        assert "cat: is of another size and shows no number; left out" in notes

    def test_a_number_of_another_plan(self) -> None:
        notes = match_photos(PLAN, [*full(), photo("odd", 99)], set()).notes
        assert "odd: shows number 99, which is not in this plan; left out" in notes

    def test_the_sharpest_that_is_not_clipped_is_kept(self) -> None:
        photos = [
            *full(),
            photo("soft", 3, sharpness=0.5),
            photo("sharp", 3, sharpness=2.0),
            photo("clipped", 3, sharpness=9.0, clipped=0.1),
        ]
        notes = match_photos(PLAN, photos, set()).notes
        assert chosen(photos)["s-3@0.1"] == "sharp"
        assert "soft: shows s-3 too; sharp is kept, it is sharper" in notes
        assert "clipped: shows s-3 too; sharp is kept, it is less clipped" in notes

    def test_the_index_goes_before_the_number(self) -> None:
        photos = [*full(), photo("mine", 5, claimed="s-3", sharpness=0.1)]
        assert chosen(photos)["s-3@0.1"] == "mine"
        assert chosen(photos)["s-5@0.1"] == "p5"
        notes = match_photos(PLAN, photos, set()).notes
        assert "p3: shows s-3, but the index names another for it; left out" in notes

    def test_exposures_sort_photographs_of_one_shot(self) -> None:
        photos = full()
        photos[:2] = [photo("long", exposure_s=4.0), photo("short", exposure_s=0.125)]
        found = chosen(photos)
        assert (found["dark@0.1"], found["dark@5"]) == ("short", "long")

    def test_unknown_exposures(self) -> None:
        photos = [*full(), *(photo(f"x{i}", claimed="dark") for i in range(3))]
        match = match_photos(PLAN, photos, set())
        assert ("dark", 0.1) in match.missing
        assert any(
            "needs exposures of 0.1 s, 5 s, but their own are not known" in note
            for note in match.notes
        )

    def test_what_is_stored_stays(self) -> None:
        stored = set(SLOTS[:5])
        match = match_photos(PLAN, full(), stored)
        assert set(match.chosen) == set(SLOTS[5:])
        assert "p3: s-3 is stored already" in match.notes
        assert match.missing == []

    def test_a_later_roll_of_missing_shots(self) -> None:
        photos = [photo("a"), photo("b")]
        assert chosen(photos, set(SLOTS[2:])) == {"dark@0.1": "a", "dark@5": "b"}
        assert chosen(photos, set(SLOTS[3:])) == {}

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from people_fusion.core.pairing import NearestInTime
from people_fusion.core.stamps import from_seconds

TOLERANCE_S, CAPACITY = 0.02, 4
STAMPS = st.lists(st.integers(0, from_seconds(0.2)), max_size=10)


@given(STAMPS, st.integers(0, from_seconds(0.2)))
def test_the_nearest_of_the_newest_is_taken_if_it_is_near_enough(stamps, wanted):
    pairs = NearestInTime(TOLERANCE_S, CAPACITY)
    for stamp_ns in stamps:
        pairs.put(stamp_ns, stamp_ns)
    near = [stamp for stamp in stamps[-CAPACITY:] if abs(stamp - wanted) <= from_seconds(TOLERANCE_S)]
    found = pairs.at(wanted)
    assert (found is None) == (not near)
    assert found is None or abs(found - wanted) == min(abs(stamp - wanted) for stamp in near)


def test_of_two_that_are_as_near_the_later_is_taken():
    for order in ([90, 110], [110, 90]):
        pairs = NearestInTime(TOLERANCE_S)
        for stamp_ns in order:
            pairs.put(stamp_ns, stamp_ns)
        assert pairs.at(100) == 110


def test_nothing_is_left_of_the_time_before_a_jump():
    pairs = NearestInTime(TOLERANCE_S)
    pairs.put(7, "image")
    pairs.clear()
    assert pairs.at(7) is None

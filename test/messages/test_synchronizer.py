from __future__ import annotations

import random
from itertools import chain

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from rgbd_glue_ros.messages.channel_queue import BACKWARD_JUMP_NS
from rgbd_glue_ros.messages.synchronizer import Channel, Match, Synchronizer

MS = 1_000_000
PERIOD = 33 * MS
Event = tuple[Channel, int]


def synchronized(
    events: list[Event], max_interval_ns: int = 20 * MS, queue_size: int = 1000
) -> tuple[list[Match[int]], Synchronizer[int]]:
    """Plays the events into a synchronizer; each item is its own stamp."""
    sync: Synchronizer[int] = Synchronizer(max_interval_ns, queue_size)
    matches = list(chain.from_iterable(sync.add(c, stamp, stamp) for c, stamp in events))
    return matches + sync.flush(), sync


def matched_in_steps(events: list[Event], queue_size: int) -> list[list[Match[int]]]:
    """The matches that each event completes, as a node gets them."""
    sync: Synchronizer[int] = Synchronizer(20 * MS, queue_size)
    return [sync.add(c, stamp, stamp) for c, stamp in events]


def restarts(matches: list[Match[int]]) -> list[int]:
    """Indices of the matches with which time goes back."""
    return [i for i in range(1, len(matches)) if matches[i].stamp_ns < matches[i - 1].stamp_ns]


def triples(stamps: list[int], depth_offset: int = 0) -> list[Event]:
    return [
        event
        for t in stamps
        for event in (
            (Channel.COLOR, t),
            (Channel.DEPTH, t + depth_offset),
            (Channel.INFO, t),
        )
    ]


def test_equal_stamps_match_as_soon_as_all_three_have_arrived() -> None:
    sync: Synchronizer[str] = Synchronizer(0, 10)
    assert sync.add(Channel.COLOR, 7, "color") == []
    assert sync.add(Channel.INFO, 7, "info") == []
    assert sync.add(Channel.DEPTH, 7, "depth") == [Match(7, 0, "color", "depth", "info")]


@pytest.mark.parametrize("offset", [10 * MS, PERIOD // 2, 20 * MS])
def test_near_stamps_match_without_waiting_for_the_next_image(offset: int) -> None:
    """Once the period is known, nothing is to be expected that is so much nearer as to count."""
    sync: Synchronizer[int] = Synchronizer(20 * MS, 10)
    for channel, stamp in triples([0, PERIOD], depth_offset=offset):
        sync.add(channel, stamp, stamp)
    now = 2 * PERIOD
    sync.add(Channel.INFO, now, now)
    sync.add(Channel.COLOR, now, now)
    (match,) = sync.add(Channel.DEPTH, now + offset, now + offset)
    assert (match.color, match.interval_ns) == (now, offset)


def test_each_image_goes_to_its_nearest_partner_not_to_the_first_within_reach() -> None:
    """The first depth image is lost; a greedy pairing would be one image off for ever."""
    period = 16 * MS
    colors = [i * period for i in range(6)]
    events = triples(colors)
    events.remove((Channel.DEPTH, 0))
    matches, sync = synchronized(events)
    assert [(m.color, m.depth) for m in matches] == [(t, t) for t in colors[1:]]
    assert sync.counts[Channel.COLOR].unmatched == 1


def test_images_too_far_apart_are_dropped_and_counted_and_their_interval_is_reported() -> None:
    matches, sync = synchronized(triples([0, PERIOD, 2 * PERIOD], depth_offset=15 * MS), 10 * MS)
    assert matches == []
    assert sync.closest_miss_ns == 15 * MS
    assert sync.counts[Channel.COLOR].unmatched + sync.counts[Channel.DEPTH].unmatched == 5


@given(st.data())
@settings(max_examples=200, deadline=None)
def test_the_matches_do_not_depend_on_how_the_channels_interleave(data: st.DataObject) -> None:
    gaps = st.lists(st.integers(1, 40 * MS), min_size=1, max_size=12)
    streams = {}
    for channel in Channel:
        steps = data.draw(gaps)
        streams[channel] = [(channel, sum(steps[: i + 1])) for i in range(len(steps))]
    order = data.draw(st.permutations([e for events in streams.values() for e, _ in events]))
    heads = {channel: iter(events) for channel, events in streams.items()}
    interleaved = [next(heads[channel]) for channel in order]
    one_after_the_other = list(chain.from_iterable(streams.values()))
    assert synchronized(interleaved)[0] == synchronized(one_after_the_other)[0]


@given(
    st.lists(st.integers(0, 10**9), min_size=1, max_size=30, unique=True),
    st.lists(st.integers(0, 10**9), min_size=1, max_size=30, unique=True),
    st.integers(0, 10**8),
)
@settings(max_examples=200, deadline=None)
def test_matches_are_one_to_one_in_order_and_within_the_interval(
    colors: list[int], depths: list[int], max_interval: int
) -> None:
    events = [(Channel.COLOR, t) for t in sorted(colors)]
    events += [(Channel.DEPTH, t) for t in sorted(depths)]
    matches, sync = synchronized([(Channel.INFO, 0), *events], max_interval)
    used_colors, used_depths = [m.color for m in matches], [m.depth for m in matches]
    assert used_colors == sorted(set(used_colors))
    assert used_depths == sorted(set(used_depths))
    assert all(abs(m.interval_ns) <= max_interval for m in matches)
    assert sync.matches == len(matches)


@given(st.sets(st.integers(0, 59)), st.sets(st.integers(0, 59)), st.integers(-16, 16))
@settings(max_examples=50, deadline=None)
def test_images_whose_partners_arrive_are_matched_whatever_is_lost(
    lost_colors: set[int], lost_depths: set[int], offset_ms: int
) -> None:
    """Both images of a moment arrive: they match, whatever else was lost."""
    events = [
        (channel, i * PERIOD + offset)
        for i in range(60)
        for channel, offset, lost in (
            (Channel.COLOR, 0, lost_colors),
            (Channel.DEPTH, offset_ms * MS, lost_depths),
            (Channel.INFO, 0, set()),
        )
        if i not in lost
    ]
    matches, _ = synchronized(events, 16 * MS)
    whole = [i * PERIOD for i in range(60) if i not in lost_colors | lost_depths]
    assert [m.color for m in matches] == whole
    assert all(m.interval_ns == offset_ms * MS for m in matches)


def test_a_duplicate_is_dropped_and_counted() -> None:
    events = [event for event in triples([0, PERIOD, 2 * PERIOD]) for _ in range(2)]
    matches, sync = synchronized(events)
    assert len(matches) == 3
    assert sync.counts[Channel.DEPTH].duplicates == 3


def test_every_image_is_in_a_match_a_duplicate_or_left_out() -> None:
    stamps = [i * PERIOD for i in range(20)]
    # one depth image comes twice, two are missing, and some come after the last colour image
    depths = [*stamps[:5], stamps[4], *stamps[7:], 21 * PERIOD, 22 * PERIOD]
    events = [event for event in triples(stamps) if event[0] is not Channel.DEPTH]
    events += [(Channel.DEPTH, stamp) for stamp in depths]
    matches, sync = synchronized(sorted(events, key=lambda event: event[1]))
    assert len(matches) == 18
    for channel in (Channel.COLOR, Channel.DEPTH):
        counts = sync.counts[channel]
        assert counts.left_out == 2
        assert counts.received == len(matches) + counts.duplicates + counts.left_out


def test_a_reordered_image_still_finds_its_partner_until_a_later_one_is_used() -> None:
    events = [
        *triples([0]),
        (Channel.COLOR, 2 * PERIOD),
        (Channel.COLOR, PERIOD),
        (Channel.INFO, PERIOD),
        (Channel.INFO, 2 * PERIOD),
        (Channel.DEPTH, PERIOD),
        (Channel.DEPTH, 2 * PERIOD),
        (Channel.COLOR, PERIOD // 2),
    ]
    matches, sync = synchronized(events)
    assert [m.color for m in matches] == [0, PERIOD, 2 * PERIOD]
    assert sync.counts[Channel.COLOR].late == 1


def test_a_looping_bag_matches_in_every_round_and_reports_one_restart_per_round() -> None:
    once = triples([i * PERIOD for i in range(90)])
    matches, sync = synchronized(once * 3)
    assert len(matches) == 270
    assert restarts(matches) == [90, 180]
    assert {c.backward_jumps for c in sync.counts.values()} == {2}


@pytest.mark.parametrize("glitch", [Channel.COLOR, Channel.DEPTH, Channel.INFO])
def test_one_stamp_from_the_far_future_costs_only_a_few_frames(glitch: Channel) -> None:
    """Were epochs counted per channel, a single wild stamp would stop everything for good."""
    stamps = [i * PERIOD for i in range(30)]
    before, after = triples(stamps[:10]), triples(stamps[10:])
    matches, _ = synchronized([*before, (glitch, 10**18), *after])
    assert len(matches) >= 28
    assert [m.color for m in matches][-1] == stamps[-1]
    assert restarts(matches) == []


def test_stragglers_of_the_old_time_after_a_jump_do_not_stop_the_pairing() -> None:
    old = triples([BACKWARD_JUMP_NS * 4 + i * PERIOD for i in range(5)])
    new = triples([i * PERIOD for i in range(10)])
    straggler = old.pop(old.index((Channel.DEPTH, BACKWARD_JUMP_NS * 4 + 4 * PERIOD)))
    matches, _ = synchronized([*old, new[0], straggler, *new[1:]])
    assert [m.color for m in matches if m.color < BACKWARD_JUMP_NS][-8:] == [
        i * PERIOD for i in range(2, 10)
    ]
    assert len(restarts(matches)) == 1


def test_a_camera_info_sent_only_once_serves_all_images() -> None:
    images = [e for e in triples([i * PERIOD for i in range(1, 41)]) if e[0] is not Channel.INFO]
    matches, _ = synchronized([(Channel.INFO, 0), *images], queue_size=10)
    assert len(matches) == 40
    assert {m.info for m in matches} == {0}


@pytest.mark.parametrize("pause_s", [5, 15, 3600])
@pytest.mark.parametrize("sent_s", [-2.0, 0.0, 0.1])
def test_a_camera_info_sent_once_after_a_pause_serves_the_images_after_it(
    pause_s: int, sent_s: float
) -> None:
    """A driver that restarts may publish other intrinsics, once for each start."""
    before = [i * PERIOD for i in range(90)]
    again = before[-1] + pause_s * 1000 * MS
    after = [again + t for t in before]
    infos = [(Channel.INFO, 0), (Channel.INFO, again + round(sent_s * 1000) * MS)]
    images = [(c, t) for t in [*before, *after] for c in (Channel.COLOR, Channel.DEPTH)]
    events = sorted([*images, *infos], key=lambda event: event[1])
    matches = list(chain.from_iterable(matched_in_steps(events, queue_size=10)))
    assert len(matches) == 180
    assert {m.info for m in matches if m.color in before} == {0}
    # those before it, if any, cannot have waited for it
    late = [m for m in matches if m.color > again + sent_s * 1000 * MS + PERIOD]
    assert {m.info for m in late if m.color in after} == {infos[1][1]}


def test_one_camera_info_with_a_wrong_stamp_is_not_used() -> None:
    images = [(c, i * PERIOD) for i in range(60) for c in (Channel.COLOR, Channel.DEPTH)]
    wrong = (Channel.INFO, 3600 * 1000 * MS)
    events = [(Channel.INFO, 0), *images[:60], wrong, *images[60:]]
    matches = list(chain.from_iterable(matched_in_steps(events, queue_size=10)))
    assert {m.info for m in matches} == {0}


def test_pairs_wait_only_once_for_a_rare_camera_info() -> None:
    sync: Synchronizer[int] = Synchronizer(0, 5)
    sync.add(Channel.INFO, -1, -1)
    arrivals = []
    for i in range(20):
        sync.add(Channel.COLOR, i * PERIOD, i)
        arrivals.append(len(sync.add(Channel.DEPTH, i * PERIOD, i)))
    assert arrivals == [0] * 5 + [6] + [1] * 14


def test_an_image_gets_the_camera_info_with_its_stamp_even_if_that_arrives_last() -> None:
    stamps = [i * PERIOD for i in range(5)]
    events = sorted(triples(stamps), key=lambda e: (e[0] is Channel.INFO, e[1]))
    matches, _ = synchronized(events, queue_size=10)
    assert [m.info for m in matches] == stamps


def test_a_lost_camera_info_is_replaced_by_the_nearest() -> None:
    events = triples([0, 10 * MS, 30 * MS])
    events.remove((Channel.INFO, 10 * MS))
    matches, _ = synchronized(events)
    assert [m.info for m in matches] == [0, 0, 30 * MS]


def test_without_camera_info_nothing_matches_and_memory_stays_bounded() -> None:
    images = [e for e in triples([i * PERIOD for i in range(100)]) if e[0] is not Channel.INFO]
    matches, sync = synchronized(images, queue_size=10)
    assert matches == []
    assert sync.counts[Channel.COLOR].overflowed == 90


def test_without_depth_the_oldest_colour_images_are_dropped_and_counted() -> None:
    matches, sync = synchronized([(Channel.COLOR, i * PERIOD) for i in range(100)], queue_size=10)
    assert matches == []
    assert sync.counts[Channel.COLOR].overflowed == 90


def interleaved(streams: dict[Channel, list[int]], data: st.DataObject) -> list[Event]:
    """The streams in one, none of them ahead of another by a whole frame."""
    left = {channel: list(stamps) for channel, stamps in streams.items()}
    events = []
    while any(left.values()):
        longest = max(map(len, left.values()))
        channel = data.draw(st.sampled_from([c for c in Channel if len(left[c]) == longest]))
        events.append((channel, left[channel].pop(0)))
    return events


def matched_at_once(events: list[Event]) -> list[Match[int]]:
    """The matches without those that only the end of the stream gives."""
    sync: Synchronizer[int] = Synchronizer(20 * MS, 10)
    return [match for channel, stamp in events for match in sync.add(channel, stamp, stamp)]


@pytest.mark.parametrize("wrong_ns", [0, 2**31 * 10**9])
@given(data=st.data())
def test_wrong_stamps_of_one_frame_cost_no_other_frame_however_the_channels_interleave(
    wrong_ns: int, data: st.DataObject
) -> None:
    good = [1_700_000_000 * 10**9 + i * PERIOD for i in range(6)]
    wrong = data.draw(st.sets(st.sampled_from(Channel), min_size=1))
    streams = {c: [*good[:3], *([wrong_ns] if c in wrong else []), *good[3:]] for c in Channel}
    matches = matched_at_once(interleaved(streams, data))
    assert [(m.color, m.depth) for m in matches] == [(t, t) for t in good]
    # infos of neighbours are as good
    assert all(abs(m.info - m.color) <= PERIOD for m in matches)


@pytest.mark.parametrize("ahead_s", [0.6, 2.0, 9.9])
@given(data=st.data())
def test_a_frame_whose_stamp_is_ahead_by_seconds_costs_no_other_frame(
    ahead_s: float, data: st.DataObject
) -> None:
    good = [i * PERIOD for i in range(1, 16)]
    wrong = data.draw(st.sets(st.sampled_from(Channel), min_size=1))
    ahead = good[10] + round(ahead_s * 1000) * MS
    streams = {c: [*good[:11], *([ahead] if c in wrong else []), *good[11:]] for c in Channel}
    matches = matched_at_once(interleaved(streams, data))
    assert [(m.color, m.depth) for m in matches] == [(t, t) for t in good]
    assert all(abs(m.info - m.color) <= PERIOD for m in matches)


PAUSES_S = [0.6, 3.0, 9.0, 3600.0]


def with_pause(pause_s: float) -> list[int]:
    """The stamps of eleven frames, and of as many after a pause."""
    before = [i * PERIOD for i in range(1, 12)]
    return [*before, *(before[-1] + round(pause_s * 1000) * MS + t for t in before)]


@pytest.mark.parametrize("pause_s", PAUSES_S)
def test_a_pause_delays_its_first_frame_by_a_period(pause_s: float) -> None:
    stamps = with_pause(pause_s)
    steps = matched_in_steps(triples(stamps), queue_size=10)
    arrived = [len(list(chain.from_iterable(steps[: 3 * i]))) for i in range(1, len(stamps) + 1)]
    assert arrived == [*range(1, 12), 11, *range(13, 23)]


@pytest.mark.parametrize("pause_s", PAUSES_S)
@given(data=st.data())
def test_a_pause_costs_no_frame_however_the_channels_interleave(
    pause_s: float, data: st.DataObject
) -> None:
    stamps = with_pause(pause_s)
    matches = matched_at_once(interleaved(dict.fromkeys(Channel, stamps), data))
    assert [(m.color, m.depth) for m in matches] == [(t, t) for t in stamps]


@pytest.mark.parametrize("period_s", [0.4, 1.0, 2.0])
def test_a_slow_camera_is_not_delayed_even_if_images_are_lost(period_s: float) -> None:
    stamps = [round(i * period_s * 1000) * MS for i in range(20) if i not in (10, 12, 13)]
    steps = matched_in_steps(triples(stamps), queue_size=10)
    assert [len(step) for step in steps] == [0, 0, 1] * len(stamps)


@pytest.mark.parametrize("jump_ns", [-(10**18), -20 * PERIOD, 20 * PERIOD, 10**18])
@given(data=st.data())
def test_a_jump_in_time_costs_no_frame_however_the_channels_interleave(
    jump_ns: int, data: st.DataObject
) -> None:
    before = [2 * 10**18 + i * PERIOD for i in range(4)]
    stamps = [*before, *(t + jump_ns for t in before)]
    matches = matched_at_once(interleaved(dict.fromkeys(Channel, stamps), data))
    assert [(m.color, m.depth) for m in matches] == [(t, t) for t in stamps]
    assert restarts(matches) == ([4] if jump_ns < 0 else [])


@given(st.sets(st.integers(12, 60), max_size=3), st.integers(0, 2**32 - 1))
@example({46, 47, 48}, 2746)
def test_messages_that_never_arrived_are_counted_from_gaps_in_the_stamps(
    lost: set[int], seed: int
) -> None:
    jitter = random.Random(seed)
    stamps = [i * PERIOD + jitter.randint(-4 * MS, 4 * MS) for i in range(64) if i not in lost]
    _, sync = synchronized(triples(stamps))
    assert sync.counts[Channel.COLOR].missing == len(lost)


def test_a_message_out_of_order_is_not_missing_and_a_pause_of_the_camera_is_not_a_loss() -> None:
    stamps = [i * PERIOD for i in range(20)]
    stamps[12], stamps[13] = stamps[13], stamps[12]
    later = [stamps[-1] + 10_000 * MS + i * PERIOD for i in range(5)]
    _, sync = synchronized(triples([*stamps, *later]))
    assert sync.counts[Channel.DEPTH].missing == 0


def test_the_usual_interval_and_period_are_those_of_the_stamps() -> None:
    _, sync = synchronized(triples([i * PERIOD for i in range(20)], depth_offset=7 * MS))
    assert (sync.interval_ns, sync.period_ns) == (7 * MS, PERIOD)


@pytest.mark.parametrize(
    ("frames_late", "offset_ns", "needed"),
    [(0, 0, 0), (5, 0, 0), (15, 0, 21), (15, 3 * MS, 21), (15, 10**13, 0), (0, -50 * MS, 0)],
)
def test_depth_that_comes_late_with_the_right_stamps_needs_a_longer_queue(
    frames_late: int, offset_ns: int, needed: int
) -> None:
    """Late by more frames than wait; clocks that differ, or stamps that do, need no queue."""
    events: list[Event] = []
    for i in range(60):
        events.append((Channel.COLOR, i * PERIOD))
        events.append((Channel.INFO, i * PERIOD))
        if i >= frames_late:
            events.append((Channel.DEPTH, (i - frames_late) * PERIOD + offset_ns))
    matches, sync = synchronized(events, queue_size=10)
    assert sync.queue_needed == needed
    assert len(matches) < 25 or not needed
    if needed:
        assert len(synchronized(events, queue_size=needed)[0]) == 60 - frames_late


def test_misses_are_forgotten_when_they_no_longer_matter() -> None:
    late = [(Channel.COLOR, i * PERIOD) for i in range(30)]
    late += [(Channel.DEPTH, i * PERIOD) for i in range(15)]
    _, sync = synchronized(late, queue_size=10)
    assert sync.queue_needed > 10
    assert sync.closest_miss_ns
    sync.forget_misses()
    assert (sync.queue_needed, sync.closest_miss_ns or 0) == (0, 0)
    # and are counted anew
    for stamp in range(30):
        sync.add(Channel.COLOR, 10**12 + stamp * PERIOD, 0)
    for stamp in range(15):
        sync.add(Channel.DEPTH, 10**12 + stamp * PERIOD, 0)
    assert sync.queue_needed > 10


def test_a_restarting_bag_needs_no_longer_queue() -> None:
    once = [(c, i * PERIOD) for i in range(300) for c in Channel]
    matches, sync = synchronized([*once, *once, *once], queue_size=10)
    assert len(matches) == 900
    assert sync.queue_needed == 0

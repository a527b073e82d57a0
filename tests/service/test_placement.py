"""When the next keyframe is due, and from where."""

from __future__ import annotations

import math

import msgspec
import pytest

from service_parts import CAMERA
from torchrender.wire.messages import CREDITS, Ack, CameraHeader, Pose
from torchrender_service.streams.placement import SPARE_S, STALE_S, Placement, Shown
from torchrender_service.streams.prediction import angle, distance, overscanned, predicted, same_view


def moved(x: float = 0.0, turn: float = 0.0) -> CameraHeader:
    c, s = math.cos(turn), math.sin(turn)
    matrix = (c, 0.0, s, x, 0.0, 1.0, 0.0, 0.0, -s, 0.0, c, 0.0, 0.0, 0.0, 0.0, 1.0)
    return msgspec.structs.replace(CAMERA, world_from_camera=matrix)


def pose(seq: int = 1, camera: CameraHeader = CAMERA, **rest) -> Pose:
    return Pose(seq=seq, time_ms=0.0, camera=camera, **rest)


def shown(view: CameraHeader = CAMERA, still: bool = False, depth: float = 2.0) -> Shown:
    return Shown(view, 1.2, depth, still)


def started(still: bool = False) -> Placement:
    """A client that stands at CAMERA since time 0 and has seen one keyframe."""
    place = Placement(0.5, 0.0)
    place.take_pose(pose(moving=False), 0.0)
    place.begin(0, 0.0, timed=True)
    place.done(0, shown(still=still))
    place.take_ack(Ack(id=0), 0.1)
    return place


def test_the_first_keyframe_waits_for_a_pose():
    place = Placement(0.5, 0.0)
    assert place.due(0.0) is None
    place.take_pose(pose(), 0.0)
    assert place.due(0.0) == "moving"


def test_a_view_at_rest_is_refined_and_smoothed_once():
    place = started()
    assert place.due(0.4) is None
    assert place.due(0.51) == "still"
    place.begin(1, 0.51, timed=False)
    place.done(1, shown(still=True))
    assert place.due(0.6) == "smooth"
    place.smoothed()
    assert place.due(5.0) is None
    place.take_pose(pose(2, moving=True), 5.1)  # the same view, whatever the client calls it
    assert place.due(9.0) is None


def test_a_client_that_is_seldom_heard_has_not_stopped_between_two_poses():
    """As over a slow link, or in a page that its browser gives one turn a second."""
    place = started(still=True)
    for second in range(1, 5):
        place.take_pose(pose(second + 1, moved(0.001 * second)), float(second))
        rest = 0.6 if second == 1 else 0.99  # the second pose tells how often they come
        assert place.due(second + rest) == ("still" if second == 1 else None)
    assert place.due(5.2) is None
    assert place.due(5.6) == "still"  # silent for longer than between the others
    place.take_pose(pose(9, moved(0.01)), 6.0)
    place.take_pose(pose(10, moved(0.01), moving=False), 6.1)  # it says that it stands: no more waiting than usual
    assert place.due(6.51) == "still"
    place.take_pose(pose(11, moved(0.011)), 100.0)
    place.take_pose(pose(12, moved(0.012)), 160.0)  # nobody waits for a minute
    assert place.due(162.9) is None and place.due(163.1) == "still"


def test_moving_far_enough_asks_for_a_keyframe():
    place = started(still=True)
    place.take_pose(pose(2, moved(0.02)), 1.0)
    assert place.due(1.0) is None
    place.take_pose(pose(3, moved(0.05)), 1.0)
    assert place.due(1.0) == "moving"
    place = started(still=True)
    place.take_pose(pose(2, moved(turn=0.06)), 1.0)
    assert place.due(1.0) == "moving"


@pytest.mark.parametrize("change", [{"fx": 1.02}, {"fx": 0.98}, {"width": 1.25}, {"height": 1.25}])
def test_another_lens_or_size_asks_for_a_keyframe(change: dict[str, float]) -> None:
    name, factor = next(iter(change.items()))
    value = getattr(CAMERA, name)
    place = started(still=True)
    place.take_pose(pose(2, msgspec.structs.replace(CAMERA, **{name: type(value)(factor * value)})), 1.0)
    assert place.due(1.0) == "moving"
    place.take_pose(pose(3, msgspec.structs.replace(CAMERA, fx=1.001 * CAMERA.fx)), 1.0)
    assert place.due(1.0) is None, "as little as rounding does"


def test_holes_ask_for_a_keyframe_while_the_view_moves():
    place = started(still=True)
    place.begin(1, 1.0, timed=True)
    place.done(1, shown())
    place.take_ack(Ack(id=1, holes=0.05), 1.1)
    assert place.due(1.1) == "still"
    place.take_pose(pose(2, moved(0.01)), 1.2)
    assert place.due(1.2) == "moving"


def test_a_view_at_rest_previews_a_changed_scene_and_shows_it_before_the_one_at_rest_is_begun():
    place = started(still=True)
    place.refresh(scene=True)
    assert place.due(1.0) == "preview"
    place.begin(1, 1.0, timed=False)
    place.done(1, Shown(CAMERA, 1.0, 2.0, still=False, preview=True))
    assert place.due(1.1) is None, "a page on this machine has not shown it"
    place.refresh(scene=True)
    assert place.due(1.2) == "preview", "what changes again does not wait"
    place.begin(2, 1.2, timed=False)
    place.done(2, Shown(CAMERA, 1.0, 2.0, still=False, preview=True))
    place.take_ack(Ack(id=1), 1.3)
    place.take_ack(Ack(id=2), 1.3)
    assert place.latency_s == pytest.approx(0.1), "the next one takes as long as one of a moving view did"
    assert place.due(1.3) is None, "what changes all the time is not refined in between"
    assert place.patience(1.3, 9.0) == pytest.approx(0.4)
    assert place.due(1.71) == "still", "half a second after the last change was begun"


def test_what_is_not_a_change_of_the_scene_or_moves_has_no_preview():
    place = started(still=True)
    place.refresh()
    assert place.due(1.0) == "moving", "settings"
    place.refresh(scene=True)
    place.take_pose(pose(2, moved(0.01), velocity=(1.0, 0.0, 0.0), moving=True), 1.0)
    assert place.due(1.0) == "moving"


def test_no_keyframe_without_a_credit():
    place = started()
    for number in range(1, 1 + CREDITS):
        place.refresh()
        assert place.due(1.0) == "moving"
        place.begin(number, 1.0, timed=True)
    place.refresh()
    assert place.due(1.0) is None
    place.take_ack(Ack(id=99), 1.0)
    assert place.due(1.0) is None
    place.take_ack(Ack(id=1), 1.0)
    assert place.due(1.0) == "moving"


def test_a_resync_gives_all_credits_back_and_wants_one_fresh_keyframe():
    place = started(still=True)
    place.begin(1, 1.0, timed=True)
    place.begin(2, 1.0, timed=True)
    place.resync()
    assert place.due(1.0) == "moving"
    assert not place.done(2, shown())
    place.begin(3, 1.0, timed=True)
    place.done(3, shown(still=True))
    assert place.due(1.0) == "smooth"


def test_what_failed_gives_its_credit_back_and_is_wanted_again():
    place = started(still=True)
    for number in range(1, 1 + CREDITS):
        place.begin(number, 1.0, timed=True)
        place.done(number, shown(still=True))
    assert place.due(1.0) is None
    place.failed(1)
    assert place.due(1.0) == "moving"
    place.begin(9, 1.0, timed=True)
    assert place.due(1.0) is None, "the one credit is taken again"


def test_only_the_newest_pose_counts():
    place = started()
    place.take_pose(pose(7, moved(1.0)), 1.0)
    place.take_pose(pose(6, moved(2.0)), 1.0)
    assert place.pose is not None and place.pose.seq == 7


def test_the_camera_is_led_by_velocity_times_round_trip():
    place = Placement(0.5, 0.0)
    going = pose(velocity=(1.0, 0.0, 0.0))
    place.take_pose(going, 0.0)
    place.begin(0, 0.0, timed=True)
    assert place.take_ack(Ack(id=0), 0.2) == pytest.approx(0.2)
    place.take_pose(going, 1.0)
    assert place.view(going, 1.0).world_from_camera[3] == pytest.approx(0.2)
    assert place.view(going, 1.05).world_from_camera[3] == pytest.approx(0.25)
    assert place.view(going, 1.0 + STALE_S + 0.01) == CAMERA  # who no longer speaks no longer moves
    resting = pose(2, velocity=(1.0, 0.0, 0.0), moving=False)
    assert predicted(resting, 0.3) == CAMERA


def test_one_slow_round_trip_does_not_lead_the_camera_astray():
    """The first picture of a scene may take long: kernels are compiled, maps are drawn."""
    place = Placement(0.5, 0.0)
    place.take_pose(pose(velocity=(1.0, 0.0, 0.0)), 0.0)
    now = 0.0
    for number, (trip, latency) in enumerate([(25.0, 25.0), (0.1, 0.1), (0.3, 0.3), (0.2, 0.2)]):
        place.begin(number, now, timed=True)
        now += trip
        place.take_ack(Ack(id=number), now)
        assert place.latency_s == pytest.approx(latency)
    assert Placement(0.5, 0.2).latency_s == 0.2


def test_round_trips_unlike_the_next_one_do_not_count() -> None:
    """A refined view takes as long as it takes: it is at rest."""
    place = Placement(0.5, 0.0)
    for number, (timed, trip) in enumerate([(True, 0.1), (False, 9.0), (False, 9.0)]):
        place.begin(number, 0.0, timed=timed)
        assert place.take_ack(Ack(id=number), trip) == pytest.approx(trip)
    assert place.latency_s == pytest.approx(0.1)


def test_a_view_that_moves_gets_keyframes_that_it_could_do_without_where_there_is_time() -> None:
    place = started()
    right = {"velocity": (0.01, 0.0, 0.0), "moving": True}
    place.take_pose(pose(2, moved(x=0.001), **right), 0.2)
    assert place.due(0.2) is None, "too little to be seen"
    place.take_pose(pose(3, moved(x=0.01), **right), 0.3)
    assert place.due(0.3) == "spare"
    place.begin(1, 0.3, timed=True)
    assert place.due(0.35) is None, "one is on its way"
    place.done(1, shown(moved(x=0.01)))
    place.take_ack(Ack(id=1), 0.32)
    place.take_pose(pose(4, moved(x=0.02), **right), 0.34)
    assert place.due(0.34) is None and place.patience(0.34, 1.0) == pytest.approx(0.3 + SPARE_S - 0.34)
    assert place.due(0.3 + SPARE_S) == "spare"
    place.take_pose(pose(5, moved(x=0.2), **right), 0.35)
    assert place.due(0.35) == "moving", "now the samples run out"
    place.take_pose(pose(6, moved(x=0.02)), 0.4)
    assert place.due(0.41) is None, "what does not move on needs none"


@pytest.mark.parametrize(("answer", "kind"), [(0.05, "spare"), (0.3, None)])
def test_the_next_keyframe_is_begun_while_a_client_takes_one_that_takes_it_sooner_than_it_is_made(answer, kind) -> None:
    place, now = started(), 1.0
    for number in range(1, 4):
        place.begin(number, now, timed=True).sent = now + 0.1
        place.take_ack(Ack(id=number), now + 0.1 + answer)
        now += 1.0
    right = {"velocity": (0.001, 0.0, 0.0), "moving": True}
    place.take_pose(pose(2, moved(x=0.01), **right), now)
    assert place.due(now) == "spare"
    place.begin(9, now, timed=True).sent = now + 0.1
    place.done(9, shown(moved(x=0.01)))
    place.take_pose(pose(3, moved(x=0.02), **right), now + 0.11)
    assert place.due(now + 0.11) == kind


def test_a_silent_client_does_not_cause_keyframes_for_ever():
    place = started()
    going = pose(2, velocity=(5.0, 0.0, 0.0))
    place.take_pose(going, 1.0)
    made, now = [], 1.0
    while now < 10.0:
        kind = place.due(now)
        if kind == "smooth":
            place.smoothed()
            made.append(kind)
        elif kind is not None:
            view = CAMERA if kind == "still" else place.view(going, now)
            place.begin(len(made) + 1, now, timed=True)
            place.done(len(made) + 1, shown(view, kind == "still"))
            place.take_ack(Ack(id=len(made) + 1), now)
            made.append(kind)
        now += 0.01
    assert made[-2:] == ["still", "smooth"]
    assert made.count("still") == 1


def test_prediction_turns_about_the_cameras_axes():
    turning = pose(spin=(0.0, 0.5, 0.0))
    ahead = predicted(turning, 0.2)
    assert angle(CAMERA, ahead) == pytest.approx(0.1)
    assert distance(CAMERA, ahead) == 0.0
    assert same_view(predicted(turning, 100.0), predicted(turning, 1.0))  # no further than a second


def test_overscan_keeps_the_view_in_the_middle():
    wide = overscanned(CAMERA, 1.25, 10**6)
    assert (wide.width, wide.height, wide.fx) == (80, 60, 50.0)
    assert (wide.cx - CAMERA.cx, wide.cy - CAMERA.cy) == (8.0, 6.0)
    tight = overscanned(CAMERA, 1.5, 64 * 48)
    assert (tight.width, tight.height) == (64, 48)
    coarse = overscanned(CAMERA, 1.2, 1000)
    assert coarse.width * coarse.height <= 1000
    assert coarse.fx / coarse.width == pytest.approx(50 / 64)


@pytest.mark.parametrize("size", [(32768, 1), (1, 32768), (32760, 3)])
def test_overscan_keeps_within_the_largest_side_of_a_message(size: tuple[int, int]) -> None:
    camera = msgspec.structs.replace(CAMERA, width=size[0], height=size[1])
    wide = overscanned(camera, 1.5, 2**21)
    again = msgspec.msgpack.decode(msgspec.msgpack.encode(wide), type=CameraHeader)
    assert again == wide and max(wide.width, wide.height) <= 32768
